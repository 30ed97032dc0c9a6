"""ROS 1 bags, ROS 2 bag folders and MCAP files, read by ``rosbags``; no ROS is needed."""

import contextlib
import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2 import Reader as Ros2Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.recording.files.readings import KINDS, TF, Reading, Topic, decoded
from midnet_bench.recording.files.unindexed import UnindexedRos1
from midnet_bench.recording.files.unpacking import TooLargeError, check_files, check_size, unpacked

TF_TYPE = "tf2_msgs/msg/TFMessage"
"""which tf's first version calls tf/tfMessage"""
BAG_ENDINGS = (".bag", ".mcap", ".db3")


def is_bag(path: Path) -> bool:
    """Whether a path is a bag by its name, or the folder of a ROS 2 bag."""
    return path.suffix in BAG_ENDINGS or (path.is_dir() and (path / "metadata.yaml").exists())


class Bag:
    """One recorded bag. Messages of types without readings are never decoded."""

    def __init__(self, path: Path) -> None:
        """Open it. Raises InputError: it is no bag, or its index is damaged."""
        self.path = str(path)
        self.remarks: list[str] = []
        self.mount: Pose2D | None = None  # transforms have it
        check_files(path)
        self._is_ros1 = path.suffix == ".bag"
        self._is_packed = False
        """whether each message is packed by itself"""
        self._reader: Any = Ros1Reader(path) if self._is_ros1 else Ros2Reader(path)
        try:
            try:
                self._reader.open()
            except Exception:  # a bag that was cut off has lost its index, and no more than its end
                if not self._is_ros1:
                    raise
                self._reader = UnindexedRos1(path)
                self.remarks.append(f"{path}: its index is missing; its records are read in their order")
            self._check_chunks()
            self.topics = self._topics()
            counts = sum(topic.messages for topic in self.topics.values())
            self.start_ns = int(self._reader.start_time) if counts else 0
            self.end_ns = int(self._reader.end_time) if counts else 0
        except TooLargeError as error:
            self.close()
            raise InputError(f"{path}: {error}") from error
        except Exception as error:  # whatever a library raises of a file that is no bag
            self.close()
            raise InputError(f"{path}: no bag that can be read: {in_words(error)}{self._advice()}") from error
        self._store = _types(self._is_ros1)

    def _advice(self) -> str:
        if self._is_ros1:
            return "; if it is cut off or was never closed, 'rosbag reindex' repairs it"
        return "; if it was never closed, 'ros2 bag reindex' or 'mcap recover' repairs it"

    def _check_chunks(self) -> None:
        """Raises TooLargeError: a chunk is too large by what the index says of it."""
        if isinstance(self._reader, Ros1Reader):
            check_size(max((chunk.datasize for chunk in self._reader.chunks.values()), default=0))
        if not isinstance(self._reader, Ros2Reader):
            return
        storage: Any = self._reader.storage
        for part in getattr(storage, "storages", [storage]):
            for chunk in getattr(part, "chunks", ()):
                check_size(max(chunk.compressed_size, chunk.uncompressed_size))
        if storage.metadata.compression_mode == "message":  # rosbags takes no count
            storage.metadata, self._is_packed = storage.metadata._replace(compression_mode=None), True

    def _topics(self) -> dict[str, Topic]:
        found: dict[str, Topic] = {}
        for connection in self._reader.connections:
            kind = KINDS.get(connection.msgtype, "")
            known = found.get(connection.topic)
            count = connection.msgcount + (known.messages if known else 0)
            kind = kind or (known.kind if known else "")
            found[connection.topic] = Topic(connection.topic, connection.msgtype, count, kind)
        return dict(sorted(found.items()))

    def readings(
        self, topics: set[str], start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[Reading]:
        """See :class:`Source`."""
        wanted = [
            connection
            for connection in self._reader.connections
            if connection.topic in topics and connection.msgtype in KINDS
        ]
        if not wanted:
            return
        decode = self._store.deserialize_ros1 if self._is_ros1 else self._store.deserialize_cdr
        record_ns = self.start_ns
        try:
            for connection, record_ns, raw in self._reader.messages(wanted, start=start_ns, stop=stop_ns):
                topic = self.topics[connection.topic]
                if topic.type != connection.msgtype:  # two types on one topic
                    topic = topic._replace(type=connection.msgtype, kind=KINDS[connection.msgtype])
                known = TF_TYPE if topic.kind == TF else connection.msgtype
                raw = unpacked("zstd", raw) if self._is_packed else raw
                yield from decoded(topic, record_ns, decode(raw, known))
        except TooLargeError as error:
            raise InputError(f"{self.path}: {error}") from error
        except Exception as error:  # whatever decoders raise of damaged bytes
            after_s = (record_ns - self.start_ns) / 1e9
            raise InputError(
                f"{self.path}: damaged {after_s:.3f} s after its start: {in_words(error)}; what came before "
                "was read"
            ) from error

    def close(self) -> None:
        """See :class:`Source`."""
        with contextlib.suppress(Exception):  # it may never have been opened
            self._reader.close()


@functools.cache
def _types(is_ros1: bool) -> Typestore:
    """The types that are read here, the same in all of ROS 1, and in all of ROS 2.

    All bags share them: rosbags writes and compiles a decoder of each type, for longer than it reads a bag.
    """
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    if TF_TYPE not in store.fielddefs:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF_TYPE))
    return store


def in_words(said: BaseException | str) -> str:
    """An error of another library, or a text from elsewhere, on one line, printable and not too long."""
    words = " ".join(str(said).split()) or type(said).__name__
    words = f"{words} is missing" if isinstance(said, KeyError) else words
    plain = "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in words)
    return plain if len(plain) <= 120 else f"{plain[:117]}..."
