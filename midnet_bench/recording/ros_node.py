"""The ``midnet`` node of the paper, of either ROS: a middleware brings bytes, ``live.py`` makes frames.

rosbags unpacks and packs the messages of both. ROS 1: rospy alone, and none of ROS's message packages. ROS 2:
rclpy where it can be imported, else the wire itself, DDS, by Cyclone DDS. There the topic ``/scan`` is
``rt/scan``, and its type ``sensor_msgs::msg::dds_::LaserScan_``.
"""

import contextlib
import importlib
import logging
import os
import queue
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import cache, partial
from operator import itemgetter
from pathlib import Path
from typing import Any, Literal

from rosbags.interfaces import Nodetype

from midnet_bench.errors import InputError
from midnet_bench.grid import OccupancyGrid
from midnet_bench.recording.files.bags import in_words
from midnet_bench.recording.files.ros_messages import detections
from midnet_bench.recording.files.writer import Types, types_of
from midnet_bench.recording.live import MAP_TOPIC, TF_STATIC, LiveNode, LiveOptions

log = logging.getLogger("midnet_bench")

PUBLISHED = "/midnet/detections"
KIND = "visualization_msgs/msg/MarkerArray"
LOOK_EVERY_S = 0.5
DEBIANS = "/usr/lib/python3/dist-packages"  # where Debian puts Python packages for all its Pythons
SCAN = "sensor_msgs/msg/LaserScan"  # its messages come at best effort, all others reliably
KEPT = {MAP_TOPIC: 100, TF_STATIC: 100}
"""topics whose last messages come to a node that starts later, and how many of them"""
QUEUED = 10_000  # messages of any other topic that wait to be taken, at most
MOST_DOMAINS = 232  # the ports of a higher one are out of range
LOCAL = """<CycloneDDS><Domain Id="any">
<General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>
<AllowMulticast>false</AllowMulticast><MaxMessageSize>65500B</MaxMessageSize></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>99</MaxAutoParticipantIndex>
<Peers><Peer Address="localhost"/></Peers></Discovery>
</Domain></CycloneDDS>"""
"""of this machine alone, by unicast; CYCLONEDDS_URI says otherwise"""


def spin(middleware: "Rospy | Rclpy | Dds", options: LiveOptions, prior_map: OccupancyGrid | None) -> None:
    """Subscribe, and publish the detections of each frame until the node is shut down.

    A middleware hears and says the bytes of messages. Without a ``prior_map``, int8, the first message on
    ``/map`` is taken. Raises InputError: the detector's options cannot be.
    """
    node, reported = LiveNode(options, prior_map), ""
    listened = options.topics(prior_map is None)
    middleware.listen(listened)
    middleware.say("midnet listens to " + ", ".join(listened))
    while middleware.is_up():
        is_quiet = True
        for topic, raw, arrived_s in middleware.hear(LOOK_EVERY_S):
            is_quiet = False
            try:
                message = middleware.unpacked(raw, topic, listened[topic])
            except Exception as error:  # whatever rosbags raises of damaged bytes: they cost themselves
                node.leave_out("messages cannot be read", f"{topic}: {in_words(error)}", arrived_s)
                continue
            for detected in node.hear(topic, message, arrived_s):
                middleware.publish(middleware.types.packed(detections(*detected)))
        for line in node.warnings:
            middleware.say(line, is_warning=True)
        node.warnings.clear()
        if is_quiet and node.waits_for != reported:
            reported = node.waits_for
            middleware.say(f"midnet waits for {reported}" if reported else "midnet detects")


def node_of(ros: str, remappings: Sequence[str]) -> "Rospy | Rclpy | Dds":
    """On ROS ``1``, or on the ROS 2 that is set up here, else without one; ``remappings`` are ``FROM:=TO``.

    Raises InputError: neither rclpy nor Cyclone DDS, no rospy, no master, or it cannot start.
    """
    if ros == "1":
        return Rospy(remappings)
    try:
        rclpy = importlib.import_module("rclpy")
    except ImportError:
        return Dds(remappings)
    return Rclpy(rclpy, remappings)


class _Middleware:
    """Messages that wait to be taken, and the types that they have."""

    def __init__(self, ros: Literal[1, 2]) -> None:
        self.types = Types(ros)
        # every connection of rospy has a thread of its own; a full queue lets it read no more
        self._heard: queue.Queue[tuple[str, Any, float]] = queue.Queue(QUEUED)

    def _put(self, topic: str, raw: Any) -> None:
        self._heard.put((topic, raw, time.monotonic()))

    def hear(self, timeout_s: float) -> Iterator[tuple[str, Any, float]]:
        """Topic, bytes and time of arrival, seconds, of at most one message."""
        with contextlib.suppress(queue.Empty):
            yield self._heard.get(timeout=timeout_s)

    def unpacked(self, raw: Any, topic: str, kind: str) -> Any:
        """A message of ``kind`` from its bytes. Raises Exception: they are none of it."""
        return self.types.unpacked(raw, kind)


def rospy_module() -> Any:
    """The module ``rospy``, from Debian's packages if this Python has none of its own. Raises InputError."""
    try:
        return importlib.import_module("rospy")
    except ImportError as error:
        if DEBIANS in sys.path or not (Path(DEBIANS) / "rospy").is_dir():
            raise InputError(
                f"node --ros 1: {error}; install Debian's python3-rospy and use Debian's Python (docs/ros.md)"
            ) from error
    sys.path.append(DEBIANS)  # at the end: what this environment has itself comes before
    return rospy_module()


class Rospy(_Middleware):
    """A node of ROS 1."""

    def __init__(self, remappings: Sequence[str]) -> None:
        """Raises InputError: there is no rospy, or no master answers."""
        super().__init__(1)
        self._rospy = rospy_module()
        if not importlib.import_module("rosgraph").is_master_online():
            raise InputError("node --ros 1: no master answers at ROS_MASTER_URI; start roscore")
        self._rospy.init_node("midnet", argv=["midnet", *remappings])
        # instances of what is published hold bytes that are packed already
        definition, digest = self.types.store.generate_msgdef(KIND)
        named = {"_type": KIND.replace("/msg/", "/"), "_md5sum": digest, "_full_text": definition}
        packed = type("MarkerArray", (self._rospy.AnyMsg,), named)
        self._publisher = self._rospy.Publisher(PUBLISHED, packed, queue_size=100)

    def listen(self, topics: Mapping[str, str]) -> None:
        """Messages of any type are let in: :meth:`unpacked` refuses one of another type."""
        for topic in topics:
            self._rospy.Subscriber(topic, self._rospy.AnyMsg, partial(self._put, topic))

    def unpacked(self, raw: Any, topic: str, kind: str) -> Any:
        """Raises InputError: it is of another type than ``kind``."""
        given, wanted = raw._connection_header["type"], kind.replace("/msg/", "/")
        if given != wanted:
            raise InputError(f"{topic}: it has {given}; {wanted} is needed")
        return super().unpacked(bytes(raw._buff), topic, kind)

    def publish(self, packed: bytes) -> None:
        """To all that listen now."""
        raw = self._rospy.AnyMsg()
        raw._buff = packed
        self._publisher.publish(raw)

    def is_up(self) -> bool:
        """Until ROS shuts the node down, as Ctrl-C does."""
        return not self._rospy.is_shutdown()

    def say(self, line: str, is_warning: bool = False) -> None:
        """On /rosout and the terminal."""
        (self._rospy.logwarn if is_warning else self._rospy.loginfo)(line)


class Rclpy(_Middleware):
    """A node on rclpy, which takes and gives bytes that are packed already."""

    def __init__(self, rclpy: Any, remappings: Sequence[str]) -> None:
        super().__init__(2)
        self._rclpy, self._qos = rclpy, importlib.import_module("rclpy.qos")
        self._message = importlib.import_module("rosidl_runtime_py.utilities").get_message
        rclpy.init(args=["--ros-args", *(part for one in remappings for part in ("-r", one))])
        self._node = rclpy.create_node("midnet")
        self._publisher = self._node.create_publisher(self._message(KIND), PUBLISHED, 100)

    def listen(self, topics: Mapping[str, str]) -> None:
        """See ``SCAN`` and ``KEPT``."""
        for topic, kind in topics.items():
            profile = self._qos.QoSProfile(depth=KEPT.get(topic, QUEUED))
            if kind == SCAN:
                profile.reliability = self._qos.ReliabilityPolicy.BEST_EFFORT
            if topic in KEPT:
                profile.durability = self._qos.DurabilityPolicy.TRANSIENT_LOCAL
            heard = partial(self._put, topic)
            self._node.create_subscription(self._message(kind), topic, heard, profile, raw=True)

    def hear(self, timeout_s: float) -> Iterator[tuple[str, Any, float]]:
        """What one turn of the executor brings."""
        self._rclpy.spin_once(self._node, timeout_sec=timeout_s)
        while not self._heard.empty():
            yield self._heard.get()

    def publish(self, packed: bytes) -> None:
        """To all that listen now."""
        self._publisher.publish(packed)

    def is_up(self) -> bool:
        """Until ROS shuts the node down."""
        return bool(self._rclpy.ok())

    def say(self, line: str, is_warning: bool = False) -> None:
        """On /rosout and the terminal."""
        # rclpy refuses another severity from a place that has logged before
        if is_warning:
            self._node.get_logger().warning(line)
        else:
            self._node.get_logger().info(line)


class Dds(_Middleware):
    """A participant of ROS 2's network that needs no ROS 2."""

    def __init__(self, remappings: Sequence[str]) -> None:
        """Raises InputError: no Cyclone DDS, or it cannot start; a remapping or ROS_DOMAIN_ID is none."""
        super().__init__(2)
        try:
            self._dds = importlib.import_module("cyclonedds.core")
            domain, self._pub, self._qos, self._sub, self._topic = (
                importlib.import_module(f"cyclonedds.{name}")
                for name in ("domain", "pub", "qos", "sub", "topic")
            )
        except ImportError as error:
            raise InputError(
                f"node --ros 2: {error}; set up your ROS 2, or pip install 'midnet-bench[ros2]' (docs/ros.md)"
            ) from error
        self._renamed = dict(map(_remapping, remappings))
        number = _domain_id()
        try:
            # the domain lives as long as its object
            self._domain = None if "CYCLONEDDS_URI" in os.environ else domain.Domain(number, LOCAL)
            self._participant = domain.DomainParticipant(number)
        except self._dds.DDSException as error:
            raise InputError(f"node --ros 2: DDS cannot start: {error}") from error
        self._writer = self._end(self._pub.DataWriter, PUBLISHED, KIND)
        self._wakes = self._dds.WaitSet(self._participant)
        self._readers: dict[str, Any] = {}

    def _end(self, reader_or_writer: Any, topic: str, kind: str) -> Any:
        """One end of a topic."""
        policy = self._dds.Policy
        qos = self._qos.Qos(
            policy.History.KeepLast(KEPT.get(topic, QUEUED)),
            policy.DataRepresentation(True, False),
            policy.Reliability.BestEffort if kind == SCAN else policy.Reliability.Reliable(1_000_000_000),
            policy.Durability.TransientLocal if topic in KEPT else policy.Durability.Volatile,
        )
        at, name = self._participant, f"rt{self._renamed.get(topic, topic)}"
        return reader_or_writer(at, self._topic.Topic(at, name, bytes_type(kind)), qos)

    def listen(self, topics: Mapping[str, str]) -> None:
        """See ``SCAN`` and ``KEPT``."""
        dds = self._dds
        every = dds.SampleState.Any | dds.ViewState.Any | dds.InstanceState.Any
        for topic, kind in topics.items():
            self._readers[topic] = self._end(self._sub.DataReader, topic, kind)
            self._wakes.attach(dds.ReadCondition(self._readers[topic], every))

    def hear(self, timeout_s: float) -> Iterator[tuple[str, Any, float]]:
        """All that has come, in the order in which it was sent."""
        self._wakes.wait(round(timeout_s * 1e9))
        came = [
            (sample.sample_info.source_timestamp, topic, sample.packed)
            for topic, reader in self._readers.items()
            for sample in reader.take(QUEUED)
            if isinstance(sample, _Sample)
        ]
        arrived_s = time.monotonic()
        for _, topic, packed in sorted(came, key=itemgetter(0)):
            yield topic, packed, arrived_s

    def publish(self, packed: bytes) -> None:
        """To all that listen now."""
        self._writer.write(bytes_type(KIND).of(packed))

    def is_up(self) -> bool:
        """Until Ctrl-C."""
        return True

    def say(self, line: str, is_warning: bool = False) -> None:
        """On the terminal."""
        log.log(logging.WARNING if is_warning else logging.INFO, line)


class _Sample:
    """What was read: its bytes, as they came. Cyclone DDS adds the sample's own facts."""

    sample_info: Any = None

    def __init__(self, packed: bytes) -> None:
        self.packed = packed


@cache
def bytes_type(kind: str) -> Any:
    """A DDS type whose instances are a message's bytes: malformed ones are met where each costs itself."""
    idl = idl_type(kind)
    idl.deserialize = staticmethod(lambda data, *_, **__: _Sample(bytes(data)))
    idl.deserialize_key = staticmethod(lambda *_, **__: None)
    idl.serialize = lambda self, *_, **__: self.packed

    def of(packed: bytes) -> Any:
        made = idl.__new__(idl)
        made.packed = packed
        return made

    idl.of = staticmethod(of)
    return idl


@cache
def idl_type(kind: str) -> Any:
    """The DDS type of a message, named as ROS 2 names it."""
    idl, wire = importlib.import_module("cyclonedds.idl"), importlib.import_module("cyclonedds.idl.types")

    def of(described: Any) -> Any:
        node, what = described
        if node == Nodetype.NAME:
            return idl_type(what)
        if node == Nodetype.BASE:
            plain = {"string": str, "bool": bool, "octet": wire.byte}
            return plain.get(what[0]) or getattr(wire, what[0])
        each, length = what
        if node == Nodetype.ARRAY:
            return wire.array[of(each), length]
        return wire.sequence[of(each), length] if length else wire.sequence[of(each)]

    package, _, name = kind.split("/")
    fields = {name: of(described) for name, described in types_of(2).store.fielddefs[kind][1]}
    return idl.make_idl_struct(f"{name}_", f"{package}.msg.dds_.{name}_", fields)


def _remapping(given: str) -> tuple[str, str]:
    """``/front/scan:=/scan`` as (from, to), both with a leading slash."""
    before, _, after = given.partition(":=")
    if not (before.strip("/") and after.strip("/")):
        raise InputError(f"{given}: is no remapping; give FROM:=TO, such as /guard_1/scan:=/scan")
    return f"/{before.lstrip('/')}", f"/{after.lstrip('/')}"


def _domain_id() -> int:
    """ROS_DOMAIN_ID, 0 without it."""
    given = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not given.isdecimal() or int(given) > MOST_DOMAINS:
        raise InputError(f"ROS_DOMAIN_ID: {given[:40]!r} is out of range; allowed: 0 to {MOST_DOMAINS}")
    return int(given)
