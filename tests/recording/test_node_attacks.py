"""A ROS 1 node that is fed malformed messages among sound ones gives the frames of the sound ones."""

import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from midnet_bench.campaign.trial import Scalar
from midnet_bench.recording import ros_node
from midnet_bench.recording.files.writer import Types
from midnet_bench.recording.live import LiveOptions
from midnet_bench.recording.setup import ReplaySettings
from midnet_bench.workflows.export import export_trial

SEED = 3
NAMES = ["guard_1", "guard_2", "guard_3"]
NS = 1_000_000_000
FIFTY_YEARS_S = 50 * 365 * 86_400
SCAN, POSE, MAP, TF = (
    "sensor_msgs/msg/LaserScan",
    "geometry_msgs/msg/PoseStamped",
    "nav_msgs/msg/OccupancyGrid",
    "tf2_msgs/msg/TFMessage",
)
OPTIONS = LiveOptions(NAMES, lambda resolution_m: ReplaySettings.of("paper", {}, resolution_m))
TYPES = Types(1)


class Raw(NamedTuple):
    """A message on the wire."""

    topic: str
    kind: str
    arrived_ns: int
    data: bytes

    @property
    def message(self) -> Any:
        return TYPES.store.deserialize_ros1(self.data, self.kind)

    def said(self, message: Any) -> "Raw":
        """The same with another message."""
        return self._replace(data=bytes(TYPES.store.serialize_ros1(message, self.kind)))


@cache
def whole_drive() -> list[Raw]:
    """What a team of three says in a trial, on the topics that a node listens to."""
    team: dict[str, Scalar] = {"robots": len(NAMES), "frames": 40, "engine": "fast"}
    listened = OPTIONS.topics(True)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "drive.bag"
        export_trial("detection", team, SEED, path, "ros1")
        with AnyReader([path]) as bag:
            return [
                Raw(connection.topic, connection.msgtype, stamp_ns + 1000 * NS, raw)
                for connection, stamp_ns, raw in bag.messages()
                if connection.topic in listened
            ]


def drive(frames: int) -> list[Raw]:
    """Its first frames."""
    return [one for one in whole_drive() if one.arrived_ns <= 1000 * NS + frames * NS // 5]


class Node(NamedTuple):
    """What a node has published, and warned of."""

    frames: list[bytes]
    warnings: list[str]


def node_of(messages: Sequence[Raw]) -> Node:
    """The node over a rospy that hands it these messages, each at its time."""
    heard, done = iter(messages), Node([], [])
    now_s, called = [0.0], dict[str, Callable[[Any], None]]()

    def is_shutdown() -> bool:
        one = next(heard, None)
        if one is None:
            return True
        now_s[0] = one.arrived_ns / NS
        header = {"type": one.kind.replace("/msg/", "/")}
        called[one.topic](SimpleNamespace(_connection_header=header, _buff=one.data))
        return False

    def subscriber(topic: str, kind: type, callback: Callable[[Any], None]) -> None:
        called[topic] = callback

    publisher = SimpleNamespace(publish=lambda raw: done.frames.append(raw._buff))
    rospy = SimpleNamespace(
        AnyMsg=type("AnyMsg", (), {}),
        Publisher=lambda *arguments, **named: publisher,
        Subscriber=subscriber,
        init_node=lambda *arguments, **named: None,
        is_shutdown=is_shutdown,
        loginfo=lambda line: None,
        logwarn=done.warnings.append,
    )
    found = {"rospy": rospy, "rosgraph": SimpleNamespace(is_master_online=lambda: True)}
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(ros_node, "importlib", SimpleNamespace(import_module=found.__getitem__))
        patched.setattr(ros_node, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
        ros_node.spin(ros_node.Rospy([]), OPTIONS, None)
    return done


def stamped(one: Raw, by_s: float) -> Raw:
    """The same, stamped later; before the epoch there is no time."""
    message = one.message
    stamp_ns = message.header.stamp.sec * NS + message.header.stamp.nanosec + round(by_s * NS)
    sec, nanosec = divmod(max(stamp_ns, 0), NS)
    stamp = replace(message.header.stamp, sec=sec, nanosec=nanosec)
    return one.said(replace(message, header=replace(message.header, stamp=stamp)))


def scanned(one: Raw, **fields: Any) -> Raw:
    return one.said(replace(one.message, **fields))


def ranged(one: Raw, ranges: Callable[[Any], Any]) -> Raw:
    return scanned(one, ranges=np.asarray(ranges(one.message.ranges), np.float32))


def posed(one: Raw, part: str, **fields: float) -> Raw:
    pose = one.message.pose
    return scanned(one, pose=replace(pose, **{part: replace(getattr(pose, part), **fields)}))


def mapped(one: Raw, **fields: Any) -> Raw:
    return scanned(one, info=replace(one.message.info, **fields))


ANY: dict[str, Callable[[Raw], Raw]] = {
    "three bytes": lambda one: one._replace(data=one.data[:3]),
    "no byte": lambda one: one._replace(data=b""),
    "half": lambda one: one._replace(data=one.data[: len(one.data) // 2]),
    "noise": lambda one: one._replace(data=random.Random(1).randbytes(len(one.data))),
    "lying length": lambda one: one._replace(data=one.data[:12] + b"\xff\xff\xff\xff" + one.data[16:]),
    "another type": lambda one: one._replace(kind="std_msgs/msg/String"),
}
STAMPED: dict[str, Callable[[Raw], Raw]] = {
    "50 years ahead": lambda one: stamped(one, FIFTY_YEARS_S),
    "a day ahead": lambda one: stamped(one, 86_400.0),
    "30 s ahead": lambda one: stamped(one, 30.0),
    "50 years ago": lambda one: stamped(one, -FIFTY_YEARS_S),
}
MALFORMED: dict[str, dict[str, Callable[[Raw], Raw]]] = {
    SCAN: {
        **ANY,
        **STAMPED,
        "no range": lambda one: ranged(one, lambda ranges: ranges[:0]),
        "half the beams": lambda one: ranged(one, lambda ranges: ranges[: len(ranges) // 2]),
        "one beam": lambda one: ranged(one, lambda ranges: ranges[:1]),
        "twice the beams": lambda one: ranged(one, lambda ranges: np.tile(ranges, 2)),
        "ranges nan": lambda one: ranged(one, lambda ranges: np.nan * ranges),
        "angle nan": lambda one: scanned(one, angle_min=np.nan),
        "increment 0": lambda one: scanned(one, angle_increment=0.0),
        "increment inf": lambda one: scanned(one, angle_increment=np.inf),
        "limit nan": lambda one: scanned(one, range_max=np.nan),
        "limit 0": lambda one: scanned(one, range_max=0.0),
    },
    POSE: {
        **ANY,
        **STAMPED,
        "1e300": lambda one: posed(one, "position", x=1e300),
        "nan": lambda one: posed(one, "position", x=np.nan),
        "inf": lambda one: posed(one, "position", x=-np.inf),
        "no turn": lambda one: posed(one, "orientation", w=0.0, z=0.0),
    },
    MAP: {
        **ANY,
        "empty": lambda one: scanned(mapped(one, width=0, height=0), data=one.message.data[:0]),
        "wrong size": lambda one: mapped(one, width=7),
        "huge size": lambda one: mapped(one, width=2**32 - 1, height=2**32 - 1),
        "resolution 0": lambda one: mapped(one, resolution=0.0),
        "resolution nan": lambda one: mapped(one, resolution=np.nan),
    },
    TF: {name: made for name, made in ANY.items() if name != "noise"},
}
EVERY = [(kind, name) for kind, made in MALFORMED.items() for name in made]


def with_malformed(sound: list[Raw], count: int) -> Iterator[Raw]:
    """These messages and so many malformed ones among them, each stamped a little later than a sound one.

    Each way to be malformed comes as often as any other.
    """
    rng = random.Random(count)
    samples = {kind: [one for one in sound if one.kind == kind] for kind in MALFORMED}
    places = sorted(rng.randrange(1, len(sound)) for _ in range(count))
    ways = [EVERY[number % len(EVERY)] for number in range(count)]
    rng.shuffle(ways)
    for number, one in enumerate(sound):
        yield one
        while places and places[0] == number:
            places.pop(0)
            kind, name = ways.pop()
            before = [said for said in samples[kind] if said.arrived_ns <= one.arrived_ns]
            template = before[-1] if before else samples[kind][0]
            if kind in (SCAN, POSE):
                template = stamped(template, 0.001)
            yield MALFORMED[kind][name](template)._replace(arrived_ns=one.arrived_ns)


@pytest.mark.slow
def test_malformed_messages_among_sound_ones_change_no_frame() -> None:
    sound = drive(20)
    wanted = node_of(sound)
    assert len(wanted.frames) == 19
    assert wanted.warnings == []
    found = node_of(list(with_malformed(sound, len(EVERY))))
    assert found.frames == wanted.frames
    assert 1 <= len(found.warnings) <= 14
    assert all(len(line) < 200 and line.isprintable() for line in found.warnings)


@pytest.fixture(scope="module")
def few() -> tuple[list[Raw], list[bytes]]:
    """Sound messages, and the frames of a node that hears no others."""
    sound = drive(3)
    return sound, node_of(sound).frames


# bytes that cannot be unpacked go the same way whatever the topic is
@pytest.mark.slow
@pytest.mark.parametrize(("kind", "name"), [one for one in EVERY if one[0] == SCAN or one[1] not in ANY])
def test_a_malformed_message_comes_first(kind: str, name: str, few: tuple[list[Raw], list[bytes]]) -> None:
    sound, frames = few
    template = next(one for one in sound if one.kind == kind)
    at = sound.index(template)
    bad = MALFORMED[kind][name](template)._replace(arrived_ns=sound[at].arrived_ns)
    found = node_of([*sound[:at], bad, *sound[at:]])
    assert found.frames == frames
    assert len(found.frames) == 2
    assert len(found.warnings) <= 1


@pytest.mark.slow
@pytest.mark.parametrize("by_s", [FIFTY_YEARS_S, -3600.0])
def test_a_clock_that_is_set_costs_a_second_or_two(by_s: float) -> None:
    def later(one: Raw, by_s: float) -> Raw:
        return stamped(stamped(one, 7200.0), by_s) if one.kind in (SCAN, POSE) else one

    sound = drive(40)
    middle_ns = sound[len(sound) // 2].arrived_ns
    found = node_of([later(one, 0.0 if one.arrived_ns < middle_ns else by_s) for one in sound])
    stamps_s = [int.from_bytes(frame[8:12], "little") - 7200 for frame in found.frames]
    assert sum(0 <= stamp_s < 8 for stamp_s in stamps_s) >= 18
    assert sum(0 <= stamp_s - by_s < 8 for stamp_s in stamps_s) >= 13


@pytest.mark.slow
def test_a_robot_whose_clock_is_off_does_not_silence_the_others() -> None:
    sound = drive(30)
    off = [stamped(one, FIFTY_YEARS_S) if one.topic.startswith("/guard_2/") else one for one in sound]
    found = node_of(off)
    assert len(found.frames) >= 20
    assert len(found.warnings) == 1
