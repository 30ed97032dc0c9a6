"""The parameters of a navigator, with move_base's names where it has them."""

from dataclasses import dataclass, field

from midnet_bench.navigation.costmap_settings import CostmapSettings, burger_global, burger_local
from midnet_bench.navigation.dwa import DwaSettings
from midnet_bench.navigation.footprint import BURGER, Footprint
from midnet_bench.navigation.trajectory_rollout import TrajectoryRolloutSettings


@dataclass(frozen=True)
class NavigatorSettings:
    """Defaults: turtlebot3_navigation's files for the Burger."""

    local_costmap: CostmapSettings = field(default_factory=burger_local)
    global_costmap: CostmapSettings = field(default_factory=burger_global)
    local_planner: DwaSettings | TrajectoryRolloutSettings = field(default_factory=DwaSettings)
    bare_footprint: Footprint = BURGER
    """the robot's outline without padding: what a robot that is stuck may still move with"""
    allow_unknown: bool = True
    """plans may cross cells that nobody has seen"""
    goal_tolerance_m: float = 0.5
    """a goal that a scanned obstacle covers (another robot that passes) is approached up to this far; navfn's
    default_tolerance, 0 in TurtleBot3's files, where such a goal is not approached at all"""
    controller_frequency_hz: float = 10.0
    planner_frequency_hz: float = 5.0
    planner_patience_s: float = 5.0
    controller_patience_s: float = 15.0
    oscillation_timeout_s: float = 10.0
    oscillation_distance_m: float = 0.2
    conservative_reset_dist_m: float = 3.0
    aggressive_reset_dist_m: float = 1.84
    """four times move_base's own circumscribed radius (0.46 m)"""
    wave_period_s: float = 1.0
    """no new potential sooner than this after the last one for the same goal"""
    change_radius_m: float = 0.3
    """obstacles that come or go this near to the plan ahead call for a new potential"""
