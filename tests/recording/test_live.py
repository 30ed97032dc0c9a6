"""A ``LiveNode`` makes the same frames in whatever order messages come, and none before it can."""

import itertools
import math
import tracemalloc
from collections.abc import Iterable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from midnet_bench.campaign.trial import Scalar
from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.recording import live, poses
from midnet_bench.recording.files.ros_messages import transforms
from midnet_bench.recording.files.writer import Types
from midnet_bench.recording.live import Detected, LiveNode, LiveOptions
from midnet_bench.recording.setup import ReplaySettings
from midnet_bench.workflows.export import export_trial
from tests.recording.test_export import Said, read, trials_own

FRAMES, SEED = 15, 3
TEAM: dict[str, Scalar] = {"robots": 3, "frames": FRAMES, "engine": "fast"}
NAMES = ["guard_1", "guard_2", "guard_3"]
NS = 1_000_000_000
STILL = SimpleNamespace(
    translation=SimpleNamespace(x=0.0, y=0.0, z=0.0), rotation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
)


def options(pose_by_tf: bool = False, mount: Pose2D | None = None) -> LiveOptions:
    return LiveOptions(
        NAMES, lambda resolution_m: ReplaySettings.of("paper", {}, resolution_m), pose_by_tf, mount
    )


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> list[Said]:
    path = tmp_path_factory.mktemp("live") / "trial.mcap"
    export_trial("detection", TEAM, SEED, path)
    return list(read(path))


def heard(node: LiveNode, chosen: LiveOptions, said: Iterable[Said]) -> list[Detected]:
    topics = chosen.topics(needs_map=True)
    return [
        found
        for one in said
        if one.topic in topics
        for found in node.hear(one.topic, one.message, one.stamp_ns / NS)
    ]


def in_order(said: list[Said]) -> list[Detected]:
    return heard(LiveNode(options(), None), options(), said)


def test_frames_are_those_of_the_trial(said: list[Said]) -> None:
    found = in_order(said)
    # the last one waits for somebody to say that it is over
    assert [one.stamp_ns for one in found] == [number * NS // 5 for number in range(1, FRAMES)]
    own = trials_own(TEAM, SEED)
    assert sum(map(len, own)) > FRAMES
    # 32 bits of a range move an edge now and then
    same = sum(one.boxes == boxes for one, boxes in zip(found, own, strict=False))
    assert same >= FRAMES - 3


@pytest.mark.parametrize("seed", range(2))
def test_the_order_between_topics_does_not_matter(said: list[Said], seed: int) -> None:
    rng, chosen = np.random.default_rng(seed), options()
    by_topic = {topic: [one for one in said if one.topic == topic] for topic in chosen.topics(needs_map=True)}
    queues = [list(queue) for queue in by_topic.values()]
    shuffled = []
    while any(queues):
        # each topic up to 0.6 s later than others: less than the patience
        first_ns = min(queue[0].stamp_ns for queue in queues if queue)
        ready = [queue for queue in queues if queue and queue[0].stamp_ns <= first_ns + 0.6 * NS]
        shuffled.append(ready[rng.integers(len(ready))].pop(0))
    assert [one.topic for one in shuffled] != [one.topic for one in said if one.topic in by_topic]
    assert heard(LiveNode(chosen, None), chosen, shuffled) == in_order(said)


def test_tf_tells_the_same_poses_and_a_mount_may_be_told(said: list[Said]) -> None:
    by_tf, told = options(pose_by_tf=True), options(mount=Pose2D(-0.032, 0.0, 0.0))
    assert "/guard_1/pose" not in by_tf.topics(needs_map=True)
    assert heard(LiveNode(by_tf, None), by_tf, said) == in_order(said)
    without_tf = [one for one in said if one.topic != "/tf_static"]
    assert heard(LiveNode(told, None), told, without_tf) == in_order(said)


def test_it_says_what_it_waits_for(said: list[Said]) -> None:
    first = {one.topic: one for one in reversed(said)}
    node = LiveNode(options(), None)
    for topic, missing in [
        ("/guard_1/pose", "/map"),
        ("/map", "/guard_1/scan"),
        ("/guard_1/scan", "guard_1/base_scan"),
        ("/tf_static", "/guard_2/scan"),
        ("/guard_2/scan", "/guard_3/scan"),
        ("/guard_3/scan", ""),
    ]:
        node.hear(topic, first[topic].message, 0.0)
        assert missing in node.waits_for
        assert bool(missing) == bool(node.waits_for)
    by_tf = LiveNode(options(pose_by_tf=True), None)
    for topic in ("/map", "/tf_static", "/guard_1/scan"):
        by_tf.hear(topic, first[topic].message, 0.0)
    assert "map to guard_1/base_scan" in by_tf.waits_for


def test_a_robot_that_falls_silent_is_waited_for_no_longer_than_said(said: list[Said]) -> None:
    silent = [one for one in said if not (one.topic.startswith("/guard_2") and one.stamp_ns > 1.05 * NS)]
    found = in_order(silent)
    assert [one.stamp_ns for one in found[:5]] == [one.stamp_ns for one in in_order(said)[:5]]
    # the other two go on, a second behind their own stamps
    assert found[-1].stamp_ns == pytest.approx((FRAMES - 5) * NS // 5, abs=0.21 * NS)


def test_what_is_late_is_counted_and_a_gap_has_no_frames(said: list[Said]) -> None:
    gone = [
        one for one in said if not (one.topic in options().topics(True) and 1 * NS < one.stamp_ns < 2 * NS)
    ]
    node, chosen = LiveNode(options(), None), options()
    found = heard(node, chosen, gone)
    stamps = [one.stamp_ns for one in found]
    assert all(later > sooner for sooner, later in itertools.pairwise(stamps))
    assert not any(1.2 * NS <= stamp_ns < 2 * NS for stamp_ns in stamps)
    again = [one for one in said if one.topic == "/guard_1/scan"][:3]
    heard(node, chosen, again)
    assert node.dropped == {"scans came late, or their stamps go back": 3}


def test_what_cannot_be_is_left_out_and_counted(said: list[Said]) -> None:
    node, chosen = LiveNode(options(), None), options()
    broken, wrong = [], {"no range at all": 0, "a LiDAR that cannot be": 0}
    for one in said:
        if one.topic == "/guard_1/scan" and NS < one.stamp_ns < 1.5 * NS:
            one = one._replace(message=replace(one.message, angle_increment=float("nan")))
            wrong["a LiDAR that cannot be"] += 1
        elif one.topic == "/guard_1/scan" and 1.5 * NS < one.stamp_ns < 2 * NS:
            one = one._replace(message=replace(one.message, ranges=one.message.ranges[:0]))
            wrong["no range at all"] += 1
        broken.append(one)
    found = heard(node, chosen, broken)
    assert [one.boxes for one in found[:5]] == [one.boxes for one in in_order(said)[:5]]
    assert found[-1].stamp_ns == in_order(said)[-1].stamp_ns
    for what, count in wrong.items():
        assert [times for why, times in node.dropped.items() if what in why] == [count]


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"robots": ["guard_1", "guard_1"]}, "twice"),
        ({"robots": ["guard 1"]}, "guard 1"),
        *(({"rate_hz": hz}, "--rate: .* allowed: 0.01 to 1000") for hz in (0.0, 0.009, 1001.0, math.nan)),
        ({"patience_s": math.nan}, "--patience"),
    ],
)
def test_options_that_cannot_be_are_told(changes: dict[str, object], named: str) -> None:
    given = {"robots": NAMES, "settings_of": options().settings_of, **changes}
    with pytest.raises(InputError, match=named):
        LiveOptions(**given)  # type: ignore[arg-type]


def tf_of(stamp_ns: int, *children: str) -> object:
    placed = [("base", child, Pose2D(0.1, 0.0, 0.0)) for child in children]
    return Types(2).made(*transforms(stamp_ns, placed))


@pytest.mark.parametrize("stamp_s", [2e4, 2e9])
def test_clocks_of_frames_that_lead_to_no_laser_silence_nobody(said: list[Said], stamp_s: float) -> None:
    chosen = options(pose_by_tf=True)
    bad = Said(
        "/tf",
        "tf2_msgs/msg/TFMessage",
        0,
        tf_of(round(stamp_s * NS), *(f"joint_{number}" for number in range(20))),
    )
    half = len(said) // 2
    mixed = [*said[:half], *[bad._replace(stamp_ns=said[half].stamp_ns)] * 3, *said[half:]]
    assert heard(LiveNode(chosen, None), chosen, mixed) == in_order(said)


@pytest.mark.slow
def test_a_node_that_waits_takes_no_more_memory(said: list[Said], monkeypatch: pytest.MonkeyPatch) -> None:
    """Of poses of wheels, of frames that come and go, and of scans before a map is there."""
    for module, name, small in (
        (live, "KEPT", 20),
        (live, "MOST_FRAMES", 100),
        (live, "WAITED_NS", NS),
        (poses, "FORGET_EVERY", 5),
    ):
        monkeypatch.setattr(module, name, small)
    node, held = LiveNode(options(pose_by_tf=True), None), []
    scan = next(one.message for one in said if one.topic == "/guard_1/scan")
    short = replace(scan, ranges=scan.ranges[:2], angle_increment=scan.angle_max - scan.angle_min)
    tracemalloc.start()
    for number in range(400):
        stamp_ns = number * NS // 20
        stamp = replace(scan.header.stamp, sec=stamp_ns // NS, nanosec=stamp_ns % NS)
        scan = replace(short, header=replace(short.header, stamp=stamp))
        wheel = SimpleNamespace(header=scan.header, child_frame_id="wheel", transform=STILL)
        other = SimpleNamespace(header=scan.header, child_frame_id=f"frame_{number}", transform=STILL)
        node.hear("/tf", SimpleNamespace(transforms=[wheel, other]), stamp_ns / NS)
        node.hear("/guard_1/scan", scan, stamp_ns / NS)
        if number in (200, 399):
            held.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert held[1] < 1.05 * held[0]
    assert any("frames" in line for line in node.warnings)
