"""No-return codes, time, allies, labels, causes: scenes by hand of which it is known what must come out."""

import math
from dataclasses import replace

import numpy as np
import pytest

from midnet_bench.geometry import Pose2D
from midnet_bench.grid import OccupancyGrid
from tests.recording import recordings as made
from tests.recording.recorded_drives import CELL_M, room
from tests.recording.recordings import Drive, apart_m, edited, played

pytestmark = pytest.mark.usefixtures("no_search")

RED = {"red": made.on_the_way(6.0)}
DRIVE = Drive(seconds=3.0, lidar=made.lidar_of(180, range_m=2.0), movers=RED)
"""its range ends before most walls: half of the beams meet nothing"""


def coded(drive, value, least=None):
    """The scans with this number where nothing came back; ``least``: some of them with this one instead."""
    found = []
    for said in made.scan_messages(drive):
        ranges = said.message.fields["ranges"].copy()
        ranges[~np.isfinite(ranges)] = value
        if least is not None:
            ranges[::60] = least
        found.append(edited(said, ranges=ranges))
    return found


@pytest.mark.slow
def test_no_return_in_any_code_gives_the_same_boxes(tmp_path):
    keys = {"settings": {"local_map": "persistent"}, "labels": DRIVE.labels()}
    codes = {
        math.inf: "inf",
        math.nan: "nan",
        0.0: "0 or less",
        2.0: "range_max or more",
        0.05: "below range_min",
    }
    results = {value: played(tmp_path, DRIVE, scans=coded(DRIVE, value), **keys) for value in codes}
    for value, expected in codes.items():
        line = results[value].notes[0]
        assert f"{expected} " in line, line
        assert line.count("clears") == 1, line
        assert results[value].plain_boxes == results[math.inf].plain_boxes, value
    assert results[0.0].score()["recall"] == 1.0
    # where it says nothing, it clears nothing, and marks of the mover stay behind it
    other = played(tmp_path, DRIVE, scans=coded(DRIVE, 0.0), no_return={"zero": "nothing"}, **keys)
    assert other.notes[0].endswith("(says nothing)")
    assert other.plain_boxes != results[0.0].plain_boxes


def test_a_few_odd_readings_are_no_code(tmp_path):
    line = played(tmp_path, DRIVE, scans=coded(DRIVE, math.inf, least=0.05)).notes[0]
    assert "(clears), below range_min 1.7% (says nothing)" in line


@pytest.mark.slow
def test_scan_delay(tmp_path):
    late = [made.stamped(said, said.record_ns + 200_000_000) for said in made.scan_messages(DRIVE)]
    poses = made.pose_messages(replace(DRIVE, seconds=3.5))
    right = played(tmp_path, DRIVE, poses=poses)
    assert apart_m(played(tmp_path, DRIVE, scans=late, poses=poses), right) > 0.0
    mended = played(tmp_path, DRIVE, scans=late, poses=poses, delay_s=0.2)
    assert mended.plain_boxes == right.plain_boxes


@pytest.mark.slow
def test_deskew_and_rubbish_in_time_increment(tmp_path):
    turning = Drive(
        seconds=2.5,
        pose=lambda time_s: Pose2D(4.2 + 0.3 * time_s, 3.0, 1.5 * time_s),
        lidar=made.lidar_of(180),
        movers={"red": lambda time_s: [made.Disc(4.6, 4.0 + 0.1 * time_s, 0.15)]},
        sweep_s=0.1,
    )
    settings = {"unknown_in_prior": "free", "return_area_m2": 0}

    def deskewed(increment_s, is_on=True):
        scans = made.scan_messages(turning, time_increment=increment_s)
        found = played(
            tmp_path, turning, scans=scans, labels=turning.labels(), settings=settings, deskew=is_on
        )
        return found.score(), [line for line in found.notes if "time_increment" in line]

    (plain, no_line), (right, no_line_either) = deskewed(0.1 / 180, False), deskewed(0.1 / 180)
    assert no_line == no_line_either == []
    assert plain["fp"] >= 5
    assert (right["fp"], right["recall"]) == (0, 1.0)
    for rubbish in (2.99e-5, 7.0):
        score, lines = deskewed(rubbish)
        assert len(lines) == 1
        assert score["fp"] <= right["fp"] + 2, rubbish


def test_frames_at_a_rate(tmp_path):
    found = played(tmp_path, DRIVE, rate_hz=4.0, labels=DRIVE.labels())
    assert found.score()["frames"] == 10  # of 2.4 s of scans, at 4 Hz, both ends included
    assert found.score()["recall"] == 1.0
    assert {float(row["t"]) % 0.25 for row in found.boxes} == {0.0}


def friend_poses(mover, seconds, topic="/friend"):
    times = np.arange(0.0, seconds + 0.3, 0.05).tolist()
    poses = [(t, Pose2D(*made.middle(mover(t)), 0.0)) for t in times]
    return made.track_messages(poses, topic=topic)


def with_friend(behind_s, radius_m):
    """A drive with an intruder before it and an ally behind it, and that ally's poses."""
    movers = {**RED, "friend": made.on_the_way(-behind_s, radius_m)}
    drive = replace(DRIVE, lidar=made.lidar_of(360), seconds=4.0, movers=movers)
    return drive, friend_poses(movers["friend"], 4.0)


def friend(diameter_m):
    """The declared ally."""
    return {"allies": {"friend": {"topic": "/friend", "diameter_m": diameter_m}}, "pose": "/pose"}


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
@pytest.mark.parametrize("radius_m", [0.1, 0.3])
def test_a_declared_ally_is_gone_and_the_other_is_not(radius_m, tmp_path):
    drive, poses = with_friend(6.0 if radius_m > 0.2 else 3.5, radius_m)
    labels = drive.labels("red")
    without = played(tmp_path, drive, more=poses, labels=labels, pose="/pose")
    assert len(near_friend(drive, without)) > 0.9 * without.score()["frames"]
    declared = played(tmp_path, drive, more=poses, labels=labels, **friend(2.0 * radius_m))
    assert len(near_friend(drive, declared)) <= 0.01 * declared.score()["frames"]
    assert declared.score()["recall"] == 1.0
    assert any("ally friend: oldest pose at a frame: 0.0" in line for line in declared.notes)


@pytest.mark.slow
def test_an_ally_that_is_late_is_noted_with_its_age(tmp_path):
    drive, poses = with_friend(3.0, 0.15)
    silent = [one for one in poses if one.record_ns < made.ns_of(2.0)]
    found = played(tmp_path, drive, more=silent, labels=drive.labels("red"), **friend(0.3))
    (line,) = (line for line in found.notes if line.startswith("ally friend"))
    assert "oldest pose at a frame: 1.9" in line
    assert "15 of 35 frames over 0.5 s" in line
    late = [row for row in found.errors if row["cause"] == "ally_late"]
    assert len(late) >= 12
    assert {row["name"] for row in late} == {"friend"}
    assert max(float(row["age_s"]) for row in late) == pytest.approx(1.95, abs=0.1)
    assert found.score()["recall"] == 1.0


@pytest.mark.slow
def test_labels_by_time_by_index_and_by_topic_score_alike(tmp_path):
    more = friend_poses(RED["red"], 3.0, "/red")
    by_t, by_index = (
        str(made.write_labels(tmp_path / f"{by}.csv", DRIVE.labels(), by)) for by in ("t", "scan_index")
    )
    scores = [
        played(tmp_path, DRIVE, more=more, pose="/pose", truth=truth).score()
        for truth in (by_t, by_index, {"red": "/red"})
    ]
    for score in scores:
        assert (score["labelled"], score["in_range"], score["matched"]) == (25, 25, 25)
    assert scores[0] == scores[1]


def at_rest(**movers):
    rest = Pose2D(4.2, 3.0, 0.0)
    return replace(DRIVE, pose=lambda time_s: rest, lidar=made.lidar_of(360), movers=movers)


@pytest.mark.slow
def test_sector_and_window_and_what_is_not_seen(tmp_path):
    """Labelled: ahead, and beside and behind a wall, outside both limits; on the right stands one without."""
    places = {"ahead": (4.9, 3.0), "beside": (4.2, 4.2), "behind": (2.7, 1.5), "right": (4.2, 1.6)}
    drive = at_rest(**{name: made.standing(*at) for name, at in places.items()})
    drive = replace(drive, seconds=2.0)
    labels = drive.labels("ahead", "beside", "behind")
    for limits, expected in (
        ({}, (2, 1, 1)),
        ({"sector_deg": [-30, 30]}, (1, 0, 0)),
        ({"window_m": 2.0}, (1, 0, 0)),
    ):
        score = played(tmp_path, drive, labels=labels, **limits).score()
        found = [score[name] / score["frames"] for name in ("in_range", "not_visible", "fp")]
        assert tuple(found) == expected, limits
        assert (score["missed"], score["tp"]) == (0, score["in_range"])
    half = replace(drive, lidar=made.lidar_of(181, math.pi))
    seen = played(tmp_path, half, labels=labels).score()
    assert (seen["not_visible"], seen["recall"]) == (0, 1.0)


def moving(x, y, dx, dy, radius_m=0.12):
    return lambda time_s: [made.Disc(x + dx * time_s, y + dy * time_s, radius_m)]


SEEN = moving(4.9, 3.0, 0.0, 0.15)
BESIDE_A_WALL = moving(4.0, 0.08, 0.05, 0.0, 0.1)
FAR = moving(5.9, 3.0, 0.0, 0.1)
SMALL = OccupancyGrid(room().data[:, : round(6.5 / CELL_M)], CELL_M, room().origin)
FAR_UP = {"settings": {"obstacle_range_m": 4.0}, "match_distance_m": 0.2}
MISSES = {
    # the label lies in range, what is there behind it
    "beyond_range": (
        {"a": moving(4.2, 5.6, 0.02, 0.0, 0.05)},
        -0.2,
        {"settings": {"obstacle_range_m": 2.45}},
    ),
    "outside_window": ({"a": FAR}, 0.0, {"settings": {"local_size_m": 2.0}}),
    "outside_prior": ({"a": FAR}, 0.0, {"grid": SMALL}),
    "under_prior": ({"a": BESIDE_A_WALL}, 0.0, FAR_UP),
    "too_few_returns": ({"a": SEEN}, 0.0, {"settings": {"min_returns": 99}}),
    "too_small": ({"a": SEEN}, 0.0, {"settings": {"min_returns": 0, "min_area_cells": 999}}),
    "merged": (
        {"a": moving(4.9, 3.0, 0.0, 0.1), "b": moving(4.9, 3.2, 0.0, 0.1)},
        0.0,
        {"match_distance_m": 0.3},
    ),
    "taken_for_ally": ({"a": SEEN}, 0.0, {"more": friend_poses(SEEN, 3.0), **friend(0.3)}),
    "not_detected": (
        {"a": BESIDE_A_WALL},
        0.0,
        {**FAR_UP, "settings": {"detector": "subtraction", "obstacle_range_m": 4.0}},
    ),
}
"""cause -> movers, by how much y of their labels is off, keys"""


@pytest.mark.slow
@pytest.mark.parametrize("cause", MISSES)
def test_each_cause_of_a_miss(cause, tmp_path):
    movers, off_m, keys = MISSES[cause]
    drive = at_rest(**movers)
    labels = [(*said, y + off_m) for *said, y in drive.labels()]
    result = played(tmp_path, drive, labels=labels, **keys)
    assert result.score()["missed"] > 3
    misses = [row["cause"] for row in result.errors if row["kind"] == "miss"]
    assert misses.count(cause) >= 0.95 * len(misses), misses
    assert len(misses) == result.score()["missed"]


MOVER = moving(4.9, 2.2, 0.0, 0.25)
OTHER = moving(3.6, 2.6, 0.0, 0.2)
BOTH = at_rest(a=MOVER, b=OTHER)


def of_boxes(result):
    return [row["cause"] for row in result.errors if row["kind"] != "miss"]


def unknown_strip():
    grid = room()
    data = grid.data.copy()
    column, row = (round((at + 1.025) / grid.resolution) for at in (3.4, 2.4))
    data[row : row + 40, column : column + 10] = -1
    return OccupancyGrid(data, grid.resolution, grid.origin)


def odd_returns(drive):
    """In each scan another beam ends where nothing is."""
    found = []
    for number, said in enumerate(made.scan_messages(drive)):
        ranges = said.message.fields["ranges"].copy()
        ranges[(40 + 7 * number) % 60 + 250] = 1.3
        found.append(edited(said, ranges=ranges))
    return found


def of_a(drive):
    return drive.labels("a")


def with_a_gap(drive):
    return [one for one in drive.labels() if one[2] == "a" or not 0.8 < one[1] - made.BEGIN_S < 2.2]


def that_are_off(drive):
    return [(*said, x + 0.7, y) for *said, x, y in drive.labels()]


CRATE = at_rest(a=MOVER, b=made.standing(3.2, 3.8, 0.15))
ALONE = at_rest(a=MOVER)
LEGS = at_rest(a=lambda time_s: [made.Disc(4.9, 3.0 + s * 0.25 + 0.05 * time_s, 0.06) for s in (-1, 1)])
SOURCES = {
    "unlabelled": (BOTH, of_a, 20, {}),
    "unmapped": (CRATE, of_a, 20, {}),
    "label_gap": (BOTH, with_a_gap, 10, {}),
    "fragment, beyond the distance": (ALONE, that_are_off, 15, {}),
    "fragment": (LEGS, Drive.labels, 20, {}),
    "ally_left": (
        BOTH,
        of_a,
        20,
        {"more": friend_poses(OTHER, 3.0), **friend(0.02), "settings": {"iou_ally": 0.9}},
    ),
    "ghost": (ALONE, Drive.labels, 20, {"scans": odd_returns, "settings": {"min_returns": 0}}),
    "unknown_cells": (
        BOTH,
        of_a,
        15,
        {"grid": unknown_strip(), "settings": {"unknown_in_prior": "free"}},
    ),
}
"""cause, and what else it is -> drive, labels, the fewest boxes of it, keys"""


QUICK = ("unlabelled", "unmapped")


@pytest.mark.parametrize(
    "source", [pytest.param(one, marks=[pytest.mark.slow] * (one not in QUICK)) for one in SOURCES]
)
def test_each_source_of_a_box_that_is_no_labels(source, tmp_path):
    drive, labels, least, keys = SOURCES[source]
    cause = source.partition(",")[0]
    scans = keys.get("scans")
    keys = {**keys, "scans": scans(drive) if scans else None}
    result = played(tmp_path, drive, labels=labels(drive), **keys)
    found = of_boxes(result)
    assert found.count(cause) >= max(least, 0.95 * len(found)), found
    assert len(found) == result.score()["fp"] + result.score()["duplicates"]
    assert cause != "ally_left" or {row["name"] for row in result.errors} == {"friend"}
    assert source != "fragment" or result.score()["recall"] == 1.0
    kinds = {row["kind"] for row in result.errors if row["cause"] == "fragment"}
    assert cause != "fragment" or kinds == {"fragment" if source == "fragment" else "false"}
    single = {row["returns"] for row in result.errors if row["cause"] == "ghost"}
    assert cause != "ghost" or single == {"1"}


@pytest.mark.slow
def test_single_returns_make_no_box_by_the_preset(tmp_path):
    assert of_boxes(played(tmp_path, ALONE, scans=odd_returns(ALONE), labels=ALONE.labels())) == []


@pytest.mark.slow
def test_marks_that_nothing_clears_are_ghosts(tmp_path):
    drive = replace(at_rest(a=moving(4.9, 2.2, 0.0, 0.6)), lidar=made.lidar_of(360, range_m=1.9), seconds=4.5)
    result = played(
        tmp_path,
        drive,
        scans=coded(drive, 0.0),
        labels=drive.labels(),
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
@pytest.mark.parametrize(("cause", "noise_m"), [("pose_error", 0.005), ("near_wall", 0.14)])
def test_walls_that_are_off_by_the_pose_or_by_the_ranges(cause, noise_m, tmp_path):
    drive = replace(DRIVE, lidar=made.lidar_of(360), movers={}, seconds=5.0, noise_m=noise_m)
    poses = drive.poses()
    if cause == "pose_error":
        poses = [
            (t, at._replace(yaw=at.yaw + (0.09 if int(t) % 2 else 0.0), x=at.x + 0.1)) for t, at in poses
        ]
    far = {"obstacle_range_m": 4.0}
    found = of_boxes(played(tmp_path, drive, poses=made.track_messages(poses), settings=far))
    assert len(found) > 15
    assert found.count(cause) >= (0.95 if cause == "pose_error" else 0.9) * len(found), found


def test_events_of_a_recording(tmp_path):
    """One drives ahead all the time, and something without a label stands beside the way."""
    movers = {**RED, "crate": made.standing(4.2, 1.6)}
    drive = replace(DRIVE, movers=movers, lidar=made.lidar_of(360))
    found = played(tmp_path, drive, labels=drive.labels("red"))
    rows = made.rows(found.folder / "events.csv")
    (true,) = [row for row in rows if row["is_true"] == "true"]
    assert float(true["share"]) > 0.95
    score = found.score()
    assert (score["events"], score["false_events"], score["id_switches"]) == (len(rows), len(rows) - 1, 0)
    wrong = score["missed"] + score["fp"] + score["duplicates"]
    assert score["mota"] == pytest.approx(1.0 - wrong / score["in_range"])


@pytest.mark.slow
def test_what_stands_beside_a_labelled_way_is_unmapped_not_the_label_s(tmp_path):
    """Pylons that the map lacks stand along the way of a labelled robot, which comes as near as 0.3 m."""
    pylons = [(3.4, 2.6), (4.6, 2.4), (3.9, 3.7), (5.0, 2.0)]
    movers = {**RED, **{f"pylon {k}": made.standing(x, y, 0.06) for k, (x, y) in enumerate(pylons)}}
    drive = replace(DRIVE, seconds=8.0, movers=movers, lidar=made.lidar_of(360))
    found = played(tmp_path, drive, labels=drive.labels("red"))
    of_pylons = [
        row["cause"]
        for row in found.errors
        if row["kind"] != "miss"
        and min(math.dist((float(row["x"]), float(row["y"])), pylon) for pylon in pylons) < 0.25
    ]
    assert len(of_pylons) > 60
    assert of_pylons.count("unmapped") >= 0.95 * len(of_pylons)
