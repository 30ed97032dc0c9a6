"""A ROS 1 bag without its index, cut off or never closed: its records in their order, up to the damage."""

import io
import os
import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from midnet_bench.recording.files.unpacking import check_size, unpacked

MAGIC = b"#ROSBAG V2.0"
PLAIN = "none"
MESSAGE, CHUNK, CONNECTION = 2, 5, 7
"""kinds of records, as https://wiki.ros.org/Bags/Format/2.0 numbers them"""
_NUMBER = struct.Struct("<I")


class Connection(NamedTuple):
    """A connection, as rosbags has it."""

    topic: str
    msgtype: str
    msgcount: int


class UnindexedRos1:
    """As much of rosbags' reader as is needed here; every pass reads the file from its beginning."""

    def __init__(self, path: Path) -> None:
        """Look through it. Raises ValueError: it is no bag, or no message of it can be read."""
        self._path = path
        self._names: dict[int, tuple[str, str]] = {}
        counts: dict[int, int] = {}
        times: list[int] = []
        try:
            for number, time_ns, _ in self._records():
                counts[number] = counts.get(number, 0) + 1
                times = [min([time_ns, *times[:1]]), max([time_ns, *times[1:]])]
        except (ValueError, LookupError, OSError, EOFError, struct.error, RuntimeError):
            if not counts:  # what came before the damage counts
                raise
        if not counts:
            raise ValueError("it holds no message")
        self.start_time, self.end_time = times[0], times[1] + 1
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
        for number, time_ns, raw in self._records():
            connection = self._by_number.get(number)
            if connection not in connections or (start is not None and time_ns < start):
                continue
            if connection is not None and (stop is None or time_ns < stop):
                yield connection, time_ns, raw

    def close(self) -> None:
        """Nothing is open between two passes."""

    def _records(self) -> Iterator[tuple[int, int, bytes]]:
        """(number of the connection, record time in ns, message)."""
        with open(self._path, "rb") as file:
            if not file.readline(100).startswith(MAGIC):
                raise ValueError("it does not begin as a bag of ROS 1 does")
            size = os.fstat(file.fileno()).st_size
            while file.tell() < size:
                header = _fields(_block(file))
                kind, length = header["op"][0], _number(file)
                if kind == CHUNK:
                    check_size(length)
                    packing, packed = header["compression"].decode(), file.read(length)
                    # of a plain chunk that is cut off a part is good too
                    whole = packed if packing == PLAIN else unpacked(packing, packed)
                    yield from self._in_chunk(io.BytesIO(whole))
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
