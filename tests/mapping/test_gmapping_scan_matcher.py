"""The compiled scan matcher against plain Python written from the formulas."""

import math
from dataclasses import asdict, replace

import numpy as np
import numpy.typing as npt
import pytest

from midnet_bench.geometry import Pose2D
from midnet_bench.mapping.gmapping import (
    ParticleMaps,
    log_likelihood,
    match_particles,
    match_score,
    matching_in_cells,
)
from midnet_bench.mapping.grid_slam import hill_climb, rotate, trace_rays
from midnet_bench.mapping.mapping_settings import BURGER_UKF, RECORDED_LOG
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


def matched(
    maps: ParticleMaps, ends_m: Points, start: Pose2D, **changes: float
) -> tuple[Pose2D, float, float]:
    """Where a particle at ``start`` ends up, its log-likelihood and its score."""
    matching = matching_in_cells(replace(RECORDED_LOG, **changes))  # type: ignore[arg-type]
    at = maps.to_cells(np.array([start]))
    found, likelihoods, scores = match_particles(maps.means, maps.tables, ends_m / CELL_M, at, matching)
    return Pose2D(*maps.to_metres(found)[0].tolist()), float(likelihoods[0]), float(scores[0])


@pytest.mark.parametrize("seed", range(3))
def test_score_and_likelihood_equal_the_slow_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = Pose2D(*rng.uniform(-3.0, 3.0, 3))
    ends = rng.uniform(-2.0, 2.0, (600, 2))
    maps, slow = mapped(pose, ends), SlowMap(placed(pose, ends))
    beams = ends[::3] + rng.normal(0.0, 0.1, (200, 2))
    beams[:5] += 100.0  # far outside the map
    guess = Pose2D(pose.x + 0.07, pose.y - 0.03, pose.yaw + 0.05)
    x, y, yaw = maps.to_cells(np.array([guess]))[0]
    rotated = rotate(beams / CELL_M, yaw)
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


POSE = Pose2D(1.7, 2.3, 0.4)


def moved(dx: float, dy: float, turn: float) -> Pose2D:
    return Pose2D(POSE.x + dx, POSE.y + dy, POSE.yaw + turn)


@pytest.mark.parametrize("offset", [(0.06, -0.04, 0.03), (-0.05, 0.05, -0.05), (0.0, 0.08, 0.0)])
def test_the_climb_finds_back_to_a_known_offset(offset: tuple[float, float, float]) -> None:
    ends = room_scan(POSE)
    found, likelihood, _ = matched(mapped(POSE, ends), ends, moved(*offset))
    assert found.distance_to(POSE) < 0.004
    assert found.yaw == pytest.approx(POSE.yaw, abs=0.004)
    assert likelihood > -1.0


def test_the_climb_never_ends_below_its_start_and_reports_the_score_of_its_end() -> None:
    ends = room_scan(POSE)
    maps = mapped(POSE, ends)

    def scored(pose: Pose2D) -> float:
        x, y, yaw = maps.to_cells(np.array([pose]))[0]
        rotated = rotate(ends / CELL_M, yaw)
        return match_score(maps.means, maps.tables[0], rotated, x, y, 0.05 / CELL_M**2, 0.0)

    for seed in range(10):
        start = moved(*np.random.default_rng(seed).normal(0.0, 0.15, 3).tolist())
        found, _, score = matched(maps, ends, start)
        assert score == pytest.approx(scored(found))
        assert score >= scored(start)


def test_a_match_at_or_below_the_minimum_score_leaves_the_particle_where_it_was() -> None:
    ends = room_scan(POSE)
    for minimum, moves in ((350.0, True), (360.0, False)):
        found, _, _ = matched(mapped(POSE, ends), ends, moved(0.04, 0.0, 0.0), minimum_score=minimum)
        assert (found.x < POSE.x + 0.03) == moves


def test_the_odometry_holds_against_the_pull_of_a_corridor() -> None:
    """The far ends of two parallel walls are new: the score alone slides back to where more is known."""
    walls = np.array([(-50.0, -1.0, 50.0, -1.0), (-50.0, 1.0, 50.0, 1.0)])
    angles = 2.0 * math.pi / 360 * np.arange(360)

    def scan(x: float) -> Points:
        ranges = cast(walls, Pose2D(x, 0.0, 0.0), angles)
        near, r = angles[ranges < 3.0], ranges[ranges < 3.0]
        return np.column_stack([r * np.cos(near), r * np.sin(near)])

    maps, at = mapped(Pose2D(0.0, 0.0, 0.0), scan(0.0)), Pose2D(0.4, 0.0, 0.0)
    free, held = (
        matched(maps, scan(0.4), at, sigma_m2=0.0025, linear_reliability=reliability)[0]
        for reliability in (0.0, 20.0)
    )
    assert abs(held.x - 0.4) < 0.05 < abs(free.x - 0.4)


def test_a_trusted_heading_is_hardly_turned_by_one_scan() -> None:
    """Turned by 0.01 rad: the walls tell, and how far the match goes back is a matter of trust."""
    ends, left_rad = room_scan(POSE), []
    for reliability in (0.0, 1e3, 1e6):
        trust = replace(BURGER_UKF, angular_reliability=reliability)
        found, _, _ = matched(mapped(POSE, ends), ends, moved(0.0, 0.0, 0.01), **asdict(trust))
        left_rad.append(found.yaw - POSE.yaw)
    assert abs(left_rad[0]) < 0.001 < left_rad[1] < left_rad[2]
    assert left_rad[2] == pytest.approx(0.01, abs=1e-4)


def test_a_climb_that_odometry_holds_as_hard_as_can_be_stays() -> None:
    ends, start = room_scan(POSE), moved(0.1, 0.1, 0.1)
    held = {"angular_reliability": 1e9, "linear_reliability": 1e9}
    assert matched(mapped(POSE, ends), ends, start, **held)[0] == pytest.approx(start, abs=1e-12)


def test_the_price_of_a_beam_into_the_unknown() -> None:
    ends = room_scan(POSE)
    for settings, expected in ((RECORDED_LOG, -0.5 / 0.075), (BURGER_UKF, -0.02 / 0.01)):
        _, likelihood, _ = matched(mapped(POSE, ends), ends, Pose2D(200.0, 0.0, 0.0), **asdict(settings))
        assert likelihood == pytest.approx(len(ends) * expected)


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
    cells, _ = trace_rays(np.array([0.5, 0.5, 0.0]), np.array([end], np.float64))
    assert [tuple(cell) for cell in cells.tolist()] == expected


def test_the_hill_climb_takes_the_best_of_six_steps_and_halves_them() -> None:
    tried: list[tuple[float, ...]] = []

    def score(goal_x: float, pose: Pose2D, enough: float) -> float:
        tried.append(tuple(pose))
        return -abs(pose.x - goal_x) - abs(pose.y) - abs(pose.yaw)

    assert hill_climb(score, 0.75, Pose2D(0.0, 0.0, 0.0), 1.0, 1.0, 2) == ((0.75, 0.0, 0.0), 0.0)
    assert tried[:4] == [(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, -1, 0)]
    assert tried[4:7] == [(0, 1, 0), (0, 0, 1), (0, 0, -1)]
    assert hill_climb(score, 0.75, Pose2D(0.0, 0.0, 0.0), 1.0, 1.0, 1)[0].x == 1.0
