"""Records of bags: unpacked in bounded steps, and read in their order where the index is missing."""

import bz2
import io
import os
import struct
import sys
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import lz4.frame
from rosbags.rosbag1 import reader as rosbag1
from rosbags.rosbag2 import storage_mcap
from rosbags.typesys.msg import normalize_msgtype

from midnet_bench.errors import InputError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MOST_BYTES = 150_000_000  # of a chunk or a message; recorders make chunks of one to four megabytes
MOST_TIMES = 100
"""a file that is packed as a whole may grow to so many times its size; scans shrink to a fifth"""
STEP_BYTES = 1 << 20
ROS1_MAGIC, MCAP_MAGIC, ZSTD_MAGIC = b"#ROSBAG V2.0", b"\x89MCAP0\r\n", b"\x28\xb5\x2f\xfd"

_UNPACKERS: dict[str, Callable[[], Any]] = {
    "bz2": bz2.BZ2Decompressor,
    "lz4": lz4.frame.LZ4FrameDecompressor,
    "zstd": zstd.ZstdDecompressor,
}


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
for _kind in _UNPACKERS:
    rosbag1.decompressors[_kind] = storage_mcap.DECOMPRESSORS[_kind] = partial(unpacked, _kind)


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


MCAP_SCHEMA, MCAP_CHANNEL, MCAP_MESSAGE, MCAP_CHUNK, MCAP_END = 3, 4, 5, 6, 15
"""kinds of records, as https://mcap.dev/spec numbers them; what follows the end of the data is the index"""


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
