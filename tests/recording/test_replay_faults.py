"""What cannot be, in a recording or said of it: one line, exit code 2, results where there are any."""

import json
import math
import re
import sqlite3
import struct
from dataclasses import fields, replace

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from midnet_bench.cli.replay import ReplayOptions, key_of
from midnet_bench.geometry import Pose2D
from midnet_bench.recording.files.bags import zstd
from tests.cli.command import midnet_bench, one_line_of_complaint, rows
from tests.recording import recordings as made
from tests.recording.recordings import Drive

pytestmark = pytest.mark.usefixtures("no_search")

DRIVE = Drive(seconds=3.0, lidar=made.lidar_of(60), movers={"red": made.on_the_way(6.0)})
SCANS = made.scan_messages(DRIVE)
POSES = made.pose_messages(DRIVE)
MOUNT = made.MOUNT_DEG


@pytest.fixture(scope="module")
def map_file(tmp_path_factory):
    return made.write_map(tmp_path_factory.mktemp("map"))


@pytest.fixture(scope="module")
def frames(tmp_path_factory, map_file):
    """How many frames' boxes the sound recording gives."""
    folder = tmp_path_factory.mktemp("sound")
    made.replayed(made.write_bag(folder, [*SCANS, *POSES]), folder, map=str(map_file), mount=MOUNT)
    return kept(folder)


@pytest.fixture
def replay(tmp_path, map_file):
    """``midnet-bench replay`` with the map, or what a listing of the same file says."""

    def run(*arguments, use_map=True, **keys):
        words = ["--map", map_file, "-o", tmp_path / "out", "--preset", "real"] if use_map else []
        if keys:
            (tmp_path / "setup.yaml").write_text(json.dumps(keys))
            words += ["--setup", tmp_path / "setup.yaml"]
        return midnet_bench("replay", *arguments, *words, folder=tmp_path)

    return run


@pytest.fixture
def sound(tmp_path):
    """The sound recording, for you to damage."""
    return lambda container="mcap": made.write_bag(tmp_path, [*SCANS, *POSES], container)


def complaint(done):
    """The line on stderr that begins with ``error``, of a command that ended with 2."""
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    (line,) = (line for line in done.stderr.splitlines() if line.startswith("error"))
    assert len(line) < 700
    return line


def kept(folder):
    """How many frames' boxes were written."""
    return len({row["frame"] for row in rows(folder / "out" / "boxes.csv")})


@pytest.mark.slow
@pytest.mark.parametrize(("container", "share"), [("ros1", 0.02), ("mcap", 0.0), ("ros2", 0.98)])
def test_a_truncated_bag(container, share, sound, replay):
    bag = sound(container)
    file = next(bag.glob("*.db3")) if container == "ros2" else bag
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    for done in (replay(bag, mount=MOUNT), replay(bag, use_map=False)):
        line = complaint(done)
        assert file.name in line or f"{bag.name}: damaged" in line
        assert "no bag that can be read" in line or "damaged" in line


@pytest.mark.parametrize(
    ("container", "index", "tool"),
    [("ros1", b"chunk_pos=", "rosbag reindex"), ("mcap", b"\x0f\x04\x00", "mcap recover")],
)
def test_a_bag_without_its_index_is_refused_with_the_tool_that_makes_one(
    container, index, tool, sound, replay
):
    bag = sound(container)
    whole = bag.read_bytes()
    for length in (whole.rindex(index) - 100 * (container == "ros1"), len(whole) // 2):  # never closed, cut
        bag.write_bytes(whole[:length])
        line = complaint(replay(bag, mount=MOUNT))
        assert re.search(rf"'{tool} \S*{bag.name}", line)
        assert len(line) < 450


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["renamed", "no metadata", "packed"])
def test_a_folder_is_known_by_its_file_s_bytes(kind, tmp_path, sound, replay, frames):
    bag = sound("ros2")
    (file,) = bag.glob("*.db3")
    if kind == "renamed":
        file.rename(bag / "other.db3")
    elif kind == "no metadata":
        (bag / "metadata.yaml").unlink()
    else:
        packed = zstd.compress(file.read_bytes())
        bag = tmp_path / "alone.db3.zstd"
        bag.write_bytes(packed)
    assert replay(bag, mount=MOUNT).returncode == 0
    assert kept(tmp_path) == frames


@pytest.mark.slow
@pytest.mark.parametrize(("container", "suffix"), [("ros1", ".mcap"), ("mcap", ".db3"), ("mcap", ".log")])
def test_a_bag_is_known_by_its_bytes(container, suffix, sound, replay):
    bag = sound(container)
    listed = replay(bag.rename(bag.with_suffix(suffix)), use_map=False)
    assert (listed.returncode, "/scan" in listed.stdout) == (0, True)


def mcap_record(kind, *parts):
    body = b"".join(parts)
    return struct.pack("<BQ", kind, len(body)) + body


def mcap_text(text):
    return struct.pack("<I", len(text)) + text.encode()


def test_an_mcap_file_without_chunks_is_refused_with_the_tool_that_makes_them(tmp_path, replay):
    """As ``ros2 bag record`` with the profile ``fastwrite`` leaves it."""
    kinds, said = {}, b"\x89MCAP0\r\n" + mcap_record(1, mcap_text("ros2"), mcap_text("test"))
    with AnyReader([made.write_bag(tmp_path, [*SCANS, *POSES], "ros2")]) as opened:
        for one, record_ns, raw in opened.messages():
            if one.topic not in kinds:
                number = kinds[one.topic] = struct.pack("<H", len(kinds) + 1)
                said += mcap_record(3, number, mcap_text(one.msgtype), mcap_text("ros2msg"), mcap_text(""))
                said += mcap_record(4, number, number, mcap_text(one.topic), mcap_text("cdr"), bytes(4))
            times = struct.pack("<QQ", record_ns, record_ns)
            said += mcap_record(5, kinds[one.topic], bytes(4), times, raw)
    said += mcap_record(15, bytes(4)) + mcap_record(2, bytes(20)) + b"\x89MCAP0\r\n"
    (tmp_path / "plain.mcap").write_bytes(said)
    assert "'mcap recover " in complaint(replay(tmp_path / "plain.mcap", mount=MOUNT))


def test_a_folder_of_several_recordings_is_none(sound, replay):
    bag = sound("ros2")
    (bag / "metadata.yaml").unlink()
    (file,) = bag.glob("*.db3")
    (bag / "day_2.db3").write_bytes(file.read_bytes())
    line = complaint(replay(bag, mount=MOUNT))
    assert file.name in line
    assert "day_2.db3" in line


def test_a_bag_that_is_damaged_in_the_middle_keeps_what_came_before(tmp_path, sound, replay):
    bag = sound("ros1")
    data = bag.read_bytes()
    # the length of a scan's array of ranges, of a scan in the middle
    at = data.index(struct.pack("<I", 60), len(data) // 2)
    bag.write_bytes(data[:at] + struct.pack("<I", 2**31) + data[at + 4 :])
    line = complaint(replay(bag, mount=MOUNT))
    assert "damaged" in line
    assert "s after its start" in line
    assert kept(tmp_path) >= 5
    assert "damaged" in complaint(replay(bag, use_map=False))


@pytest.mark.slow
def test_an_sqlite_file_that_is_damaged_in_the_middle(tmp_path, sound, replay):
    bag = sound("ros2")
    with sqlite3.connect(next(bag.glob("*.db3"))) as file:
        limits = (made.ns_of(2.0), made.ns_of(2.2))
        file.execute("update messages set data = x'0001' where timestamp > ? and timestamp < ?", limits)
    file.close()
    line = complaint(replay(bag, mount=MOUNT))
    assert "damaged 2.0" in line
    assert kept(tmp_path) >= 5


@pytest.mark.parametrize("container", ["ros1", "ros2", "mcap"])
def test_no_message_and_no_scan(container, tmp_path, replay):
    line = complaint(replay(made.write_bag(tmp_path, [], container)))
    assert any(why in line for why in ("empty", "no scan", "no message")), line
    bag = made.write_bag(tmp_path, POSES, container, "poses")
    assert "no scan: no message of sensor_msgs/LaserScan; it holds /pose" in complaint(replay(bag))
    listed = replay(bag, use_map=False)
    assert listed.returncode == 0
    assert "no scan" in listed.stderr


def tf_without(*frames, begin_s=-1.0, end_s=99.0):
    """Scans, and a chain of transforms, one link of which says nothing from ``begin_s`` to ``end_s``."""
    found = list(SCANS)
    for said in made.tf_messages(DRIVE, slow_hz=2.0):
        (one,) = said.message.fields["transforms"]
        link = (one["header"]["frame_id"], one["child_frame_id"])
        time_s = (said.record_ns - made.ns_of(0.0)) / made.NS
        if link != frames or not begin_s <= time_s < end_s:
            found.append(said)
    return found


def exchanged(messages, changes):
    """The messages with those at some places exchanged for what a change makes of them."""
    return [changes.get(number, lambda said: said)(said) for number, said in enumerate(messages)]


def posed(**parts):
    return lambda said: made.edited(said, pose={**said.message.fields["pose"], **parts})


def scanned(**fields):
    return lambda said: made.edited(said, **fields)


def of_all(change):
    return [*map(change, SCANS), *POSES]


EMPTY = scanned(ranges=np.zeros(0, np.float32))
NO_POSES = {
    40: posed(position={"x": math.nan}),
    60: posed(position={"x": math.inf}),
    70: posed(orientation={"z": math.nan, "w": math.inf}),
    80: posed(orientation={"w": 0.0}),
}
AHEAD = {5: lambda said: made.stamped(said, made.ns_of(1e8))}
BACK = {30: lambda said: made.stamped(said, 0)}
FAULTS = [
    (tf_without("map", "odom"), "no transform begins at 'map', the chain ends at 'odom'", 0),
    (tf_without("odom", "base_link"), "nothing links 'base_link' to 'map'", 0),
    (tf_without("base_link", "laser"), "no transform ends at 'laser'", 0),
    (tf_without("odom", "base_link", end_s=1.55), "tf odom -> base_link before it", 4),
    (tf_without("map", "odom", begin_s=0.6), "from a pose of tf map -> odom", 4),
    (of_all(EMPTY), "no range at all", 0),
    ([*exchanged(SCANS, {0: EMPTY, 7: EMPTY}), *POSES], "2 of 25 scans were left out: each has no range", 16),
    (of_all(scanned(angle_increment=0.0)), "angle_increment", 0),
    (of_all(scanned(angle_min=math.nan)), "angle_min", 0),
    (of_all(scanned(angle_increment=6.0)), "in degrees?", 0),
    (of_all(scanned(range_max=math.nan)), "range limit", 0),
    ([*SCANS, *exchanged(POSES, NO_POSES)], "/pose: 4 poses are not finite, too far off or no rotation", 16),
    ([*exchanged(SCANS, AHEAD), *exchanged(POSES, BACK)], "stamp that jumps by more than an hour", 16),
]
"""messages, words of the complaint, and the fewest frames that are kept"""


@pytest.mark.parametrize(("messages", "expected", "least"), FAULTS, ids=[words for _, words, _ in FAULTS])
def test_a_fault_is_named_and_what_is_sound_is_kept(messages, expected, least, tmp_path, replay):
    bag = made.write_bag(tmp_path, messages)
    keys = {} if any(said.topic == "/tf" for said in messages) else {"mount": MOUNT}
    assert expected in complaint(replay(bag, **keys))
    assert (kept(tmp_path) if least else 0) >= least
    assert replay(bag, use_map=False).returncode == 0


START = made.ns_of(0.0)
STILL = [made.stamped(said, START) for said in SCANS]
STILL_POSES = [made.stamped(said, START) for said in POSES]
STILL_LINK = [
    made.edited(said, transforms=[{**one, "header": {**one["header"], "stamp": START}}])
    if one["child_frame_id"] == "base_link"
    else said
    for said in made.tf_messages(DRIVE)
    for one in said.message.fields["transforms"]
]
OF_BOOT = [made.stamped(said, said.record_ns - START) for said in SCANS]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("messages", "expected"),
    [
        ([*STILL, *POSES], "the stamps of the scans stand still"),
        ([*SCANS, *STILL_POSES], "/pose: the stamps of the poses stand still"),
        ([*SCANS, *STILL_LINK], "tf odom -> base_link: the stamps of the poses stand still"),
        ([*OF_BOOT, *POSES], "clock: record"),  # scans and poses never meet
    ],
)
def test_stamps_that_are_no_times(messages, expected, tmp_path, replay):
    bag = made.write_bag(tmp_path, messages)
    assert expected in complaint(replay(bag, mount=MOUNT))
    assert replay(bag, mount=MOUNT, clock="record").returncode == 0
    if "scans stand still" in expected:
        assert "clock: record" in replay(bag, use_map=False).stdout


@pytest.mark.slow
def test_clocks_that_run_apart(tmp_path, replay):
    apart = [made.stamped(said, said.record_ns - round(0.05 * (said.record_ns - START))) for said in SCANS]
    done = replay(made.write_bag(tmp_path, [*apart, *POSES]), mount=MOUNT)
    assert "the clocks run apart" in done.stderr


@pytest.mark.slow
def test_ranges_that_are_no_numbers(tmp_path, replay):
    rng, odd = np.random.default_rng(1), []
    for said in SCANS:
        ranges = said.message.fields["ranges"].copy()
        ranges[rng.integers(0, len(ranges), 6)] = [np.nan, -np.inf, np.inf, -1.0, 1e30, 0.0]
        odd.append(made.edited(said, ranges=ranges))
    done = replay(made.write_bag(tmp_path, [*odd, *POSES]), mount=MOUNT)
    assert done.returncode == 0, done.stderr


POSE = ("--pose", "/pose")
NAMES = [
    ((), {"scan": "/scam"}, "no topic '/scam'; did you mean '/scan'?"),
    ((), {}, "choose with --pose"),
    (("--pose", "/scan"), {}, "'/scan' is sensor_msgs/msg/LaserScan, which gives no pose"),
    (POSE, {"scan": "/pose"}, "gives no scan"),
    (POSE, {"allies": {"red": {"topic": "/rde"}}}, "no topic '/rde'"),
    (("--pose", "/odmo"), {}, "--pose: no topic"),
    (("--pose", "poses.csv"), {}, "poses.csv"),
    ((*POSE, "--truth", "red=/red_poze"), {}, "--truth: red: no topic"),
    ((*POSE, "--set", "thresh_global=300"), {}, "thresh_global: "),
    ((*POSE, "--set", "min_returns=-1"), {}, "min_returns: "),
    ((*POSE, "--truth", "truth.csv"), {}, "truth.csv"),
    (("--pose", "robot=/pose", "--pose", "robot=tf"), {}, "'robot' is given twice"),
    (POSE, {"mount": {"rbot": MOUNT}}, "mount: rbot: no robot is called 'rbot'; did you mean 'robot'?"),
]


@pytest.mark.slow
def test_names_that_are_not_there(tmp_path, replay):
    bag = made.write_bag(tmp_path, [*SCANS, *POSES, *made.pose_messages(DRIVE, topic="/other")])
    for words, keys, expected in NAMES:
        assert expected in complaint(replay(bag, *words, **keys))
    assert "nowhere.bag: there is no such recording" in one_line_of_complaint(replay("nowhere.bag"))


KEYS = {f"--{name}": name.replace("-", "_") for name in ["background", "scan", "mount", "map-frame", "clock"]}
KEYS |= {"--hit-threshold": "hit_threshold", "--no-return": "no_return", "--unmapped": "unmapped"}
KEYS |= {"--deskew": "deskew", "--mirror": "mirrored", "--resolution": "resolution_m"}
KEYS |= {"--rate": "rate_hz", "--offset": "offset_s", "--allies": "allies", "--delay": "delay_s"}
KEYS |= {"--window": "window_m", "--sector": "sector_deg", "--from": "from_s"}
KEYS |= {"--max-pose-age": "max_pose_age_s", "--max-ally-age": "max_ally_age_s"}
KEYS |= {"--match-distance": "match_distance_m"}


def test_an_option_that_is_a_key_of_the_setup_says_so(tmp_path):
    assert {option: key_of(option) for option in KEYS} == KEYS
    assert key_of("--nothing") is key_of("--m") is key_of("--scan-delay") is None
    assert len({one.name for one in fields(ReplayOptions)} - {"as_json", "wide"}) == 12
    for words in (["--mount", "1,2,3"], ["--unmapped"]):
        line = one_line_of_complaint(midnet_bench("replay", "a.bag", *words, folder=tmp_path))
        assert f"{words[0]}: write '{KEYS[words[0]]}: ...' into setup.yaml" in line


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"mont": MOUNT}, "setup.yaml: mont: unknown key; did you mean 'mount'?"),
        ({"mount": [0.1, "two", 0.0]}, "setup.yaml: mount.1: "),
        ({"mount": {"front": [0.1, 0.0]}}, "setup.yaml: mount.front.2: "),
        ({"scan": []}, "setup.yaml: scan: a topic is needed, or a list of topics"),
        ({"scan": {"front": ["/f", 3]}}, "setup.yaml: scan.front: a topic is needed"),
        ({"clock": "wall"}, "setup.yaml: clock: "),
        ({"delay_s": -1e300}, "setup.yaml: delay_s: "),
        ({"map": "map.yaml", "pose": "at:1e300,0,0"}, "pose 1e300,0,0: '1e300' is out of range"),
        ({"rate_hz": True}, "setup.yaml: rate_hz: "),
        ({"no_return": {"infi": "clears"}}, "no_return: no such code 'infi'; did you mean 'inf'?"),
        ({"allies": {"red": "/red"}}, "setup.yaml: allies.red: "),
        ({"map": "map.yaml", "background": "first-3"}, "leave one out"),
        ({"map": "/map", "from_s": 99}, "setup.yaml: from_s: "),
        ({"map": "/map", "from_s": 2, "to_s": 1}, "setup.yaml: to_s: "),
        ({"map": "/map", "from_s": 2.97}, "change from_s"),
    ],
)
def test_a_setup_that_cannot_be(keys, expected, tmp_path):
    made.write_bag(tmp_path, [made.map_message(), *SCANS, *POSES])
    (tmp_path / "setup.yaml").write_text(json.dumps(keys))
    done = midnet_bench("replay", "bag.mcap", "--setup", "setup.yaml", folder=tmp_path)
    assert expected in one_line_of_complaint(done)


@pytest.mark.slow
def test_a_map_without_a_place_and_one_that_is_not_there(tmp_path):
    grid = made.map_message()
    info = grid.message.fields["info"]
    origin = {**info["origin"], "orientation": {"z": math.nan, "w": 0.8}}
    grid = made.edited(grid, info={**info, "origin": origin})
    bag = made.write_bag(tmp_path, [*SCANS, *POSES, grid])
    for given, expected in (
        ("nowhere.yaml", "nowhere.yaml"),
        ("/map", "its origin is no pose"),
        ("/mapp", "no such topic; did you mean '/map'?"),
    ):
        assert expected in complaint(midnet_bench("replay", bag, "--map", given, folder=tmp_path))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "empty"),
        ("t,x,y\n1,2,3\n", "columns t, x, y"),
        ("t,x,y,yaw\n1,2,3,4,5\n", "5 cells below a heading of 4"),
        ("t,x,y,yaw\n1,2,three,4\n", "table.csv:2: y: 'three' is not a number"),
        ("t,x,y,yaw\nnan,2,3,4\n", "t: 'nan' is not a finite number"),
        ("t,angle_min,angle_increment,range_min,range_max,r0,r1\n1,0,0.1,0,8,one,2\n", "r0: 'one'"),
        ("\x00\x01\x02", "table.csv"),
    ],
)
def test_a_table_that_cannot_be_read(text, expected, tmp_path, replay):
    table = tmp_path / "table.csv"
    table.write_text(text)
    assert expected in one_line_of_complaint(replay(table))
    assert expected in one_line_of_complaint(replay(table, use_map=False))


@pytest.mark.slow
def test_labels_that_lie_nowhere(tmp_path, sound, replay):
    bag = sound()
    shifted = [(index + 1000, t + 500.0, *more) for index, t, *more in DRIVE.labels()]
    for by in ("t", "scan_index"):
        truth = made.write_labels(tmp_path / f"{by}.csv", shifted, by)
        line = complaint(replay(bag, "--truth", truth, mount=MOUNT))
        assert "nothing is scored" in line
        assert f"labels have {by} " in line
        assert kept(tmp_path) > 15


@pytest.mark.slow
def test_the_proposed_command_runs(tmp_path):
    messages = []
    for name, by in (("a", Pose2D(0, 0, 0)), ("b", Pose2D(-0.5, 0, 0))):
        drive = replace(DRIVE, pose=lambda time_s, by=by: DRIVE.track(time_s).compose(by))
        messages += made.scan_messages(drive, f"/{name}/scan")
        messages += made.pose_messages(drive, "odometry", f"/{name}/odom")
    bag = made.write_bag(tmp_path, [*messages, made.map_message()])
    listed = midnet_bench("replay", bag, folder=tmp_path)
    assert listed.returncode == 0, listed.stderr
    (line,) = (line for line in listed.stderr.splitlines() if line.startswith("proposed: "))
    done = midnet_bench(*line.removeprefix("proposed: midnet-bench ").split(), folder=tmp_path)
    # without the mount, where only poses are, scans may not fit; that is printed
    assert done.returncode == 0 or "does not fit" in done.stderr, done.stderr
    assert (tmp_path / "results" / "replay-bag" / "boxes.csv").exists()
