"""The TurtleBot3 Waffle with its LDS-01; the Waffle Pi has the same measures here, but for its camera.

From turtlebot3_description's turtlebot3_waffle.urdf.xacro and .gazebo.xacro, and turtlebot3_navigation's
costmap_common_params_waffle.yaml and dwa_local_planner_params_waffle.yaml.
"""

from dataclasses import replace

from midnet_bench.geometry import Pose2D
from midnet_bench.robots.burger import LDS_01
from midnet_bench.robots.model import Disc, RobotModel

_HALF_BODY = (
    (0.069, 0.133),
    (0.033, 0.133),
    (0.033, 0.153),
    (-0.033, 0.153),
    (-0.033, 0.133),
    (-0.197, 0.133),
)

WAFFLE = RobotModel(
    name="TurtleBot3 Waffle",
    # the base, a square of 0.266 m about 64 mm behind the axle, and the wheels, 18 mm wide, at 144 mm
    body=_HALF_BODY + tuple((x, -y) for x, y in reversed(_HALF_BODY)),
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
