"""Records of bags: unpacked in bounded steps, and read in their order where the index is missing."""

import bz2
import io
import os
import struct
import sys
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import lz4.frame
from rosbags.rosbag1 import reader as rosbag1
from rosbags.rosbag2 import storage_mcap

from midnet_bench.errors import InputError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MOST_BYTES = 150_000_000  # of a chunk or a message; recorders make chunks of one to four megabytes
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
MESSAGE, CHUNK, CONNECTION = 2, 5, 7
"""kinds of records of ROS 1, as https://wiki.ros.org/Bags/Format/2.0 numbers them"""
MCAP_SCHEMA, MCAP_CHANNEL, MCAP_MESSAGE, MCAP_CHUNK, MCAP_END = 3, 4, 5, 6, 15
"""of MCAP, as https://mcap.dev/spec numbers them; what follows the end of the data is the index"""
_NUMBER, _RECORD = struct.Struct("<I"), struct.Struct("<BQ")

RawMessage = tuple[int, int, bytes]  # number of the connection, record time in ns, message


class Connection(NamedTuple):
    """A connection, as rosbags has it."""

    topic: str
    msgtype: str
    msgcount: int = 0


class Unindexed:
    """As much of rosbags' readers as is needed here; every pass reads the file from its beginning."""

    def __init__(self, path: Path) -> None:
        """Look through it. Raises ValueError: it is no bag, or no message of it can be read."""
        self._path = path
        self.is_ros1 = True
        """whether its messages are those of ROS 1, as tools that convert bags leave them in MCAP too"""
        counts: dict[Connection, int] = {}
        self.start_time, self.end_time = 1 << 63, 0
        try:
            for connection, time_ns, _ in self._messages():
                counts[connection] = counts.get(connection, 0) + 1
                self.start_time = min(self.start_time, time_ns)
                self.end_time = max(self.end_time, time_ns + 1)
        except (ValueError, LookupError, OSError, EOFError, ArithmeticError, struct.error, RuntimeError):
            if not counts:  # what came before the damage counts
                raise
        if not counts:
            raise ValueError("it holds no message")
        self._counted = {one: one._replace(msgcount=count) for one, count in counts.items()}
        self.connections = list(self._counted.values())
        """those of which a message can be read"""

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """(connection, record time in ns, message) in the file's order, up to an error at the damage."""
        for one, time_ns, raw in self._messages():
            connection = self._counted.get(one)
            if connection is None or connection not in connections:
                continue
            if (start is None or time_ns >= start) and (stop is None or time_ns < stop):
                yield connection, time_ns, raw

    def _messages(self) -> Iterator[tuple[Connection, int, bytes]]:
        known: dict[int, Connection] = {}
        with open(self._path, "rb") as file:
            size, begins = os.fstat(file.fileno()).st_size, file.read(len(ROS1_MAGIC))
            if begins == ROS1_MAGIC:
                file.readline(100)
                messages = _of_ros1(file, size, known)
            elif begins.startswith(MCAP_MAGIC):
                file.seek(len(MCAP_MAGIC))
                messages = self._of_mcap(file, size, known)
            else:
                raise ValueError("it does not begin as such a bag does")
            for number, time_ns, raw in messages:
                if number in known:
                    yield known[number], time_ns, raw

    def _of_mcap(self, file: BinaryIO, size: int, known: dict[int, Connection]) -> Iterator[RawMessage]:
        """Channels in another encoding than its first one's are passed over."""
        types: dict[int, str] = {}
        for kind, record in _mcap_records(file, size):
            if kind == MCAP_MESSAGE:
                number, _, time_ns = struct.unpack_from("<HIQ", record)
                yield number, time_ns, record[22:]
                continue
            (number,), said = struct.unpack_from("<H", record), io.BytesIO(record[2:])
            if kind == MCAP_SCHEMA:
                types[number] = _block(said).decode()
                continue
            (schema,) = struct.unpack("<H", _exactly(said, 2))
            topic, encoding = _block(said).decode(), _block(said)
            if encoding in (b"cdr", b"ros1") and schema in types:
                self.is_ros1 = self.is_ros1 if known else encoding == b"ros1"
                if self.is_ros1 == (encoding == b"ros1"):
                    package, _, name = types[schema].rpartition("/")
                    known[number] = Connection(topic, f"{package.removesuffix('/msg')}/msg/{name}")


def _of_ros1(file: BinaryIO, size: int, known: dict[int, Connection]) -> Iterator[RawMessage]:
    """The messages of a bag of ROS 1; ``known`` gets its connections, with names as rosbags writes them."""
    for header, data in _ros1_records(file, size):
        number = _NUMBER.unpack(header["conn"])[0]
        if header["op"][0] == CONNECTION:
            topic = header["topic"].decode()
            plain = "/" * topic.startswith("/") + "/".join(filter(None, topic.split("/")))
            package, _, name = _fields(data)["type"].decode().rpartition("/")
            known[number] = Connection(plain, f"{package}/msg/{name}")
        else:
            seconds, nanoseconds = struct.unpack("<II", header["time"])
            yield number, seconds * 10**9 + nanoseconds, data


def _ros1_records(
    file: BinaryIO, size: int, in_chunk: bool = False
) -> Iterator[tuple[dict[str, bytes], bytes]]:
    """Header and data of each connection and message, those of a chunk in its place."""
    while file.tell() < size:
        header, length = _fields(_block(file)), _number(file)
        kind = header["op"][0]
        if kind == CHUNK and not in_chunk:
            check_size(length)
            packing, packed = header["compression"].decode(), file.read(length)
            # of a chunk that is cut off a part is good too
            whole = packed if packing == "none" else unpacked(packing, packed, is_cut=True)
            yield from _ros1_records(io.BytesIO(whole), len(whole), in_chunk=True)
            if len(packed) < length:
                raise EOFError("a chunk is cut off")
        elif kind == CONNECTION or (kind == MESSAGE and in_chunk):
            yield header, _exactly(file, length)
        else:
            file.seek(length, os.SEEK_CUR)


def _mcap_records(file: BinaryIO, size: int, in_chunk: bool = False) -> Iterator[tuple[int, bytes]]:
    """Kind and content of each schema, channel and message, those of a chunk in its place."""
    while file.tell() < size:
        kind, length = _RECORD.unpack(_exactly(file, _RECORD.size))
        if kind == MCAP_END:
            return
        if kind == MCAP_CHUNK and not in_chunk:
            check_size(length)
            record = file.read(length)
            (whole_size,), packing = struct.unpack_from("<Q", record, 16), _block(io.BytesIO(record[28:]))
            check_size(whole_size)
            whole = record[28 + 4 + len(packing) + 8 :]
            if packing:  # of a chunk that is cut off a part is good too
                whole = unpacked(packing.decode(), whole, whole_size, is_cut=True)
            yield from _mcap_records(io.BytesIO(whole), len(whole), in_chunk=True)
            if len(record) < length:
                raise EOFError("a chunk is cut off")
        elif kind in (MCAP_SCHEMA, MCAP_CHANNEL, MCAP_MESSAGE):
            yield kind, _exactly(file, length)
        else:
            file.seek(min(length, size), os.SEEK_CUR)


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
