"""No-return codes, time, allies, labels, causes: scenes by hand of which it is known what must come out."""

import math
from dataclasses import replace

import numpy as np
import pytest

from midnet_bench.geometry import Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.recording.files.ros_messages import Message
from tests.recording import recordings as made
from tests.recording.recorded_drives import room
from tests.recording.recordings import Drive, apart_m, replayed

MOUNT = [0.1, 0.02, 2.864789]
RED = {"red": made.on_the_way(6.0)}
DRIVE = Drive(seconds=4.0, lidar=made.lidar_of(180, range_m=2.0), movers=RED)
"""its range ends before most walls: half of the beams meet nothing"""


@pytest.fixture(scope="module")
def map_file(tmp_path_factory):
    return str(made.write_map(tmp_path_factory.mktemp("map")))


def coded(drive, value, least=None):
    """The scans with this number where nothing came back; ``least``: some of them with this one instead."""
    found = []
    for said in made.scan_messages(drive):
        ranges = said.message.fields["ranges"].copy()
        ranges[~np.isfinite(ranges)] = value
        if least is not None:
            ranges[::60] = least
        found.append(
            said._replace(message=Message(said.message.kind, {**said.message.fields, "ranges": ranges}))
        )
    return found


@pytest.mark.slow
def test_no_return_in_any_code_gives_the_same_boxes(tmp_path, map_file):
    truth = str(made.write_labels(tmp_path / "truth.csv", DRIVE.labels()))
    keys = {
        "map": map_file,
        "mount": MOUNT,
        "settings": {"local_map": "persistent"},
        "truth": truth,
        "match_distance_m": 0.35,
    }
    results = {}
    for value, expected in (
        (math.inf, "inf"),
        (math.nan, "nan"),
        (0.0, "0 or less"),
        (3.0, "range_max or more"),
        (2.0, "range_max or more"),
        (0.05, "below range_min"),
    ):
        bag = made.write_bag(tmp_path, [*coded(DRIVE, value), *made.pose_messages(DRIVE)], name=f"b{value}")
        results[value] = replayed(bag, tmp_path, **keys)
        line = results[value].notes[0]
        assert f"{expected} " in line, line
        assert line.count("clears") == 1, line
        assert results[value].plain_boxes == results[math.inf].plain_boxes, value
    assert results[0.0].score()["recall"] == 1.0
    # told to say nothing, it clears nothing, and marks of the mover stay behind it
    bag = made.write_bag(tmp_path, [*coded(DRIVE, 0.0), *made.pose_messages(DRIVE)], name="told")
    told = replayed(bag, tmp_path, no_return={"zero": "nothing"}, **keys)
    assert told.notes[0].endswith("(says nothing)")
    assert told.plain_boxes != results[0.0].plain_boxes


def test_a_few_odd_readings_are_no_code(tmp_path, map_file):
    bag = made.write_bag(tmp_path, [*coded(DRIVE, math.inf, least=0.05), *made.pose_messages(DRIVE)])
    line = replayed(bag, tmp_path, map=map_file, mount=MOUNT).notes[0]
    assert "(clears), below range_min 1.7% (says nothing)" in line


@pytest.mark.slow
def test_scan_delay(tmp_path, map_file):
    late = [
        said._replace(
            message=Message(
                said.message.kind,
                {
                    **said.message.fields,
                    "header": {**said.message.fields["header"], "stamp": said.record_ns + 200_000_000},
                },
            )
        )
        for said in made.scan_messages(DRIVE)
    ]
    poses = made.pose_messages(replace(DRIVE, seconds=4.5))
    keys = {"map": map_file, "mount": MOUNT}
    right = replayed(made.write_bag(tmp_path, [*made.scan_messages(DRIVE), *poses]), tmp_path, **keys)
    bag = made.write_bag(tmp_path, [*late, *poses], name="late")
    assert apart_m(replayed(bag, tmp_path, **keys), right) > 0.0
    mended = replayed(bag, tmp_path, delay_s=0.2, **keys)
    assert mended.plain_boxes == right.plain_boxes


TURNING = Drive(
    seconds=2.5,
    pose=lambda time_s: Pose2D(4.2 + 0.3 * time_s, 3.0, 1.5 * time_s),
    lidar=made.lidar_of(180),
    movers={"red": lambda time_s: [made.Disc(4.6, 4.0 + 0.1 * time_s, 0.15)]},
    sweep_s=0.1,
)


@pytest.mark.slow
def test_deskew_and_rubbish_in_time_increment(tmp_path, map_file):
    truth = str(made.write_labels(tmp_path / "truth.csv", TURNING.labels()))
    keys = {
        "map": map_file,
        "mount": MOUNT,
        "truth": truth,
        "settings": {"unknown_in_prior": "free", "return_area_m2": 0},
    }
    poses = made.pose_messages(TURNING)
    scores, lines = {}, {}
    for name, increment, is_on in (
        ("as it is", 0.1 / 180, False),
        ("right", 0.1 / 180, True),
        ("zero", 0.0, True),
        ("rubbish", 2.99e-5, True),
        ("huge", 7.0, True),
        ("negative", -0.1, True),
        ("nan", math.nan, True),
    ):
        scans = made.scan_messages(TURNING, time_increment=increment)
        bag = made.write_bag(tmp_path, [*scans, *poses], name=name)
        found = replayed(bag, tmp_path, deskew=is_on, **keys)
        scores[name] = found.score()
        lines[name] = [line for line in found.notes if "time_increment" in line]
    assert scores["as it is"]["fp"] >= 5
    assert scores["right"]["fp"] == 0
    assert scores["right"]["recall"] == 1.0
    for name in ("zero", "rubbish", "huge", "negative", "nan"):
        assert len(lines[name]) == 1
        assert scores[name]["fp"] <= scores["right"]["fp"] + 2, name
    assert lines["right"] == lines["as it is"] == []


def test_frames_at_a_rate(tmp_path, map_file):
    bag = made.write_bag(tmp_path, [*made.scan_messages(DRIVE), *made.pose_messages(DRIVE)])
    truth = str(made.write_labels(tmp_path / "truth.csv", DRIVE.labels()))
    found = replayed(bag, tmp_path, map=map_file, mount=MOUNT, rate_hz=4.0, truth=truth)
    score = found.score()
    assert score["frames"] == 14  # of 3.4 s of scans, at 4 Hz, both ends included
    assert score["recall"] == 1.0
    assert {float(row["t"]) % 0.25 for row in found.boxes} == {0.0}


def with_ally(behind_s=3.0, radius_m=0.15, **changes):
    """A drive with an intruder before it and an ally at rest beside its way."""
    movers = {**RED, "friend": made.on_the_way(-behind_s, radius_m)}
    return replace(DRIVE, lidar=made.lidar_of(360), seconds=6.0, movers=movers, **changes)


def friend_poses(drive, rate_hz=20.0, **said):
    times = np.arange(0.0, drive.seconds + 0.3, 1.0 / rate_hz).tolist()
    return made.track_messages(
        [(t, Pose2D(*made.middle(drive.movers["friend"](t)), 0.0)) for t in times], topic="/friend", **said
    )


def friend(diameter_m):
    """The declared ally."""
    return {"friend": {"topic": "/friend", "diameter_m": diameter_m}}


def friend_track(poses):
    return made.track_messages(poses, topic="/friend")


def near_friend(drive, result, reach_m=0.4):
    """Frames in which a box lies on the friend."""
    frames = set()
    for row in result.boxes:
        x, y = made.middle(drive.movers["friend"](float(row["t"]) - made.BEGIN_S))
        at = [(float(row[f"{axis}_min_m"]) + float(row[f"{axis}_max_m"])) / 2.0 for axis in "xy"]
        if math.dist(at, (x, y)) < reach_m:
            frames.add(row["frame"])
    return frames


@pytest.mark.slow
@pytest.mark.parametrize("radius_m", [0.1, 0.15, 0.3])
def test_a_declared_ally_is_gone_and_the_other_is_not(radius_m, tmp_path, map_file):
    drive = with_ally(6.0 if radius_m > 0.2 else 3.5, radius_m)
    messages = [*made.scan_messages(drive), *made.pose_messages(drive), *friend_poses(drive)]
    bag = made.write_bag(tmp_path, messages)
    truth = str(made.write_labels(tmp_path / "truth.csv", drive.labels("red")))
    keys = {"map": map_file, "mount": MOUNT, "truth": truth, "pose": "/pose"}
    without = replayed(bag, tmp_path, **keys)
    assert len(near_friend(drive, without)) > 0.9 * without.score()["frames"]
    declared = replayed(bag, tmp_path, allies=friend(2.0 * radius_m), **keys)
    assert len(near_friend(drive, declared)) <= 0.01 * declared.score()["frames"]
    assert declared.score()["recall"] == 1.0
    assert any("ally friend: oldest pose at a frame: 0.0" in line for line in declared.notes)


@pytest.mark.slow
def test_an_ally_that_is_late_is_told_with_its_age(tmp_path, map_file):
    drive = with_ally()
    silent = [one for one in friend_poses(drive) if one.record_ns < made.ns_of(2.5)]
    bag = made.write_bag(tmp_path, [*made.scan_messages(drive), *made.pose_messages(drive), *silent])
    truth = str(made.write_labels(tmp_path / "truth.csv", drive.labels("red")))
    found = replayed(bag, tmp_path, map=map_file, mount=MOUNT, pose="/pose", truth=truth, allies=friend(0.3))
    (line,) = (line for line in found.notes if line.startswith("ally friend"))
    assert "oldest pose at a frame: 3.4" in line
    assert "30 of 55 frames over 0.5 s" in line
    late = [row for row in found.errors if row["cause"] == "ally_late"]
    assert len(late) >= 25
    assert {row["name"] for row in late} == {"friend"}
    assert max(float(row["age_s"]) for row in late) == pytest.approx(3.45, abs=0.1)
    assert found.score()["recall"] == 1.0


@pytest.mark.slow
def test_labels_by_time_by_index_and_by_topic_score_alike(tmp_path, map_file):
    poses = [(t, Pose2D(*made.middle(RED["red"](t)), 0.0)) for t in np.arange(0.0, 4.3, 0.05).tolist()]
    messages = [
        *made.scan_messages(DRIVE),
        *made.pose_messages(DRIVE),
        *made.track_messages(poses, topic="/red"),
    ]
    bag = made.write_bag(tmp_path, messages)
    by_t = str(made.write_labels(tmp_path / "t.csv", DRIVE.labels()))
    by_index = str(made.write_labels(tmp_path / "index.csv", DRIVE.labels(), "scan_index"))
    scores = [
        replayed(bag, tmp_path, map=map_file, mount=MOUNT, pose="/pose", truth=truth).score()
        for truth in (by_t, by_index, {"red": "/red"})
    ]
    for score in scores:
        assert (score["labelled"], score["in_range"], score["matched"]) == (35, 35, 35)
    assert scores[0] == scores[1]


@pytest.mark.slow
def test_sector_and_window_and_who_is_not_seen(tmp_path, map_file):
    still = {
        "ahead": made.standing(4.9, 3.0),
        "beside": made.standing(4.2, 4.2),
        "behind the wall": made.standing(2.7, 1.5),
    }
    drive = replace(DRIVE, pose=lambda time_s: Pose2D(4.2, 3.0, 0.0), lidar=made.lidar_of(360), movers=still)
    bag = made.write_bag(tmp_path, [*made.scan_messages(drive), *made.pose_messages(drive)])
    truth = str(made.write_labels(tmp_path / "truth.csv", drive.labels()))
    keys = {"map": map_file, "mount": MOUNT, "truth": truth}
    every = replayed(bag, tmp_path, **keys).score()
    frames = every["frames"]
    assert (every["in_range"], every["not_visible"], every["missed"]) == (2 * frames, frames, 0)
    ahead = replayed(bag, tmp_path, sector_deg=[-30, 30], **keys).score()
    assert (ahead["in_range"], ahead["not_visible"], ahead["fp"]) == (frames, 0, 0)
    small = replayed(bag, tmp_path, window_m=2.0, **keys).score()
    assert (small["in_range"], small["not_visible"], small["fp"]) == (frames, 0, 0)
    # half a circle ahead
    half = replace(drive, lidar=made.lidar_of(181, math.pi))
    bag = made.write_bag(tmp_path, [*made.scan_messages(half), *made.pose_messages(half)], name="half")
    seen = replayed(bag, tmp_path, **keys).score()
    assert seen["not_visible"] == 0
    assert seen["recall"] == 1.0


def caused(tmp_path, map_file, drive, **keys):
    bag = made.write_bag(tmp_path, [*made.scan_messages(drive), *made.pose_messages(drive)])
    return replayed(bag, tmp_path, map=map_file, mount=MOUNT, **keys)


def at_rest(x=4.2, y=3.0, yaw=0.0, **movers):
    return replace(
        DRIVE, pose=lambda time_s: Pose2D(x, y, yaw), lidar=made.lidar_of(360), seconds=6.0, movers=movers
    )


def moving(x, y, dx, dy, radius_m=0.12):
    return lambda time_s: [made.Disc(x + dx * time_s, y + dy * time_s, radius_m)]


BARE = (0.0, 0.0)
SEEN = moving(4.9, 3.0, 0.0, 0.15)

BY_SUBTRACTION = {"detector": "subtraction", "obstacle_range_m": 4.0}
MISSES = {
    # the label lies in range, what is there behind it
    "beyond_range": (
        at_rest(a=moving(4.2, 5.6, 0.02, 0.0, 0.05)),
        (0.0, -0.2),
        {"obstacle_range_m": 2.45},
        0.35,
    ),
    "outside_window": (at_rest(a=moving(5.9, 3.0, 0.0, 0.1)), BARE, {"local_size_m": 2.0}, 0.35),
    "under_prior": (at_rest(a=moving(4.0, 0.08, 0.05, 0.0, 0.1)), BARE, {"obstacle_range_m": 4.0}, 0.2),
    "too_few_returns": (at_rest(a=SEEN), BARE, {"min_returns": 99}, 0.35),
    "too_small": (at_rest(a=SEEN), BARE, {"min_returns": 0, "min_area_cells": 999}, 0.35),
    "merged": (at_rest(a=moving(4.9, 3.0, 0.0, 0.1), b=moving(4.9, 3.2, 0.0, 0.1)), BARE, {}, 0.3),
    "not_detected": (at_rest(a=moving(4.0, 0.08, 0.05, 0.0, 0.1)), BARE, BY_SUBTRACTION, 0.2),
}
"""cause -> drive, by how much its labels are off, settings, matching distance"""


@pytest.mark.slow
@pytest.mark.parametrize("cause", MISSES)
def test_each_cause_of_a_miss(cause, tmp_path, map_file):
    drive, off, settings, distance_m = MISSES[cause]
    labels = [(*said, x + off[0], y + off[1]) for *said, x, y in drive.labels()]
    truth = str(made.write_labels(tmp_path / "truth.csv", labels))
    result = caused(tmp_path, map_file, drive, settings=settings, match_distance_m=distance_m, truth=truth)
    assert result.score()["missed"] > 5
    misses = [row["cause"] for row in result.errors if row["kind"] == "miss"]
    assert misses.count(cause) >= 0.95 * len(misses), misses
    assert len(misses) == result.score()["missed"]


@pytest.mark.slow
def test_a_label_within_a_declared_ally_is_taken_for_it(tmp_path, map_file):
    drive = at_rest(a=SEEN)
    ally = [(t, Pose2D(*made.middle(SEEN(t)), 0.0)) for t in np.arange(0.0, 6.3, 0.05).tolist()]
    messages = [
        *made.scan_messages(drive),
        *made.pose_messages(drive),
        *friend_track(ally),
    ]
    truth = str(made.write_labels(tmp_path / "truth.csv", drive.labels()))
    result = replayed(
        made.write_bag(tmp_path, messages),
        tmp_path,
        map=map_file,
        mount=MOUNT,
        pose="/pose",
        truth=truth,
        allies=friend(0.3),
    )
    assert set(result.causes()) == {"taken_for_ally"}
    assert len(result.errors) == result.score()["missed"] == result.score()["frames"]


@pytest.mark.slow
def test_a_label_off_the_map(tmp_path):
    drive = at_rest(a=moving(5.9, 3.0, 0.0, 0.1))
    grid = room()
    small = OccupancyGrid(grid.data[:, : round(6.5 / grid.resolution)], grid.resolution, grid.origin)
    map_file = str(made.write_map(tmp_path, small))
    truth = str(made.write_labels(tmp_path / "truth.csv", drive.labels()))
    misses = caused(tmp_path, map_file, drive, truth=truth)
    assert misses.score()["missed"] > 5
    assert set(misses.causes()) == {"outside_prior"}


MOVER = moving(4.9, 2.2, 0.0, 0.25)
OTHER = moving(3.6, 2.6, 0.0, 0.2)


def of_false_boxes(result):
    return [row["cause"] for row in result.errors if row["kind"] != "miss"]


def expect(result, cause, least=10):
    found = of_false_boxes(result)
    assert found.count(cause) >= least, found
    assert found.count(cause) >= 0.95 * len(found), found
    assert len(found) == result.score()["fp"] + result.score()["duplicates"]


def test_false_box_of_somebody_without_a_label(tmp_path, map_file):
    drive = at_rest(a=MOVER, b=OTHER)
    truth = str(made.write_labels(tmp_path / "truth.csv", drive.labels("a")))
    expect(caused(tmp_path, map_file, drive, truth=truth), "unlabelled", 50)


def test_false_box_of_what_stands_there_and_is_not_on_the_map(tmp_path, map_file):
    drive = at_rest(a=MOVER, b=made.standing(3.2, 3.8, 0.15))
    truth = str(made.write_labels(tmp_path / "truth.csv", drive.labels("a")))
    expect(caused(tmp_path, map_file, drive, truth=truth), "unmapped", 50)


def test_an_intruder_that_stands_still_is_found(tmp_path, map_file):
    drive = at_rest(a=made.standing(4.9, 3.3))
    truth = str(made.write_labels(tmp_path / "truth.csv", drive.labels("a")))
    result = caused(tmp_path, map_file, drive, truth=truth)
    assert (result.score()["recall"], result.errors) == (1.0, [])


@pytest.mark.slow
def test_false_box_where_labels_have_a_gap(tmp_path, map_file):
    drive = at_rest(a=MOVER, b=OTHER)
    labels = [one for one in drive.labels() if one[2] == "a" or not 1.0 < one[1] - made.BEGIN_S < 3.0]
    truth = str(made.write_labels(tmp_path / "truth.csv", labels))
    expect(caused(tmp_path, map_file, drive, truth=truth), "label_gap", 15)


@pytest.mark.slow
def test_false_box_of_a_label_that_is_off(tmp_path, map_file):
    drive = at_rest(a=MOVER)
    labels = [(*said, x + 0.7, y) for *said, x, y in drive.labels()]
    truth = str(made.write_labels(tmp_path / "truth.csv", labels))
    expect(caused(tmp_path, map_file, drive, truth=truth), "displaced", 40)


@pytest.mark.slow
def test_false_boxes_of_one_object_in_parts(tmp_path, map_file):
    legs = lambda time_s: [made.Disc(4.9, 3.0 + s * 0.25 + 0.05 * time_s, 0.06) for s in (-1.0, 1.0)]  # noqa: E731
    drive = at_rest(a=legs)
    truth = str(made.write_labels(tmp_path / "truth.csv", drive.labels()))
    result = caused(tmp_path, map_file, drive, truth=truth)
    expect(result, "fragment", 50)
    assert result.score()["recall"] == 1.0


@pytest.mark.slow
def test_false_box_of_an_ally_that_is_not_taken_out(tmp_path, map_file):
    drive = at_rest(a=MOVER, b=OTHER)
    ally = [(t, Pose2D(*made.middle(OTHER(t)), 0.0)) for t in np.arange(0.0, 6.3, 0.05).tolist()]
    messages = [
        *made.scan_messages(drive),
        *made.pose_messages(drive),
        *friend_track(ally),
    ]
    truth = str(made.write_labels(tmp_path / "truth.csv", drive.labels("a")))
    result = replayed(
        made.write_bag(tmp_path, messages),
        tmp_path,
        map=map_file,
        mount=MOUNT,
        pose="/pose",
        truth=truth,
        allies=friend(0.02),
        settings={"iou_ally": 0.9},
    )
    expect(result, "ally_left", 50)
    assert {row["name"] for row in result.errors} == {"friend"}


@pytest.mark.slow
def test_false_box_of_marks_that_nothing_clears(tmp_path, map_file):
    drive = replace(at_rest(a=moving(4.9, 2.2, 0.0, 0.4)), lidar=made.lidar_of(360, range_m=1.9))
    truth = str(made.write_labels(tmp_path / "truth.csv", drive.labels()))
    bag = made.write_bag(tmp_path, [*coded(drive, 0.0), *made.pose_messages(drive)])
    result = replayed(
        bag,
        tmp_path,
        map=map_file,
        mount=MOUNT,
        truth=truth,
        no_return={"zero": "nothing"},
        settings={"local_map": "persistent", "min_returns": 0, "align": "origin"},
        match_distance_m=0.1,
    )
    ghosts = [row for row in result.errors if row["cause"] == "ghost"]
    assert len(ghosts) >= 10
    # the mover left the sensor's range long before the end; the trail has the age of that
    assert max(float(row["age_s"]) for row in ghosts) > 1.5
    assert all(float(row["returns"]) == 0 for row in ghosts)


@pytest.mark.slow
def test_false_box_of_a_single_return(tmp_path, map_file):
    drive = at_rest(a=MOVER)
    scans = []
    for number, said in enumerate(made.scan_messages(drive)):
        ranges = said.message.fields["ranges"].copy()
        ranges[(40 + 7 * number) % 60 + 250] = 1.3
        scans.append(
            said._replace(message=Message(said.message.kind, {**said.message.fields, "ranges": ranges}))
        )
    truth = str(made.write_labels(tmp_path / "truth.csv", drive.labels()))
    bag = made.write_bag(tmp_path, [*scans, *made.pose_messages(drive)])
    keys = {"map": map_file, "mount": MOUNT, "truth": truth}
    expect(replayed(bag, tmp_path, settings={"min_returns": 0}, **keys), "single_return", 45)
    assert of_false_boxes(replayed(bag, tmp_path, **keys)) == []


@pytest.mark.slow
def test_false_box_where_the_map_knows_nothing(tmp_path):
    grid = room()
    data = grid.data.copy()
    column, row = (round((at + 1.025) / grid.resolution) for at in (3.4, 2.4))
    data[row : row + 40, column : column + 10] = -1
    map_file = str(made.write_map(tmp_path, OccupancyGrid(data, grid.resolution, grid.origin)))
    drive = at_rest(a=MOVER, b=OTHER)
    truth = str(made.write_labels(tmp_path / "truth.csv", drive.labels("a")))
    result = caused(tmp_path, map_file, drive, truth=truth, settings={"unknown_in_prior": "free"})
    expect(result, "unknown_cells", 40)


@pytest.mark.slow
def test_false_boxes_of_poses_that_are_off(tmp_path, map_file):
    drive = replace(DRIVE, lidar=made.lidar_of(360), movers={}, seconds=6.0)
    off = [
        (t, pose._replace(yaw=pose.yaw + (0.09 if int(t) % 2 else 0.0), x=pose.x + 0.1))
        for t, pose in drive.poses()
    ]
    bag = made.write_bag(tmp_path, [*made.scan_messages(drive), *made.track_messages(off)])
    result = replayed(bag, tmp_path, map=map_file, mount=MOUNT, settings={"obstacle_range_m": 4.0})
    found = of_false_boxes(result)
    assert len(found) > 20
    assert found.count("pose_error") >= 0.95 * len(found), found


@pytest.mark.slow
def test_false_boxes_of_a_wall_that_is_told_roughly(tmp_path, map_file):
    drive = replace(DRIVE, lidar=made.lidar_of(360), movers={}, seconds=6.0, noise_m=0.14)
    result = caused(tmp_path, map_file, drive, settings={"obstacle_range_m": 4.0})
    found = of_false_boxes(result)
    assert len(found) > 20
    assert found.count("near_wall") >= 0.9 * len(found), found


@pytest.mark.parametrize(
    ("limits", "expected"),
    [({}, (2, 1, 0)), ({"sector_deg": [-30, 30]}, (1, 0, 0)), ({"window_m": 2.0}, (1, 0, 0))],
)
def test_a_box_outside_sector_or_window_is_neither_true_nor_false(tmp_path, map_file, limits, expected):
    """Ahead and beside, outside both limits, stand labelled objects; a third one beside has no label."""
    still = {
        "ahead": made.standing(4.9, 3.0),
        "beside": made.standing(4.2, 4.2),
        "right": made.standing(4.2, 1.6),
    }
    drive = replace(DRIVE, pose=lambda time_s: Pose2D(4.2, 3.0, 0.0), lidar=made.lidar_of(360), movers=still)
    bag = made.write_bag(tmp_path, [*made.scan_messages(drive), *made.pose_messages(drive)])
    truth = str(made.write_labels(tmp_path / "truth.csv", drive.labels("ahead", "beside")))
    score = replayed(bag, tmp_path, map=map_file, mount=MOUNT, truth=truth, **limits).score()
    frames = score["labelled"]
    assert (score["in_range"], score["fp"], score["missed"]) == tuple(frames * each for each in expected)
    assert score["tp"] == score["in_range"]


def test_events_of_a_recording_are_told(tmp_path, map_file):
    """Somebody drives ahead all the time, and something without a label stands beside the way."""
    movers = {**RED, "crate": made.standing(4.2, 1.6)}
    drive = replace(DRIVE, movers=movers, lidar=made.lidar_of(360))
    bag = made.write_bag(tmp_path, [*made.scan_messages(drive), *made.pose_messages(drive)])
    truth = str(made.write_labels(tmp_path / "truth.csv", drive.labels("red")))
    found = replayed(bag, tmp_path, map=map_file, mount=MOUNT, truth=truth)
    lines = (found.folder / "events.csv").read_text().splitlines()
    rows = [dict(zip(lines[0].split(","), line.split(","), strict=True)) for line in lines[1:]]
    assert [row["is_true"] for row in rows].count("true") == 1
    (true,) = [row for row in rows if row["is_true"] == "true"]
    assert float(true["share"]) > 0.95
    score = found.score()
    assert score["events"] == len(rows)
    assert score["false_events"] == len(rows) - 1
    assert score["id_switches"] == 0
    wrong = score["missed"] + score["fp"] + score["duplicates"]
    assert score["mota"] == pytest.approx(1.0 - wrong / score["in_range"])


def test_what_stands_beside_a_labelled_way_is_unmapped_not_the_label_s(tmp_path, map_file):
    """Pylons that the map lacks stand along the way of a labelled robot, which comes as near as 0.3 m."""
    pylons = [(3.4, 2.6), (4.6, 2.4), (3.9, 3.7), (5.0, 2.0)]
    movers = {**RED, **{f"pylon {k}": made.standing(x, y, 0.06) for k, (x, y) in enumerate(pylons)}}
    drive = replace(DRIVE, seconds=12.0, movers=movers, lidar=made.lidar_of(360))
    bag = made.write_bag(tmp_path, [*made.scan_messages(drive), *made.pose_messages(drive)])
    truth = str(made.write_labels(tmp_path / "truth.csv", drive.labels("red")))
    found = replayed(bag, tmp_path, map=map_file, mount=MOUNT, truth=truth)
    of_pylons = [
        row["cause"]
        for row in found.errors
        if row["preset"] == "real"
        and row["kind"] != "miss"
        and min(math.dist((float(row["x"]), float(row["y"])), pylon) for pylon in pylons) < 0.25
    ]
    assert len(of_pylons) > 100
    print(f"{of_pylons.count('unmapped')} of {len(of_pylons)}: {sorted(set(of_pylons))}")
    assert of_pylons.count("unmapped") >= 0.95 * len(of_pylons)
