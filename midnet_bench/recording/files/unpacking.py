"""Chunks and files of bags unpacked in steps, and refused where they would take all memory."""

import bz2
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

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
