"""``replay --bag``: what a replay found, read again by rosbags, beside the recording that it is of."""

import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path

import pytest

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.recording.setup import RecordingSetup
from midnet_bench.workflows.export import export_trial
from midnet_bench.workflows.replay import replay
from tests.cli.command import midnet_bench, one_line_of_complaint, rows
from tests.recording import recordings as made
from tests.recording.recordings import Drive
from tests.recording.test_export import Said, read, stamp_of, transform_of

pytestmark = pytest.mark.usefixtures("no_search")

DRIVE = Drive(seconds=2.0, lidar=made.lidar_of(90), movers={"red": made.on_the_way(6.0)})
MOUNT = made.MOUNT_DEG
NS = 1_000_000_000
LAG_NS = 400_000_000


def recording_of(
    folder: Path, *more: made.Said, poses: Sequence[made.Said] | None = None, name: str = "bag"
) -> Path:
    """The drive with its map, its poses or these, and more."""
    poses = made.pose_messages(DRIVE) if poses is None else poses
    return made.write_bag(folder, [made.map_message(), *made.scan_messages(DRIVE), *poses, *more], name=name)


def written(recording: Path, bag: Path, **keys: object) -> tuple[list[Said], list[dict[str, str]]]:
    """All messages of the bag, and the rows of boxes.csv."""
    setup = RecordingSetup().changed({"preset": "real", "map": "/map", **keys})
    out = bag.parent / "out"
    replay([recording], setup, lambda line: None, lambda share: None, output=out, bag=bag)
    return list(read(bag)), rows(out / "boxes.csv")


def boxes_of(message: object) -> list[tuple[float, ...]]:
    _, *cubes = message.markers  # type: ignore[attr-defined]
    found = []
    for cube in cubes:
        (x, y), (wide, high) = (cube.pose.position.x, cube.pose.position.y), (cube.scale.x, cube.scale.y)
        found.append((x - wide / 2.0, y - high / 2.0, x + wide / 2.0, y + high / 2.0))
    return found


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    bag = tmp_path_factory.mktemp("trial") / "trial.mcap"
    export_trial("detection", {"robots": 2, "frames": 6, "engine": "fast"}, 3, bag)
    return bag


@pytest.mark.slow
@pytest.mark.parametrize("name", ["out.bag", "out"])
def test_boxes_of_a_trial_go_round(name: str, trial: Path, tmp_path: Path) -> None:
    setup = trial.with_name("trial.setup.yaml")
    line = ("replay", trial, "--setup", setup, "--bag", tmp_path / name, "-o", "out_")
    done = midnet_bench(*line, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    scores = rows(tmp_path / "out_" / "recording_scores.csv")
    assert int(scores[0]["labelled"]) == 6  # its truth is its own
    own = [boxes_of(one.message) for one in read(trial) if one.topic == "/midnet/detections"]
    said = list(read(tmp_path / name))
    again = [one for one in said if one.topic == "/replay/paper/detections"]
    assert [boxes_of(one.message) for one in again] == own
    assert [one.stamp_ns for one in again] == [k * NS // 5 for k in range(1, 7)]
    listed = [one.message for one in said if one.topic == "/replay/paper/detections_2d"]
    assert [len(one.detections) for one in listed] == [len(boxes) for boxes in own]
    assert sum(one.topic == "/replay/guard_2/scan" for one in said) == 6
    assert sum(one.topic == "/replay/paper/guard_2/foreground" for one in said) == 6
    assert (tmp_path / "out.foxglove.json").exists()


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Said], list[dict[str, str]]]:
    """What was written of a drive whose messages were recorded 0.4 s after their stamps."""
    folder = tmp_path_factory.mktemp("late")
    said = [*made.scan_messages(DRIVE), *made.pose_messages(DRIVE)]
    recorded = [one._replace(record_ns=one.record_ns + LAG_NS) for one in said]
    recording = made.write_bag(folder, [made.map_message(), *recorded])
    return written(recording, folder / "out.mcap", pose="/pose", mount=MOUNT)


def test_record_times_and_stamps_are_those_of_the_scans(
    late: tuple[list[Said], list[dict[str, str]]],
) -> None:
    said, boxes = late
    heard = [one for one in said if one.topic == "/replay/robot/scan"]
    assert {(one.stamp_ns, one.stamp_ns - stamp_of(one.message.header)) for one in heard} <= {
        (one.record_ns + LAG_NS, LAG_NS) for one in made.scan_messages(DRIVE)
    }
    by_frame = defaultdict(list)
    for row in boxes:
        sides = tuple(float(row[side]) for side in ("x_min_m", "y_min_m", "x_max_m", "y_max_m"))
        by_frame[int(row["frame"])].append(sides)
    frames = [one for one in said if one.topic == "/replay/real/detections"]
    assert len(frames) == len(heard)
    assert sum(map(len, by_frame.values())) > 5
    for number, one in enumerate(frames):
        for found, box in zip(boxes_of(one.message), by_frame[number], strict=True):
            assert found == pytest.approx(box, abs=1e-4)


def test_who_walks_through_keeps_the_number_of_a_track(
    late: tuple[list[Said], list[dict[str, str]]],
) -> None:
    said, _ = late
    frames = [one.message.markers[1:] for one in said if one.topic == "/replay/real/tracks"]
    cubes = [[one for one in frame if one.type == one.CUBE] for frame in frames]
    seen = Counter(one.ns for frame in cubes for one in frame)
    assert sum(map(len, cubes)) > 10
    assert seen.most_common(1)[0][1] > 0.8 * len([frame for frame in cubes if frame])
    assert {one.text for frame in frames for one in frame if one.type == one.TEXT_VIEW_FACING} == {
        name.removeprefix("track_") for name in seen
    }


def check_frames(said: list[Said], child: str, below: Pose2D) -> None:
    """The recording's topmost frame hangs where its robot, ``below`` from there, is on the map."""
    placed = [one.message.transforms for one in said if one.topic == "/tf"]
    assert len(placed) > 5
    for robot, top in placed:
        assert (robot.child_frame_id, top.child_frame_id) == ("replay/robot", child)
        apart = transform_of(robot.transform).compose(below).relative_to(transform_of(top.transform))
        assert (apart.x, apart.y, math.sin(apart.yaw)) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_the_laser_hangs_on_the_map(late: tuple[list[Said], list[dict[str, str]]]) -> None:
    check_frames(late[0], "laser", made.MOUNT)


@pytest.mark.slow
def test_the_recordings_own_base_hangs_on_the_map(tmp_path: Path) -> None:
    mount = made.Said("/tf_static", made.ns_of(0.0), made.mount_message(DRIVE), True)
    said, _ = written(recording_of(tmp_path, mount), tmp_path / "out.mcap", pose="/pose", mount=MOUNT)
    check_frames(said, "base_link", Pose2D(0.0, 0.0, 0.0))


@pytest.mark.slow
def test_a_recording_that_leads_to_the_map_has_its_own_transforms(tmp_path: Path) -> None:
    recording = recording_of(tmp_path, poses=made.tf_messages(DRIVE))
    said, _ = written(recording, tmp_path / "out.mcap", pose="tf")
    assert all(len(one.message.transforms) == 1 for one in said if one.topic == "/tf")


@pytest.mark.slow
def test_a_placed_odometry_hangs_on_the_map_where_it_was_placed(tmp_path: Path) -> None:
    odometry = [one for one in made.tf_messages(DRIVE) if "'map'" not in repr(one.message)]
    begins = DRIVE.track(0.0)
    start = [begins.x, begins.y, math.degrees(begins.yaw)]
    recording = recording_of(tmp_path, poses=odometry)
    said, _ = written(recording, tmp_path / "out.mcap", pose="tf", start=start)
    fixed = next(one.message.transforms for one in said if one.topic == "/tf_static")
    (odom,) = (one for one in fixed if one.child_frame_id == "odom")
    assert odom.header.frame_id == "map"
    assert made.map_to_odom(1.0).distance_to(transform_of(odom.transform)) < 0.1
    assert all(len(one.message.transforms) == 1 for one in said if one.topic == "/tf")


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    recording = recording_of(tmp_path)
    before = recording.read_bytes()
    for name in ("bag.mcap", "out.db3", "out.txt"):
        done = midnet_bench(
            *("replay", recording, "--map", "/map", "--pose", "/pose", "--bag", name), folder=tmp_path
        )
        assert name in one_line_of_complaint(done)
    assert recording.read_bytes() == before
    (tmp_path / "folder").mkdir()
    inner = recording.rename(tmp_path / "folder" / "part_0.mcap")
    other = recording_of(tmp_path, name="other")
    (tmp_path / "setup.yaml").write_text("background: other.mcap\npose: /pose\n")
    for bag, given in ((inner, ("--map", "/map")), (other, ("--setup", "setup.yaml"))):
        before = bag.read_bytes()
        done = midnet_bench("replay", tmp_path / "folder", *given, "--bag", bag, folder=tmp_path)
        assert "is the recording itself" in one_line_of_complaint(done)
        assert bag.read_bytes() == before
    with pytest.raises(InputError, match="map"):  # no map is known
        replay([inner], RecordingSetup(), lambda line: None, lambda share: None, bag=tmp_path / "o.mcap")


@pytest.mark.parametrize("way", [["--check"], ["--steps", "3"]])
def test_a_bag_without_a_replay_is_refused(way: list[str], tmp_path: Path) -> None:
    recording = recording_of(tmp_path)
    given = ("replay", recording, "--map", "/map", "--pose", "/pose", "--bag", "o.mcap", *way)
    complaint = one_line_of_complaint(midnet_bench(*given, folder=tmp_path))
    assert "--bag" in complaint
    assert way[0] in complaint
    assert not (tmp_path / "o.mcap").exists()
