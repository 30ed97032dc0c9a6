"""``BagWriter``: ROS messages into an MCAP file, the folder of a ROS 2 bag or a ROS 1 bag, without ROS."""

import contextlib
import sqlite3
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from rosbags import interfaces
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from midnet_bench.errors import InputError, MidnetBenchError, nearest_name
from midnet_bench.io.files import cannot_be_written, temporary_folder
from midnet_bench.recording.files.readings import NS

if TYPE_CHECKING:  # it takes numba, which readers of bags do without
    from midnet_bench.recording.files.ros_messages import Message

ENDINGS = {"mcap": ".mcap", "ros2": "", "ros1": ".bag"}
"""of each format: a plain MCAP file, a ROS 2 bag's folder with an SQLite file, a ROS 1 bag"""
QUATERNION = "geometry_msgs/msg/Quaternion"
TIME = "builtin_interfaces/msg/Time"

_HYPOTHESIS = "geometry_msgs/PoseWithCovariance pose"
_VISION_MSGS = {
    1: {  # 0.0.1 of Noetic
        "ObjectHypothesisWithPose": f"int64 id\nfloat64 score\n{_HYPOTHESIS}",
        "BoundingBox2D": "geometry_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y",
        "Detection2D": (
            "Header header\nObjectHypothesisWithPose[] results\nBoundingBox2D bbox\n"
            "sensor_msgs/Image source_img"
        ),
        "Detection2DArray": "Header header\nDetection2D[] detections",
    },
    2: {  # 4, since Humble
        "Point2D": "float64 x\nfloat64 y",
        "Pose2D": "vision_msgs/Point2D position\nfloat64 theta",
        "ObjectHypothesis": "string class_id\nfloat64 score",
        "ObjectHypothesisWithPose": f"ObjectHypothesis hypothesis\n{_HYPOTHESIS}",
        "BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y",
        "Detection2D": (
            "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox2D bbox\nstring id"
        ),
        "Detection2DArray": "std_msgs/Header header\nDetection2D[] detections",
    },
}
"""what rosbags does not know, for ROS 1 and ROS 2"""


def format_of(path: Path, given: str | None = None) -> str:
    """The format of a bag: the ``given`` one, else what its name stands for.

    Raises InputError: the name stands for none, or for another one.
    """
    named = next((bag_format for bag_format, ending in ENDINGS.items() if path.suffix == ending), None)
    if given is not None:
        if path.suffix and named not in (None, given):
            raise InputError(f"{path}: is the name of a {named} bag; --format {given} is another")
        return given
    if named is not None:
        return named
    raise InputError(f"{path}: is no bag's name; end it in .mcap or .bag, or in nothing for a ROS 2 folder")


def ending_of(bag_format: str) -> str:
    """What the name of such a bag ends in, dot included; empty for a folder. Raises InputError: no format."""
    if bag_format not in ENDINGS:
        raise InputError(f"--format: no such choice '{bag_format}'{nearest_name(bag_format, ENDINGS)}")
    return ENDINGS[bag_format]


def _qos(is_kept: bool) -> interfaces.Qos:
    """Reliable; the last message of a topic that ``is_kept`` reaches later subscribers."""
    durability, forever = interfaces.QosDurability, interfaces.QosTime(0, 0)
    return interfaces.Qos(
        interfaces.QosHistory.KEEP_LAST,
        1 if is_kept else 10,
        interfaces.QosReliability.RELIABLE,
        durability.TRANSIENT_LOCAL if is_kept else durability.VOLATILE,
        deadline=forever,
        lifespan=forever,
        liveliness=interfaces.QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=forever,
        avoid_ros_namespace_conventions=False,
    )


class Types:
    """Message types of one ROS, and instances of them."""

    def __init__(self, ros: Literal[1, 2]) -> None:
        self.store = store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
        self._pack = store.serialize_ros1 if ros == 1 else store.serialize_cdr
        self.unpacked = store.deserialize_ros1 if ros == 1 else store.deserialize_cdr
        """a message from its bytes and its type"""
        found: dict[str, Any] = {}
        for name, definition in _VISION_MSGS[ros].items():
            found |= get_types_from_msg(definition, f"vision_msgs/msg/{name}")
        if ros == 1:
            transforms = "geometry_msgs/TransformStamped[] transforms"
            found |= get_types_from_msg(transforms, "tf2_msgs/msg/TFMessage")
        self.store.register(found)
        self._empty: dict[str, Any] = {}

    def packed(self, message: "Message") -> bytes:
        """The bytes of a message."""
        return bytes(self._pack(self.made(*message), message.kind))

    def made(self, kind: str, fields: Any) -> Any:
        """A message of that type from its :data:`Fields`, a time from its nanoseconds."""
        message_type = self.store.types[kind]
        if kind == TIME and not isinstance(fields, Mapping):
            return message_type(*divmod(fields, NS))
        if not fields:  # no message is changed, so all share the one where nothing is given
            if kind not in self._empty:
                self._empty[kind] = self._filled(kind, {"w": 1.0} if kind == QUATERNION else {})
            return self._empty[kind]
        return self._filled(kind, fields)

    def _filled(self, kind: str, fields: Mapping[str, Any]) -> Any:
        described = self.store.fielddefs[kind][1]
        return self.store.types[kind](**{name: self._field(of, fields.get(name)) for name, of in described})

    def _field(self, described: Any, value: Any) -> Any:
        """What a field holds for a value, or for None; ``described``: as rosbags has it."""
        node, what = described
        if node == Nodetype.NAME:
            return self.made(what, {} if value is None else value)
        if node == Nodetype.BASE:
            return {"string": "", "bool": False}.get(what[0], 0) if value is None else value
        (of, name), length = what
        if of == Nodetype.BASE and name[0] != "string":
            return np.zeros(length if node == Nodetype.ARRAY else 0, name[0]) if value is None else value
        return [self._field(what[0], each) for each in value or ()]


@cache
def types_of(ros: Literal[1, 2]) -> Types:
    """The same for all bags: rosbags writes and compiles an encoder of each type."""
    return Types(ros)


class BagWriter:
    """A bag that is being written; messages must come in the order of their times."""

    def __init__(self, writer: Ros1Writer | Ros2Writer) -> None:
        """``writer``: opened."""
        self._writer = writer
        self.ros: Literal[1, 2] = 1 if isinstance(writer, Ros1Writer) else 2
        self._types = types_of(self.ros)
        self._topics: dict[str, Any] = {}

    @property
    def kinds(self) -> dict[str, str]:
        """Topic -> message type of what was written."""
        return {topic: connection.msgtype for topic, connection in self._topics.items()}

    def write(self, topic: str, stamp_ns: int, message: "Message", is_kept: bool = False) -> None:
        """Append a message, recorded at ``stamp_ns``.

        ``is_kept``: whether players hand the topic's last message to later subscribers (latched).
        """
        connection = self._topics.get(topic)
        if connection is None:
            connection = self._topics[topic] = self._add(topic, message.kind, is_kept)
        self._writer.write(connection, stamp_ns, self._types.packed(message))

    def _add(self, topic: str, kind: str, is_kept: bool) -> Any:
        if isinstance(self._writer, Ros1Writer):
            return self._writer.add_connection(
                topic, kind, typestore=self._types.store, callerid="/midnet_bench", latching=int(is_kept)
            )
        return self._writer.add_connection(
            topic, kind, typestore=self._types.store, offered_qos_profiles=[_qos(is_kept)]
        )


@contextlib.contextmanager
def bag_writer(path: Path, bag_format: str) -> Iterator[BagWriter]:
    """Writes the bag ``path``, which is there in full after the block, and as it was if anything fails.

    An MCAP file is compressed by Zstandard and a ROS 1 bag by BZip2, in chunks, as their own tools do.

    Raises:
        InputError: no such format, or the place cannot be written; a ROS 2 bag's folder must not be there.
        MidnetBenchError: the disk is full.
    """
    ending = ending_of(bag_format)
    if bag_format == "ros2" and path.exists():
        raise InputError(f"{path}: is there already; remove it, or give another name")
    if bag_format != "ros2" and path.is_dir():
        raise InputError(f"{path}: is a folder; give a file, such as {path / ('trial' + ending)}")
    try:
        with temporary_folder(path) as folder:
            draft = folder / path.name
            with _opened(draft, bag_format) as writer:
                yield BagWriter(writer)
            # rosbags makes a folder about an MCAP file, for the metadata that the file itself has too
            (draft / f"{draft.name}.mcap" if bag_format == "mcap" else draft).replace(path)
    except OSError as error:
        raise cannot_be_written(path, error) from error
    except sqlite3.OperationalError as error:
        raise MidnetBenchError(f"{path}: cannot be written: {error}; make room") from error


def _opened(path: Path, bag_format: str) -> Ros1Writer | Ros2Writer:
    if bag_format == "ros1":
        ros1 = Ros1Writer(path)
        # ROS cannot read the frames that rosbags makes with LZ4: they have no checksum
        ros1.set_compression(Ros1Writer.CompressionFormat.BZ2)
        return ros1
    # version 8 of its metadata is what ROS 2 from Humble to the newest reads
    if bag_format == "ros2":
        return Ros2Writer(path, version=8, storage_plugin=StoragePlugin.SQLITE3)
    mcap = Ros2Writer(path, version=8, storage_plugin=StoragePlugin.MCAP)
    mcap.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    return mcap
