import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from midnet_bench.geometry import Pose2D, wrap_angle
from midnet_bench.grid import OccupancyGrid
from midnet_bench.localization.localization_settings import UkfSettings
from midnet_bench.localization.scan_to_map import ScanToMap
from midnet_bench.localization.ukf import PlanarUkf, UkfTeam
from midnet_bench.rng import stream
from midnet_bench.robots.turtlebot3 import LDS_01

LIDAR = LDS_01
CELL_M = 0.05
WALL_M = 0.3  # how thick a room's wall is drawn; its face lies in the first of its cells


def room(width_m, height_m, face_at=0.5, outside=0, cell_m=CELL_M):
    """A map of a room whose wall faces are x = 0, y = 0, x = width, y = height, the first two ``face_at``
    of a cell's width within their cells (0.5: in the middle); ``outside`` is free, unknown or solid.
    """
    wall = max(round(WALL_M / cell_m), 4)
    corner = -(wall - 1 + face_at) * cell_m
    columns, rows = (math.floor((side - corner) / cell_m) + wall for side in (width_m, height_m))
    data = np.full((rows, columns), 100, dtype=np.int8)
    data[wall:-wall, wall:-wall] = 0
    around = 10
    return OccupancyGrid(
        np.pad(data, around, constant_values=outside), cell_m, (corner - around * cell_m,) * 2
    )


def scan(pose, width_m, height_m, discs=(), rng=None, sigma_m=0.01):
    """What an LDS-01 at a robot's pose in that room says; ``discs`` are (x, y, radius) that no map has."""
    sensor = pose.compose(LIDAR.mount)
    angles = sensor.yaw + LIDAR.angles_rad
    c, s = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore", over="ignore"):
        to_x = np.where(c > 0, width_m - sensor.x, -sensor.x) / c
        to_y = np.where(s > 0, height_m - sensor.y, -sensor.y) / s
    ranges = np.minimum(to_x, to_y)
    for x, y, radius in discs:
        dx, dy = x - sensor.x, y - sensor.y
        along, beside = c * dx + s * dy, c * dy - s * dx
        chord = np.sqrt(np.maximum(radius**2 - beside**2, 0.0))
        ranges = np.where((chord > 0.0) & (along > 0.0), np.minimum(ranges, along - chord), ranges)
    if rng is not None:
        ranges = ranges + rng.normal(0.0, sigma_m, LIDAR.beams)
    return np.where(ranges < LIDAR.range_max_m, ranges, np.inf)


def degrees_between(a, b):
    return abs(math.degrees(wrap_angle(a.yaw - b.yaw)))


def is_covariance(matrix):
    return np.array_equal(matrix, matrix.T) and np.linalg.eigvalsh(matrix)[0] > 0.0


@pytest.mark.parametrize("seed", range(10))
def test_a_pose_off_by_20_cm_and_6_degrees_is_found_again(seed):
    rng = stream(seed, "lost")
    truth = Pose2D(*rng.uniform(0.4, 2.6, 2), rng.uniform(-math.pi, math.pi))
    way = rng.uniform(-math.pi, math.pi)
    believed = Pose2D(
        truth.x + 0.2 * math.cos(way), truth.y + 0.2 * math.sin(way), truth.yaw + math.radians(6.0)
    )
    matched, _ = ScanToMap(room(3.0, 3.0)).match(believed, scan(truth, 3.0, 3.0, rng=rng), LIDAR)
    assert matched.distance_to(truth) < 0.01
    assert degrees_between(matched, truth) < 0.3


def test_the_outer_walls_of_an_explored_map_may_be_its_last_cells():
    around = room(8.0, 8.0)
    rest = 10 + round(WALL_M / CELL_M) - 1
    inner = slice(rest, -rest)
    cropped = OccupancyGrid(around.data[inner, inner], CELL_M, (-CELL_M / 2.0, -CELL_M / 2.0))
    truth = Pose2D(1.0, 0.6, 0.7)  # in a corner: no other wall would make up for these
    ranges = scan(truth, 8.0, 8.0, rng=stream(2, "scan"))
    matched, _ = ScanToMap(cropped).match(Pose2D(1.03, 0.64, 0.75), ranges, LIDAR)
    assert matched.distance_to(truth) < 0.004
    assert degrees_between(matched, truth) < 0.3


def test_where_the_map_ends_without_a_wall_nothing_pulls():
    grid = room(3.0, 3.0)
    grid.data[:, grid.width // 2 :] = -1  # the eastern half was never seen
    truth = Pose2D(0.8, 1.8, 0.0)
    ranges = scan(truth, 3.0, 3.0, [(1.9, 1.8, 0.35)], rng=stream(2, "scan"))  # somebody stands at its edge
    matched, covariance = ScanToMap(grid).match(Pose2D(0.84, 1.77, 0.05), ranges, LIDAR)
    assert matched.distance_to(truth) < 0.01
    assert degrees_between(matched, truth) < 0.3
    assert is_covariance(covariance)


def test_along_a_corridor_nothing_is_claimed_and_across_it_is_sure():
    truth = Pose2D(10.0, 0.8, 0.3)
    ranges = scan(truth, 20.0, 1.5, rng=stream(3, "scan"))
    matched, covariance = ScanToMap(room(20.0, 1.5)).match(Pose2D(10.2, 0.85, 0.35), ranges, LIDAR)
    along_m, across_m = np.sqrt(np.diag(covariance)[:2])
    assert along_m > 0.5
    assert across_m < 0.02
    assert is_covariance(covariance)
    assert abs(matched.y - truth.y) < 0.01
    assert abs(matched.x - 10.2) < 0.02  # no reason to move
    assert degrees_between(matched, truth) < 0.3


@pytest.mark.slow
def test_a_corridor_leaves_the_filter_its_own_mind_along_it_only():
    grid, rng = room(20.0, 1.5), stream(4, "corridor")
    rows = np.flatnonzero((grid.data == 0)[:, grid.width // 2])[10:-10]
    for row in (rows[0], rows[-1]):  # an explored map's walls are bumpy
        bumps = np.flatnonzero(rng.random(grid.width) < 0.1)
        grid.data[row, bumps[(bumps > 20) & (bumps < grid.width - 20)]] = 100
    scan_to_map = ScanToMap(grid)
    truth = Pose2D(6.0, 0.75, 0.0)
    ukf = PlanarUkf(Pose2D(6.2, 0.85, 0.0), UkfSettings().suited_to("encoder"))
    team = UkfTeam([ukf])
    for _ in range(200):
        truth = truth.compose(Pose2D(0.04, 0.0, 0.0))
        team.step(np.array([0]), np.array([[0.2, 0.0]]), np.array([[0.0, 0.0]]), 0.2)
        ukf.correct_pose(*scan_to_map.match(ukf.pose, scan(truth, 20.0, 1.5, rng=rng), LIDAR))
    assert ukf.pose.x - truth.x == pytest.approx(0.2, abs=0.02)
    assert ukf.pose.y == pytest.approx(0.75, abs=0.01)


def test_things_that_the_map_does_not_have_lose_their_say():
    truth = Pose2D(1.2, 1.4, 0.5)
    afar = [(2.0, 1.6, 0.4), (1.2, 0.9, 0.1)]
    at_the_north_wall = [(x, 3.0, 0.12) for x in np.arange(0.2, 3.0, 0.3)]
    clear, hidden = scan(truth, 3.0, 3.0), scan(truth, 3.0, 3.0, afar + at_the_north_wall)
    assert 0.35 < np.mean(hidden < clear - 0.03) < 0.5
    matched, _ = ScanToMap(room(3.0, 3.0)).match(Pose2D(1.24, 1.37, 0.55), hidden, LIDAR)
    assert matched.distance_to(truth) < 0.01
    assert degrees_between(matched, truth) < 0.3


def test_among_things_that_the_map_does_not_have_a_match_is_right_or_as_unsure_as_it_says():
    scan_to_map = ScanToMap(room(6.0, 6.0))
    for seed in range(100):
        rng = stream(seed, "crowd")
        truth = Pose2D(*rng.uniform(0.4, 5.6, 2), rng.uniform(-math.pi, math.pi))
        ways = zip(rng.uniform(0.5, 1.5, 4), rng.uniform(-3.14, 3.14, 4), strict=True)
        things = [(truth.x + d * math.cos(a), truth.y + d * math.sin(a), 0.15) for d, a in ways]
        off = rng.uniform(-1.0, 1.0, 3) * (0.14, 0.14, 0.1)
        believed = Pose2D(truth.x + off[0], truth.y + off[1], truth.yaw + off[2])
        found = scan_to_map.match(believed, scan(truth, 6.0, 6.0, things, rng), LIDAR)
        if found is not None:
            matched, covariance = found
            error = np.array([matched.x - truth.x, matched.y - truth.y, wrap_angle(matched.yaw - truth.yaw)])
            assert error @ np.linalg.solve(covariance, error) < 25.0, seed


def test_too_few_beams_on_walls_say_nothing():
    scan_to_map = ScanToMap(room(3.0, 3.0))
    middle = Pose2D(1.5, 1.5, 0.0)
    walled_in = [(1.5 + 0.7 * math.cos(a), 1.5 + 0.7 * math.sin(a), 0.3) for a in np.arange(0.0, 6.0, 0.7)]
    assert scan_to_map.match(middle, scan(middle, 3.0, 3.0, walled_in), LIDAR) is None
    for silent in (np.inf, np.nan, 0.0, LIDAR.range_max_m):
        assert scan_to_map.match(middle, np.full(LIDAR.beams, silent), LIDAR) is None
    assert scan_to_map.match(Pose2D(40.0, 0.0, 0.0), scan(middle, 3.0, 3.0), LIDAR) is None
    without_walls = ScanToMap(OccupancyGrid(np.zeros((60, 60), dtype=np.int8), CELL_M, (0.0, 0.0)))
    assert without_walls.match(middle, scan(middle, 3.0, 3.0), LIDAR) is None


SHARE = st.floats(0.0, 1.0)
SIGNED = st.floats(-1.0, 1.0)


@pytest.mark.slow
@given(
    width_m=st.floats(2.0, 4.5),
    height_m=st.floats(2.0, 4.5),
    at=st.tuples(SHARE, SHARE, SIGNED),
    off=st.tuples(SIGNED, SIGNED, SIGNED),
    face_at=st.floats(0.05, 0.95),
    cell_m=st.sampled_from([0.025, 0.05, 0.1]),
    outside=st.sampled_from([0, -1, 100]),
    seed=st.integers(0, 99),
)
def test_in_any_room_the_pose_is_right_to_a_cell_and_as_sure_as_it_says(
    width_m, height_m, at, off, face_at, cell_m, outside, seed
):
    truth = Pose2D(0.3 + at[0] * (width_m - 0.6), 0.3 + at[1] * (height_m - 0.6), at[2] * math.pi)
    believed = Pose2D(truth.x + 0.05 * off[0], truth.y + 0.05 * off[1], truth.yaw + 0.05 * off[2])
    ranges = scan(truth, width_m, height_m, rng=stream(seed, "scan"))
    matched, covariance = ScanToMap(room(width_m, height_m, face_at, outside, cell_m)).match(
        believed, ranges, LIDAR
    )
    error = np.array([matched.x - truth.x, matched.y - truth.y, wrap_angle(matched.yaw - truth.yaw)])
    # A wall's face is drawn half a cell off at most; the rest is the sensor's noise.
    assert np.all(np.abs(error[:2]) < 0.75 * cell_m + 0.01)
    assert -math.pi <= matched.yaw < math.pi
    assert is_covariance(covariance)
    assert error @ np.linalg.solve(covariance, error) < 25.0


@given(
    ranges=st.lists(st.floats(0.0, 5.0) | st.sampled_from([math.inf, math.nan]), min_size=1, max_size=60),
    pose=st.builds(Pose2D, st.floats(-1.0, 4.0), st.floats(-1.0, 4.0), st.floats(-9.0, 9.0)),
)
def test_whatever_a_scan_says_the_answer_is_finite_or_none(ranges, pose):
    answer = ScanToMap(room(3.0, 3.0)).match(pose, np.resize(ranges, LIDAR.beams), LIDAR)
    if answer is not None:
        matched, covariance = answer
        assert np.all(np.isfinite(matched))
        assert is_covariance(covariance)


@settings(deadline=None, max_examples=30)
@given(quarter=st.integers(1, 3), at=st.tuples(SHARE, SHARE, SIGNED))
def test_turning_the_building_turns_the_answer(quarter, at):
    # A corridor that turns into one along the other axis keeps its blind direction.
    grid = room(6.0, 1.5)
    rows, columns = grid.data.shape
    half = (columns * CELL_M / 2.0, rows * CELL_M / 2.0)
    centred = OccupancyGrid(grid.data, CELL_M, (-half[0], -half[1]))
    turned = np.rot90(grid.data, -quarter)
    corner = (-half[1], -half[0]) if quarter % 2 else (-half[0], -half[1])
    turn = Pose2D(0.0, 0.0, quarter * math.pi / 2.0)
    truth = Pose2D(0.3 + 5.4 * at[0], 0.3 + 0.9 * at[1], at[2] * math.pi)
    ranges = scan(truth, 6.0, 1.5, rng=stream(5, "scan"))
    shift_x, shift_y = (a - b for a, b in zip(grid.origin, centred.origin, strict=True))
    believed = Pose2D(truth.x - shift_x + 0.03, truth.y - shift_y - 0.02, truth.yaw + 0.02)
    straight, covariance = ScanToMap(centred).match(believed, ranges, LIDAR)
    other, other_covariance = ScanToMap(OccupancyGrid(turned, CELL_M, corner)).match(
        turn.compose(believed), ranges, LIDAR
    )
    expected = turn.compose(straight)
    assert other.distance_to(expected) < 1e-6
    assert degrees_between(other, expected) < 1e-4
    c, s = round(math.cos(turn.yaw)), round(math.sin(turn.yaw))
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    np.testing.assert_allclose(other_covariance, rotation @ covariance @ rotation.T, rtol=1e-3, atol=1e-8)


def test_a_robot_with_wrong_wheels_stays_on_the_map():
    start, dt_s = Pose2D(1.0, 0.6, 0.0), 0.1
    settings_ = UkfSettings().suited_to("encoder")
    alone, with_map = filters = PlanarUkf(start, settings_), PlanarUkf(start, settings_)
    team = UkfTeam(filters)
    scan_to_map, rng = ScanToMap(room(3.0, 3.0)), stream(6, "drive")
    truth = start
    for step in range(1200):  # two minutes round a circle, wheels that say 3 % too much
        truth = truth.compose(Pose2D(0.2 * dt_s, 0.0, 0.25 * dt_s))
        twists, imus = [[0.2 * 1.03, 0.25]] * 2, [[wrap_angle(truth.yaw + 0.002), 0.25]] * 2
        team.step(np.arange(2), np.array(twists), np.array(imus), dt_s)
        if step % 2:
            with_map.correct_pose(*scan_to_map.match(with_map.pose, scan(truth, 3.0, 3.0, rng=rng), LIDAR))
        if step > 600:
            assert with_map.pose.distance_to(truth) < 0.015
    assert alone.pose.distance_to(truth) > 0.03
