"""What can be set of costmaps, planners and navigator; nothing here needs a compiler."""

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from midnet_bench.errors import InputError
from midnet_bench.geometry import LidarGeometry, lengths
from midnet_bench.robots.model import Outline, RobotModel
from midnet_bench.robots.turtlebot3 import BURGER, LDS_01
from midnet_bench.settings import Settings, fixed, group, option

Footprint = Outline  # the corners of a convex polygon in order, (x, y) in the base frame, metres


def padded(footprint: Footprint, padding_m: float) -> Footprint:
    """Each coordinate moved away from zero by ``padding_m``; a zero stays (costmap_2d's rule)."""
    corners = [
        [value + math.copysign(padding_m, value) if value else value for value in c] for c in footprint
    ]
    return tuple((x, y) for x, y in corners)


COSTMAP_PADDING_M = 0.01  # of a footprint, costmap_2d's own
BURGER_PADDED = padded(BURGER.footprint, COSTMAP_PADDING_M)


def radii(footprint: Footprint) -> tuple[float, float]:
    """(inscribed, circumscribed) radius about the base frame's origin, metres."""
    corners = np.asarray(footprint, dtype=np.float64)
    edges = np.roll(corners, -1, axis=0) - corners
    along = np.clip(-(corners * edges).sum(axis=1) / (edges * edges).sum(axis=1), 0.0, 1.0)
    nearest = corners + along[:, None] * edges
    return float(lengths(nearest).min()), float(lengths(corners).max())


MAX_RANGE_M = 100.0  # of what a costmap takes from a LiDAR
LDS_WINDOW_M = 3.5  # turtlebot3: local_costmap_params.yaml, width
MAX_INFLATION_CELLS = 100  # what the compiled inflation can count in 16 bits


@dataclass(frozen=True)
class CostmapSettings(Settings):
    """One costmap; the defaults are those of costmap_2d where it has any.

    ``inscribed_radius_m`` is the Burger's robot_radius of 0.105 m as it stands. costmap_2d would pad a robot
    of that radius by 0.01 m: its circle of 16 corners then has an inscribed radius of 0.1127 m.

    MIDNet's local costmaps take window and ranges from TurtleBot3's files instead (items 6 and 7).
    ``BURGER_COSTMAP`` is what a TurtleBot3 navigates with.
    """

    resolution: float = fixed(0.05, "package: costmap_2d, resolution")
    size_m: float = option(
        5.0,
        "Side of the square window around the robot; a costmap over a map has the map's size. Another LiDAR "
        "than the LDS-01: twice its range unless set.",
        ge=1,
        le=250,
        key="local_size_m",
        source="ours: holds the whole obstacle range; costmap_2d's 10 m would cost time",
    )
    centered: bool = fixed(True, "paper: IV.B.1, the robot is always in the middle of the window")
    obstacle_range_m: float = option(
        2.5,
        "Returns nearer than this mark obstacles; for MIDNet that is the usable range. Another LiDAR than "
        "the LDS-01: its range unless set.",
        gt=0,
        le=MAX_RANGE_M,
        source="package: costmap_2d, obstacle_range",
    )
    raytrace_range_m: float = option(
        3.0,
        "Beams clear obstacles up to this distance. Another LiDAR than the LDS-01: its range unless set.",
        gt=0,
        le=MAX_RANGE_M,
        source="package: costmap_2d, raytrace_range",
    )
    inflation_radius_m: float = option(
        0.55,
        "Distance from an obstacle at which its inflated cost ends.",
        ge=0,
        le=3,
        source="package: costmap_2d, inflation_radius",
    )
    cost_scaling_factor: float = option(
        10.0,
        "How fast the cost falls with distance from an obstacle, 1/m.",
        gt=0,
        le=100,
        key="cost_scaling",
        source="package: costmap_2d, cost_scaling_factor",
    )
    inscribed_radius_m: float = option(
        BURGER.radius_m,
        "Distance from an obstacle up to which a cell costs 99, as if the robot touched it.",
        gt=0,
        le=1,
        source="ours: robot_radius, which costmap_common_params_burger.yaml has as a comment; the "
        "footprint's inscribed radius would be 0.041 m",
    )
    footprint: Footprint = BURGER_PADDED  # the polygon that is free because the robot stands there
    footprint_clearing: bool = option(
        True,
        "Free the cells under the robot's own footprint at every scan.",
        source="package: costmap_2d, footprint_clearing_enabled",
    )
    track_unknown: bool = fixed(False, "package: costmap_2d, track_unknown_space")
    inf_is_valid: bool = option(
        False,
        "Let a beam without a return clear its way; in TurtleBot3's files it does not, and ghosts remain.",
        source="package: costmap_2d, inf_is_valid",
    )
    memory: Literal["persistent", "single_scan", "decay"] = option(
        "persistent",
        "How long an obstacle stays marked: until a beam passes through it (persistent, as "
        "costmap_2d), until the next scan (single_scan), or for decay_s after the last scan that met "
        "it (decay).",
        key="local_map",
        source="package: costmap_2d, a mark stays until a beam clears it",
    )
    decay_s: float = option(
        1.0, "How long a mark lives under decay.", gt=0, le=60, source="ours: off unless memory=decay"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.inflation_radius_m > MAX_INFLATION_CELLS * self.resolution:
            raise InputError(
                f"costmap: inflation_radius_m {self.inflation_radius_m} spans more than "
                f"{MAX_INFLATION_CELLS} cells of {self.resolution} m; use a coarser resolution or a "
                f"smaller radius"
            )

    def of_robot(self, robot: RobotModel) -> "CostmapSettings":
        """The same of another robot: its footprint padded, its radius as it stands."""
        footprint = padded(robot.footprint, COSTMAP_PADDING_M)
        return replace(self, footprint=footprint, inscribed_radius_m=robot.radius_m)

    def of_lidar(self, lidar: LidarGeometry) -> "CostmapSettings":
        """The same with the whole range of another LiDAR than the LDS-01, and a window that holds it.

        What TurtleBot3's files say, they say of the LDS-01 (items 6 and 7); the window of another one is
        twice its range (IV.B.1), at least 1 m, and never smaller than one that is wider than the files' here.
        """
        if lidar == replace(LDS_01, mount=lidar.mount):
            return self
        range_m = min(lidar.range_max_m, MAX_RANGE_M)
        side_m = max(2.0 * range_m, self.size_m if self.size_m > LDS_WINDOW_M else 1.0)
        return self.but(obstacle_range_m=range_m, raytrace_range_m=range_m, size_m=side_m)

    @property
    def memory_s(self) -> float:
        """How long a mark outlives the scan that last met it, seconds; inf: until a beam passes (item 8)."""
        return {"persistent": math.inf, "single_scan": 0.0, "decay": self.decay_s}[self.memory]

    def reach_m(self, thresh: int) -> float:
        """How far from an obstacle a published cost stays at ``thresh`` or above, metres (item 1)."""
        if thresh == 100:
            return 0.0
        from midnet_bench.elementary import from_python  # which needs a compiler

        least_cost = 1 + math.ceil(251 * (thresh - 1) / 97)
        graded_m = self.inscribed_radius_m + from_python.log(252 / least_cost) / self.cost_scaling_factor
        return min(self.inscribed_radius_m if thresh == 99 else graded_m, self.inflation_radius_m)


_MARGIN_M = 0.04
"""Padding of the Burger's footprint. costmap_2d has 0.01, but a LiDAR sees the 11 cm of another Burger's
LiDAR and not the 18 cm below it: with 0.03 and the footprint of release 0.2.1 bodies touch in 4 of 4 drives
past a Burger that leaves, with 0.04 in none."""

_COMMON, _DWA = "costmap_common_params_burger.yaml", "turtlebot3: dwa_local_planner_params.yaml"
MIDNET_SOURCES = {
    "size_m": "turtlebot3: local_costmap_params.yaml, width",
    "obstacle_range_m": "paper: V.A, 2.5 metres",
    "raytrace_range_m": f"turtlebot3: {_COMMON}, raytrace_range",
    "inf_is_valid": "ours: the files' false leaves false positives before open space, IV.A little or none",
}
"""Sources of what MIDNet's local costmaps have instead of the defaults."""
PERIOD_S = 0.1  # of control; turtlebot3, move_base_params.yaml, controller_frequency
_STANDSTILL = "with 0.2.1's inflation and 2 Hz robots stand still for half of Map 2's time"
BURGER_SOURCES = {
    "resolution": "turtlebot3: local_costmap_params.yaml, resolution",
    "size_m": "turtlebot3: local_costmap_params.yaml, width",
    "centered": "package: costmap_2d, whose rolling window moves by whole cells",
    "obstacle_range_m": f"turtlebot3: {_COMMON}, obstacle_range",
    "raytrace_range_m": f"turtlebot3: {_COMMON}, raytrace_range",
    "inflation_radius_m": f"turtlebot3 1.0.0: {_COMMON}, inflation_radius; {_STANDSTILL}",
    "cost_scaling_factor": f"turtlebot3 1.0.0: {_COMMON}, cost_scaling_factor; {_STANDSTILL}",
    "inscribed_radius_m": "ours: of the file's footprint, padded by 0.04 m so that bodies do not touch",
    "inf_is_valid": "ours: with the files' false, marks before open space stay for ever and close the way",
}
"""Sources of the values of ``BURGER_COSTMAP``."""

_BURGER_OUTLINE = padded(BURGER.footprint, _MARGIN_M)

BURGER_COSTMAP = CostmapSettings(
    size_m=LDS_WINDOW_M,
    centered=False,
    raytrace_range_m=3.5,
    inflation_radius_m=1.0,
    cost_scaling_factor=3.0,
    inscribed_radius_m=radii(_BURGER_OUTLINE)[0],
    footprint=_BURGER_OUTLINE,
    inf_is_valid=True,
)
"""Both costmaps of turtlebot3_navigation 0.2.1: the local one rolls with the robot and has no static map, the
global one has the static map's size. ``BURGER_SOURCES`` says where they depart from the files; the padding
of the footprint and the rate (each scan, not 2 Hz) do too."""


@dataclass(frozen=True)
class LocalPlannerLimits(Settings):
    """Velocities in the body frame, accelerations, tolerances.

    The defaults are those of dwa_local_planner_params.yaml of TurtleBot3 0.2.1.
    """

    max_vel_x_mps: float = option(
        0.18,
        "Highest forward speed; a Burger reaches 0.22.",
        gt=0,
        le=1,
        source=f"{_DWA}, max_vel_x",
    )
    min_vel_x_mps: float = fixed(-0.18, f"{_DWA}, min_vel_x")
    max_vel_trans_mps: float = fixed(0.18, f"{_DWA}, max_trans_vel")
    min_vel_trans_mps: float = fixed(0.05, f"{_DWA}, min_trans_vel")
    max_vel_theta_radps: float = fixed(1.8, f"{_DWA}, max_rot_vel")
    min_vel_theta_radps: float = fixed(0.7, f"{_DWA}, min_rot_vel")
    acc_lim_x_mps2: float = fixed(2.0, f"{_DWA}, acc_lim_x")
    acc_lim_theta_radps2: float = fixed(2.0, f"{_DWA}, acc_lim_theta")
    xy_goal_tolerance_m: float = fixed(0.05, f"{_DWA}, xy_goal_tolerance")
    yaw_goal_tolerance_rad: float = fixed(0.15, f"{_DWA}, yaw_goal_tolerance")

    def of_robot(self, robot: RobotModel) -> "LocalPlannerLimits":
        """Up to all that ``robot`` can do; too slow is less than half of it, as in a Waffle's file."""
        turn_radps = robot.max_angular_radps
        return replace(
            self.at_speed(robot.max_linear_mps),
            min_vel_trans_mps=robot.max_linear_mps / 2.0,
            max_vel_theta_radps=turn_radps,
            min_vel_theta_radps=turn_radps / 2.0,
        )

    def within(self, robot: RobotModel) -> "LocalPlannerLimits":
        """The same where ``robot`` can do it, else less."""
        turn_radps = robot.max_angular_radps
        return replace(
            self.at_speed(min(self.max_vel_x_mps, robot.max_linear_mps)),
            max_vel_theta_radps=min(self.max_vel_theta_radps, turn_radps),
            min_vel_theta_radps=min(self.min_vel_theta_radps, turn_radps),
        )

    def at_speed(self, top_mps: float) -> "LocalPlannerLimits":
        """The limits of a robot whose top speed is ``top_mps``; its other speeds change in proportion."""
        share = top_mps / self.max_vel_x_mps
        return self.but(
            max_vel_x_mps=top_mps,
            min_vel_x_mps=share * self.min_vel_x_mps,
            max_vel_trans_mps=share * self.max_vel_trans_mps,
            min_vel_trans_mps=share * self.min_vel_trans_mps,
        )


@dataclass(frozen=True)
class DwaSettings(Settings):
    """Parameters of DWAPlannerROS.

    What never acts on a Burger is left out: the y axis, footprint scaling above 0.25 m/s, twirling, and
    ``use_dwa: false`` (that is Trajectory Rollout's way of sampling). What no option sets stands in ``dwa``.
    """

    limits: LocalPlannerLimits = group(LocalPlannerLimits(), "limits")
    sim_time_s: float = option(
        1.5,
        "How far ahead each velocity is simulated.",
        gt=0,
        le=10,
        source="turtlebot3 1.0.0: dwa_local_planner_params_burger.yaml, sim_time; with 0.2.1's 3.5 s guards "
        "give up 40 of 139 goals, not 0 of 188",
    )
    goal_distance_bias: float = option(
        20.0,
        "Weight of the distance from the local goal.",
        ge=0,
        le=1000,
        source="turtlebot3 1.0.0: dwa_local_planner_params_burger.yaml, goal_distance_bias; with 0.2.1's 24 "
        "and occdist_scale an unmapped box ahead takes 87 s, not 30 s",
    )
    occdist_scale: float = option(
        0.02,
        "Weight of the highest cost under the robot.",
        ge=0,
        le=1000,
        source="turtlebot3 1.0.0: dwa_local_planner_params_burger.yaml, occdist_scale; 0.2.1's 0.04 as "
        "goal_distance_bias",
    )


TRAJECTORY_ROLLOUT_LIMITS = LocalPlannerLimits(
    min_vel_x_mps=0.08,
    min_vel_trans_mps=0.08,
    max_vel_theta_radps=1.0,
    min_vel_theta_radps=1.0,
    xy_goal_tolerance_m=0.10,
    yaw_goal_tolerance_rad=0.05,
)
"""TurtleBot3's base_local_planner_params.yaml, whose min_vel_x, max_vel_theta, min_in_place_vel_theta and
tolerances these are; its accelerations are DWA's, as the file's 0.6 rad/s2 is too slow for corners."""


@dataclass(frozen=True)
class NavigatorSettings(Settings):
    """move_base on a Burger."""

    controller: Literal["dwa", "trajectory_rollout"] = option(
        "dwa",
        "Local planner: DWA, or the older Trajectory Rollout.",
        source="turtlebot3: turtlebot3_navigation.launch, base_local_planner",
    )
    dwa: DwaSettings = group(DwaSettings(), "DWA", prefix="dwa_")
    rollout_limits: LocalPlannerLimits = TRAJECTORY_ROLLOUT_LIMITS
    """the limits of Trajectory Rollout, whose other numbers stand in its file"""
    local_costmap: CostmapSettings = group(
        BURGER_COSTMAP,
        "local costmap",
        prefix="nav_local_",
        only=("inflation_radius_m", "cost_scaling_factor"),
        sources=BURGER_SOURCES,
    )
    global_costmap: CostmapSettings = group(
        BURGER_COSTMAP,
        "global costmap",
        prefix="nav_global_",
        only=("inflation_radius_m", "cost_scaling_factor"),
        sources=BURGER_SOURCES,
    )
    bare_footprint: Footprint = BURGER.footprint
    """the robot's outline without padding: what a robot that is stuck may still move with"""
    goal_tolerance_m: float = option(
        0.5,
        "A goal that a scanned obstacle covers is approached up to this distance (navfn's "
        "default_tolerance; 0 in TurtleBot3's files, where such a goal is not approached at all).",
        ge=0,
        le=5,
        key="nav_goal_tolerance_m",
        source="ours: with navfn's 0 a robot stops wherever an intruder is on its goal",
    )
    planner_frequency_hz: float = option(
        5.0,
        "How often a plan is traced anew, at most once a scan.",
        gt=0,
        le=100,
        key="nav_planner_frequency_hz",
        source="turtlebot3 1.0.0: move_base_params.yaml, planner_frequency; with 0.2.1's 2 Hz bodies touch "
        "12 times in 100 labyrinth trials",
    )
    controller_patience_s: float = option(
        15.0,
        "Without a legal velocity for this long, a recovery begins.",
        ge=0,
        le=600,
        key="nav_controller_patience_s",
        source="turtlebot3 1.0.0: move_base_params.yaml, controller_patience; after 0.2.1's 1.0 s a recovery"
        " would come before DWA's way off",
    )

    def of_robot(self, robot: RobotModel) -> "NavigatorSettings":
        """The same for another robot than a Burger: its outlines, and limits within what it can do."""
        footprint = padded(robot.footprint, _MARGIN_M)
        outline: Any = {"footprint": footprint, "inscribed_radius_m": radii(footprint)[0]}
        return replace(
            self,
            bare_footprint=robot.footprint,
            local_costmap=replace(self.local_costmap, **outline),
            global_costmap=replace(self.global_costmap, **outline),
            dwa=replace(self.dwa, limits=self.dwa.limits.of_robot(robot)),
            rollout_limits=self.rollout_limits.within(robot),
        )

    def at_speed(self, top_mps: float) -> "NavigatorSettings":
        """The settings of a robot whose top speed is ``top_mps``."""
        return self.but(
            dwa=self.dwa.but(limits=self.dwa.limits.at_speed(top_mps)),
            rollout_limits=self.rollout_limits.at_speed(top_mps),
        )
