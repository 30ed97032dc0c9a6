"""ROS 1 bags, ROS 2 bag folders, MCAP and SQLite files, read by ``rosbags``; no ROS is needed.

What a file is, its first bytes say. A ROS 2 folder is its data files; ``metadata.yaml`` only names them.
"""

import re
import stat
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any

from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.io.checked_yaml import read_yaml
from midnet_bench.recording.files.readings import KINDS, TF, Reading, Topic, decoded
from midnet_bench.recording.files.records import (
    MCAP_MAGIC,
    ROS1_MAGIC,
    ZSTD_MAGIC,
    TooLargeError,
    Unindexed,
    check_size,
    unpack_file,
    unpacked,
)
from midnet_bench.recording.files.writer import types_of

TF_TYPE = "tf2_msgs/msg/TFMessage"  # which tf's first version calls tf/tfMessage
ROS1, MCAP, SQLITE, PACKED = ".bag", ".mcap", ".db3", ".zstd"
MAGIC = {ROS1_MAGIC: ROS1, MCAP_MAGIC: MCAP, b"SQLite format 3": SQLITE, ZSTD_MAGIC: PACKED}
"""first bytes of a file -> the ending that it should have"""


def is_bag(path: Path) -> bool:
    """Whether a file is a bag by its first bytes or its ending, or a folder is one of ROS 2."""
    if path.is_dir():
        return (path / "metadata.yaml").exists() or any(map(_kind, _in_folder(path)))
    return bool(_kind(path)) or path.suffix in MAGIC.values()


def _kind(path: Path) -> str:
    """The ending that a file should have by its first bytes; empty if it is no bag."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            return ""
        with path.open("rb") as file:
            begins = file.read(16)
    except OSError:
        return ""
    return next((kind for magic, kind in MAGIC.items() if begins.startswith(magic)), "")


def _in_folder(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if not path.is_dir() and path.name != "metadata.yaml")


def _files(path: Path) -> list[Path]:
    """The file, or the data files of a ROS 2 bag: those that its metadata names, if all of them are there.

    Else those that are there, if their names differ by a number at most: a bag that was never closed has no
    metadata, and that of a renamed file names what is gone.

    Raises:
        InputError: one is a pipe, a socket or a device, which may never end; or there are none, or several.
    """
    if not path.is_dir():
        return [_ordinary(path)]
    there = [_ordinary(file) for file in _in_folder(path)]
    try:
        said = read_yaml(_ordinary(path / "metadata.yaml"))["rosbag2_bagfile_information"]
        named = [path / PurePath(name).name for name in said["relative_file_paths"]]
        if named and set(named) <= set(there):
            return named
    except (InputError, LookupError, TypeError, ValueError):
        if (path / "metadata.yaml").exists():
            _ordinary(path / "metadata.yaml")
    found = [file for file in there if _kind(file) in (MCAP, SQLITE, PACKED)]
    if len({re.sub(r"_\d+$", "", file.name.split(".")[0]) for file in found}) != 1:
        what = ", ".join(file.name for file in found) or "no data file of one"
        raise InputError(f"{path}: is the folder of no one ROS 2 bag: it holds {what[:120]}; give a file")
    return found


def _ordinary(path: Path) -> Path:
    try:
        if stat.S_ISREG(path.stat().st_mode):
            return path
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    raise InputError(f"{path}: is a pipe, a socket or a device; give an ordinary file")


class Bag:
    """One recorded bag. Messages of types without readings are never decoded."""

    def __init__(self, path: Path) -> None:
        """Open it. Raises InputError: it is no bag, or nothing of it can be read."""
        self.path = str(path)
        self.remarks: list[str] = []
        self.mount: Pose2D | None = None  # transforms have it
        self._stack = ExitStack()
        try:
            self._parts = [self._opened(file) for file in _files(path)]
            first = self._parts[0]
            self._is_ros1 = isinstance(first, Ros1Reader) or getattr(first, "is_ros1", False)
            self.topics = self._topics()
            spans = [span for part in self._parts if (span := _span(part)) is not None]
            self.start_ns = min((start_ns for start_ns, _ in spans), default=0)
            self.end_ns = max((end_ns for _, end_ns in spans), default=0)
            self._parts.sort(key=lambda part: _span(part) or (0, 0))
        except Exception as error:  # whatever a library raises of a file that is no bag
            self.close()
            if isinstance(error, InputError):
                raise
            what = "" if isinstance(error, TooLargeError) else "no bag that can be read: "
            raise InputError(f"{path}: {what}{in_words(error)}") from error
        self._store = types_of(1 if self._is_ros1 else 2).store

    def _opened(self, path: Path) -> Any:
        """A reader of a file. Raises TooLargeError: a chunk is too large by what the index says of it."""
        kind = _kind(path) or path.suffix
        if kind == PACKED:
            folder = self._stack.enter_context(TemporaryDirectory(ignore_cleanup_errors=True))
            unpack_file(path, inner := Path(folder) / path.stem)
            path, kind = inner, _kind(inner)
        if kind not in READERS:
            raise ValueError(f"{path.name} begins as no bag does")
        try:
            reader = READERS[kind](path)
            reader.open()
            if isinstance(reader, McapReader) and _span(reader) and not reader.chunks:
                reader.close()
                raise ValueError("rosbags reads messages without an index only in the order of their times")
        except TooLargeError:
            raise
        except Exception:  # a bag that was cut off has lost its index, and no more than its end
            if kind == SQLITE:
                raise
            self.remarks.append(f"{path}: its index is missing; its records are read in their order")
            return Unindexed(path)
        self._stack.callback(reader.close)
        if isinstance(reader, Ros1Reader):
            check_size(max((chunk.datasize for chunk in reader.chunks.values()), default=0))
        for chunk in reader.chunks if isinstance(reader, McapReader) else ():
            check_size(max(chunk.compressed_size, chunk.uncompressed_size))
        return reader

    def _topics(self) -> dict[str, Topic]:
        found: dict[str, Topic] = {}
        for connection in (one for part in self._parts for one in part.connections):
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
        decode = self._store.deserialize_ros1 if self._is_ros1 else self._store.deserialize_cdr
        record_ns = self.start_ns
        messages = (
            message
            for part in self._parts
            if (wanted := [one for one in part.connections if one.topic in topics and one.msgtype in KINDS])
            for message in part.messages(wanted, start_ns, stop_ns)
        )
        try:
            for connection, record_ns, raw in messages:
                topic = self.topics[connection.topic]
                if topic.type != connection.msgtype:  # two types on one topic
                    topic = topic._replace(type=connection.msgtype, kind=KINDS[connection.msgtype])
                known = TF_TYPE if topic.kind == TF else connection.msgtype
                # each message may be packed by itself; one that is not begins with its encoding
                is_packed = not self._is_ros1 and raw.startswith(ZSTD_MAGIC)
                message = decode(unpacked("zstd", raw) if is_packed else raw, known)
                yield from decoded(topic, record_ns, message)
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
        self._stack.close()


READERS: dict[str, Any] = {ROS1: Ros1Reader, MCAP: McapReader, SQLITE: Sqlite3Reader}


def _span(part: Any) -> tuple[int, int] | None:
    """First record time and the instant after the last one, ns; None of a file without messages."""
    if not any(connection.msgcount for connection in part.connections):
        return None
    times = getattr(part, "metadata", part)
    return int(times.start_time), int(times.end_time)


def in_words(said: BaseException | str) -> str:
    """An error of another library, or a text from elsewhere, on one line, printable and not too long."""
    words = " ".join(str(said).split()) or type(said).__name__
    words = f"{words} is missing" if isinstance(said, KeyError) else words
    plain = "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in words)
    return plain if len(plain) <= 120 else f"{plain[:117]}..."
