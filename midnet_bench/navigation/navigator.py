"""move_base: from a goal and scans to velocities, with recoveries when the way is lost."""

import enum
import math
from dataclasses import dataclass

import numpy as np

from midnet_bench.geometry import STOP, Command, Floats, LidarGeometry, Point, Pose2D, lengths, wrap_angle
from midnet_bench.grid import OccupancyGrid
from midnet_bench.navigation.costmap import LETHAL, GlobalCostmap, RollingCostmap, is_open_line
from midnet_bench.navigation.dwa import DwaPlanner
from midnet_bench.navigation.global_planner import GlobalPlanner
from midnet_bench.navigation.local_planner import LocalPlanner, Plan
from midnet_bench.navigation.navigation_settings import PERIOD_S, NavigatorSettings
from midnet_bench.navigation.trajectory_rollout import TrajectoryRolloutPlanner
from midnet_bench.robots.turtlebot3 import LDS_01

PLANNER_PATIENCE_S, OSCILLATION_TIMEOUT_S, OSCILLATION_DISTANCE_M = 1.0, 10.0, 0.2
"""turtlebot3, move_base_params.yaml, planner_patience, oscillation_timeout and oscillation_distance"""
CLEARED_OUTSIDE_M = (0.1, None, 1.84, None)
"""Of the recoveries in turn: outside of what square the costmaps are cleared; None: a turn on the spot.
turtlebot3, move_base_params.yaml, conservative_reset_dist; move_base, 4 x circumscribed_radius."""
_NEAR_S = 10.0
"""For so much longer than the straight way takes may a robot be near its goal, in all, and come no nearer
than it was before; move_base has no such clock. Without a limit robots were near 478 goals that they reached,
7 of them for longer than 15 s in all, and near 16 that they gave up in the end, for 40 s in the mean (three
detection trials of 300 s, seeds 2001 to 2003)."""
_WAYS, _SPARE_M = 2.0, 5.0
"""A robot may drive so many times the first plan's length, and so many metres more, for one goal."""
_STOPPED_MPS, _STOPPED_RADPS = 0.1, 0.1
"""trans_stopped_vel and rot_stopped_vel of the package: below both a robot stands"""
_RECOVERY_RADPS2, _RECOVERY_RADPS, _RECOVERED_RAD = 3.2, (0.4, 1.0), 0.10
"""TrajectoryPlannerROS: acceleration, slowest and fastest turn of a rotate_recovery, and its tolerance"""


class Status(enum.Enum):
    """How the newest goal stands."""

    IDLE = "idle"
    ACTIVE = "active"
    SUCCEEDED = "succeeded"
    ABORTED = "aborted"


class _State(enum.Enum):
    PLANNING = enum.auto()
    CONTROLLING = enum.auto()
    CLEARING = enum.auto()


@dataclass
class _Drive:
    """The goal at hand and how the robot gets on with it; clocks in seconds."""

    goal: Point
    yaw: float
    stop_rotate: "StopRotate"
    state: _State = _State.PLANNING
    trigger: _State = _State.PLANNING
    """what failed before the newest recovery: planning, controlling, or (CLEARING) moving on"""
    recovery_index: int = 0
    rotation: "RotateRecovery | None" = None
    plan: Plan | None = None  # the way that is followed, up to where it leaves the local window
    checked_on_map: bool = False
    planned_at_s: float = 0.0
    planning_since_s: float = 0.0
    valid_command_at_s: float = 0.0
    moved_at_s: float = 0.0
    moved_from: Pose2D | None = None  # None before the first control cycle, with which the clocks start
    least_m: float = math.inf  # the least straight distance to the goal, while near it
    no_progress_s: float = 0.0  # how long the robot has been near the goal and come no nearer than that
    driven_m: float = 0.0
    first_plan_m: float = math.inf


class Navigator:
    """Drives one robot to one goal at a time over a prior map (int8, -1 to 100), by its own scans.

    Call ``observe`` at every scan and ``control`` each ``PERIOD_S``. The states, clocks and the
    order of recoveries (clear all but a square, turn once, clear all but a wider one, turn once) are
    move_base's. Departures: planning runs inside ``control``, and traces the plan anew after each scan; a
    goal that the map alone makes impossible (off the map, in or at a wall, walled off) is aborted at once;
    one that a scanned obstacle covers is approached as near as can be; one that the robot has been near for
    too long without coming nearer (``_NEAR_S``) is aborted, as something that the map does not know keeps it
    off, and so is one for which it has driven twice the way and 5 m.
    """

    def __init__(self, prior: OccupancyGrid, settings: NavigatorSettings | None = None) -> None:
        self.settings = settings = settings or NavigatorSettings()
        local = settings.local_costmap
        self.local_costmap = RollingCostmap(local, prior.origin)
        self.global_costmap = GlobalCostmap(settings.global_costmap, prior)
        self._global_planner = GlobalPlanner(self.global_costmap, settings.goal_tolerance_m)
        planner = DwaPlanner if settings.controller == "dwa" else TrajectoryRolloutPlanner
        self.local_planner: LocalPlanner = planner(settings)
        self._window_m = local.size_m / 2.0
        self.status = Status.IDLE
        self.recoveries = 0  # recovery behaviours run so far, over all goals
        self._drive: _Drive | None = None
        self._pose: Pose2D | None = None
        self._has_scan = self._scan_is_new = False

    @property
    def goal(self) -> Point | None:
        """Where the robot is to go, metres; None unless ACTIVE."""
        return self._drive.goal if self._drive else None

    def set_goal(self, x: float, y: float, yaw: float = 0.0) -> None:
        """Head for (x, y) in the map's frame, metres, and turn to ``yaw`` there; the goal before is dropped.

        A move_base goal always has a heading, radians; where a caller means none, its orientation is the
        identity (w = 1), so the robot turns to the map's x axis.
        """
        self._drive = _Drive((x, y), yaw, StopRotate(self.local_planner))
        self.status = Status.ACTIVE
        self._global_planner.reset()
        self.local_planner.reset()
        if self._global_planner.is_blocked((x, y), self.global_costmap.static_costs):
            self._end(Status.ABORTED)

    def cancel(self) -> None:
        """Give the goal up; the next command is to stop."""
        self._end(Status.IDLE)

    def set_static(self, static_map: OccupancyGrid) -> None:
        """Replace the prior map by a newer or larger one; the goal stays."""
        self.global_costmap.set_static(static_map)
        self._global_planner.invalidate_plan()

    def observe(self, pose: Pose2D, ranges_m: Floats, geometry: LidarGeometry, time_s: float) -> None:
        """Take one scan into both costmaps; errors as for ``RollingCostmap.update``.

        ``pose``: the robot in the map's frame at that instant; ``ranges_m``: (beams,) metres.
        """
        self._has_scan = self._scan_is_new = True
        self.local_costmap.update(pose, ranges_m, geometry, time_s)
        self.global_costmap.update(pose, ranges_m, geometry, time_s)

    def control(self, pose: Pose2D, velocity: Command, time_s: float) -> Command:
        """The velocity to drive until the next call; ``velocity`` is the present one, in the body frame.

        Before the first scan the robot stands still. Raises ValueError for a pose that is not finite.
        """
        pose.require_finite()
        before, self._pose = self._pose or pose, pose
        drive = self._drive
        if drive is None or not self._has_scan:
            return STOP
        has_new_scan, self._scan_is_new = self._scan_is_new, False
        if drive.moved_from is None:
            drive.planning_since_s = drive.valid_command_at_s = drive.moved_at_s = time_s
            drive.moved_from = pose
        else:
            drive.driven_m += pose.distance_to(before)
        if not drive.stop_rotate.is_at_position and self._is_kept_off(drive, pose):
            self._end(Status.ABORTED)
            return STOP
        if drive.state is _State.PLANNING:
            self._make_plan(drive, pose, time_s)
        if drive.state is _State.CLEARING:
            return self._recover(drive, pose, time_s)
        if drive.state is _State.CONTROLLING and drive.plan is not None:
            return self._follow(drive, drive.plan, pose, velocity, time_s, has_new_scan)
        return STOP

    def plan(self) -> Plan | None:
        """(N, 2) the whole way from the robot's last pose to the goal, metres, for drawing; or None."""
        if self._drive is None or self._pose is None:
            return None
        return self._global_planner.whole_plan(self._pose)

    def _make_plan(self, drive: _Drive, pose: Pose2D, time_s: float) -> None:
        plan = self._global_planner.plan(drive.goal, pose, time_s, self._window_m)
        if plan is not None:
            drive.plan, drive.planned_at_s = plan, time_s
            drive.state = _State.CONTROLLING
            if drive.first_plan_m == math.inf:
                whole = self._global_planner.whole_plan(pose)
                if whole is not None:
                    drive.first_plan_m = math.fsum(lengths(np.diff(whole, axis=0)))
            self.local_planner.reset()
            if drive.trigger is _State.PLANNING:
                drive.recovery_index = 0
        elif not drive.checked_on_map:
            drive.checked_on_map = True
            if self._global_planner.is_walled_off(drive.goal, pose):
                self._end(Status.ABORTED)
        elif time_s - drive.planning_since_s > PLANNER_PATIENCE_S:
            if drive.recovery_index > 0 and self._global_planner.is_covered:
                self._end(Status.ABORTED)
            else:
                drive.state, drive.trigger = _State.CLEARING, _State.PLANNING

    def _follow(
        self, drive: _Drive, plan: Plan, pose: Pose2D, velocity: Command, time_s: float, has_new_scan: bool
    ) -> Command:
        settings = self.settings
        if drive.stop_rotate.has_arrived(drive.goal, pose):
            if drive.stop_rotate.is_finished(drive.yaw, pose, velocity):
                self._end(Status.SUCCEEDED)
                return STOP
            command = drive.stop_rotate.command(self.local_costmap, drive.yaw, pose, velocity)
        elif self._oscillates(drive, pose, time_s):
            drive.state = drive.trigger = _State.CLEARING
            return STOP
        else:
            planned_ago_s = time_s - drive.planned_at_s
            # Half a control period of slack locks planning to the scans' phase.
            if has_new_scan and planned_ago_s > 1.0 / settings.planner_frequency_hz - 0.5 * PERIOD_S:
                newer = self._global_planner.plan(drive.goal, pose, time_s, self._window_m)
                plan = plan if newer is None else newer
                drive.plan, drive.planned_at_s = plan, time_s
            command = self.local_planner.command(self.local_costmap, plan, pose, velocity)
        if command is not None:
            drive.valid_command_at_s = time_s
            if drive.trigger is _State.CONTROLLING:
                drive.recovery_index = 0
            return command
        if time_s - drive.valid_command_at_s > settings.controller_patience_s:
            drive.state, drive.trigger = _State.CLEARING, _State.CONTROLLING
        else:
            drive.state, drive.planning_since_s = _State.PLANNING, time_s
            self._global_planner.invalidate_plan()
        return STOP

    def _oscillates(self, drive: _Drive, pose: Pose2D, time_s: float) -> bool:
        """Whether the robot has stayed within the oscillation distance for too long."""
        if drive.moved_from is None or pose.distance_to(drive.moved_from) >= OSCILLATION_DISTANCE_M:
            drive.moved_from, drive.moved_at_s = pose, time_s
            if drive.trigger is _State.CLEARING:
                drive.recovery_index = 0
        return time_s - drive.moved_at_s > OSCILLATION_TIMEOUT_S

    def _is_kept_off(self, drive: _Drive, pose: Pose2D) -> bool:
        """Whether the robot has come no nearer to a near goal for too long, or has driven too far for it.

        Near is within the reach of the local window and without a wall of the map between: farther off, and
        behind a wall, the way may lead away from the goal at first. A LiDAR sees an obstacle's skin only, so
        what stands on a goal may seem open from one side and then from another, and a robot that drives to
        and fro before it makes no progress. Round an obstacle wider than the window it is never near; then
        the way that it has driven tells.
        """
        if drive.driven_m > _WAYS * drive.first_plan_m + _SPARE_M:
            return True
        to_goal_m = math.hypot(drive.goal[0] - pose.x, drive.goal[1] - pose.y)
        if to_goal_m < self._window_m and self._has_open_line(pose, drive.goal):
            if to_goal_m < drive.least_m:
                drive.least_m = to_goal_m
            else:
                drive.no_progress_s += PERIOD_S
        return drive.no_progress_s > _NEAR_S + self._window_m / self.local_planner.limits.max_vel_x_mps

    def _has_open_line(self, pose: Pose2D, goal: Point) -> bool:
        """Whether no wall of the map lies between a robot and a goal."""
        to_cells = self.global_costmap.to_cells
        return is_open_line(self.global_costmap.static, *to_cells(pose.x, pose.y), *to_cells(*goal))

    def _recover(self, drive: _Drive, pose: Pose2D, time_s: float) -> Command:
        """Run the recovery that is due; then plan again."""
        if drive.recovery_index >= len(CLEARED_OUTSIDE_M):
            self._end(Status.ABORTED)
            return STOP
        side_m = CLEARED_OUTSIDE_M[drive.recovery_index]
        if side_m is not None:
            self.local_costmap.clear_outside(pose.x, pose.y, side_m)
            self.global_costmap.clear_outside(pose.x, pose.y, side_m)
            self._global_planner.reset()
            self.recoveries += 1
        else:
            if drive.rotation is None:
                drive.rotation = RotateRecovery(self.local_planner, pose.yaw)
                self.recoveries += 1
            command = drive.rotation.command(self.local_costmap, pose)
            if command is not None:
                return command
        drive.rotation = None
        drive.recovery_index += 1
        drive.state = _State.PLANNING
        drive.planning_since_s = drive.moved_at_s = time_s
        return STOP

    def _end(self, status: Status) -> None:
        self._drive = None
        self.status = status


class StopRotate:
    """Latched stop and rotate of dwa_local_planner: takes over within the position tolerance of one goal.

    move_base looks for the latch among its own parameters, so that the planner's file cannot set it; here it
    is always on, since a robot that turns on the spot does not leave its place.
    """

    def __init__(self, planner: LocalPlanner) -> None:
        self._planner = planner
        self.is_at_position = False  # whether the robot has been within the position tolerance
        self._is_turning = False

    def has_arrived(self, goal: Point, pose: Pose2D) -> bool:
        """Whether the robot is, or was before, within the position tolerance."""
        distance_m = math.hypot(goal[0] - pose.x, goal[1] - pose.y)
        self.is_at_position = self.is_at_position or distance_m <= self._planner.limits.xy_goal_tolerance_m
        return self.is_at_position

    def is_finished(self, goal_yaw: float, pose: Pose2D, velocity: Command) -> bool:
        """Whether the robot faces ``goal_yaw``, radians, and stands; for one that has arrived."""
        angle = abs(wrap_angle(goal_yaw - pose.yaw))
        return angle <= self._planner.limits.yaw_goal_tolerance_rad and _is_standing(velocity)

    def command(
        self, costmap: RollingCostmap, goal_yaw: float, pose: Pose2D, velocity: Command
    ) -> Command | None:
        """The velocity to stop or to turn with; None when the turn would hit something."""
        limits = self._planner.limits
        v, w = velocity
        reach_v = limits.acc_lim_x_mps2 * PERIOD_S
        reach_w = limits.acc_lim_theta_radps2 * PERIOD_S
        angle = wrap_angle(goal_yaw - pose.yaw)
        if abs(angle) <= limits.yaw_goal_tolerance_rad:
            self._is_turning = False
            return STOP
        if not self._is_turning and not _is_standing(velocity):
            return Command(
                math.copysign(max(0.0, abs(v) - reach_v), v), math.copysign(max(0.0, abs(w) - reach_w), w)
            )
        self._is_turning = True
        slowest, fastest = limits.min_vel_theta_radps, limits.max_vel_theta_radps
        speed = min(max(abs(angle), slowest), fastest)
        speed = min(max(speed, abs(w) - reach_w), abs(w) + reach_w)
        # no faster than the robot can brake in what is left of the turn
        speed = min(speed, math.sqrt(2.0 * limits.acc_lim_theta_radps2 * abs(angle)))
        turn = math.copysign(min(max(speed, slowest), fastest), angle)
        can_turn = self._planner.can_turn(costmap, pose, turn * self._planner.sim_time_s)
        return Command(0.0, turn) if can_turn else None


def _is_standing(velocity: Command) -> bool:
    return abs(velocity.linear_mps) <= _STOPPED_MPS and abs(velocity.angular_radps) <= _STOPPED_RADPS


class RotateRecovery:
    """One full turn to the left on the spot (rotate_recovery).

    The turn is measured by adding up heading changes. The original waits to find itself within 0.1 rad of the
    opposite heading and then of the first one, which a robot that turns fast between two looks can miss.
    """

    def __init__(self, planner: LocalPlanner, yaw: float) -> None:
        self._planner = planner
        self._yaw = yaw
        self._turned_rad = 0.0

    def command(self, costmap: RollingCostmap, pose: Pose2D) -> Command | None:
        """The velocity to go on turning with; None when the turn is done or its rest would hit something."""
        self._turned_rad += wrap_angle(pose.yaw - self._yaw)
        self._yaw = pose.yaw
        left = 2.0 * math.pi - self._turned_rad
        if left <= _RECOVERED_RAD or not self._planner.can_turn(costmap, pose, left):
            return None
        slowest, fastest = _RECOVERY_RADPS
        return Command(0.0, min(max(math.sqrt(2.0 * _RECOVERY_RADPS2 * left), slowest), fastest))


def compile_kernels() -> None:
    """Run every compiled loop of this room once, on a few square metres; about 10 s without a cache.

    Worker processes that start afterwards find numba's cache filled.
    """
    prior = OccupancyGrid(np.zeros((60, 60), dtype=np.int8), 0.05, (0.0, 0.0))
    pose = Pose2D(1.5, 1.5, 0.0)
    # The planners' own settings differ, their kernels are all of one signature each.
    for settings in (NavigatorSettings(), NavigatorSettings(controller="trajectory_rollout")):
        navigator = Navigator(prior, settings)
        navigator.set_goal(2.5, 1.5)
        for tick in range(12):  # beyond the age from which a plan looks at what has gone
            navigator.observe(pose, np.full(LDS_01.beams, 2.5), LDS_01, 0.2 * tick)
            navigator.control(pose, STOP, 0.2 * tick)
        RotateRecovery(navigator.local_planner, pose.yaw).command(navigator.local_costmap, pose)
        navigator.local_costmap.published()
        # Shut in on all sides, DWA looks for a way off after two seconds.
        navigator.local_costmap.marks.fill(LETHAL)
        navigator.local_costmap.clear_outside(pose.x, pose.y, 2.0 * settings.local_costmap.size_m)
        for tick in range(24, 54):
            navigator.control(pose, STOP, 0.1 * tick)
