"""The TurtleBot3 Burger with its LDS-01."""

import math
from pathlib import Path

from midnet_bench.geometry import LidarGeometry, Pose2D
from midnet_bench.robots.model import Disc, RobotModel

LDS_01 = LidarGeometry(
    beams=360,
    angle_min_rad=0.0,
    angle_increment_rad=2.0 * math.pi / 360,
    range_min_m=0.12,
    range_max_m=3.5,
    mount=Pose2D(-0.032, 0.0, 0.0),
)
"""The LDS-01 on a Burger: 360 beams one degree apart, 0.12 to 3.5 m, 32 mm behind the axle.

The spacing is the driver's 2 pi / 360; Gazebo's last beam repeats its first.
"""

_HALF_BODY = (
    (0.038, 0.070),
    (0.030, 0.070),
    (0.030, 0.089),
    (-0.030, 0.089),
    (-0.030, 0.070),
    (-0.102, 0.070),
)

BURGER = RobotModel(
    name="TurtleBot3 Burger",
    # the base, and beside it what the wheels' width would touch
    body=_HALF_BODY + tuple((x, -y) for x, y in reversed(_HALF_BODY)),
    # footprint of turtlebot3_navigation's costmap_common_params_burger.yaml, release 0.2.1
    footprint=((-0.110, -0.090), (-0.110, 0.090), (0.041, 0.090), (0.041, -0.090)),
    size_m=(0.138, 0.178),
    radius_m=0.105,
    wheel_radius_m=0.033,
    wheel_separation_m=0.160,
    max_linear_mps=0.22,
    max_angular_radps=2.84,
    mass_kg=1.002,
    gyration_radius_m=0.0512,
    lidar=LDS_01,
    lidar_height_m=0.182,
    # the LDS-01's housing (item 28)
    seen=Disc(0.055, -0.017),
    urdf=Path(__file__).parent / "burger.urdf",
    base_link_height_m=0.010,
)
