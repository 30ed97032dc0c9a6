"""Detectors on scans made by hand: a square room with a round intruder in it."""

import math

import numpy as np
import numpy.typing as npt
import pytest

from midnet_bench.detectors.baselines import CircleClusters, MapSubtraction, RunningMean, cut_around
from midnet_bench.detectors.detector_node import WallEvidence
from midnet_bench.errors import InputError
from midnet_bench.geometry import LidarGeometry, Pose2D, Scan
from midnet_bench.grid import OccupancyGrid, cells_of
from midnet_bench.midnet.pipeline import Observation
from midnet_bench.robots.turtlebot3 import LDS_01

HALF_M = 2.0  # from the middle of the room to its walls
RANGE_M = 2.5


def room() -> OccupancyGrid:
    """Walls one cell thick whose inner faces are HALF_M from the middle, cells of 5 cm."""
    cells = np.zeros((82, 82), dtype=np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    return OccupancyGrid(cells, 0.05, (-2.05, -2.05))


def scan_of(pose: Pose2D, discs: list[tuple[float, float, float]], stamp_s: float = 0.0) -> Scan:
    """What the LiDAR of a robot at ``pose`` meets: walls and discs (x, y, radius), without noise."""
    sensor = pose.compose(LDS_01.mount)
    angles = sensor.yaw + LDS_01.angles_rad
    along = np.column_stack((np.cos(angles), np.sin(angles)))
    to_each = (HALF_M - np.sign(along) * (sensor.x, sensor.y)) / np.maximum(np.abs(along), 1e-12)
    to_walls = to_each.min(axis=1)
    ranges_m: npt.NDArray[np.float64] = to_walls
    for x, y, radius in discs:
        offset = np.array([x - sensor.x, y - sensor.y])
        nearest = along @ offset
        miss2 = offset @ offset - nearest**2
        entry = nearest - np.sqrt(np.maximum(radius**2 - miss2, 0.0))
        ranges_m = np.where((miss2 < radius**2) & (nearest > 0), np.minimum(ranges_m, entry), ranges_m)
    return Scan(ranges_m, LDS_01, pose, stamp_s)


MIDDLE = Pose2D(0.0, 0.0, 0.0)


def seen(scan: Scan | None, pose: Pose2D = MIDDLE) -> Observation:
    return Observation(pose, room(), scan)


DISC = (1.0, 0.5, 0.1)
DETECTORS = [MapSubtraction, CircleClusters, RunningMean]


@pytest.mark.parametrize("make", DETECTORS)
@pytest.mark.parametrize("yaw", [0.0, 1.0, math.pi])
def test_one_intruder_is_one_box_on_it_and_walls_are_none(make, yaw: float) -> None:
    pose = Pose2D(-0.3, 0.2, yaw)
    empty, full = scan_of(pose, []), scan_of(pose, [DISC], 0.2)
    detector = make(room(), RANGE_M)
    (nothing,) = detector.detect([seen(empty, pose)])
    assert len(nothing) == 0
    (found,) = detector.detect([seen(full, pose)])
    assert np.shape(found) == (1, 4)
    x_min, y_min, x_max, y_max = found[0]
    assert x_min < 0.95
    assert y_min < 0.5
    assert 0.85 < x_min < x_max < 1.15
    assert 0.35 < y_min < y_max < 0.65


@pytest.mark.parametrize("make", DETECTORS)
def test_each_robot_has_its_own_boxes_and_one_that_saw_nothing_has_none(make) -> None:
    left, right = Pose2D(-0.3, 0.2, 0.0), Pose2D(0.4, -0.5, 2.0)
    team = [
        seen(scan_of(left, [DISC]), left),
        seen(None),
        seen(scan_of(right, [DISC, (-1.0, -1.0, 0.1)]), right),
    ]
    assert [len(own) for own in make(room(), RANGE_M).detect(team)] == [1, 0, 2]
    assert make(room(), RANGE_M).detect([]) == []


@pytest.mark.parametrize("make", DETECTORS)
def test_what_is_farther_than_the_usable_range_is_not_looked_at(make) -> None:
    (found,) = make(room(), 0.8).detect([seen(scan_of(MIDDLE, [DISC]))])
    assert len(found) == 0


def test_a_circle_is_the_whole_body_and_not_the_side_that_was_seen() -> None:
    pose = Pose2D(-0.3, 0.2, 0.0)
    (found,) = CircleClusters(room(), RANGE_M).detect([seen(scan_of(pose, [DISC]), pose)])
    np.testing.assert_allclose(found, [[0.9, 0.4, 1.1, 0.6]], atol=0.01)


def test_a_single_return_is_left_out_where_two_are_asked_for() -> None:
    scan = scan_of(MIDDLE, [])
    scan.ranges_m[40] = 1.0
    one, two = (MapSubtraction(room(), RANGE_M, min_returns=n).detect([seen(scan)])[0] for n in (1, 2))
    assert (len(one), len(two)) == (1, 0)


def test_the_background_swallows_what_stands_still_and_map_subtraction_does_not() -> None:
    pose = Pose2D(-0.3, 0.2, 0.0)
    background, subtraction = RunningMean(room(), RANGE_M), MapSubtraction(room(), RANGE_M)
    counts = []
    for step in range(100):
        team = [seen(scan_of(pose, [DISC], 0.2 * step), pose)]
        counts.append((len(background.detect(team)[0]), len(subtraction.detect(team)[0])))
    assert {one for one, _ in counts[:30]} == {1}
    assert {one for one, _ in counts[40:]} == {0}, "0.69 of ten seconds are over"
    assert {other for _, other in counts} == {1}


def test_a_return_on_a_cells_edge_is_in_the_cell_that_the_grid_says() -> None:
    grid = OccupancyGrid(np.zeros((40, 40), np.int8), 0.05, (0.0, 0.0))
    background = RunningMean(grid, RANGE_M)
    for cell in range(1, 40):
        point = np.array([[round(cell * 0.05, 2), 0.025]])  # 0.15 / 0.05 is below 3
        assert cells_of(grid, point).tolist() == [[cell, 0]]
        assert np.flatnonzero(background._marked(point)[0]).tolist() == [cell]


def test_groups_are_cut_where_returns_are_apart_and_go_round() -> None:
    for apart, groups in (
        ([0, 0, 1, 0, 1], [[2, 3], [4, 0, 1]]),
        ([1, 0, 1, 0, 0], [[0, 1], [2, 3, 4]]),
        ([0, 0], [[0, 1]]),
        ([], []),
    ):
        assert [group.tolist() for group in cut_around(np.array(apart, bool))] == groups


def test_clusters_refuse_an_incidence_below_the_angle_between_beams() -> None:
    with pytest.raises(InputError, match=r"incidence_deg: 0\.5 is out of range"):
        CircleClusters(room(), RANGE_M, incidence_deg=0.5).detect([seen(scan_of(MIDDLE, [DISC]))])


@pytest.mark.parametrize("off_m", [0.0, 0.1, 0.2])
def test_a_wall_beside_its_place_on_the_map_says_nothing_and_a_leg_before_a_wall_does(off_m: float) -> None:
    evidence = WallEvidence(room(), 0.005)
    for scan in (scan_of(MIDDLE, []), scan_of(MIDDLE, [(1.7, 0.0, 0.06)])):
        is_leg = np.flatnonzero(scan.ranges_m < scan_of(MIDDLE, []).ranges_m)
        shares = evidence.shares(scan._replace(pose=Pose2D(-off_m, 0.0, 0.0)))
        assert np.delete(shares, is_leg).max() == 0.0
        assert (shares[is_leg].sum() >= 2.0) == (len(is_leg) > 0)
        assert np.array_equal(shares, np.round(shares * 1024) / 1024)


def test_evidence_takes_any_scan_and_any_map() -> None:
    scan, empty = scan_of(MIDDLE, [DISC]), OccupancyGrid(np.zeros((82, 82), np.int8), 0.05, (-2.05, -2.05))
    nothing = scan._replace(ranges_m=np.full(len(scan.ranges_m), math.inf))
    assert WallEvidence(room(), 0.005).shares(nothing).shape == (0,)
    assert WallEvidence(empty, 1e-6).shares(scan).min() == 1.0
    one = scan._replace(ranges_m=np.where(np.arange(len(scan.ranges_m)) == 7, scan.ranges_m, math.inf))
    assert WallEvidence(room(), 0.005).shares(one).tolist() == [0.0]


@pytest.mark.parametrize("make", [MapSubtraction, CircleClusters])
@pytest.mark.parametrize(("beams", "boxes"), [(360, 2), (354, 3)])
def test_the_first_beam_follows_the_last_one_in_a_full_turn_alone(make, beams: int, boxes: int) -> None:
    """Two returns on each side of straight behind, where 354 beams have a gap, and some ahead."""
    step_rad = math.radians(1.0)
    lidar = LidarGeometry(beams, -step_rad * (beams - 1) / 2.0, step_rad, 0.1, 8.0, MIDDLE)
    ranges_m = np.full(beams, np.inf)
    ranges_m[[0, 1, beams // 2, beams // 2 + 1, -2, -1]] = 1.0
    (found,) = make(room(), RANGE_M).detect([seen(Scan(ranges_m, lidar, MIDDLE, 0.0))])
    assert len(found) == boxes
