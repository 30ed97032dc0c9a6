"""Odometry placed on a map, the correction that a check prints, maps with a turned origin, maps of a log."""

import csv
import math
import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from midnet_bench.errors import InputError
from midnet_bench.geometry import LidarGeometry, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.map_server import load_map, save_map
from midnet_bench.mapping.log_mapping import map_scans
from midnet_bench.recording.files.readings import NS
from midnet_bench.recording.fitting.fit import Sample, Walls, fit_of
from midnet_bench.recording.fitting.setup_check import find_setup, start_of
from midnet_bench.recording.inputs import opened, prior_map_of, scan_log_of
from midnet_bench.recording.plan import Recorded, robots_of
from midnet_bench.recording.poses import PoseTrack
from midnet_bench.recording.setup import RecordingSetup
from tests.cli.command import midnet_bench, one_line_of_complaint
from tests.recording import recordings as made
from tests.recording.recorded_drives import rectangle, room
from tests.recording.recordings import Drive, apart_m, played

DRIVE = Drive(seconds=8.0, movers={"red": made.on_the_way(6.0)})
ODOM_IN_MAP = Pose2D(6.0, -9.0, 2.5)  # no search about the poses' own place finds that
UNTIL_APART_M = 0.15  # of boxes by true poses: three cells


def by_odometry(drive, kind):
    """What a robot records that has odometry alone, by tf or on a topic."""
    placed = replace(drive, pose=lambda time_s: ODOM_IN_MAP.inverse().compose(drive.track(time_s)))
    if kind == "topic":
        return made.pose_messages(placed, "odometry", "/odom")
    return [
        said
        for said in made.tf_messages(placed)
        if said.topic == "/tf_static" or said.message.fields["transforms"][0]["header"]["frame_id"] != "map"
    ]


@pytest.fixture(scope="module")
def truly_placed(tmp_path_factory):
    return played(tmp_path_factory.mktemp("true"), DRIVE, labels=DRIVE.labels())


@pytest.mark.slow
@pytest.mark.usefixtures("no_search")
@pytest.mark.parametrize(("kind", "start"), [("tf", "found"), ("topic", "about")])
def test_odometry_is_placed(tmp_path, truly_placed, kind, start):
    begin = DRIVE.track(0.5)
    about = [begin.x + 0.2, begin.y - 0.15, math.degrees(begin.yaw) + 6.0]
    start = "found" if start == "found" else about
    placed = played(tmp_path, DRIVE, poses=by_odometry(DRIVE, kind), labels=DRIVE.labels(), start=start)
    (line,) = [one for one in placed.notes if "began at" in one]
    said = yaml.safe_load(line.split("start: ")[1].split(" on ")[0])
    assert said == pytest.approx([begin.x, begin.y, math.degrees(begin.yaw)], abs=1.0)
    assert math.dist(said[:2], begin[:2]) < 0.05
    assert placed.score()["recall"] == truly_placed.score()["recall"] == 1.0
    assert apart_m(placed, truly_placed) < UNTIL_APART_M


@pytest.mark.slow
@pytest.mark.usefixtures("no_search")
def test_odometry_that_drifts_is_corrected_unless_that_is_off(tmp_path):
    drive = replace(DRIVE, seconds=25.0, rate_hz=4.0, pose_rate_hz=10.0, movers={})
    begin, turned = drive.track(0.0), 0.024

    def drifting(time_s):
        x, y, yaw = drive.track(time_s).relative_to(begin)
        return Pose2D(1.03 * x, 1.03 * y, yaw).compose(Pose2D(0.0, 0.0, turned * time_s / 2.0))

    poses = made.pose_messages(replace(drive, pose=drifting), "odometry", "/odom")
    corrected, plain = (
        played(tmp_path, drive, poses=poses, **off, start="found").score()["boxes_per_frame"]
        for off in ({}, {"localize": False})
    )
    assert corrected < 0.05
    # seen 0.46: one start is fitted to the whole drive, so how many are left depends on the fit
    assert plain > 0.35


@pytest.mark.slow
@pytest.mark.usefixtures("no_search")
def test_without_a_place_the_refusal_names_the_options(tmp_path):
    bag = made.write_bag(tmp_path, [*made.scan_messages(DRIVE), *by_odometry(DRIVE, "tf")])
    arguments = ("replay", bag, "--map", made.write_map(tmp_path), "--preset", "real")
    said = one_line_of_complaint(midnet_bench(*arguments, folder=tmp_path))
    assert "--start found" in said
    assert "--start X,Y,YAW_DEG" in said
    assert "began at start: [" in midnet_bench(*arguments, "--start", "2.9,3.1,0", folder=tmp_path).stderr
    assert "--start 1,2" in one_line_of_complaint(midnet_bench(*arguments, "--start", "1,2", folder=tmp_path))


@pytest.mark.slow
@pytest.mark.usefixtures("no_search")
def test_a_map_of_another_place_and_a_background_are_refused(tmp_path):
    rows, columns = np.ogrid[:240, :240]
    hall = np.abs(np.hypot(rows - 120, columns - 120) - 100.0) < 1.0
    grid = OccupancyGrid(np.where(hall, 100, 0).astype(np.int8), 0.05, (-2.0, -3.0))
    keys = {"poses": by_odometry(DRIVE, "tf"), "mount": {}, "start": "found"}
    with pytest.raises(InputError, match=r"start: robot: no place .*--map"):
        played(tmp_path, DRIVE, grid=grid, **keys)
    with pytest.raises(InputError, match=r"start: .*--map"):
        played(tmp_path, DRIVE, map=None, background="first-2", **keys)


def hall_of(side_m):
    """The walls of a hall with a pillar near a corner, where the robot drives."""
    return np.array(rectangle(0.0, 0.0, side_m, 0.8 * side_m) + rectangle(2.9, 1.9, 3.3, 2.2))


def grid_of(walls, cell_m=0.05):
    size = np.ceil((walls.max() + 2.0) / cell_m).astype(int)
    data = np.zeros((size, size), np.int8)
    for x0, y0, x1, y1 in walls:
        along = np.linspace(0.0, 1.0, 2 * size)
        cells = [(((a + along * (b - a)) + 1.0) / cell_m).astype(int) for a, b in ((x0, x1), (y0, y1))]
        data[cells[1], cells[0]] = 100
    return OccupancyGrid(data, cell_m, (-1.0, -1.0))


def sample_at(number, pose, ranges_m, lidar):
    track = PoseTrack()
    track.add(number * NS, pose)
    return Sample(number * NS, ranges_m, lidar, track)


@pytest.mark.slow
@settings(max_examples=5, deadline=None)
@given(
    side_m=st.floats(5.0, 100.0),
    x=st.floats(-1.5, 1.5),
    y=st.floats(-1.5, 1.5),
    degrees=st.floats(-12.0, 12.0),
)
def test_the_printed_correction_never_lowers_the_share(side_m, x, y, degrees):
    walls = hall_of(side_m)
    grid, lidar = grid_of(walls), LidarGeometry(180, -math.pi, math.tau / 180, 0.1, 6.0, Pose2D(0, 0, 0))
    off, samples = Pose2D(x, y, math.radians(degrees)), []
    for number in range(12):
        pose = Pose2D(1.0 + 0.2 * number, 1.0 + 0.1 * math.sin(number), 0.3 * number)
        ranges_m = made.cast(pose, lidar.angles_rad, [], walls)
        ranges_m = np.where(ranges_m > lidar.range_max_m, np.inf, ranges_m)
        samples.append(sample_at(number, off.compose(pose), ranges_m, lidar))
    found = find_setup(samples, grid)
    if "map" not in found.found.kinds:
        return
    x, y, yaw_deg = start_of(found.found)
    moved = Pose2D(x, y, math.radians(yaw_deg)).compose(samples[0].pose.inverse())
    mount = found.found.mount if {"mount", "turn"} & set(found.found.kinds) else Pose2D(0, 0, 0)
    lidar = LidarGeometry(180, -math.pi, math.tau / 180, 0.1, 6.0, mount)
    after = [
        sample_at(number, moved.compose(one.pose), one.ranges_m, lidar) for number, one in enumerate(samples)
    ]
    before, now = (fit_of(each, Walls(grid)).on_walls for each in (samples, after))
    assert now >= before
    assert now >= found.found.share - 0.02


@pytest.mark.parametrize("degrees", [0.5, 90.0, -170.0])
def test_a_map_s_yaw_is_read(tmp_path, degrees):
    grid = room()
    save_map(grid, tmp_path / "map.yaml")
    words = yaml.safe_load((tmp_path / "map.yaml").read_text())
    words["origin"][2] = math.radians(degrees)
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(words))
    turned = load_map(tmp_path / "map.yaml")
    turn = Pose2D(*grid.origin, math.radians(degrees))
    rows, columns = np.nonzero(grid.data == 100)
    centres = turn.transform(np.stack((columns + 0.5, rows + 0.5), axis=1) * grid.resolution)
    walls = Walls(turned)
    assert walls.distances(centres).max() <= 1.5 * grid.resolution
    found = np.argwhere(turned.data == 100)[:, ::-1] + 0.5
    back = turn.inverse().transform(np.array(turned.origin) + found * grid.resolution)
    row, column = (np.floor(back / grid.resolution).astype(int)).T[::-1]
    assert (grid.data[row, column] == 100).all()
    # a wall stays whole: as many pieces as before, of 8-connected cells
    import cv2

    pieces = [cv2.connectedComponents((one.data == 100).astype(np.uint8))[0] for one in (grid, turned)]
    assert pieces[0] == pieces[1]


LONG_DRIVE = Drive(seconds=20.0, rate_hz=5.0)


def bag_of(folder, container):
    if container == "csv":  # which does not say where the laser sits
        at_base = replace(LONG_DRIVE, mount=Pose2D(0.0, 0.0, 0.0))
        return made.write_scan_table(folder / "drive.csv", at_base, with_poses=True)
    said = [*made.scan_messages(LONG_DRIVE), *by_odometry(LONG_DRIVE, "tf")]
    return made.write_bag(folder, said, container=container)


@pytest.mark.slow
@pytest.mark.parametrize("container", ["ros1", "csv"])
def test_a_recording_of_each_kind_is_mapped(tmp_path, container):
    notes = []
    log = scan_log_of(bag_of(tmp_path, container), notes.append)
    assert len(log) == len(LONG_DRIVE.scans)
    assert any("poses" in line for line in notes)
    result = map_scans(log)
    times_s = [LONG_DRIVE.scans[number - 1][0] for number in result.integrated]
    true = [LONG_DRIVE.track(time_s).relative_to(LONG_DRIVE.track(times_s[0])) for time_s in times_s]
    found = [result.trajectory.pose(k).relative_to(result.trajectory.pose(0)) for k in range(len(true))]
    assert max(a.distance_to(b) for a, b in zip(found, true, strict=True)) < 0.08
    assert np.count_nonzero(result.grid.data == 100) > 300
    assert result.warnings == log.warnings


@pytest.mark.slow
def test_the_commands_of_a_bag_without_a_map_are_named_and_work(tmp_path):
    bag = bag_of(tmp_path, "mcap")
    listed = midnet_bench("replay", bag.name, folder=tmp_path)
    assert "--start found" in listed.stderr
    mapped = midnet_bench("map", "--from-log", bag.name, "--no-clip", "-o", "made", folder=tmp_path)
    assert mapped.returncode == 0, mapped.stderr
    done = midnet_bench("replay", bag.name, "--map", "made/map.yaml", "--start", "found", folder=tmp_path)
    assert "began at start" in done.stderr, done.stderr


def changed_table(folder, change):
    """The drive as a CSV table, with ``change`` made to each row, by its number."""
    path = bag_of(folder, "csv")
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for number, row in enumerate(rows):
        change(number, row)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


def test_a_recorded_scan_with_a_beam_less_is_left_out_and_told(tmp_path):
    def cut(number, row):
        if number == 7:
            row[[name for name in row if re.fullmatch(r"r\d+", name)][-1]] = ""

    whole = scan_log_of(bag_of(tmp_path, "csv"), lambda line: None)
    log = scan_log_of(changed_table(tmp_path, cut), lambda line: None)
    beams = whole.geometry.beams
    assert (len(log), log.geometry) == (len(whole) - 1, whole.geometry)
    assert log.warnings == [
        f"{log.path}: 1 of {len(whole)} scans have {beams - 1} ranges, not {beams} as the others, and were "
        "left out"
    ]


@pytest.mark.slow
def test_a_recording_in_utm_is_mapped_as_any_other_by_slam_and_by_counting(tmp_path):
    def moved(number, row):
        row["x"], row["y"] = float(row["x"]) + 448262.25, float(row["y"]) + 5411932.5

    (tmp_path / "far").mkdir()
    near, far = bag_of(tmp_path, "csv"), changed_table(tmp_path / "far", moved)
    for path in (near, far):
        out = path.parent / "made"
        done = midnet_bench("map", "--from-log", path, "--no-clip", "-o", out, folder=tmp_path)
        assert done.returncode == 0, done.stderr
    maps = [load_map(path.parent / "made" / "map.yaml") for path in (near, far)]
    walls = [np.count_nonzero(grid.data == 100) for grid in maps]
    assert walls[1] == pytest.approx(walls[0], rel=0.05)
    away = np.subtract(maps[1].origin, maps[0].origin) - (448262.25, 5411932.5)
    assert np.abs(away).max() < 0.11
    setup = RecordingSetup().changed({"background": "first-10"})
    grids = []
    for path in (near, far):
        with opened([path]) as sources:
            recorded = Recorded.of(sources, setup)
            grids.append(prior_map_of(setup, recorded, robots_of(recorded, setup), lambda line: None)[0])
    walls = [np.count_nonzero(grid.data == 100) for grid in grids]
    assert walls[1] == pytest.approx(walls[0], rel=0.1)


def test_several_robots_are_refused(tmp_path):
    said = [*made.scan_messages(LONG_DRIVE), *by_odometry(LONG_DRIVE, "tf")]
    other = replace(LONG_DRIVE, seed=2)
    bag = made.write_bag(tmp_path, [*said, *made.scan_messages(other, "/rear/scan", "rear")])
    with pytest.raises(InputError, match=r"one|rear"):
        scan_log_of(bag, lambda line: None)
    assert "bag.mcap" in one_line_of_complaint(midnet_bench("map", "--from-log", bag, folder=tmp_path))
