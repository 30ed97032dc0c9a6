"""Graph SLAM: the correlative match, loops, and a slip of the wheels that GMapping does not survive."""

import gzip
import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from benchmarks import wide_halls
from benchmarks.recorded_log import drawn_slips, with_slip
from benchmarks.relations import Relation, read_dense_odometry, read_relations, relations_error
from midnet_bench.errors import InputError
from midnet_bench.geometry import LidarGeometry, Pose2D, wrap_angle
from midnet_bench.io.scan_logs import LoggedScan, ScanLog, Trajectory, half_circle, read_scan_log
from midnet_bench.mapping.correlative_matcher import BLOCK_CELLS, CELL_M, FULL, Window, hit_field, match
from midnet_bench.mapping.graph_slam import GraphSlam
from midnet_bench.mapping.grid_slam import ORIGIN
from midnet_bench.mapping.log_mapping import MappingResult, map_scans
from midnet_bench.robots.turtlebot3 import LDS_01
from tests.mapping.gmapping_room import ROOM, ROUND_TRIP, Drive, cast, drive

pytestmark = pytest.mark.slow  # compiled loops
INTEL = Path(__file__).parents[2].parent / "shared" / "data" / "intel"
LIDAR = half_circle(180)


def hits_from(pose: Pose2D) -> np.ndarray:
    ranges = cast(ROOM, pose, LIDAR.angles_rad)
    return ranges[:, None] * LIDAR.directions


def test_a_field_is_full_at_hits_and_its_blocks_hold_their_greatest_cell() -> None:
    hits = hits_from(Pose2D(1.0, 1.0, 0.5))
    field = hit_field(hits)
    columns, rows = np.floor((hits - field.corner) / CELL_M).astype(int).T
    assert field.fine[rows, columns].min() > 0.8 * FULL
    assert field.fine[0].max() == 0
    for row, column in ((0, 0), (20, 31), (field.fine.shape[0] - 3, 7)):
        block = field.fine[row : row + BLOCK_CELLS, column : column + BLOCK_CELLS]
        assert field.coarse[row, column] == block.max()
    assert (field.coarse >= field.fine).all()


@pytest.mark.parametrize("slip", [Pose2D(-0.4, 0.45, -0.5), Pose2D(0.0, 0.0, 3.0)])
def test_the_match_is_found_wherever_in_the_window_it_lies(slip: Pose2D) -> None:
    truth = Pose2D(1.0, 1.0, 0.5)
    seen = Pose2D(1.15, 1.1, 0.6)
    field = hit_field(truth.transform(hits_from(truth)))
    found = match(field, hits_from(seen), seen.compose(slip), Window(0.8, 3.2, 0.01, 0.01))
    assert found.pose.distance_to(seen) < 0.04
    assert abs(math.remainder(found.pose.yaw - seen.yaw, 2.0 * math.pi)) < 0.01
    assert found.score > 0.8


def test_where_nothing_tells_the_pose_the_odometry_does() -> None:
    """Between two long walls the pull holds the place along them."""
    wall = np.stack([np.linspace(-10.0, 10.0, 400), np.ones(400)], axis=1)
    walls = np.concatenate([wall, wall * (1.0, -1.0)])
    short = walls[np.abs(walls[:, 0]) < 5.0]
    found = match(hit_field(walls), short, Pose2D(0.13, 0.1, 0.05), Window(0.6, 0.3, 0.5, 0.5))
    assert found.pose.y == pytest.approx(0.0, abs=0.02)
    assert found.pose.yaw == pytest.approx(0.0, abs=0.006)
    assert found.pose.x == pytest.approx(0.13, abs=0.05)


@pytest.fixture(scope="module")
def journey() -> Drive:
    """Round the pillar of the room, and on where the way began."""
    corners = [*ROUND_TRIP, ROUND_TRIP[0]]
    return drive(ROOM, LIDAR, Pose2D(1.0, 1.0, 0.0), corners, np.random.default_rng(5))


def log_of(journey: Drive, slip: Pose2D = ORIGIN) -> ScanLog:
    """Every fourth scan of a drive, as a log; with a slip of the wheels half way."""
    taken = zip(journey.stamps_s, journey.odometry, journey.ranges_m, strict=True)
    scans = [LoggedScan(*scan) for scan in taken][::4]
    place = len(scans) // 2
    before = scans[place - 1].odometry
    moved = before.compose(slip).compose(before.inverse())
    scans[place:] = [scan._replace(odometry=moved.compose(scan.odometry)) for scan in scans[place:]]
    return ScanLog(Path("room.log"), LIDAR, scans)


def worst_error_m(journey: Drive, result: MappingResult) -> float:
    trajectory = result.trajectory
    truth = [journey.truth[round(stamp_s / journey.stamps_s[1])] for stamp_s in trajectory.stamps_s]
    return max(trajectory.pose(k).distance_to(pose) for k, pose in enumerate(truth))


@pytest.mark.parametrize("slip", [Pose2D(0.3, 0.3, 0.8), Pose2D(0.3, 0.0, 2.5)], ids=str)
def test_graph_slam_survives_a_slip_and_says_so(slip: Pose2D, journey: Drive) -> None:
    result = map_scans(log_of(journey, slip))
    assert worst_error_m(journey, result) < 0.06
    (line,) = result.warnings
    assert "off the wheels: they slipped" in line


def test_a_slip_loses_gmapping_and_the_map_is_said_to_be_broken(journey: Drive) -> None:
    result = map_scans(log_of(journey, Pose2D(0.3, 0.3, 0.8)), 5, seed=1)
    assert worst_error_m(journey, result) > 1.0
    assert any("the map may be broken" in line for line in result.warnings)


@pytest.mark.parametrize("kind", ["hall", "square"])
def test_along_a_bare_wall_the_wheels_hold_the_robot(kind: str) -> None:
    """A Burger's LiDAR sees one wall of a hall: matches slide along it, to metres of error before."""
    log, truth = wide_halls.drive(kind, 9001, LDS_01)
    result = map_scans(beginning(log, 0.35))
    assert wide_halls.errors_m(result, truth).mean() < 0.3
    assert result.warnings == log.warnings


def beginning(log: ScanLog, share: float) -> ScanLog:
    return replace(log, scans=log.scans[: round(share * len(log))])


def test_at_a_corner_into_the_unknown_the_wheels_are_believed() -> None:
    """The corridor behind fits the view into the one ahead; nothing contradicts the turn by the wheels."""
    forward = LidarGeometry(181, -math.pi / 2.0, math.pi / 180.0, 0.1, 20.0, Pose2D(0.0, 0.0, 0.0))
    log, truth = wide_halls.drive("square", 9002, forward)
    result = map_scans(beginning(log, 0.3))
    headings = np.array([truth[number - 1].yaw for number in result.integrated])
    turned = np.abs(np.vectorize(wrap_angle)(result.trajectory.poses[:, 2] - headings))
    assert turned.max() < 0.3


def test_few_beams_are_refused() -> None:
    few = LidarGeometry(31, -math.pi / 2.0, math.pi / 30.0, 0.1, 20.0, Pose2D(0.0, 0.0, 0.0))
    log, _ = wide_halls.drive("hall", 9001, few)
    with pytest.raises(InputError, match=r"31 beams .*--slam gmapping"):
        map_scans(log)


def test_looking_on_changes_nothing_and_the_map_drawn_on_the_way_is_the_map(journey: Drive) -> None:
    log = log_of(journey)
    slam = GraphSlam(log.geometry, log.scans[0].odometry)
    for scan in log:
        slam.process(scan.odometry, scan.ranges_m, scan.stamp_s)
        if len(slam.scores) % 10 == 0:
            slam.occupancy()
    slam.finish()
    on_the_way, anew = slam.occupancy(), slam.occupancy(anew=True)
    result = map_scans(log)
    assert result.warnings == []
    assert worst_error_m(journey, result) < 0.06
    assert anew.data.tobytes() == result.grid.data.tobytes()
    assert slam.trajectory.poses.tobytes() == result.trajectory.poses.tobytes()
    walls = [np.count_nonzero(grid.data == 100) for grid in (on_the_way, anew)]
    assert walls[0] == pytest.approx(walls[1], rel=0.1)
    assert math.isnan(slam.scores[0])
    assert 0.5 < min(slam.scores[1:]) <= max(slam.scores[1:]) <= 1.0
    last = round(log.scans[-1].stamp_s / journey.stamps_s[1])
    assert slam.best_pose.distance_to(journey.truth[last]) < 0.06


def test_scans_that_see_nothing_follow_the_wheels() -> None:
    poses = [Pose2D(0.4 * k, 0.0, 0.0) for k in range(30)]
    slam = GraphSlam(LIDAR, poses[0])
    for k, pose in enumerate(poses):
        slam.process(pose, np.full(180, np.inf), float(k))
    slam.finish()
    np.testing.assert_allclose(slam.trajectory.poses, poses, atol=1e-9)
    assert all(map(math.isnan, slam.scores))


class RealLog(NamedTuple):
    scans: ScanLog
    odometry: Trajectory  # all of its readings
    relations: list[Relation]

    def error_m(self, trajectory: Trajectory) -> float:
        error = relations_error(self.relations, trajectory, self.odometry)
        assert error.relations > 2 * len(self.scans)
        return error.mean_m


@pytest.fixture(scope="module")
def intel(tmp_path_factory: pytest.TempPathFactory) -> RealLog:
    """The first 120 scans of a real log: the Intel Research Lab in Seattle."""
    if not (INTEL / "intel_scans.txt.gz").exists():
        pytest.skip("the Intel Research Lab log is not beside the checkout")
    lines = gzip.decompress((INTEL / "intel_scans.txt.gz").read_bytes()).decode().splitlines()
    path = tmp_path_factory.mktemp("intel") / "part.txt"
    path.write_text("\n".join(lines[:121]), encoding="utf-8")
    odometry = read_dense_odometry(INTEL / "intel_odom_dense.txt.gz")
    return RealLog(read_scan_log(path), odometry, read_relations(INTEL / "intel.relations"))


def test_gmapping_maps_a_real_log(intel: RealLog) -> None:
    """GMapping 0.03 m, raw odometry 0.9 m."""
    stamps_s, poses = (np.array([scan[k] for scan in intel.scans]) for k in (0, 1))
    assert intel.error_m(Trajectory(stamps_s, poses)) == pytest.approx(0.90, abs=0.02)
    assert intel.error_m(map_scans(intel.scans, particles=5, seed=0).trajectory) < 0.045


def test_a_real_log_with_slips_is_mapped_as_well_as_without(intel: RealLog) -> None:
    log, odometry = beginning(intel.scans, 2 / 3), intel.odometry
    intel = intel._replace(scans=log)
    as_it_is = intel.error_m(map_scans(log).trajectory)
    for place, slip in drawn_slips(len(log), 11):
        log, odometry = with_slip(log, odometry, place, slip)
    slipped = intel._replace(odometry=odometry).error_m(map_scans(log).trajectory)
    assert as_it_is < 0.04
    assert slipped == pytest.approx(as_it_is, abs=0.01)
