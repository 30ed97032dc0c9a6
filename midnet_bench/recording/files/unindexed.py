"""A ROS 1 bag without its index, cut off or never closed: its records in their order, up to the damage."""

import io
import os
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from rosbags.rosbag1.reader import (
    Header,
    ReaderError,
    RecordType,
    decompressors,
    normalize,
    read_bytes,
    read_uint32,
)
from rosbags.typesys.msg import normalize_msgtype

MAGIC = b"#ROSBAG V2.0"
PLAIN = "none"


class Connection(NamedTuple):
    """A connection, as rosbags has it."""

    topic: str
    msgtype: str
    msgcount: int


class UnindexedRos1:
    """As much of rosbags' reader as is needed here; every pass reads the file from its beginning."""

    def __init__(self, path: Path) -> None:
        """DetectorOutput through it. Raises ReaderError: it is no bag, or no message of it can be read."""
        self._path = path
        self._names: dict[int, tuple[str, str]] = {}
        counts: dict[int, int] = {}
        times: list[int] = []
        try:
            for number, time_ns, _ in self._records():
                counts[number] = counts.get(number, 0) + 1
                times = [min([time_ns, *times[:1]]), max([time_ns, *times[1:]])]
        except Exception as error:  # whatever damaged bytes bring about; what came before counts
            if not counts:
                raise ReaderError(str(error)) from error
        if not counts:
            raise ReaderError("It holds no message.")
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
        """(connection, record time in ns, message) in the file's order. Raises ReaderError at the damage."""
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
            if not file.readline().startswith(MAGIC):
                raise ReaderError("File magic is invalid.")
            size = os.fstat(file.fileno()).st_size
            while file.tell() < size:
                header = Header.read(file)
                kind = header.get_uint8("op")
                if kind == RecordType.CONNECTION:
                    self._meet(header, file)
                    continue
                length = read_uint32(file)
                if kind != RecordType.CHUNK:
                    file.seek(length, os.SEEK_CUR)
                    continue
                compression = header.get_string("compression")
                if compression == PLAIN:  # of which a part is good too
                    yield from self._in_chunk(io.BytesIO(file.read(length)))
                else:
                    packed = read_bytes(file, length)
                    yield from self._in_chunk(io.BytesIO(decompressors[compression](packed)))

    def _in_chunk(self, chunk: io.BytesIO) -> Iterator[tuple[int, int, bytes]]:
        size = len(chunk.getbuffer())
        while chunk.tell() < size:
            header = Header.read(chunk)
            kind = header.get_uint8("op")
            if kind == RecordType.CONNECTION:
                self._meet(header, chunk)
                continue
            raw = read_bytes(chunk, read_uint32(chunk))
            if kind == RecordType.MSGDATA:
                yield header.get_uint32("conn"), header.get_time("time"), raw

    def _meet(self, header: Header, file: BinaryIO) -> None:
        """Learn of a connection; what it says of itself follows its header."""
        connection = Header.read(file)
        names = normalize(header.get_string("topic")), normalize_msgtype(connection.get_string("type"))
        self._names[header.get_uint32("conn")] = names
