"""ROS 1 bags, ROS 2 bag folders, MCAP and SQLite files, read by ``rosbags``; no ROS is needed.

What a file is, its first bytes say. A ROS 2 folder is its data files; ``metadata.yaml`` only names them.
Chunks are unpacked in bounded steps, and records are read in their order where the index is missing.
"""

import bz2
import io
import os
import re
import struct
import sys
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, NamedTuple

import lz4.frame
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import reader as rosbag1
from rosbags.rosbag2 import storage_mcap
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
from rosbags.typesys.msg import normalize_msgtype

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
READERS: dict[str, Any] = {ROS1: Ros1Reader, MCAP: McapReader, SQLITE: Sqlite3Reader}
MOST_BYTES = 150_000_000  # of a chunk or a message; recorders make chunks of one to four megabytes
MOST_TIMES = 100
"""a file that is packed as a whole may grow to so many times its size; scans shrink to a fifth"""
STEP_BYTES = 1 << 20
_UNPACKERS: dict[str, Callable[[], Any]] = {
    "bz2": bz2.BZ2Decompressor,
    "lz4": lz4.frame.LZ4FrameDecompressor,
    "zstd": zstd.ZstdDecompressor,
}
MCAP_SCHEMA, MCAP_CHANNEL, MCAP_MESSAGE, MCAP_CHUNK, MCAP_END = 3, 4, 5, 6, 15
"""kinds of records, as https://mcap.dev/spec numbers them; what follows the end of the data is the index"""


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
        raise InputError(f"{path}: is the folder of no one ROS 2 bag: it holds {what[:120]}; give a file")
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
            spans = [_span(part) for part in self._parts if _span(part)]
        except Exception as error:  # whatever a library raises of a file that is no bag
            self.close()
            if isinstance(error, InputError):
                raise
            what = "" if isinstance(error, TooLargeError) else "no bag that can be read: "
            raise InputError(f"{path}: {what}{in_words(error)}") from error
        first = self._parts[0]
        self._is_ros1 = isinstance(first, Ros1Reader) or getattr(first, "is_ros1", False)
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
            if kind == MCAP and _span(reader) and not reader.chunks:
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
        return 0, 0
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


def unpacked(kind: str, packed: bytes, size: int = 0, *, is_cut: bool = False) -> bytes:
    """What bz2, lz4 or zstd packed, in one frame or several; of data that ``is_cut`` what is there.

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
    if is_cut:
        return b"".join(parts)
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


class Connection(NamedTuple):
    """A topic and the type of its messages, as rosbags has them."""

    topic: str
    msgtype: str
    msgcount: int = 0


RawMessage = tuple[Connection, int, bytes]  # its connection, record time in ns, message


class Unindexed:
    """As much of rosbags' readers as is needed here; every pass reads the file from its beginning."""

    def __init__(self, path: Path) -> None:
        """Look through it. Raises Exception: it is no bag, or no message of it can be read."""
        self._path = path
        self.is_ros1 = True
        """whether its messages are those of ROS 1, as tools that convert bags leave them in MCAP too"""
        counts = Counter[Connection]()
        self.start_time, self.end_time = 1 << 63, 0
        try:
            for connection, time_ns, _ in self._messages():
                counts[connection] += 1
                self.start_time = min(self.start_time, time_ns)
                self.end_time = max(self.end_time, time_ns + 1)
        except Exception as error:  # of damage: what came before it counts
            if not counts or isinstance(error, TooLargeError):
                raise
        if not counts:
            raise ValueError("it holds no message")
        self.connections = [one._replace(msgcount=count) for one, count in counts.items()]

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Iterator[RawMessage]:
        """The messages of these connections in the file's order, up to an error at the damage."""
        wanted = {one[:2] for one in connections}
        for connection, time_ns, raw in self._messages():
            is_in_time = (start is None or time_ns >= start) and (stop is None or time_ns < stop)
            if is_in_time and connection[:2] in wanted:
                yield connection, time_ns, raw

    def _messages(self) -> Iterator[RawMessage]:
        with self._path.open("rb") as file:
            begins = file.readline(100)
            if begins.startswith(ROS1_MAGIC):
                yield from _of_ros1(file)
            elif begins.startswith(MCAP_MAGIC[:7]):
                file.seek(len(MCAP_MAGIC))
                yield from self._of_mcap(file)
            else:
                raise ValueError("it does not begin as such a bag does")

    def _of_mcap(self, file: BinaryIO) -> Iterator[RawMessage]:
        """Channels in another encoding than the first one's are left out."""
        types: dict[int, str] = {}
        known: dict[int, Connection] = {}
        for kind, record in _mcap_records(file):
            (number,), said = struct.unpack_from("<H", record), io.BytesIO(record[2:])
            if kind == MCAP_MESSAGE and number in known:
                yield known[number], struct.unpack_from("<Q", record, 6)[0], record[22:]
            elif kind == MCAP_SCHEMA:
                types[number] = normalize_msgtype(_block(said).decode())
            elif kind == MCAP_CHANNEL:
                (schema,) = struct.unpack("<H", _exactly(said, 2))
                topic, encoding = _block(said).decode(), _block(said)
                if encoding in (b"cdr", b"ros1") and schema in types:
                    self.is_ros1 = self.is_ros1 if known else encoding == b"ros1"
                    if self.is_ros1 == (encoding == b"ros1"):
                        known[number] = Connection(topic, types[schema])


def _mcap_records(file: BinaryIO, in_chunk: bool = False) -> Iterator[tuple[int, bytes]]:
    """Kind and content of each schema, channel and message, those of a chunk in its place."""
    while (kind := int.from_bytes(file.read(1))) not in (0, MCAP_END):
        (length,) = struct.unpack("<Q", _exactly(file, 8))
        if kind == MCAP_CHUNK and not in_chunk:
            check_size(length)
            record = file.read(length)
            (size,), packing = struct.unpack_from("<Q", record, 16), _block(io.BytesIO(record[28:]))
            check_size(size)
            whole = record[28 + 4 + len(packing) + 8 :]
            if packing:  # of a chunk that is cut off a part is good too
                whole = unpacked(packing.decode(), whole, is_cut=True)
            yield from _mcap_records(io.BytesIO(whole), in_chunk=True)
            if len(record) < length:
                raise EOFError("a chunk is cut off")
        elif kind in (MCAP_SCHEMA, MCAP_CHANNEL, MCAP_MESSAGE):
            yield kind, _exactly(file, length)
        else:
            file.seek(min(length, 1 << 48), os.SEEK_CUR)


def _of_ros1(file: BinaryIO, known: dict[int, Connection] | None = None) -> Iterator[RawMessage]:
    """The messages of ROS 1, those of a chunk in its place, where connections are ``known`` from before."""
    in_chunk, known = known is not None, {} if known is None else known
    while begins := file.read(4):
        header = _ros1_header(_exactly(file, int.from_bytes(begins, "little")))
        kind, length = header.get_uint8("op"), rosbag1.read_uint32(file)
        if kind == rosbag1.RecordType.CHUNK and not in_chunk:
            check_size(length)
            packing, packed = header.get_string("compression"), file.read(length)
            # of a chunk that is cut off a part is good too
            whole = packed if packing == "none" else unpacked(packing, packed, is_cut=True)
            yield from _of_ros1(io.BytesIO(whole), known)
            if len(packed) < length:
                raise EOFError("a chunk is cut off")
        elif kind == rosbag1.RecordType.CONNECTION:
            topic = rosbag1.normalize(header.get_string("topic"))
            message_type = _ros1_header(_exactly(file, length)).get_string("type")
            known[header.get_uint32("conn")] = Connection(topic, normalize_msgtype(message_type))
        elif kind == rosbag1.RecordType.MSGDATA and in_chunk:
            number, data = header.get_uint32("conn"), _exactly(file, length)
            if number in known:
                yield known[number], header.get_time("time"), data
        else:
            file.seek(length, os.SEEK_CUR)


def _ros1_header(data: bytes) -> rosbag1.Header:
    return rosbag1.Header.read(io.BytesIO(len(data).to_bytes(4, "little") + data))


def _exactly(file: BinaryIO, size: int) -> bytes:
    check_size(size)
    data = file.read(size)
    if len(data) < size:
        raise EOFError("a record is cut off")
    return data


def _block(file: BinaryIO) -> bytes:
    """A length, and as many bytes."""
    return _exactly(file, int.from_bytes(_exactly(file, 4), "little"))
