import itertools
import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from midnet_bench.geometry import Command, Pose2D
from midnet_bench.navigation import dwa as dwa_kernels
from midnet_bench.navigation import trajectory_rollout as trajectory_rollout_kernels
from midnet_bench.navigation.costmap import RollingCostmap
from midnet_bench.navigation.dwa import DwaPlanner
from midnet_bench.navigation.local_planner import (
    GOAL,
    GOAL_FRONT,
    PATH,
    distance_grids,
    outline_cost,
    velocity_samples,
)
from midnet_bench.navigation.navigation_settings import (
    BURGER_COSTMAP,
    DwaSettings,
    LocalPlannerLimits,
    NavigatorSettings,
)
from midnet_bench.navigation.navigator import StopRotate
from midnet_bench.navigation.trajectory_rollout import TrajectoryRolloutPlanner
from midnet_bench.robots.turtlebot3 import LDS_01
from tests.navigation.planar_world import bresenham

Costs = npt.NDArray[np.uint8]
FOOTPRINT = np.array([(-2.3, -2.3), (-2.3, 2.3), (1.02, 2.3), (1.02, -2.3)])
SIZE = 40


def scene(
    seed: int,
) -> tuple[Costs, npt.NDArray[np.int32], npt.NDArray[np.float64], tuple[float, float, float]]:
    """A 40 x 40 costmap with some inflated obstacles, its grids for a plan, the plan, a start on it."""
    rng = np.random.default_rng(seed)
    lethal = np.zeros((SIZE, SIZE), dtype=bool)
    for _ in range(rng.integers(0, 5)):
        x, y = rng.integers(2, SIZE - 6, size=2)
        lethal[y : y + rng.integers(1, 5), x : x + rng.integers(1, 5)] = True
    start = (rng.uniform(15, 25), rng.uniform(15, 25), rng.uniform(-3.1, 3.1))
    lethal[int(start[1]) - 2 : int(start[1]) + 3, int(start[0]) - 2 : int(start[0]) + 3] = False
    distance = distance_transform_edt(~lethal) if lethal.any() else np.full(lethal.shape, 99.0)
    costs = np.where(distance <= 1.0, 253, 252 * np.exp(-0.15 * (distance - 1.0))).astype(np.uint8)
    costs[lethal] = 254
    angle = start[2] + rng.uniform(-2.5, 2.5)
    steps = np.arange(0.0, 30.0, 0.5)
    bend = rng.uniform(-0.05, 0.05)
    plan = np.column_stack(
        (
            start[0] + np.cumsum(0.5 * np.cos(angle + bend * steps)),
            start[1] + np.cumsum(0.5 * np.sin(angle + bend * steps)),
        )
    )
    return costs, distance_grids(costs, plan, (0.0, 0.0), 1.0, start[:2], 6.5), plan, start


def outline(costs: Costs, x: float, y: float, yaw: float) -> int:
    corners = [
        (x + fx * math.cos(yaw) - fy * math.sin(yaw), y + fx * math.sin(yaw) + fy * math.cos(yaw))
        for fx, fy in FOOTPRINT
    ]
    if any(not (0 <= cx < costs.shape[1] and 0 <= cy < costs.shape[0]) for cx, cy in corners):
        return -1
    worst = 0
    for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
        for cx, cy in bresenham(int(ax), int(ay), int(bx), int(by)):
            if costs[cy, cx] >= 254:
                return -1
            worst = max(worst, int(costs[cy, cx]))
    return worst


# Distance grids


def steps_by_relaxation(costs: Costs, seeds: set[tuple[int, int]]) -> npt.NDArray[np.int64]:
    height, width = costs.shape
    blocked, unreached = height * width, height * width + 1
    distance = {(x, y): 0 for x, y in seeds}
    front = sorted(seeds)
    grid = np.full((height, width), unreached, dtype=np.int64)
    while front:
        following = []
        for x, y in front:
            for nx, ny in ((x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)):
                if 0 <= nx < width and 0 <= ny < height and (nx, ny) not in distance:
                    if costs[ny, nx] >= 253:
                        grid[ny, nx] = blocked
                    else:
                        distance[nx, ny] = distance[x, y] + 1
                        following.append((nx, ny))
        front = following
    for (x, y), steps in distance.items():
        grid[y, x] = steps
    return grid


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_distance_grids_count_steps_around_obstacles(seed: int) -> None:
    rng = np.random.default_rng(seed)
    costs = rng.choice(
        np.array([0, 120, 253, 254, 255], dtype=np.uint8), size=(17, 13), p=[0.6, 0.15, 0.1, 0.1, 0.05]
    )
    plan = np.column_stack(
        (
            np.linspace(rng.uniform(0, 13), rng.uniform(-5, 18), 40),
            np.linspace(rng.uniform(0, 17), rng.uniform(-5, 22), 40),
        )
    )
    run: list[tuple[int, int]] = []
    for x, y in plan:
        if 0 <= x < 13 and 0 <= y < 17 and costs[int(y), int(x)] != 255:
            run.append((int(x), int(y)))
        elif run:
            break
    grids = distance_grids(costs, plan, (0.0, 0.0), 1.0, (0.0, 0.0), 0.0)
    assert (grids[:, [0, -1]] == -1).all()
    assert (grids[:, :, [0, -1]] == -1).all()
    for k, seeds in ((PATH, set(run)), (GOAL, set(run[-1:])), (GOAL_FRONT, set(run[-1:]))):
        assert np.array_equal(grids[k, 1:-1, 1:-1], steps_by_relaxation(costs, seeds))


def test_gaps_in_a_plan_are_filled_and_the_last_point_is_pushed() -> None:
    costs = np.zeros((5, 12), dtype=np.uint8)
    plan = 0.05 * np.array([[1.5, 2.5], [6.5, 2.5]]) - 1.0
    grids = distance_grids(costs, plan, (-1.0, -1.0), 0.05, (-0.9, 0.05 * 2.5 - 1.0), 0.15)
    assert grids[PATH, 3, 1:-1].tolist() == [1, 0, 0, 0, 0, 0, 0, 1, 2, 3, 4, 5]
    assert grids[GOAL, 3, 1:-1].tolist() == [6, 5, 4, 3, 2, 1, 0, 1, 2, 3, 4, 5]
    assert grids[GOAL_FRONT, 3, 1:-1].tolist() == [9, 8, 7, 6, 5, 4, 3, 2, 1, 0, 1, 2]


# Footprint and samples


def test_only_the_outline_is_examined_and_253_is_legal() -> None:
    costs = np.zeros((20, 20), dtype=np.uint8)
    costs[10, 10] = 254
    assert outline_cost(costs, 10.5, 10.5, 1.0, 0.0, FOOTPRINT) == 0
    costs[10, 8] = 253
    assert outline_cost(costs, 10.5, 10.5, 1.0, 0.0, FOOTPRINT) == 253
    for forbidden in (254, 255):
        costs[10, 8] = forbidden
        assert outline_cost(costs, 10.5, 10.5, 1.0, 0.0, FOOTPRINT) == -1
    assert outline_cost(costs, 2.2, 10.5, 1.0, 0.0, FOOTPRINT) == -1


@given(st.integers(0, 2**32 - 1))
def test_outlines_equal_an_independent_walk(seed: int) -> None:
    rng = np.random.default_rng(seed)
    costs, _, _, start = scene(seed)
    x, y = start[0] + rng.uniform(-12, 12), start[1] + rng.uniform(-12, 12)
    assert outline_cost(costs, x, y, math.cos(start[2]), math.sin(start[2]), FOOTPRINT) == outline(
        costs, x, y, start[2]
    )


@pytest.mark.slow
def test_velocity_samples_include_zero_once() -> None:
    assert velocity_samples(0.1, 0.1, 20).tolist() == [0.1]
    assert velocity_samples(-1.0, 1.0, 4) == pytest.approx([-1.0, -1 / 3, 0.0, 1 / 3, 1.0])
    assert velocity_samples(-1.0, 1.0, 3).tolist() == [-1.0, 0.0, 1.0]
    assert velocity_samples(0.0, 1.0, 1).tolist() == [0.0, 1.0]


# DWA


def scales(occupied: float) -> dwa_kernels.SearchParameters:
    """Weights are sums of few powers of two, so that totals are exact and ties are ties."""
    return dwa_kernels.SearchParameters(0.11, 0.22, 1.37, 1.5, 20.0, 1.5, 1.0, occupied, 6.5)


def arc(
    start: tuple[float, float, float], v: float, w: float, s: dwa_kernels.SearchParameters
) -> list[tuple[float, float, float]]:
    """The simulated poses of a sample by Euler's steps; none where it is too slow."""
    if abs(v) + 1e-4 < s.min_vel_trans and abs(w) + 1e-4 < s.min_vel_theta:
        return []
    (x, y, yaw), poses = start, []
    n = math.ceil(max(abs(v) * 60.0, abs(w) * 15.0))
    for _ in range(n):
        poses.append((x, y, yaw))
        x += v * s.cells_per_m * math.cos(yaw) * s.sim_time / n
        y += v * s.cells_per_m * math.sin(yaw) * s.sim_time / n
        yaw += w * s.sim_time / n
    return poses


def dwa_total(
    costs: Costs,
    grids: npt.NDArray[np.int32],
    start: tuple[float, float, float],
    v: float,
    w: float,
    aligned: bool,
    s: dwa_kernels.SearchParameters,
) -> float | None:
    """One sample scored step by step, in the words of the notes; None when it is discarded."""
    poses = arc(start, v, w, s)
    if not poses or abs(v) - 1e-4 > s.max_vel_trans:
        return None
    height, width = costs.shape
    worst, total = 0, 0.0
    for x, y, yaw in poses:
        if not (0 <= x < width and 0 <= y < height):
            return None
        path, goal = (int(grids[k, int(y) + 1, int(x) + 1]) for k in (PATH, GOAL))
        ahead = (x + s.forward_cells * math.cos(yaw), y + s.forward_cells * math.sin(yaw))
        if path >= height * width or goal >= height * width:
            return None
        if not (0 <= ahead[0] < width and 0 <= ahead[1] < height):
            return None
        under = outline(costs, x, y, yaw)
        if under < 0:
            return None
        worst = max(worst, under, int(costs[int(y), int(x)]))
        front = int(grids[GOAL_FRONT, int(ahead[1]) + 1, int(ahead[0]) + 1])
        side = int(grids[PATH, int(ahead[1]) + 1, int(ahead[0]) + 1])
        total = s.path * path + s.goal * goal + s.goal * front + (s.path * side if aligned else 0.0)
    return total + s.occupied * worst


@pytest.mark.slow
@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from([0.0, 1 / 64, 0.5]))
def test_the_pruned_search_picks_what_scoring_every_sample_picks(
    seed: int, aligned: bool, occupied: float
) -> None:
    rng = np.random.default_rng(seed + 1)
    costs, grids, _, start = scene(seed)
    speeds = velocity_samples(-0.22, 0.22, 5)
    w = rng.uniform(-2.4, 2.4)
    turns = velocity_samples(w - 0.32, w + 0.32, 7)
    allowed = tuple(bool(rng.random() < 0.8) for _ in range(4))
    best, best_total = -1, math.inf
    for i, (v, turn) in enumerate(itertools.product(speeds, turns)):
        signs = (v > 0, v < 0, turn > 0, turn < 0)
        forbidden = any(sign and not may for sign, may in zip(signs, allowed, strict=True))
        total = None if forbidden else dwa_total(costs, grids, start, v, turn, aligned, scales(occupied))
        if total is not None and total < best_total:
            best, best_total = i, total
    now = costs, grids, start, allowed, aligned, FOOTPRINT
    found, total = dwa_kernels.search(now, speeds, turns, scales(occupied))
    assert found == best
    assert total == best_total


def room(x: float, y: float, ahead_m: float = 3.0) -> RollingCostmap:
    """What a robot at (x, y) sees of walls 0.6 m to its sides and of one ``ahead_m`` in front."""
    geometry = LDS_01
    costmap = RollingCostmap(BURGER_COSTMAP)
    pose = Pose2D(x, y, 0.0)
    with np.errstate(divide="ignore"):
        sides = 0.6 / np.abs(np.sin(geometry.angles_rad))
        front = (ahead_m + 0.032) / np.maximum(np.cos(geometry.angles_rad), 0.0)
    ranges = np.minimum(sides, front)
    costmap.update(pose, np.where(ranges < 3.5, ranges, np.inf), geometry, 0.0)
    return costmap


def dwa(**changed: float) -> DwaPlanner:
    settings = DwaSettings(limits=LocalPlannerLimits(**changed))
    return DwaPlanner(NavigatorSettings(dwa=settings))


def straight_plan(x: float, y: float, length_m: float = 1.4) -> npt.NDArray[np.float64]:
    xs = np.arange(x, x + length_m, 0.025)
    return np.column_stack((xs, np.full(len(xs), y)))


@pytest.mark.parametrize(
    ("yaw", "velocity"), [(0.0, (0.18, 0.0)), (3.0, (0.0, 0.0)), (0.4, (0.1, 1.0)), (0.4, (-0.15, -1.7))]
)
def test_dwa_drives_on_within_what_can_be_reached(yaw: float, velocity: tuple[float, float]) -> None:
    """Straight ahead it neither slows down nor turns; from rest it never turns on the spot."""
    planner = dwa(acc_lim_x_mps2=0.5)
    pose, plan = Pose2D(1.01, 2.02, yaw), straight_plan(1.01, 2.02)
    command = planner.command(room(1.01, 2.02), plan, pose, Command(*velocity))
    assert np.abs(np.subtract(command, velocity)).tolist() <= [0.05 + 1e-9, 0.2 + 1e-9]
    assert abs(command.linear_mps) >= 0.05 - 1e-4
    if yaw == 0.0:
        assert command.linear_mps == pytest.approx(0.18, abs=0.03)
        assert abs(command.angular_radps) < 0.2


def test_dwa_finds_nothing_when_the_way_is_walled_off_in_the_window() -> None:
    plan = straight_plan(1.01, 2.02)
    costmap = room(1.01, 2.02, ahead_m=0.6)
    # A wall across the whole window hides the local goal.
    costmap.marks[:, costmap.marks.shape[1] // 2 + 12] = 254
    costmap.clear_outside(1.0, 2.0, 9.0)
    assert dwa().command(costmap, plan, Pose2D(1.01, 2.02, 0.0), Command(0.2, 0.0)) is None


def wedged() -> RollingCostmap:
    """Obstacles at both flanks, under the padded outline but not the bare one; one ahead, none behind."""
    costmap = room(1.025, 2.025)
    column, row = (int(value) for value in costmap.to_cells(1.025, 2.025))
    for side in (-3, 3):
        costmap.marks[row + side, column - 1 : column + 2] = 254
    costmap.marks[row - 1 : row + 2, column + 2] = 254
    costmap.clear_outside(1.0, 2.0, 9.0)
    return costmap


def test_a_wedged_robot_backs_off_after_standing_for_two_seconds() -> None:
    planner, costmap = dwa(), wedged()
    pose = Pose2D(1.025, 2.025, 0.0)
    plan = straight_plan(1.025, 2.025)
    commands = [planner.command(costmap, plan, pose, Command(0.0, 0.0)) for _ in range(25)]
    assert commands[:20] == [None] * 20
    assert all(command is not None and command.linear_mps <= -0.05 for command in commands[20:])
    # As soon as the plan can be followed, it is.
    onwards = planner.command(room(1.025, 2.025), plan, pose, Command(0.0, 0.0))
    assert onwards.linear_mps > 0.0
    assert planner.command(costmap, plan, pose, Command(0.0, 0.0)) is None


@pytest.mark.slow
@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_an_escape_ends_farther_from_obstacles_than_any_other_legal_motion(seed: int) -> None:
    costs, grids, _, start = scene(seed)
    speeds, turns = velocity_samples(-0.22, 0.22, 5), velocity_samples(-1.6, 1.6, 5)
    s = scales(0.0)
    best, lowest = -1, int(costs[int(start[1]), int(start[0])])
    for sample, (v, w) in enumerate(itertools.product(speeds, turns)):
        poses = arc(start, v, w, s)
        if not poses or any(outline(costs, *pose) < 0 for pose in poses):
            continue
        x, y, _ = poses[-1]
        if costs[int(y), int(x)] < lowest:
            best, lowest = sample, int(costs[int(y), int(x)])
    now = costs, grids, start, (True,) * 4, True, FOOTPRINT
    assert dwa_kernels.escape(now, speeds, turns, s) == best


@pytest.mark.parametrize("start", [(-0.1, 20.0), (20.0, 1e6), (math.nan, 20.0), (20.0, math.inf)])
def test_an_escape_from_off_the_window_is_none(start: tuple[float, float]) -> None:
    """Found as a read outside the array, which ended the process."""
    costs = np.full((SIZE, SIZE), 100, dtype=np.uint8)
    turns = velocity_samples(-1.6, 1.6, 5)
    grids = np.zeros((3, SIZE + 2, SIZE + 2), dtype=np.int32)
    now = costs, grids, (*start, 0.3), (True,) * 4, True, FOOTPRINT
    assert dwa_kernels.escape(now, turns, turns, scales(0.5)) == -1


def test_a_swing_forbids_the_old_direction_until_the_robot_has_moved() -> None:
    planner = dwa()
    memory = planner._oscillation
    memory.note(Command(0.2, 0.0), Pose2D(0.0, 0.0, 0.0))
    assert memory.allowed == (True, True, True, True)
    memory.note(Command(-0.2, 0.0), Pose2D(0.0, 0.0, 0.0))
    assert memory.allowed == (False, True, True, True)
    memory.note(Command(-0.05, 1.5), Pose2D(0.04, 0.0, 0.0))
    memory.note(Command(-0.05, -1.5), Pose2D(0.04, 0.0, 0.0))
    assert memory.allowed == (False, True, False, True)
    memory.note(Command(-0.2, 0.0), Pose2D(0.095, 0.0, 0.0))
    assert memory.allowed == (True, True, True, True)


# Trajectory Rollout


ROBOT = (1.0, 2.0, 20.0)  # accelerations, and the cells of a metre


def rollout_total(
    costs: Costs,
    grids: npt.NDArray[np.int32],
    start: tuple[float, float, float],
    velocity: tuple[float, float],
    speed: float,
    turn: float,
) -> tuple[float, tuple[float, float, float]]:
    s, (acc_x, acc_theta, cells_per_m) = trajectory_rollout_kernels, ROBOT
    n = max(1, int(max(abs(speed) * s.SIM_TIME_S * 40.0, abs(turn) * 40.0) + 0.5))
    dt = s.SIM_TIME_S / n
    (x, y, yaw), (v, w) = start, velocity
    worst, path, goal = 0, 0, 0
    for _ in range(n):
        if not (0 <= x < costs.shape[1] and 0 <= y < costs.shape[0]):
            return -1.0, (x, y, yaw)
        under = outline(costs, x, y, yaw)
        if under < 0:
            return -1.0, (x, y, yaw)
        worst = max(worst, under, int(costs[int(y), int(x)]))
        path, goal = (int(grids[k, int(y) + 1, int(x) + 1]) for k in (PATH, GOAL))
        if path >= costs.size or goal >= costs.size:
            return -2.0, (x, y, yaw)
        v += float(np.clip(speed - v, -acc_x * dt, acc_x * dt))
        w += float(np.clip(turn - w, -acc_theta * dt, acc_theta * dt))
        x += v * cells_per_m * math.cos(yaw) * dt
        y += v * cells_per_m * math.sin(yaw) * dt
        yaw += w * dt
    return s.PATH_DISTANCE_BIAS * path + s.GOAL_DISTANCE_BIAS * goal + s.OCCDIST_SCALE * worst, (x, y, yaw)


@pytest.mark.slow
@settings(max_examples=12)
@given(st.integers(0, 2**32 - 1))
def test_the_rollout_search_picks_what_scoring_every_rollout_picks(seed: int) -> None:
    rng = np.random.default_rng(seed + 2)
    costs, grids, _, start = scene(seed)
    velocity = (rng.uniform(0.0, 0.2), rng.uniform(-1.0, 1.0))
    speeds, turns = np.linspace(0.05, 0.2, 4), np.linspace(-1.0, 1.0, 6)
    sides = (bool(rng.random() < 0.8), bool(rng.random() < 0.8))
    best, chosen = -1.0, (0.0, 0.0)
    for speed in speeds:
        for turn in (0.0, *turns[:-1]):
            total, _ = rollout_total(costs, grids, start, velocity, speed, turn)
            if total >= 0 and (best < 0 or total < best):
                best, chosen = total, (speed, turn)
    nearest = math.inf
    for turn in turns:
        if abs(turn) <= turns[1] - turns[0] or not sides[0 if turn > 0 else 1]:
            continue
        limited = math.copysign(max(abs(turn), 0.8), turn)
        total, (x, y, yaw) = rollout_total(costs, grids, start, velocity, 0.0, limited)
        if total < 0 or (best >= 0 and total > best):
            continue
        x, y = x + 6.5 * math.cos(yaw), y + 6.5 * math.sin(yaw)
        if 0 <= x < SIZE and 0 <= y < SIZE and grids[GOAL, int(y) + 1, int(x) + 1] < nearest:
            nearest = grids[GOAL, int(y) + 1, int(x) + 1]
            best, chosen = total, (0.0, limited)
    cost, speed, turn = trajectory_rollout_kernels.search_rollouts(
        (costs, grids, start, velocity, FOOTPRINT, ROBOT), speeds, turns, sides, 0.8
    )
    assert cost == best
    assert (speed, turn) == chosen


@pytest.mark.slow
def test_trajectory_rollout_backs_away_from_a_collision_and_then_goes_on() -> None:
    planner = TrajectoryRolloutPlanner(NavigatorSettings())
    costmap = room(1.01, 2.02)
    plan = straight_plan(1.01, 2.02)
    column, row = (int(value) for value in costmap.to_cells(1.08, 2.02))
    costmap.marks[row - 4 : row + 5, column] = 254
    costmap.clear_outside(1.0, 2.0, 9.0)
    assert planner.command(costmap, plan, Pose2D(1.01, 2.02, 0.0), Command(0.0, 0.0)) == (-0.1, 0.0)
    free = room(1.01, 2.02)
    assert planner.command(free, plan, Pose2D(0.95, 2.02, 0.0), Command(-0.1, 0.0)) == (-0.1, 0.0)
    onwards = planner.command(free, plan, Pose2D(0.90, 2.02, 0.0), Command(-0.1, 0.0))
    assert onwards.linear_mps > 0.0


# At the goal


def test_at_the_goal_the_robot_stops_turns_within_its_limits_and_ends() -> None:
    costmap, goal = room(1.01, 2.02), (1.03, 2.02)
    planner = dwa()
    limits = planner.limits
    controller = StopRotate(planner)
    assert not controller.has_arrived(goal, Pose2D(0.90, 2.02, 0.0))
    assert controller.has_arrived(goal, Pose2D(1.01, 2.02, 0.0))
    assert controller.has_arrived(goal, Pose2D(0.95, 2.02, 0.0))  # latched
    pose, velocity, commands = Pose2D(1.01, 2.02, 0.0), Command(0.18, 0.0), []
    for _ in range(60):
        if controller.is_finished(1.5, pose, velocity):
            break
        command = controller.command(costmap, 1.5, pose, velocity)
        commands.append(command)
        velocity = command
        pose = pose._replace(yaw=pose.yaw + 0.1 * command.angular_radps)
    assert commands[0] == (0.0, 0.0)
    turning = [command.angular_radps for command in commands if command.angular_radps]
    assert turning
    assert all(limits.min_vel_theta_radps <= turn <= limits.max_vel_theta_radps for turn in turning)
    assert all(command.linear_mps == 0.0 for command in commands)
    assert abs(pose.yaw - 1.5) <= limits.yaw_goal_tolerance_rad


def test_a_turn_at_the_goal_that_would_hit_something_gives_no_command() -> None:
    controller = StopRotate(dwa())
    controller.has_arrived((1.025, 2.025), Pose2D(1.025, 2.025, 0.0))
    assert controller.command(wedged(), 1.5, Pose2D(1.025, 2.025, 0.0), Command(0.0, 0.0)) is None
