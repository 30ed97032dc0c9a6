"""``LidarModel``: what a LiDAR can do, by its maker's data sheet; those that have names, on any robot."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from midnet_bench.geometry import LidarGeometry, Pose2D


class LidarModel(NamedTuple):
    """A planar LiDAR as its data sheet has it; all beams of a scan leave at one instant."""

    beams: int
    angle_min_rad: float
    angle_increment_rad: float
    range_min_m: float
    range_max_m: float
    rate_hz: float  # scans a second
    source: str

    def at(self, mount: Pose2D) -> LidarGeometry:
        """The same on a robot; ``mount``: the sensor in the robot's base frame."""
        return LidarGeometry(*self[:5], mount=mount)


def _all_round(beams: int, range_min_m: float, range_max_m: float, rate_hz: float, source: str) -> LidarModel:
    return LidarModel(beams, 0.0, 2.0 * math.pi / beams, range_min_m, range_max_m, rate_hz, source)


LD19 = _all_round(
    455,
    *(0.02, 12.0, 10.0),
    "LDROBOT, LD19 development manual: 0.02 to 12 m, 10 Hz, 4500 readings a second; 455 beams as the ROS "
    "driver ldlidar_stl_ros publishes",
)
LIDARS: Mapping[str, LidarModel] = {
    "lds_01": _all_round(
        360, 0.12, 3.5, 5.0, "ROBOTIS, LDS-01 specifications: 0.12 to 3.5 m, 1 degree, 300 rpm"
    ),
    "rplidar_a1": _all_round(
        360,
        *(0.15, 12.0, 5.5),
        "Slamtec, RPLIDAR A1 data sheet LD108, model A1M8, figure 2-1: 0.15 to 12 m, 5.5 Hz at 360 samples "
        "a scan",
    ),
    "ld06": LD19._replace(
        source="LDROBOT, LD06 data sheet: 0.02 to 12 m, 4500 readings a second, 10 Hz; beams as of the LD19"
    ),
    "ld19": LD19,
    "urg_04lx": LidarModel(
        682,
        *(-340 * 2.0 * math.pi / 1024, 2.0 * math.pi / 1024),
        *(0.06, 4.095, 10.0),
        "Hokuyo, URG-04LX specifications: 60 to 4095 mm, 100 ms a scan; SCIP 2.0 protocol, table 2: steps "
        "44 to 725 of 1024 a turn, 384 ahead",
    ),
    "utm_30lx": LidarModel(
        1081,
        *(-540 * 2.0 * math.pi / 1440, 2.0 * math.pi / 1440),
        *(0.1, 30.0, 40.0),
        "Hokuyo, UTM-30LX specifications: 0.1 to 30 m, 25 ms a scan; SCIP 2.0 protocol, table 2: steps 0 to "
        "1080 of 1440 a turn, 540 ahead",
    ),
    "tim571": LidarModel(
        811,
        *(-405 * math.pi / 540, math.pi / 540),
        *(0.05, 25.0, 15.0),
        "SICK, TiM571-2050101 data sheet: 0.05 to 25 m, 270 degrees in steps of 0.33, 15 Hz",
    ),
}
"""by the name that ``--robot-model "burger(lidar=NAME)"`` takes"""
