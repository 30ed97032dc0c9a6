"""``export``: what stands in a bag; ``test_replay_bag.py`` and ``test_cli_replay.py`` play it again."""

import json
import math
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from midnet_bench.campaign.trial import Scalar
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.recording.files.writer import ENDINGS
from midnet_bench.workflows.export import export_trial

FRAMES, SEED = 3, 3
TEAM: dict[str, Scalar] = {"robots": 3, "frames": FRAMES, "engine": "fast"}
NS = 1_000_000_000


class Said(NamedTuple):
    """One message of a bag."""

    topic: str
    kind: str
    stamp_ns: int
    message: Any


def read(path: Path) -> Iterator[Said]:
    """All messages in their order."""
    with AnyReader([path]) as bag:
        for connection, stamp_ns, raw in bag.messages():
            message = bag.deserialize(raw, connection.msgtype)
            yield Said(connection.topic, connection.msgtype, stamp_ns, message)


def stamp_of(header: Any) -> int:
    return int(header.stamp.sec * NS + header.stamp.nanosec)


def pose_of(message: Any) -> Pose2D:
    at, turn = message.position, message.orientation
    return Pose2D(at.x, at.y, 2.0 * math.atan2(turn.z, turn.w))


def trials_own(parameters: dict[str, Scalar], seed: int) -> list[list[Box]]:
    """What the trial that nobody writes down detects, frame by frame."""
    with DetectionTrial(DetectionParameters.of(**parameters), seed) as trial:
        return [frame.midnet.detections for frame in trial.frames()]


@pytest.fixture(scope="module")
def detected() -> list[list[Box]]:
    found = trials_own(TEAM, SEED)
    assert len(found) == FRAMES
    assert sum(map(len, found)) > FRAMES
    return found


FORMATS = [name if name == "mcap" else pytest.param(name, marks=pytest.mark.slow) for name in ENDINGS]


@pytest.fixture(scope="module", params=FORMATS)
def exported(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> list[Said]:
    path = tmp_path_factory.mktemp(request.param) / "made" / f"trial{ENDINGS[request.param]}"
    told: list[tuple[int, int]] = []
    export_trial("detection", TEAM, SEED, path, request.param, lambda done, most: told.append((done, most)))
    assert told == [(number, FRAMES) for number in range(1, FRAMES + 1)]
    assert path.is_dir() == (request.param == "ros2")
    beside = {"trial.foxglove.json", "trial.setup.yaml"}
    assert {one.name for one in path.parent.iterdir()} == {path.name, *beside}
    return list(read(path))


def test_detections_stand_in_the_bag(exported: list[Said], detected: list[list[Box]]) -> None:
    markers = [one for one in exported if one.topic == "/midnet/detections"]
    arrays = [one for one in exported if one.topic == "/midnet/detections_2d"]
    for number, (marked, listed, boxes) in enumerate(zip(markers, arrays, detected, strict=True), 1):
        assert marked.stamp_ns == listed.stamp_ns == number * NS // 5
        first, *cubes = marked.message.markers
        assert first.action == first.DELETEALL
        assert {cube.ns for cube in cubes} <= {f"guard_{robot}" for robot in range(1, 4)}
        for cube, entry, box in zip(cubes, listed.message.detections, boxes, strict=True):
            size = (cube.scale.x, cube.scale.y)
            assert size == (entry.bbox.size_x, entry.bbox.size_y)
            assert size == pytest.approx((box.x_max - box.x_min, box.y_max - box.y_min), abs=1e-12)
            at = getattr(entry.bbox.center, "position", entry.bbox.center)
            assert (cube.pose.position.x, cube.pose.position.y) == (at.x, at.y)
            assert (at.x, at.y) == pytest.approx(box.center, abs=1e-12)


def test_every_frame_hangs_on_the_map(exported: list[Said]) -> None:
    parents: dict[str, str] = {}
    used: set[str] = set()
    for one in exported:
        message = one.message
        if one.kind.endswith("TFMessage"):
            for each in message.transforms:
                parents[each.child_frame_id] = each.header.frame_id
        headers = [each.header for each in getattr(message, "markers", [])]
        if hasattr(message, "header"):
            assert stamp_of(message.header) == one.stamp_ns
            headers.append(message.header)
        used |= {header.frame_id for header in headers}
        used |= {getattr(message, "child_frame_id", "map")}
    for frame in used:
        while frame != "map":
            frame = parents[frame]


def test_a_pose_comes_before_its_scan(exported: list[Said]) -> None:
    scans, last_ns = 0, dict[str, int]()
    for one in exported:
        last_ns[one.topic] = one.stamp_ns
        if not one.topic.endswith("/scan"):
            continue
        scans += 1
        assert last_ns[one.topic.replace("/scan", "/pose")] == one.stamp_ns
        said = one.message
        assert said.angle_max == pytest.approx(said.angle_min + 359 * said.angle_increment, abs=1e-5)
    assert scans == 3 * FRAMES


def transform_of(message: Any) -> Pose2D:
    at, turn = message.translation, message.rotation
    return Pose2D(at.x, at.y, 2.0 * math.atan2(turn.z, turn.w))


@pytest.mark.slow
@pytest.mark.parametrize("odometry", ["world", "encoder"])
def test_map_odom_and_base_hang_together(odometry: str, tmp_path: Path) -> None:
    export_trial(
        "detection",
        {**TEAM, "robots": 2, "odometry": odometry, "wheel_radius_error": 0.02},
        1,
        tmp_path / "b.mcap",
    )
    poses: dict[int, dict[str, Pose2D]] = defaultdict(dict)
    for topic, _, stamp_ns, message in read(tmp_path / "b.mcap"):
        if topic == "/guard_2/pose":
            poses[stamp_ns]["pose"] = pose_of(message.pose)
        elif topic == "/guard_2/odom":
            assert (message.header.frame_id, message.child_frame_id) == (
                "guard_2/odom",
                "guard_2/base_footprint",
            )
            poses[stamp_ns]["odometry"] = pose_of(message.pose.pose)
        elif topic == "/tf" and message.transforms[0].child_frame_id == "guard_2/odom":
            poses[stamp_ns]["map -> odom"], poses[stamp_ns]["odom -> base"] = (
                transform_of(one.transform) for one in message.transforms
            )
    assert len(poses) == 2 * FRAMES + 1
    drift_m = 0.0
    for found in poses.values():
        assert found["odom -> base"] == found["odometry"]
        whole = found["map -> odom"].compose(found["odom -> base"]).relative_to(found["pose"])
        assert (math.hypot(whole.x, whole.y), math.sin(whole.yaw)) == pytest.approx((0.0, 0.0), abs=1e-9)
        drift_m = math.hypot(*found["map -> odom"][:2])
    assert 1e-6 < drift_m < 0.5


@pytest.mark.slow
def test_a_layout_shows_what_the_bag_has(tmp_path: Path) -> None:
    export_trial("detection", {**TEAM, "robots": 1, "frames": 1}, 1, tmp_path / "b.bag", "ros1")
    layout = json.loads((tmp_path / "b.foxglove.json").read_text())
    panel = layout["configById"][layout["layout"]]
    assert panel["topics"].keys() == {one.topic for one in read(tmp_path / "b.bag")}
    shown = {topic for topic, how in panel["topics"].items() if how["visible"]}
    assert {"/map", "/guard_1/scan", "/midnet/detections", "/truth/markers"} <= shown
    assert "/guard_1/costmap" not in shown


def test_the_truth_is_told_by_name(exported: list[Said]) -> None:
    last = {one.topic: one.message for one in exported}
    cubes = {one.ns: one for one in last["/truth/markers"].markers if one.type == one.CUBE and one.ns}
    assert {"intruder_1", "stationary_1"} <= cubes.keys()
    for name, cube in cubes.items():
        pose = last[f"/truth/{name}/pose"].pose
        assert (pose.position.x, pose.position.y) == (cube.pose.position.x, cube.pose.position.y)
        assert 0.1 <= cube.scale.x <= 1.0


def test_grids_lie_on_the_lattice_of_the_map(exported: list[Said]) -> None:
    last = {one.topic: one.message for one in exported}
    origin = last["/map"].info.origin.position
    for topic in ("/guard_1/costmap", "/guard_1/foreground"):
        grid = last[topic]
        offset = np.array([grid.info.origin.position.x - origin.x, grid.info.origin.position.y - origin.y])
        assert np.abs(offset / 0.05 - np.round(offset / 0.05)).max() < 1e-6
    assert set(last["/guard_1/foreground"].data.tolist()) <= {0, 100}
    assert 100 in last["/guard_1/costmap"].data


@pytest.mark.slow
def test_a_labyrinth_trial_is_written_to_its_end(tmp_path: Path) -> None:
    parameters: dict[str, Scalar] = {"robots": 2, "intruders": 1, "engine": "fast", "time_limit_s": 1.0}
    assert export_trial("labyrinth", parameters, 1, tmp_path / "trial.bag", "ros1") == 5
    said = list(read(tmp_path / "trial.bag"))
    assert said[-1].stamp_ns == NS
    assert sum(one.topic == "/truth/intruder_1/pose" for one in said) == 5


@pytest.mark.parametrize(
    ("experiment", "parameters", "bag_format", "named"),
    [
        ("mapping", {}, "mcap", "mapping"),
        ("detection", {**TEAM, "oracle": "pose"}, "mcap", "oracle: pose"),
        ("detection", {**TEAM, "message_delay_s": 0.1}, "mcap", "network"),
        ("detection", TEAM, "ros", "--format"),
        ("detection", TEAM, "ros2", "is there already"),
        ("detection", TEAM, "ros1", "is a folder"),
    ],
)
def test_what_cannot_be_written_is_told(
    experiment: str, parameters: dict[str, Scalar], bag_format: str, named: str, tmp_path: Path
) -> None:
    path = tmp_path / "trial"
    if "is " in named:
        path.mkdir()
    before = list(tmp_path.iterdir())
    with pytest.raises(InputError, match=named):
        export_trial(experiment, parameters, SEED, path, bag_format)
    assert list(tmp_path.iterdir()) == before


def test_a_bag_stays_as_it_was_if_the_trial_breaks_off(tmp_path: Path) -> None:
    path = tmp_path / "trial.mcap"
    path.write_text("older")

    def stop(done: int, most: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export_trial("detection", {**TEAM, "robots": 1}, SEED, path, "mcap", stop)
    assert [one.read_text() for one in tmp_path.iterdir()] == ["older"]
