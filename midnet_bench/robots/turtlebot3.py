"""The TurtleBot3 Burger and Waffle, each with its LDS-01.

The Waffle's measures are from turtlebot3_description's turtlebot3_waffle.urdf.xacro and .gazebo.xacro, and
turtlebot3_navigation's costmap_common_params_waffle.yaml and dwa_local_planner_params_waffle.yaml; the Waffle
Pi has the same here, but for its camera.
"""

from dataclasses import replace
from pathlib import Path

from midnet_bench.geometry import Point, Pose2D
from midnet_bench.robots.lidars import LIDARS
from midnet_bench.robots.model import Disc, Outline, RobotModel

LDS_01 = LIDARS["lds_01"].at(Pose2D(-0.032, 0.0, 0.0))
"""The LDS-01 on a Burger: 360 beams one degree apart, 0.12 to 3.5 m, 32 mm behind the axle.

The spacing is the driver's 2 pi / 360; Gazebo's last beam repeats its first.
"""


def _mirrored(*left: Point) -> Outline:
    """The outline of a body by the corners of its left side, from front to rear, metres."""
    return left + tuple((x, -y) for x, y in reversed(left))


BURGER = RobotModel(
    name="TurtleBot3 Burger",
    # the base, and beside it what the wheels' width would touch
    body=_mirrored(
        *((0.038, 0.070), (0.030, 0.070), (0.030, 0.089)),
        *((-0.030, 0.089), (-0.030, 0.070), (-0.102, 0.070)),
    ),
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

WAFFLE = RobotModel(
    name="TurtleBot3 Waffle",
    # the base, a square of 0.266 m about 64 mm behind the axle, and the wheels, 18 mm wide, at 144 mm
    body=_mirrored(
        *((0.069, 0.133), (0.033, 0.133), (0.033, 0.153)),
        *((-0.033, 0.153), (-0.033, 0.133), (-0.197, 0.133)),
    ),
    footprint=((-0.205, -0.155), (-0.205, 0.155), (0.077, 0.155), (0.077, -0.155)),
    size_m=(0.281, 0.306),
    radius_m=0.17,
    wheel_radius_m=0.033,
    wheel_separation_m=0.287,
    max_linear_mps=0.26,
    max_angular_radps=1.82,
    # base 1.373, wheels 0.028 each, casters 0.005 each, LDS-01 0.114 kg, and how they lie about the axle
    mass_kg=1.554,
    gyration_radius_m=0.1033,
    lidar=replace(LDS_01, mount=Pose2D(-0.064, 0.0, 0.0)),
    lidar_height_m=0.132,
    # the LDS-01's housing; base and camera end below its plane
    seen=Disc(0.055, -0.049),
)


def is_burger_but_for_lidar(robot: RobotModel) -> bool:
    """Whether a robot drives as the Burger does, for which TurtleBot3's files have the numbers."""
    return replace(robot, lidar=BURGER.lidar, lidar_hz=BURGER.lidar_hz) == BURGER
