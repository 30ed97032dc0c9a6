"""Chunks of bags unpacked in steps, and refused where they would take all memory; only ordinary files."""

import bz2
import stat
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

MOST_BYTES = 256_000_000
"""of a chunk or a message; recorders make chunks of one to four megabytes"""
MOST_METADATA_BYTES = 16_000_000
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


def unpacked(kind: str, packed: bytes, most_bytes: int = MOST_BYTES) -> bytes:
    """What was packed by bz2, lz4 or zstd, in one frame or several.

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
    raise EOFError("a chunk is cut off")


def check_size(size: int, most_bytes: int = MOST_BYTES) -> None:
    """Raises TooLargeError: so many bytes of one chunk are not to be held."""
    if size > most_bytes:
        raise TooLargeError(
            f"a chunk holds more than {most_bytes / 1e6:.0f} MB; record in smaller chunks, or filter the bag"
        )


def check_files(path: Path) -> None:
    """Look at the file of a bag, or at all files in its folder, before any of them is opened.

    Raises:
        InputError: one is a pipe, a socket or a device, which may never end; or it unpacks to too much.
    """
    try:
        for file in sorted(path.iterdir()) if path.is_dir() else [path]:
            found = file.stat()
            if stat.S_ISDIR(found.st_mode):
                continue
            if not stat.S_ISREG(found.st_mode):
                raise InputError(f"{file}: is a pipe, a socket or a device; give an ordinary file")
            if file.name == "metadata.yaml" and found.st_size > MOST_METADATA_BYTES:
                raise InputError(f"{file}: is too large for metadata; 'ros2 bag reindex' writes it again")
            _check_packed_file(file, max(MOST_TIMES * found.st_size, MOST_BYTES))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error


def _check_packed_file(path: Path, most_bytes: int) -> None:
    """A file that is packed as a whole lands unpacked in a temporary folder: rosbags takes no count."""
    with path.open("rb") as file:
        if file.read(len(ZSTD_MAGIC)) != ZSTD_MAGIC:
            return
    size = 0
    try:
        with zstd.open(path, "rb") as whole:
            while part := whole.read(STEP_BYTES):
                size += len(part)
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
