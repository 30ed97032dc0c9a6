"""The filter as a whole, in a small simulated room with wheels that lie."""

import math
from dataclasses import replace

import numba
import numpy as np
import numpy.typing as npt
import pytest

from midnet_bench.geometry import LidarGeometry, Pose2D
from midnet_bench.mapping.gmapping import (
    GMapping,
    cores,
    effective_particles,
    move_particles,
    noise_deviations,
    normalized_weights,
    systematic_resample,
)
from midnet_bench.mapping.grid_slam import scan_rays
from midnet_bench.mapping.mapping_settings import BURGER_UKF, RECORDED_LOG, GmappingSettings
from midnet_bench.rng import stream
from midnet_bench.robots.turtlebot3 import LDS_01
from tests.mapping.gmapping_room import ROOM, ROUND_TRIP, Drive, drive

LIDAR = LDS_01
START = Pose2D(1.0, 1.0, 0.0)
TURTLEBOT3 = GmappingSettings()
WHEELS = GmappingSettings(
    particles=6,
    max_usable_range_m=4.0,
    sigma_m2=0.05 * 0.05,
    linear_reliability=10.0,
    noise_srr=0.01,
    noise_srt=0.02,
    noise_str=0.01,
    noise_stt=0.02,
    linear_update_m=0.2,
    temporal_update_s=None,
)
"""a Burger without a gyroscope"""


def test_weights_by_hand() -> None:
    weights = normalized_weights(np.array([-100.0, -106.0]), gain=3.0)  # 6 / (3 * 2 particles)
    assert weights == pytest.approx(np.array([1.0, math.exp(-1.0)]) / (1.0 + math.exp(-1.0)))


def test_effective_particles_by_hand() -> None:
    assert effective_particles(np.full(30, 1.0 / 30)) == pytest.approx(30.0)
    assert effective_particles(np.array([0.0, 1.0, 0.0])) == 1.0
    assert effective_particles(np.array([0.5, 0.25, 0.25])) == pytest.approx(1.0 / 0.375)


def test_systematic_resampling_keeps_shares_within_one() -> None:
    for offset in (0.0, 0.5, 0.99):
        assert systematic_resample(np.array([0.5, 0.25, 0.25, 0.0]), offset).tolist() == [0, 0, 1, 2]
    rng = np.random.default_rng(0)
    for _ in range(50):
        weights = rng.dirichlet(np.full(30, 0.2))
        copies = np.bincount(systematic_resample(weights, rng.random()), minlength=30)
        assert copies.sum() == 30
        assert np.abs(copies - 30 * weights).max() < 1.0


SHARES = GmappingSettings(noise_srr=0.1, noise_srt=0.2, noise_str=0.3, noise_stt=0.4)


def test_deviations_of_the_motion_by_hand() -> None:
    x, y, yaw = noise_deviations(Pose2D(-2.0, 0.5, -0.25), SHARES)
    assert x == pytest.approx(0.1 * 2.0 + 0.3 * 0.25 + 0.3 * 0.1 * 0.5)
    assert y == pytest.approx(0.1 * 0.5 + 0.3 * 0.25 + 0.3 * 0.1 * 2.0)
    assert yaw == pytest.approx(0.4 * 0.25 + 0.2 * math.hypot(2.0, 0.5))


def test_draws_have_these_deviations_in_the_old_robot_frame() -> None:
    start, increment = Pose2D(3.0, -1.0, 1.1), Pose2D(0.6, -0.2, 0.3)
    moved = move_particles(np.tile(start, (200_000, 1)), increment, SHARES, np.random.default_rng(0))
    offset = moved - start
    cos, sin = math.cos(start.yaw), math.sin(start.yaw)
    local = np.column_stack([offset[:, :2] @ (cos, sin), offset[:, :2] @ (-sin, cos), offset[:, 2]])
    assert local.mean(axis=0) == pytest.approx(np.array(increment), abs=5e-3)
    assert local.std(axis=0) == pytest.approx(noise_deviations(increment, SHARES), rel=0.01)
    assert np.corrcoef(local.T) == pytest.approx(np.eye(3), abs=0.01)


def test_a_standing_robot_gets_no_noise() -> None:
    poses = np.array([[1.0, 2.0, 0.5], [-1.0, 0.0, -2.0]])
    moved = move_particles(poses, Pose2D(0.0, 0.0, 0.0), RECORDED_LOG, np.random.default_rng(0))
    assert moved == pytest.approx(poses, abs=1e-15)


def test_what_each_kind_of_range_does() -> None:
    geometry = LidarGeometry(8, 0.0, math.pi / 4, 0.12, 3.5, Pose2D(0.0, 0.0, 0.0))
    ranges = np.array([1.0, math.nan, 3.2, 0.0, math.inf, 3.5, 0.1, 2.0])
    rays = scan_rays(geometry, ranges, usable_m=3.0)
    lengths = np.hypot(*rays.ends_m.T)
    bearings = np.arctan2(rays.ends_m[:, 1], rays.ends_m[:, 0]) % (2.0 * math.pi)
    # beams 0 and 7 hit; 2 (beyond the usable range) and 4 (nothing within range) only clear
    assert rays.hits == 2
    assert lengths == pytest.approx([1.0, 2.0, 3.0, 3.0])
    assert bearings == pytest.approx([0.0, 7 * math.pi / 4, math.pi / 2, math.pi], abs=1e-9)


def run(journey: Drive, settings: GmappingSettings, seed: int) -> GMapping:
    slam = GMapping(LIDAR, settings, journey.truth[0], stream(seed, "gmapping"))
    for stamp, odometry, ranges in zip(journey.stamps_s, journey.odometry, journey.ranges_m, strict=True):
        slam.process(odometry, ranges, float(stamp))
    return slam


@pytest.mark.slow
def test_any_number_of_threads_gives_the_same_bytes(journey: Drive) -> None:
    def ran(threads: int) -> GMapping:
        settings = replace(BURGER_UKF, particles=7, linear_update_m=0.1, angular_update_rad=0.1)
        slam = GMapping(LIDAR, settings, journey.truth[0], stream(2, "gmapping"), threads)
        for k in range(0, 40, 2):
            slam.process(journey.odometry[k], journey.ranges_m[k], float(journey.stamps_s[k]))
        return slam

    def said(slam: GMapping) -> list[bytes]:
        maps = slam._maps
        numbers = (maps.tables, maps.means[maps.tables], maps.counts[maps.tables])
        arrays = (slam._poses, slam.trajectory.poses, slam.occupancy().data, *numbers)
        return [array.tobytes() for array in arrays]

    alone = ran(1)
    assert len(alone.trajectory) > 6
    for threads in (2, 40):
        assert said(ran(threads)) == said(alone)


def test_cores_are_those_that_numba_may_use(monkeypatch: pytest.MonkeyPatch) -> None:
    # joblib's workers have one each
    for count in (1, 7):
        monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", count)
        assert cores() == count


@pytest.fixture(scope="module")
def journey() -> Drive:
    return drive(ROOM, LIDAR, START, ROUND_TRIP, np.random.default_rng(7))


@pytest.fixture(scope="module")
def mapped(journey: Drive) -> GMapping:
    return run(journey, WHEELS, seed=0)


@pytest.mark.slow
def test_the_trajectory_is_much_nearer_to_the_truth_than_the_odometry(
    journey: Drive, mapped: GMapping
) -> None:
    trajectory = mapped.trajectory
    at = np.searchsorted(journey.stamps_s, trajectory.stamps_s).tolist()
    estimated = [trajectory.pose(number).distance_to(journey.truth[k]) for number, k in enumerate(at)]
    wheels = [journey.odometry[k].distance_to(journey.truth[k]) for k in at]
    assert np.mean(wheels) > 0.15
    assert max(wheels) > 0.25
    assert np.mean(estimated) < 0.03
    assert max(estimated) < 0.1
    assert mapped.best_pose.distance_to(journey.truth[-1]) < 0.1
    assert mapped.best_pose.distance_to(mapped.correction.compose(journey.odometry[-1])) < 1e-9
    at_last = mapped.correction.compose(journey.odometry[at[-1]])
    assert at_last.distance_to(trajectory.pose(len(trajectory) - 1)) < 1e-9


def distance_to_walls(points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    start, edge = ROOM[:, :2], ROOM[:, 2:] - ROOM[:, :2]
    along = ((points[:, None] - start) * edge).sum(axis=2) / (edge**2).sum(axis=1)
    nearest = start + np.clip(along, 0.0, 1.0)[..., None] * edge
    return np.asarray(np.hypot(*(points[:, None] - nearest).transpose(2, 0, 1)).min(axis=1))


@pytest.mark.slow
def test_walls_are_occupied_cells_and_where_the_robot_drove_is_free(journey: Drive, mapped: GMapping) -> None:
    grid = mapped.occupancy()
    assert set(np.unique(grid.data)) <= {-1, 0, 100}
    rows, columns = np.nonzero(grid.data == 100)
    centres = np.column_stack(grid.center_of(columns, rows))
    off = distance_to_walls(centres)
    assert (off < 0.075).mean() > 0.95
    along = np.linspace(0.02, 0.98, 40)[:, None]
    walls = np.concatenate([wall[:2] + along * (wall[2:] - wall[:2]) for wall in ROOM])
    assert np.mean([np.hypot(*(centres - wall).T).min() < 0.1 for wall in walls]) > 0.95
    for pose in journey.truth[::20]:
        column, row = grid.cell_at(pose.x, pose.y)
        assert grid.data[row, column] == 0


@pytest.mark.slow
def test_drawing_the_map_on_the_way_changes_nothing(journey: Drive) -> None:
    """A noisy filter that resamples, so that drawn scans are taken back and drawn anew."""
    settings = replace(
        WHEELS, particles=8, likelihood_gain=0.2, noise_srr=0.2, noise_srt=0.3, linear_reliability=0.0
    )
    part = Drive(*(column[:100] for column in journey))
    once = run(part, settings, 3)
    often = GMapping(LIDAR, settings, START, stream(3, "gmapping"))
    drawn, rewritten = often.trajectory.poses, 0
    for stamp, odometry, ranges in zip(part.stamps_s, part.odometry, part.ranges_m, strict=True):
        often.process(odometry, ranges, float(stamp))
        often.occupancy()
        rewritten += not np.array_equal(often.trajectory.poses[: len(drawn)], drawn)
        drawn = often.trajectory.poses
    assert rewritten > 3
    assert often.occupancy().data.tobytes() == once.occupancy().data.tobytes()
    assert often.occupancy().origin == once.occupancy().origin


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(journey: Drive) -> None:
    part = Drive(*(column[:30] for column in journey))
    settings = replace(TURTLEBOT3, particles=6)
    first, again, other = (run(part, settings, seed) for seed in (1, 1, 2))
    assert first.trajectory.poses.tobytes() == again.trajectory.poses.tobytes()
    assert first.occupancy().data.tobytes() == again.occupancy().data.tobytes()
    assert first.trajectory.poses.tobytes() != other.trajectory.poses.tobytes()


def test_a_scan_is_integrated_when_the_robot_drove_turned_or_waited_enough() -> None:
    settings = replace(TURTLEBOT3, linear_update_m=1.0, angular_update_rad=0.5, temporal_update_s=10.0)
    slam = GMapping(LIDAR, settings, START, stream(0, "gmapping"))
    silent = np.full(LIDAR.beams, math.nan)
    odometry = [
        (Pose2D(0.0, 0.0, 0.0), 0.0, True),  # the first scan always
        (Pose2D(0.5, 0.0, 0.0), 1.0, False),
        (Pose2D(1.1, 0.0, 0.0), 2.0, True),  # 1.1 m in two steps
        (Pose2D(1.1, 0.0, 0.3), 3.0, False),
        (Pose2D(1.1, 0.0, 0.0), 4.0, True),  # 0.3 rad there and 0.3 back
        (Pose2D(1.1, 0.0, 0.0), 14.0, False),  # 10 s are not more than 10 s
        (Pose2D(1.1, 0.0, 0.0), 14.1, True),
    ]
    assert [slam.process(pose, silent, stamp) for pose, stamp, _ in odometry] == [due for *_, due in odometry]
    assert slam.trajectory.stamps_s.tolist() == [0.0, 2.0, 4.0, 14.1]
    assert slam.occupancy().data.size == 0


def test_without_a_usable_beam_the_odometry_is_followed() -> None:
    quiet = replace(WHEELS, noise_srr=0.0, noise_srt=0.0, noise_str=0.0, noise_stt=0.0)
    slam = GMapping(LIDAR, quiet, Pose2D(2.0, 3.0, math.pi / 2), stream(0, "gmapping"))
    silent = np.full(LIDAR.beams, math.nan)
    slam.process(Pose2D(0.0, 0.0, 0.0), silent, 0.0)
    slam.process(Pose2D(1.0, 0.0, 0.2), silent, 1.0)
    assert slam.best_pose == pytest.approx((2.0, 4.0, math.pi / 2 + 0.2))


def test_a_scan_of_another_length_is_refused() -> None:
    slam = GMapping(LIDAR, WHEELS, START, stream(0, "gmapping"))
    with pytest.raises(ValueError, match="360 beams"):
        slam.process(START, np.ones(90), 0.0)
