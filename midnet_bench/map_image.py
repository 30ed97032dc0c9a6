"""The image of a map: a whole PGM or PNG as grey or colours, or one line that says what is wrong with it."""

import io
import re
import struct
import warnings
import zlib
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

from midnet_bench.errors import InputError

_BLANK = rb"(?:\s|#[^\r\n]*[\r\n])+"
_PGM_HEADER = re.compile(rb"P[25]" + (_BLANK + rb"(\d{1,9})") * 3 + rb"\s")
_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def read_image(path: Path, key: str) -> npt.NDArray[np.uint8]:
    """A PGM (plain or binary) or PNG as (height, width, channels) uint8, row 0 at the top.

    Deeper pixels are brought to 8 bits. ``key`` says in errors who asked for the image. Raises
    InputError when the image is missing, of another kind, too large, or not whole.
    """
    where = f"{key}: {path}"
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{where}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"{key}: {str(path)!r}: cannot be read: no file can have this name") from error
    if data[:2] in (b"P2", b"P5"):
        return _read_pgm(data, where)[:, :, np.newaxis]
    if not data.startswith(_PNG_SIGNATURE):
        raise InputError(f"{where}: not a PGM (P2, P5) or PNG image")
    return _read_png(data, where)


def _read_png(data: bytes, where: str) -> npt.NDArray[np.uint8]:
    damaged = InputError(f"{where}: the image is truncated or damaged; save it again")
    try:
        with warnings.catch_warnings():
            # Pillow warns at half of the size that it refuses
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            image = Image.open(io.BytesIO(data), formats=["PNG"])
            # Pillow paints what is missing black
            if not _png_is_whole(data):
                raise damaged
            return _pixels(image)
    except Image.DecompressionBombError as error:
        width, height = (int.from_bytes(data[at : at + 4], "big") for at in (16, 20))
        raise InputError(f"{where}: {width} x {height} pixels are too many for a map") from error
    # what Pillow raises of damaged files, and of texts in them that unpack to far too much
    except (OSError, IndexError, SyntaxError, ValueError, struct.error, zlib.error) as error:
        raise damaged from error


def _png_is_whole(data: bytes) -> bool:
    """Whether all chunks to the last are there with the checksums that they claim, and enough pixels."""
    position = len(_PNG_SIGNATURE)
    packed = []
    kind = b""
    while kind != b"IEND":
        length = int.from_bytes(data[position : position + 4], "big")
        end = position + 8 + length
        kind = data[position + 4 : position + 8]
        if end + 4 > len(data) or zlib.crc32(data[position + 4 : end]) != int.from_bytes(
            data[end : end + 4], "big"
        ):
            return False
        if kind == b"IDAT":
            packed.append(data[position + 8 : end])
        position = end + 4
    width, height, depth, colours, _, _, interlaced = struct.unpack(">IIBBBBB", data[16:29])
    bits = width * depth * {2: 3, 4: 2, 6: 4}.get(colours, 1)
    # a row begins with its filter; passes of an interlaced image have more of them than one per row
    needed = height * ((bits + 7) // 8 + (0 if interlaced else 1))
    return len(zlib.decompressobj().decompress(b"".join(packed), needed)) == needed


def _pixels(image: Image.Image) -> npt.NDArray[np.uint8]:
    """(height, width, channels) uint8: 1 grey, 3 colours, or 4: colours and alpha."""
    if image.mode.startswith("I"):  # 16 bits of grey
        return (np.atleast_3d(np.asarray(image)) // 256).astype(np.uint8)
    if image.mode in ("1", "L"):
        return np.atleast_3d(np.asarray(image.convert("L")))
    has_alpha = image.mode in ("LA", "RGBA") or "transparency" in image.info
    return np.asarray(image.convert("RGBA" if has_alpha else "RGB"))


def _read_pgm(data: bytes, where: str) -> npt.NDArray[np.uint8]:
    header = _PGM_HEADER.match(data)
    if header is None:
        raise InputError(f"{where}: a PGM needs width, height and maximum in its header, of 9 digits at most")
    width, height, maximum = (int(field) for field in header.groups())
    if width < 1 or height < 1 or not 1 <= maximum <= 65535:
        raise InputError(f"{where}: a PGM of {width} x {height} pixels and maximum {maximum} cannot be read")
    body, count = data[header.end() :], width * height
    if data[:2] == b"P5":
        depth = np.dtype(np.uint8 if maximum < 256 else ">u2")
        present, needed, unit = len(body), count * depth.itemsize, "bytes"
        values = np.frombuffer(body, depth, count).astype(np.int64) if present >= needed else None
    else:
        tokens = re.sub(rb"#[^\r\n]*", b"", body).split()
        present, needed, unit = len(tokens), count, "pixels"
        try:
            values = np.array([int(token) for token in tokens[:count]]) if present >= needed else None
        except ValueError as error:
            raise InputError(f"{where}: a plain PGM holds whole numbers only") from error
    if values is None:
        raise InputError(f"{where}: the image is truncated: {present} of {needed} {unit}; save it again")
    if values.min() < 0 or values.max() > maximum:
        raise InputError(f"{where}: a pixel is outside 0 to {maximum}, the PGM's own maximum")
    return (values * 255 // maximum).astype(np.uint8).reshape(height, width)
