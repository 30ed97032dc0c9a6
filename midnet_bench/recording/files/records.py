"""Records of bags: unpacked in bounded steps, and read in their order where the index is missing."""

import bz2
import io
import os
import struct
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, NamedTuple

import lz4.frame
from rosbags.rosbag1 import reader as rosbag1
from rosbags.rosbag2 import storage_mcap

from midnet_bench.errors import InputError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MOST_BYTES = 150_000_000
"""of a chunk or a message; recorders make chunks of one to four megabytes"""
MOST_TIMES = 100
"""a file that is packed as a whole may grow to so many times its size; scans shrink to a fifth"""
STEP_BYTES = 1 << 20
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"

_UNPACKERS: dict[str, Callable[[], Any]] = {
    "bz2": bz2.BZ2Decompressor,
    "lz4": lz4.frame.LZ4FrameDecompressor,
    "zstd": zstd.ZstdDecompressor,
}


class TooLargeError(Exception):
    """More than may be held in memory."""


def unpacked(kind: str, packed: bytes, most_bytes: int = MOST_BYTES, is_cut: bool = False) -> bytes:
    """What was packed by bz2, lz4 or zstd, in one frame or several; of data that ``is_cut`` what is there.

    Raises:
        TooLargeError: it is more than ``most_bytes`` or than a chunk may be.
        Exception: what the library raises of damaged data.
    """
    most_bytes = min(most_bytes, MOST_BYTES)
    parts: list[bytes] = []
    size, unpacker = 0, _UNPACKERS[kind]()
    while packed or not unpacker.needs_input:
        part = unpacker.decompress(packed, STEP_BYTES)
        size += len(part)
        check_size(size, most_bytes)
        parts.append(part)
        packed = b""
        if unpacker.eof:
            packed = unpacker.unused_data or b""
            if not packed:
                return b"".join(parts)
            unpacker = _UNPACKERS[kind]()
    if is_cut:
        return b"".join(parts)
    raise EOFError("a chunk is cut off")


def check_size(size: int, most_bytes: int = MOST_BYTES) -> None:
    """Raises TooLargeError: so many bytes of one chunk are not to be held."""
    if size > most_bytes:
        raise TooLargeError(
            f"a chunk holds more than {most_bytes / 1e6:.0f} MB; record in smaller chunks, or filter the bag"
        )


def unpack_file(path: Path, into: Path) -> None:
    """Unpack a file that was packed as a whole by zstd.

    Raises:
        InputError: it is damaged, or grows to more than ``MOST_TIMES`` its size.
        OSError: it cannot be read, or there is no room.
    """
    size, most_bytes = 0, max(MOST_TIMES * path.stat().st_size, MOST_BYTES)
    try:
        with zstd.open(path, "rb") as whole, into.open("wb") as file:
            while part := whole.read(STEP_BYTES):
                size += file.write(part)
                if size > most_bytes:
                    raise InputError(
                        f"{path}: unpacks to more than {most_bytes / 1e6:.0f} MB; 'zstd -d' unpacks it"
                    )
    except (EOFError, zstd.ZstdError) as error:
        raise InputError(f"{path}: damaged: {error}; 'zstd -t' tests it, copy it again") from error


# rosbags unpacks whatever a chunk says, 11 GB of 17 kB: its tables of unpackers get bounded ones
rosbag1.decompressors.update(
    {kind: lambda packed, kind=kind: unpacked(kind, packed) for kind in ("bz2", "lz4")}  # type: ignore[misc]
)
storage_mcap.DECOMPRESSORS.update(
    {
        kind: lambda packed, size, kind=kind: unpacked(kind, packed, size)  # type: ignore[misc]
        for kind in ("lz4", "zstd")
    }
)

ROS1_MAGIC, MCAP_MAGIC = b"#ROSBAG V2.0", b"\x89MCAP0\r\n"
PLAIN = "none"
MESSAGE, CHUNK, CONNECTION = 2, 5, 7
"""kinds of records of ROS 1, as https://wiki.ros.org/Bags/Format/2.0 numbers them"""
MCAP_SCHEMA, MCAP_CHANNEL, MCAP_MESSAGE, MCAP_CHUNK, MCAP_END = 3, 4, 5, 6, 15
"""of MCAP, as https://mcap.dev/spec numbers them; what follows the end of the data is the index"""
_NUMBER, _RECORD = struct.Struct("<I"), struct.Struct("<BQ")


class Connection(NamedTuple):
    """A connection, as rosbags has it."""

    topic: str
    msgtype: str
    msgcount: int


class Unindexed(ABC):
    """As much of rosbags' readers as is needed here; every pass reads the file from its beginning."""

    MAGIC: ClassVar[bytes]

    def __init__(self, path: Path) -> None:
        """Look through it. Raises ValueError: it is no bag, or no message of it can be read."""
        self._path = path
        self._names: dict[int, tuple[str, str]] = {}
        counts: dict[int, int] = {}
        self.start_time, self.end_time = 1 << 63, 0
        try:
            for number, time_ns, _ in self._messages():
                counts[number] = counts.get(number, 0) + 1
                self.start_time = min(self.start_time, time_ns)
                self.end_time = max(self.end_time, time_ns + 1)
        except (ValueError, LookupError, OSError, EOFError, ArithmeticError, struct.error, RuntimeError):
            if not counts:  # what came before the damage counts
                raise
        if not counts:
            raise ValueError("it holds no message")
        self._by_number = {
            number: Connection(*self._names[number], count) for number, count in counts.items()
        }

    @property
    def connections(self) -> list[Connection]:
        """Those of which a message can be read."""
        return list(self._by_number.values())

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """(connection, record time in ns, message) in the file's order, up to an error at the damage."""
        for number, time_ns, raw in self._messages():
            connection = self._by_number.get(number)
            if connection not in connections or (start is not None and time_ns < start):
                continue
            if connection is not None and (stop is None or time_ns < stop):
                yield connection, time_ns, raw

    def _messages(self) -> Iterator[tuple[int, int, bytes]]:
        """(number of the connection, record time in ns, message)."""
        with open(self._path, "rb") as file:
            if file.read(len(self.MAGIC)) != self.MAGIC:
                raise ValueError("it does not begin as such a bag does")
            for number, time_ns, raw in self._records(file, os.fstat(file.fileno()).st_size):
                if number in self._names:
                    yield number, time_ns, raw

    @abstractmethod
    def _records(self, file: BinaryIO, size: int) -> Iterator[tuple[int, int, bytes]]:
        """(number of the connection, record time in ns, message) of the rest of a file of so many bytes."""


class UnindexedRos1(Unindexed):
    """A bag of ROS 1."""

    MAGIC = ROS1_MAGIC
    is_ros1 = True

    def _records(self, file: BinaryIO, size: int) -> Iterator[tuple[int, int, bytes]]:
        file.readline(100)
        while file.tell() < size:
            header = _fields(_block(file))
            kind, length = header["op"][0], _number(file)
            if kind == CHUNK:
                check_size(length)
                packing, packed = header["compression"].decode(), file.read(length)
                # of a chunk that is cut off a part is good too
                whole = packed if packing == PLAIN else unpacked(packing, packed, is_cut=True)
                yield from self._in_chunk(io.BytesIO(whole))
                if len(packed) < length:
                    raise EOFError("a chunk is cut off")
            elif kind == CONNECTION:
                self._meet(header, _exactly(file, length))
            else:
                file.seek(length, os.SEEK_CUR)

    def _in_chunk(self, chunk: io.BytesIO) -> Iterator[tuple[int, int, bytes]]:
        size = len(chunk.getbuffer())
        while chunk.tell() < size:
            header, raw = _fields(_block(chunk)), _block(chunk)
            if header["op"][0] == CONNECTION:
                self._meet(header, raw)
            elif header["op"][0] == MESSAGE:
                seconds, nanoseconds = struct.unpack("<II", header["time"])
                yield *_NUMBER.unpack(header["conn"]), seconds * 10**9 + nanoseconds, raw

    def _meet(self, header: dict[str, bytes], said: bytes) -> None:
        """Learn of a connection; ``said``: what it says of itself. Names as rosbags writes them."""
        topic = header["topic"].decode()
        plain = "/" * topic.startswith("/") + "/".join(filter(None, topic.split("/")))
        package, _, name = _fields(said)["type"].decode().rpartition("/")
        self._names[_NUMBER.unpack(header["conn"])[0]] = plain, f"{package}/msg/{name}"


class UnindexedMcap(Unindexed):
    """An MCAP file; channels in another encoding than its first one's are passed over."""

    MAGIC = MCAP_MAGIC

    def __init__(self, path: Path) -> None:
        """Look through it. Raises ValueError: it is no MCAP file, or no message of it can be read."""
        self._types: dict[int, str] = {}
        self._encoding = b""
        """of its first channel with messages of ROS"""
        super().__init__(path)

    def _records(self, file: BinaryIO, size: int, in_chunk: bool = False) -> Iterator[tuple[int, int, bytes]]:
        while file.tell() < size:
            kind, length = _RECORD.unpack(_exactly(file, _RECORD.size))
            if kind == MCAP_END:
                return
            if kind == MCAP_CHUNK and not in_chunk:
                check_size(length)
                yield from self._unpacked(file.read(length), length)
            elif kind in (MCAP_SCHEMA, MCAP_CHANNEL):
                self._learn(kind, io.BytesIO(_exactly(file, length)))
            elif kind == MCAP_MESSAGE:
                record = _exactly(file, length)
                number, _, time_ns = struct.unpack_from("<HIQ", record)
                yield number, time_ns, record[22:]
            else:
                file.seek(min(length, size), os.SEEK_CUR)

    def _unpacked(self, record: bytes, length: int) -> Iterator[tuple[int, int, bytes]]:
        """What is in a chunk; of one that is cut off a part is good too."""
        (size,), packing = struct.unpack_from("<Q", record, 16), _block(io.BytesIO(record[28:])).decode()
        check_size(size)
        packed = record[28 + 4 + len(packing) + 8 :]
        whole = unpacked(packing, packed, size, is_cut=True) if packing else packed
        yield from self._records(io.BytesIO(whole), len(whole), in_chunk=True)
        if len(record) < length:
            raise EOFError("a chunk is cut off")

    def _learn(self, kind: int, record: io.BytesIO) -> None:
        """A schema's name, or a channel's topic and type."""
        (number,) = struct.unpack("<H", _exactly(record, 2))
        if kind == MCAP_SCHEMA:
            self._types[number] = _block(record).decode()
            return
        (schema,) = struct.unpack("<H", _exactly(record, 2))
        topic, encoding = _block(record).decode(), _block(record)
        if encoding in (b"cdr", b"ros1") and schema in self._types:
            self._encoding = self._encoding or encoding
            if encoding == self._encoding:
                package, _, name = self._types[schema].rpartition("/")
                self._names[number] = topic, f"{package.removesuffix('/msg')}/msg/{name}"

    @property
    def is_ros1(self) -> bool:
        """Whether its messages are those of ROS 1, as tools that convert bags leave them."""
        return self._encoding == b"ros1"


def _number(file: BinaryIO) -> int:
    return int(_NUMBER.unpack(_exactly(file, 4))[0])


def _exactly(file: BinaryIO, size: int) -> bytes:
    check_size(size)
    data = file.read(size)
    if len(data) < size:
        raise EOFError("a record is cut off")
    return data


def _block(file: BinaryIO) -> bytes:
    """A length, and as many bytes."""
    return _exactly(file, _number(file))


def _fields(data: bytes) -> dict[str, bytes]:
    """A record's header by name."""
    found, at = dict[str, bytes](), 0
    while at < len(data):
        end = at + 4 + _NUMBER.unpack_from(data, at)[0]
        name, _, value = data[at + 4 : end].partition(b"=")
        found[name.decode()], at = value, end
    return found
