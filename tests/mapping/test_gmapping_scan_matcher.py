"""The compiled scan matcher against plain Python written from the formulas."""

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from midnet_bench.geometry import Pose2D
from midnet_bench.mapping.grid_slam import hill_climb, rotate, trace_line
from midnet_bench.mapping.mapping_settings import BURGER_UKF, RECORDED_LOG
from midnet_bench.mapping.particle_map import (
    ParticleMaps,
    climb,
    log_likelihood,
    match_particles,
    match_score,
    matching_in_cells,
)
from tests.mapping.gmapping_room import ROOM, cast

CELL_M = 0.05
Points = npt.NDArray[np.float64]


class SlowMap:
    """Hit points by cell of the lattice through the map's origin, as the formulas speak of them."""

    def __init__(self, points_m: Points) -> None:
        self.cells: dict[tuple[int, int], list[Points]] = {}
        for point in points_m:
            self.cells.setdefault(self.cell(point), []).append(point)

    @staticmethod
    def cell(point: Points) -> tuple[int, int]:
        return math.floor(point[0] / CELL_M), math.floor(point[1] / CELL_M)

    def nearest_squared(self, point: Points) -> float | None:
        column, row = self.cell(point)
        around = [(column + i, row + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        means = [np.mean(self.cells[cell], axis=0) for cell in around if cell in self.cells]
        return min((float(((mean - point) ** 2).sum()) for mean in means), default=None)

    def score(self, points_m: Points, sigma_m2: float) -> float:
        squares = [self.nearest_squared(point) for point in points_m]
        return sum(math.exp(-squared / sigma_m2) for squared in squares if squared is not None)

    def likelihood(self, points_m: Points, sigma_m2: float) -> float:
        squares = [self.nearest_squared(point) for point in points_m]
        return sum(-0.5 / sigma_m2 if squared is None else -squared / sigma_m2 for squared in squares)


def placed(pose: Pose2D, ends_m: Points) -> Points:
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    return np.array([pose.x, pose.y]) + ends_m @ np.array([[cos, sin], [-sin, cos]])


def mapped(pose: Pose2D, ends_m: Points) -> ParticleMaps:
    maps = ParticleMaps(1, CELL_M)
    maps.register(np.array([pose]), ends_m, len(ends_m))
    return maps


@pytest.mark.parametrize("seed", range(5))
def test_score_and_likelihood_equal_the_slow_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = Pose2D(*rng.uniform(-3.0, 3.0, 3))
    ends = rng.uniform(-2.0, 2.0, (600, 2))
    maps, slow = mapped(pose, ends), SlowMap(placed(pose, ends))
    beams = ends[::3] + rng.normal(0.0, 0.1, (200, 2))
    beams[:5] += 100.0  # far outside the map
    guess = Pose2D(pose.x + 0.07, pose.y - 0.03, pose.yaw + 0.05)
    x, y, yaw = maps.to_cells(np.array([guess]))[0]
    rotated = np.empty_like(beams)
    rotate(beams / CELL_M, yaw, rotated)
    points = placed(guess, beams)

    score = match_score(maps.means, maps.tables[0], rotated, x, y, 0.05 / CELL_M**2, 0.0)
    assert score == pytest.approx(slow.score(points, 0.05), rel=1e-5)
    likelihood = log_likelihood(maps.means, maps.tables[0], rotated, x, y, 0.075 / CELL_M**2, -0.5 / 0.075)
    assert likelihood == pytest.approx(slow.likelihood(points, 0.075), rel=1e-5)
    assert 0.0 < score < 195.0


def test_beams_that_meet_nothing_score_0_and_cost_half_over_sigma() -> None:
    maps = mapped(Pose2D(0.0, 0.0, 0.0), np.array([[1.0, 0.0]]))
    beams = np.tile([-30.0, 0.0], (180, 1))
    x, y, _ = maps.to_cells(np.zeros((1, 3)))[0]
    assert match_score(maps.means, maps.tables[0], beams, x, y, 20.0, 0.0) == 0.0
    likelihood = log_likelihood(maps.means, maps.tables[0], beams, x, y, 30.0, -0.5 / 0.075)
    assert likelihood == pytest.approx(-1200.0)


def test_a_score_that_cannot_be_enough_is_given_up() -> None:
    maps = mapped(Pose2D(0.0, 0.0, 0.0), np.array([[1.0, 0.0], [0.0, 1.0]]))
    beams = np.array([[20.0, 0.0], [0.0, 20.0]])
    x, y, _ = maps.to_cells(np.zeros((1, 3)))[0]
    full = match_score(maps.means, maps.tables[0], beams, x, y, 20.0, 0.0)
    assert full == pytest.approx(2.0)
    assert match_score(maps.means, maps.tables[0], beams, x, y, 20.0, 1.9) == full
    assert match_score(maps.means, maps.tables[0], beams, x, y, 20.0, 2.0) == 0.0


def room_scan(pose: Pose2D, beams: int = 360) -> Points:
    angles = 2.0 * math.pi / beams * np.arange(beams)
    ranges = cast(ROOM, pose, angles)
    return np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)])


@pytest.mark.parametrize("offset", [(0.06, -0.04, 0.03), (-0.05, 0.05, -0.05), (0.0, 0.08, 0.0)])
def test_the_climb_finds_back_to_a_known_offset(offset: tuple[float, float, float]) -> None:
    pose = Pose2D(1.7, 2.3, 0.4)
    ends = room_scan(pose)
    maps = mapped(pose, ends)
    start = maps.to_cells(np.array([pose]) + offset)
    matched, likelihoods, _ = match_particles(
        maps.means, maps.tables, ends / CELL_M, start, matching_in_cells(RECORDED_LOG)
    )
    x, y, yaw = maps.to_metres(matched)[0]
    assert math.hypot(x - pose.x, y - pose.y) < 0.004
    assert yaw == pytest.approx(pose.yaw, abs=0.004)
    assert likelihoods[0] > -1.0


def test_the_climb_never_ends_below_its_start_and_reports_the_score_of_its_end() -> None:
    pose = Pose2D(1.7, 2.3, 0.4)
    ends = room_scan(pose) / CELL_M
    maps = mapped(pose, ends * CELL_M)
    matching = matching_in_cells(RECORDED_LOG)
    rotated = np.empty_like(ends)
    for seed in range(10):
        shift = np.random.default_rng(seed).normal(0.0, 0.15, 3)
        x, y, yaw = start = Pose2D(*maps.to_cells(np.array([pose]) + shift)[0])
        rotate(ends, yaw, rotated)
        before = match_score(maps.means, maps.tables[0], rotated, x, y, matching.sigma, 0.0)
        (x, y, yaw), score = climb(maps.means, maps.tables[0], ends, start, matching)
        rotate(ends, yaw, rotated)
        after = match_score(maps.means, maps.tables[0], rotated, x, y, matching.sigma, 0.0)
        assert score == pytest.approx(after)
        assert score >= before


def test_a_match_at_or_below_the_minimum_score_leaves_the_particle_where_it_was() -> None:
    pose = Pose2D(1.7, 2.3, 0.4)
    ends = room_scan(pose)
    maps = mapped(pose, ends)
    start = maps.to_cells(np.array([pose]) + np.array([0.04, 0.0, 0.0]))
    for minimum, moves in ((350.0, True), (360.0, False)):
        matching = matching_in_cells(replace(RECORDED_LOG, minimum_score=minimum))
        matched, _, _ = match_particles(maps.means, maps.tables, ends / CELL_M, start, matching)
        assert (matched[0, 0] != start[0, 0]) == moves


def test_the_odometry_holds_against_the_pull_of_a_corridor() -> None:
    """The far ends of two parallel walls are new: the score alone slides back to where more is known."""
    walls = np.array([(-50.0, -1.0, 50.0, -1.0), (-50.0, 1.0, 50.0, 1.0)])
    angles = 2.0 * math.pi / 360 * np.arange(360)

    def scan(x: float) -> Points:
        ranges = cast(walls, Pose2D(x, 0.0, 0.0), angles)
        near, r = angles[ranges < 3.0], ranges[ranges < 3.0]
        return np.column_stack([r * np.cos(near), r * np.sin(near)])

    maps = mapped(Pose2D(0.0, 0.0, 0.0), scan(0.0))
    ends = scan(0.4)
    slid = []
    for reliability in (0.0, 20.0):
        settings = replace(RECORDED_LOG, sigma_m2=0.0025, linear_reliability=reliability)
        matched, _, _ = match_particles(
            maps.means,
            maps.tables,
            ends / CELL_M,
            maps.to_cells(np.array([[0.4, 0.0, 0.0]])),
            matching_in_cells(settings),
        )
        slid.append(abs(maps.to_metres(matched)[0, 0] - 0.4))
    assert slid[1] < 0.05 < slid[0]


def test_a_trusted_heading_is_hardly_turned_by_one_scan() -> None:
    """Turned by 0.01 rad: the walls tell, and how far the match goes back is a matter of trust."""
    pose = Pose2D(1.7, 2.3, 0.4)
    ends = room_scan(pose)
    maps = mapped(pose, ends)
    start = maps.to_cells(np.array([pose]) + np.array([0.0, 0.0, 0.01]))
    left_rad = []
    for reliability in (0.0, 1e3, 1e6):
        matching = matching_in_cells(replace(BURGER_UKF, angular_reliability=reliability))
        matched, _, _ = match_particles(maps.means, maps.tables, ends / CELL_M, start, matching)
        left_rad.append(matched[0, 2] - pose.yaw)
    assert abs(left_rad[0]) < 0.001 < left_rad[1] < left_rad[2]
    assert left_rad[2] == pytest.approx(0.01, abs=1e-4)


def test_the_price_of_a_beam_into_the_unknown() -> None:
    pose = Pose2D(1.7, 2.3, 0.4)
    ends = room_scan(pose)
    maps = mapped(pose, ends)
    lost = maps.to_cells(np.array([[200.0, 0.0, 0.0]]))
    for settings, expected in ((RECORDED_LOG, -0.5 / 0.075), (BURGER_UKF, -0.02 / 0.01)):
        _, likelihoods, _ = match_particles(
            maps.means, maps.tables, ends / CELL_M, lost, matching_in_cells(settings)
        )
        assert likelihoods[0] == pytest.approx(len(ends) * expected)


@pytest.mark.parametrize(
    ("end", "expected"),
    [
        ((0, 0), []),
        ((3, 0), [(0, 0), (1, 0), (2, 0)]),
        ((0, -2), [(0, 0), (0, -1)]),
        ((-2, -2), [(0, 0), (-1, -1)]),
        ((6, 2), [(0, 0), (1, 0), (2, 1), (3, 1), (4, 1), (5, 2)]),
    ],
)
def test_a_line_visits_the_cells_before_its_end(
    end: tuple[int, int], expected: list[tuple[int, int]]
) -> None:
    cells = np.zeros((9, 2), dtype=np.int64)
    count = trace_line(0, 0, end[0], end[1], cells)
    assert [(int(c), int(r)) for c, r in cells[:count]] == expected


def test_a_climb_that_odometry_holds_as_hard_as_can_be_stays() -> None:
    pose = Pose2D(1.7, 2.3, 0.4)
    ends = room_scan(pose) / CELL_M
    maps = mapped(pose, ends * CELL_M)
    held = matching_in_cells(replace(RECORDED_LOG, angular_reliability=1e9, linear_reliability=1e9))
    start = Pose2D(*maps.to_cells(np.array([pose]) + 0.1)[0])
    assert climb(maps.means, maps.tables[0], ends, start, held)[0] == start


def test_the_hill_climb_takes_the_best_of_six_steps_and_halves_them() -> None:
    tried: list[tuple[float, ...]] = []

    def score(goal_x: float, pose: Pose2D, enough: float) -> float:
        tried.append(tuple(pose))
        return -abs(pose.x - goal_x) - abs(pose.y) - abs(pose.yaw)

    assert hill_climb(score, 0.75, Pose2D(0.0, 0.0, 0.0), 1.0, 1.0, 2) == ((0.75, 0.0, 0.0), 0.0)
    assert tried[:4] == [(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, -1, 0)]
    assert tried[4:7] == [(0, 1, 0), (0, 0, 1), (0, 0, -1)]
    assert hill_climb(score, 0.75, Pose2D(0.0, 0.0, 0.0), 1.0, 1.0, 1)[0].x == 1.0
