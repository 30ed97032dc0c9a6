"""ROS 1 bags, ROS 2 bag folders, MCAP and SQLite files, read by ``rosbags``; no ROS is needed.

What a file is, its first bytes say. A ROS 2 folder is its data files; ``metadata.yaml`` only names them.
Chunks are unpacked in bounded steps. A bag without its index is refused with the tool that makes one.
"""

import bz2
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any

import lz4.frame
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import reader as rosbag1
from rosbags.rosbag2 import ReaderError, storage_mcap
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.io.checked_yaml import read_yaml
from midnet_bench.recording.files.readings import KINDS, Reading, Topic, decoded
from midnet_bench.recording.files.writer import types_of

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

ROS1_MAGIC, MCAP_MAGIC, ZSTD_MAGIC = b"#ROSBAG V2.0", b"\x89MCAP0\r\n", b"\x28\xb5\x2f\xfd"
ROS1, MCAP, SQLITE, PACKED = ".bag", ".mcap", ".db3", ".zstd"
MAGIC = {ROS1_MAGIC: ROS1, MCAP_MAGIC: MCAP, b"SQLite format 3": SQLITE, ZSTD_MAGIC: PACKED}
"""first bytes of a file -> the ending that it should have"""
MOST_BYTES = 150_000_000  # of a chunk or a message; recorders make chunks of one to four megabytes
MOST_TIMES = 100
"""a file that is packed as a whole may grow to so many times its size; scans shrink to a fifth"""
STEP_BYTES = 1 << 20
NO_SPAN = 0, 0
_UNPACKERS: dict[str, Callable[[], Any]] = {
    "bz2": bz2.BZ2Decompressor,
    "lz4": lz4.frame.LZ4FrameDecompressor,
    "zstd": zstd.ZstdDecompressor,
}
MENDED_BY = {ROS1: "rosbag reindex {}", MCAP: "mcap recover {} -o NEW.mcap"}
"""what makes the index of a bag that was cut off or never closed; mcap: https://mcap.dev/guides/cli"""


class IndexedMcapReader(McapReader):
    """rosbags' reader without its search through files that have no index, which holds whole records."""

    def meta_scan(self) -> None:
        """Raises ReaderError: the file holds messages that no index names."""
        if self.statistics is None or self.statistics.message_count:
            raise ReaderError("its index is missing")


READERS: dict[str, Any] = {ROS1: Ros1Reader, MCAP: IndexedMcapReader, SQLITE: Sqlite3Reader}


def is_bag(path: Path) -> bool:
    """Whether a file is a bag by its first bytes or its ending, or a folder is one of ROS 2."""
    if path.is_dir():
        return (path / "metadata.yaml").exists() or any(map(_kind, path.iterdir()))
    return bool(_kind(path)) or path.suffix in MAGIC.values()


def _kind(path: Path) -> str:
    """The ending that a file should have by its first bytes; empty if it is no bag."""
    try:
        if not path.is_file():
            return ""
        with path.open("rb") as file:
            begins = file.read(16)
    except OSError:
        return ""
    return next((kind for magic, kind in MAGIC.items() if begins.startswith(magic)), "")


def _files(path: Path) -> list[Path]:
    """The file, or the data files of a ROS 2 bag: those that its metadata names, if all of them are there.

    Else those that are there, if their names differ by a number at most: a bag that was never closed has no
    metadata, and that of a renamed file names what is gone.

    Raises:
        InputError: one is a pipe, a socket or a device, which may never end; or there are none, or several.
    """
    there = sorted(file for file in path.iterdir() if not file.is_dir()) if path.is_dir() else [path]
    for file in there:
        if file.exists() and not file.is_file():
            raise InputError(f"{file}: is a pipe, a socket or a device; give an ordinary file")
    if not path.is_dir():
        return there
    try:
        information = read_yaml(path / "metadata.yaml")["rosbag2_bagfile_information"]
        named = [path / PurePath(name).name for name in information["relative_file_paths"]]
        if named and set(named) <= set(there):
            return named
    except (InputError, LookupError, TypeError, ValueError):
        pass  # the files themselves are what counts
    found = [file for file in there if _kind(file) in (MCAP, SQLITE, PACKED)]
    if len({re.sub(r"_\d+$", "", file.name.split(".")[0]) for file in found}) != 1:
        what = ", ".join(file.name for file in found) or "no data file of one"
        raise InputError(
            f"{path}: is the folder of no one ROS 2 bag: it holds {what[:120]}; give a file, or run "
            f"'ros2 bag reindex {path}' first"
        )
    return found


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
            spans = [_span(part) for part in self._parts if _span(part) != NO_SPAN]
        except Exception as error:  # whatever a library raises of a file that is no bag
            self.close()
            if isinstance(error, InputError):
                raise
            what = "" if isinstance(error, TooLargeError) else "no bag that can be read: "
            raise InputError(f"{path}: {what}{in_words(error)}") from error
        first = self._parts[0]
        self._is_ros1 = isinstance(first, Ros1Reader)
        self._unpacked = types_of(1 if self._is_ros1 else 2).unpacked
        self.start_ns = min((span[0] for span in spans), default=0)
        self.end_ns = max((span[1] for span in spans), default=0)
        found: dict[str, Topic] = {}
        for one in (one for part in self._parts for one in part.connections):
            known = found.get(one.topic, Topic(one.topic, one.msgtype, 0, ""))
            kind = KINDS.get(one.msgtype, known.kind)
            found[one.topic] = Topic(one.topic, one.msgtype, known.messages + one.msgcount, kind)
        self.topics = dict(sorted(found.items()))
        self._parts.sort(key=_span)

    def _opened(self, path: Path) -> Any:
        """A reader of a file.

        Raises:
            InputError: it has no index, or a damaged one.
            TooLargeError: a chunk is too large by what the index says of it.
        """
        given, kind = path, _kind(path) or path.suffix
        if kind == PACKED:
            folder = self._stack.enter_context(TemporaryDirectory(ignore_cleanup_errors=True))
            unpack_file(path, inner := Path(folder) / path.stem)
            path, kind = inner, _kind(inner)
        if kind not in READERS:
            raise ValueError(f"{path.name} begins as no bag does")
        try:
            reader = READERS[kind](path)
            reader.open()
            if kind == MCAP and _span(reader) != NO_SPAN and not reader.chunks:
                reader.close()
                raise ReaderError("its index is missing")
        except Exception as error:  # whatever rosbags raises of a file that is damaged
            if kind not in MENDED_BY:
                raise
            raise InputError(
                f"{given}: no bag that can be read: {in_words(error)}; where it was cut off or never closed "
                f"'{MENDED_BY[kind].format(given)}' makes its index"
            ) from error
        self._stack.callback(reader.close)
        if kind == ROS1:
            check_size(max((chunk.datasize for chunk in reader.chunks.values()), default=0))
        elif kind == MCAP:
            sizes = ((chunk.compressed_size, chunk.uncompressed_size) for chunk in reader.chunks)
            check_size(max(map(max, sizes), default=0))
        return reader

    def readings(
        self, topics: set[str], start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[Reading]:
        """See :class:`Source`."""
        record_ns = self.start_ns
        try:
            for part in self._parts:
                wanted = [one for one in part.connections if one.topic in topics and one.msgtype in KINDS]
                for connection, record_ns, raw in part.messages(wanted, start_ns, stop_ns) if wanted else ():
                    # each message may be packed by itself; one that is not begins with its encoding
                    is_packed = not self._is_ros1 and raw.startswith(ZSTD_MAGIC)
                    kind = connection.msgtype.replace("tf/msg/tfMessage", "tf2_msgs/msg/TFMessage")
                    message = self._unpacked(unpacked("zstd", raw) if is_packed else raw, kind)
                    yield from decoded(connection.topic, kind, record_ns, message)
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


def _span(part: Any) -> tuple[int, int]:
    """First record time and the instant after the last one, ns; zeros of a file without messages."""
    if not any(connection.msgcount for connection in part.connections):
        return NO_SPAN
    times = getattr(part, "metadata", part)
    return int(times.start_time), int(times.end_time)


def in_words(said: BaseException | str) -> str:
    """An error of another library, or a text from elsewhere, on one line, printable and not too long."""
    words = " ".join(str(said).split()) or type(said).__name__
    words = f"{words} is missing" if isinstance(said, KeyError) else words
    plain = "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in words)
    return plain if len(plain) <= 120 else f"{plain[:117]}..."


class TooLargeError(Exception):
    """More than may be held in memory."""


def check_size(size: int) -> None:
    """Raises TooLargeError: a chunk or message of so many bytes is not to be held."""
    if size > MOST_BYTES:
        raise TooLargeError(
            f"a chunk holds more than {MOST_BYTES / 1e6:.0f} MB; record in smaller chunks, or filter the bag"
        )


def unpacked(kind: str, packed: bytes, size: int = 0) -> bytes:
    """What bz2, lz4 or zstd packed, in one frame or several.

    ``size``: what the bag says of the result, which rosbags compares.

    Raises:
        TooLargeError: it is more than a chunk may be.
        Exception: what the library raises of damaged data.
    """
    parts: list[bytes] = []
    size, unpacker = 0, _UNPACKERS[kind]()
    while packed or not unpacker.needs_input:
        parts.append(unpacker.decompress(packed, STEP_BYTES))
        size += len(parts[-1])
        check_size(size)
        packed = b""
        if unpacker.eof:
            packed = unpacker.unused_data or b""
            if not packed:
                return b"".join(parts)
            unpacker = _UNPACKERS[kind]()
    raise EOFError("a chunk is cut off")


# rosbags unpacks whatever a chunk says, 11 GB of 17 kB: its tables of unpackers get bounded ones
for _way in _UNPACKERS:
    rosbag1.decompressors[_way] = storage_mcap.DECOMPRESSORS[_way] = partial(unpacked, _way)


def unpack_file(path: Path, into: Path) -> None:
    """Unpack a file that zstd packed as a whole.

    Raises:
        InputError: it is damaged, or grows to more than ``MOST_TIMES`` its size.
    """
    size, most_bytes = 0, max(MOST_TIMES * path.stat().st_size, MOST_BYTES)
    try:
        with zstd.open(path, "rb") as whole, into.open("wb") as file:
            while part := whole.read(STEP_BYTES):
                size += file.write(part)
                if size > most_bytes:
                    most = f"more than {most_bytes / 1e6:.0f} MB"
                    raise InputError(f"{path}: unpacks to {most}; 'zstd -d' unpacks it")
    except (EOFError, zstd.ZstdError) as error:
        raise InputError(f"{path}: damaged: {error}; 'zstd -t' tests it, copy it again") from error
