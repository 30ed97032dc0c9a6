"""The TurtleBot3 Burger: its measures, its LiDAR and its description."""

import math
from pathlib import Path

from midnet_bench.geometry import Pose2D
from midnet_bench.messages import LidarGeometry

URDF = Path(__file__).parent / "burger.urdf"

WHEEL_RADIUS_M = 0.033
WHEEL_SEPARATION_M = 0.160
MAX_LINEAR_MPS = 0.22
MAX_ANGULAR_RADPS = 2.84
RIM_ACCELERATION_MPS2 = 1.0
"""How fast the Gazebo plugin lets the speed of a wheel's rim change (its wheelAcceleration)."""
WHEEL_TORQUE_NM = 10.0
BASE_LINK_HEIGHT_M = 0.010

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
