import itertools
import math

import numpy as np
import pytest

from midnet_bench.geometry import Pose2D, Scan, wrap_angle
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.map_server import load_map
from midnet_bench.recording.fitting.fit import Localizer, LocalizerSettings
from tests.recording.recorded_drives import MOUNT, RECORDINGS, drive, mounted, recorded, room


@pytest.fixture(scope="module")
def turning():
    """(truth, ranges, LiDAR) at each scan of a drive."""
    samples = mounted(drive(), MOUNT)
    return [(each.pose, each.ranges_m, each.lidar) for each in samples]


@pytest.fixture(scope="module")
def truth(turning):
    """The true pose at each scan."""
    return [pose for pose, _, _ in turning]


def localized(grid, scans, recorded_poses, settings=None):
    """The corrected poses, and their covariances, (n, 3, 3)."""
    localizer = Localizer(grid, settings)
    poses, covariances = [], []
    for number, ((_, ranges_m, lidar), pose) in enumerate(zip(scans, recorded_poses, strict=True)):
        poses.append(localizer.corrected(Scan(ranges_m, lidar, pose, float(number))))
        covariances.append(localizer.covariance)
    return poses, np.array(covariances)


def errors_m(poses, truth):
    return np.array([pose.distance_to(right) for pose, right in zip(poses, truth, strict=True)])


def covered(poses, covariances, truth):
    """(n,) whether the truth lies within two standard deviations in the plane (Mahalanobis distance)."""
    off = np.array([(pose.x - right.x, pose.y - right.y) for pose, right in zip(poses, truth, strict=True)])
    squared = np.einsum("ni,ni->n", off, np.linalg.solve(covariances[:, :2, :2], off[:, :, None])[:, :, 0])
    return squared <= 4.0


@pytest.mark.slow
def test_right_poses_stay_and_the_claim_covers_them(turning, truth):
    poses, covariances = localized(room(), turning, truth)
    assert errors_m(poses, truth).max() < 0.04  # less than a cell
    assert max(abs(wrap_angle(pose.yaw - right.yaw)) for pose, right in zip(poses, truth, strict=True)) < 0.01
    assert covered(poses, covariances, truth).all()
    assert np.array_equal(covariances, covariances.transpose(0, 2, 1))
    assert np.linalg.eigvalsh(covariances).min() > 0.0


def test_an_offset_of_the_recorded_poses_is_found(turning, truth):
    off = [pose._replace(x=pose.x + 0.1) for pose in truth]
    poses, covariances = localized(room(), turning, off)
    assert errors_m(poses, truth)[-20:].max() < 0.05
    assert covered(poses, covariances, truth).mean() > 0.9


def test_odometry_that_drifts_is_held(turning, truth):
    drifting = [truth[0]]
    for before, now in itertools.pairwise(truth):
        step = now.relative_to(before)
        drifting.append(drifting[-1].compose(Pose2D(1.03 * step.x, step.y, step.yaw + 0.003)))
    poses, covariances = localized(room(), turning, drifting)
    assert errors_m(drifting, truth).max() > 0.2
    assert errors_m(poses, truth).max() < 0.1
    assert covered(poses, covariances, truth).mean() > 0.9


def test_after_a_slip_the_pose_comes_back(turning, truth):
    slipped = [Pose2D(0.2, 0.0, 0.0).compose(pose) if k > 40 else pose for k, pose in enumerate(truth)]
    # a good laser: by one whose ranges may be 3 % off, 0.2 m would be no surprise
    poses, covariances = localized(room(), turning, slipped, LocalizerSettings(range_error=0.002))
    errors = errors_m(poses, truth)
    assert errors[41] > 0.15
    assert errors[-1] < 0.02
    assert covered(poses, covariances, truth)[-1]


def test_a_robot_at_rest_grows_no_surer(turning):
    truth, ranges_m, lidar = turning[0]
    poses, covariances = localized(room(), [(truth, ranges_m, lidar)] * 50, [truth] * 50)
    assert np.array_equal(covariances[0], covariances[-1])
    assert poses[0] == poses[-1]


def test_walls_that_are_drawn_thick_are_known_less_well(turning, truth):
    grid = room()
    data = grid.data.copy()
    for rows, columns in ((0, 1), (0, -1), (1, 0), (-1, 0)):  # three cells instead of one
        data |= np.roll(grid.data, (rows, columns), axis=(0, 1))
    _, thin = localized(grid, turning, truth)
    _, thick = localized(OccupancyGrid(data, grid.resolution, grid.origin), turning, truth)
    assert thick[-1, 0, 0] > thin[-1, 0, 0]


def test_ranges_that_may_be_off_by_more_correct_less(turning, truth):
    off = [pose._replace(y=pose.y + 0.08) for pose in truth]
    exact, _ = localized(room(), turning, off, LocalizerSettings(range_error=0.0))
    rough, _ = localized(room(), turning, off, LocalizerSettings(range_error=0.2))
    assert errors_m(exact, truth)[0] < errors_m(rough, truth)[0] < 0.08


def test_scans_that_met_nothing_leave_the_recorded_motion_and_the_doubt_grows(turning, truth):
    empty = [(pose, np.full_like(ranges_m, np.inf), lidar) for pose, ranges_m, lidar in turning]
    poses, covariances = localized(room(), empty, truth)
    assert errors_m(poses, truth).max() < 1e-9
    assert np.diff(covariances[:, 2, 2]).min() > 0.0
    assert np.diff(np.linalg.det(covariances)).min() > 0.0


@pytest.mark.skipif(not RECORDINGS.is_dir(), reason="the recordings of others are not beside the checkout")
@pytest.mark.parametrize("name", ["intersection", "overtake_red"])
def test_on_recordings_of_others_motion_capture_is_left_alone_and_covered(name):
    pytest.importorskip("rosbags", reason="bags are read by rosbags")
    times_s, ranges_m, lidar, track = recorded(name)
    truth = [track.at(float(time_s)) for time_s in times_s]
    scans = [(None, np.where(each < lidar.range_max_m, each, math.inf), lidar) for each in ranges_m]
    poses, covariances = localized(load_map(RECORDINGS / name / "map.yaml"), scans, truth)
    assert np.median(errors_m(poses, truth)) < 0.03
    assert covered(poses, covariances, truth).mean() >= 0.9
