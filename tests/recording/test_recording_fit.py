import math
import re

import numpy as np
import pytest

from midnet_bench.errors import InputError
from midnet_bench.geometry import LidarGeometry, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.map_server import load_map
from midnet_bench.recording.fitting.fit import Sample, Walls, fit_of
from midnet_bench.recording.fitting.setup_check import find_setup, line_of, verdict
from midnet_bench.recording.fitting.setup_search import Search
from midnet_bench.recording.poses import PoseTrack
from tests.recording.recorded_drives import (
    BARE,
    MOUNT,
    RECORDINGS,
    TRUE_MOUNT,
    drive,
    mounted,
    moved,
    recorded_samples,
    room,
)


@pytest.fixture(scope="module")
def map_of_room():
    return room()


@pytest.fixture(scope="module")
def turning():
    return drive()


@pytest.fixture(scope="module")
def proposal(turning, map_of_room):
    """What is found where the mount of a drive that turns was left out."""
    return find_setup(turning, map_of_room)


def resting(x, y, yaw, ranges_m, angles_rad, mount=BARE, range_max_m=9.0):
    """One scan of a robot at rest whose two beams leave at these angles."""
    first, second = angles_rad
    lidar = LidarGeometry(2, first, second - first, 0.1, range_max_m, mount)
    track = PoseTrack()
    track.add(0, Pose2D(x, y, yaw))
    return Sample(0, np.array(ranges_m), lidar, track)


def small_map():
    """3 by 2 m of free cells of 10 cm whose columns at x = 2.0 to 2.1 m are a wall, unknown behind it."""
    data = np.zeros((20, 30), dtype=np.int8)
    data[:, 20], data[:, 21:] = 100, -1
    return OccupancyGrid(data, 0.1, (0.0, 0.0))


def test_returns_are_counted_on_walls_in_the_free_and_in_unknown_cells():
    walls = Walls(small_map())
    assert walls.near_m == pytest.approx(0.15)  # one and a half cells
    # from (0.55, 1.05): along x onto the wall's cell and 1 m beyond its face; along y into the free
    hit = resting(0.55, 1.05, 0.0, [1.5, 0.5], (0.0, math.pi / 2.0))
    through = resting(0.55, 1.05, 0.0, [2.2, np.inf], (0.0, math.pi / 2.0))
    fit = fit_of([hit, through], walls)
    assert fit_of([hit], walls)[:3] == (2, 0.5, 0.0)
    assert fit_of([through], walls)[:3] == (1, 0.0, 1.0)
    assert fit[:3] == (3, 1.0 / 3.0, 1.0 / 3.0)
    assert fit.in_the_free == pytest.approx(1.0 / 3.0)
    assert fit.robot_off_map == 0.0


def test_a_return_a_cell_and_a_half_off_a_wall_lies_on_it_and_one_further_does_not():
    walls = Walls(small_map())
    near, far = walls.distances(np.array([[1.95, 1.05], [1.85, 1.05]]))
    assert near <= walls.near_m < far
    assert walls.distances(np.array([[1.05, 1.05], [50.0, 1.0]]))[0] == pytest.approx(1.0)
    # 47 m off: what the nearest cell of the 1 m wide margin has, with the wall 0.9 m inside; a metre added to
    # the largest distance, as it once was, would be a step in the field whose slopes the least squares follow
    assert walls.distances(np.array([[50.0, 1.0]]))[0] == pytest.approx(1.9, abs=0.01)


def test_what_says_nothing_is_no_return_and_a_robot_outside_is_told():
    walls = Walls(small_map())
    for range_m in (np.nan, np.inf, 0.0, 0.05, 9.5):
        sample = resting(0.55, 1.05, 0.0, [range_m, range_m], (0.0, 1.0))
        assert fit_of([sample], walls).returns == 0
    assert math.isnan(fit_of([sample], walls).on_walls)
    mounted_back = resting(0.55, 1.05, 0.0, [1.5, np.inf], (0.0, 1.0), mount=Pose2D(-0.5, 0.0, 0.0))
    assert fit_of([mounted_back], walls).on_walls == 0.0
    outside = resting(-5.0, 1.05, 0.0, [1.5, np.inf], (0.0, 1.0))
    assert fit_of([mounted_back, outside], walls).robot_off_map == 0.5


def test_a_map_without_a_wall_is_refused(turning):
    with pytest.raises(InputError, match="no cell of it is occupied"):
        verdict(turning, OccupancyGrid(np.zeros((5, 5), dtype=np.int8), 0.05, (0.0, 0.0)))


def test_a_setup_says_where_the_frame_of_the_poses_lies_in_the_maps(turning, map_of_room):
    search = Search(mounted(turning, MOUNT), 20, Walls(map_of_room))
    values = np.array([*MOUNT, 0.0, 0.3, -0.2, 0.4, 1.0])
    moved = search.candidate(values, changed=(4, 5, 6)).map_moved
    assert moved.transform(search.place(search.as_set.values)) == pytest.approx(search.place(values))
    assert search.as_set.share > 0.99


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "beams", "view"),
    [("turns", 180, math.pi), ("rest", 1000, 1.5 * math.pi)],
)
def test_a_right_setup_fits_and_nothing_is_proposed(kind, beams, view, map_of_room):
    samples = mounted(drive(kind, beams=beams, view=view), MOUNT)
    told = verdict(samples, map_of_room)
    assert told.fits
    assert told.kinds == ()
    assert told.share > 0.95
    proposal = find_setup(samples, map_of_room)
    assert proposal.found.kinds == ()
    assert proposal.found.mount == pytest.approx(MOUNT)


@pytest.mark.slow
def test_a_mount_that_was_left_out_is_told_and_found(turning, map_of_room, proposal):
    told = verdict(turning, map_of_room)
    assert not told.fits
    assert told.kinds == ("mount",)
    assert "mount: [0." in told.lines[0]
    assert proposal.found.kinds == ("mount",)
    assert not proposal.alike  # the drive turns
    assert proposal.found.mount == pytest.approx(MOUNT, abs=0.02)
    assert proposal.share_before < 0.6 < 0.98 < proposal.found.share
    below, above, is_open = proposal.ranges["mount x"]
    assert 0.0 < below < 0.15
    assert 0.0 < above < 0.15
    assert not is_open


@pytest.mark.slow
@pytest.mark.parametrize(
    ("view", "mount", "given", "kinds"),
    [
        (math.pi, MOUNT, MOUNT, ("delay",)),
        (math.tau, MOUNT, BARE, ("mount", "delay")),
    ],
)
def test_a_scan_delay_of_100_ms_is_found_where_the_drive_turns(view, mount, given, kinds, map_of_room):
    proposal = find_setup(mounted(drive(delay_s=0.1, view=view, mount=mount), given), map_of_room)
    assert proposal.found.kinds == kinds
    assert proposal.found.mount == pytest.approx(mount, abs=0.03)
    assert proposal.found.delay_s == pytest.approx(0.1, abs=0.02)
    assert f"delay_s: {proposal.found.delay_s:.3f}" in line_of(proposal)
    already = line_of(proposal, delay_s=0.2)
    assert f"delay_s: {0.2 + proposal.found.delay_s:.3f}" in already


@pytest.mark.slow
def test_what_a_straight_drive_or_a_robot_at_rest_cannot_tell_is_said(map_of_room, proposal):
    straight = find_setup(mounted(drive("straight", delay_s=0.1), MOUNT), map_of_room).cannot_tell
    assert any("a scan delay of 0.1 s looks like a mount that is off by x 0.02" in each for each in straight)
    assert any("the heading hardly changes" in each for each in straight)
    rest = find_setup(mounted(drive("rest"), MOUNT), map_of_room)
    assert any("hardly moves" in each for each in rest.cannot_tell)
    assert rest.ranges["scan delay"].is_open
    assert proposal.cannot_tell == ()


def test_at_rest_a_mount_cannot_be_told_from_a_moved_map(map_of_room):
    proposal = find_setup(drive("rest"), map_of_room)
    assert proposal.found.kinds == ("mount",)
    assert [each.kinds for each in proposal.alike] == [("map",)]
    assert "or, which this recording cannot tell, if the map is moved" in line_of(proposal)


@pytest.mark.slow
def test_a_mirrored_scan_and_whole_turns_are_noted(turning, map_of_room):
    samples = mounted(drive(mirrored=True), MOUNT)
    told = verdict(samples, map_of_room)
    assert told.kinds == ("mirror", "mount")
    assert "mirrored: true; mount: [0." in told.lines[0]
    assert "mirrored: false" in verdict(samples, map_of_room, mirrored=True).lines[0]
    turned = MOUNT._replace(yaw=MOUNT.yaw - math.radians(90))
    told = verdict(mounted(turning, turned), map_of_room)
    assert told.kinds == ("turn",)
    assert "turned by 90 degrees" in told.lines[0]


@pytest.mark.slow
def test_a_moved_map_is_told_with_the_start_that_the_poses_have_on_it(turning, map_of_room):
    samples = mounted(turning, MOUNT)
    for x, y in ((-0.35, 0.35), (3.0, -2.0)):
        told = verdict(samples, moved(map_of_room, x, y))
        assert told.kinds[-1] == "map"
        said = [float(each) for each in re.search(r"start: \[(.*?)\]", told.lines[-1])[1].split(",")]
        first = samples[0].pose
        assert said == pytest.approx([first.x + x, first.y + y, math.degrees(first.yaw)], abs=0.06)


@pytest.mark.slow
def test_a_turned_map_and_one_of_another_place_are_told(turning, map_of_room):
    samples = mounted(turning, MOUNT)
    turned = OccupancyGrid(np.rot90(map_of_room.data).copy(), 0.05, (-4.0, -2.0))
    assert "turned by -90 degrees against the poses: start: [" in verdict(samples, turned).lines[-1]
    rows, columns = np.ogrid[:240, :240]
    hall = np.abs(np.hypot(rows - 120, columns - 120) - 100.0) < 1.0
    told = verdict(samples, OccupancyGrid(np.where(hall, 100, 0).astype(np.int8), 0.05, (-2.0, -3.0)))
    assert told.kinds == ("other place",)
    assert "is it the map of this place" in told.lines[0]


def test_a_robot_off_the_map_and_too_few_returns_are_noted(turning, map_of_room):
    told = verdict(mounted(turning, MOUNT), moved(map_of_room, 60.0, 0.0))
    assert told.kinds[0] == "off the map"
    assert "in 100% of the scans" in told.lines[0]
    empty = [each._replace(ranges_m=np.full(360, np.inf)) for each in turning[:3]]
    assert verdict(empty, map_of_room).kinds == ("few returns",)


@pytest.mark.slow
@pytest.mark.skipif(not RECORDINGS.is_dir(), reason="the recordings of others are not here")
@pytest.mark.parametrize(("name", "off_m"), [("intersection", 0.0083), ("overtake_red", 0.0198)])
def test_on_recordings_of_others_the_right_setup_fits_and_the_mount_comes_back_from_nothing(name, off_m):
    pytest.importorskip("rosbags", reason="bags are read by rosbags")
    samples, grid = recorded_samples(name), load_map(RECORDINGS / name / "map.yaml")
    told = verdict(samples, grid)
    assert (told.fits, len(told.lines)) == (True, 1)
    assert told.share > 0.65
    assert find_setup(samples, grid).found.kinds == ()
    found = find_setup(mounted(samples, BARE), grid).found
    assert found.kinds == ("mount",)
    assert found.mount.distance_to(TRUE_MOUNT) < off_m
    assert abs(found.mount.yaw - TRUE_MOUNT.yaw) < math.radians(1.0)
