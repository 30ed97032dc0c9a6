"""Maps as ROS keeps them: the YAML and image pair of map_server, read and written as it does.

Two defects of the original are left behind: in scale mode it takes the last colour of an image
without alpha for alpha, so that pixels with no blue become unknown; and it reads palette images by
palette index, where here the palette's colours count. A rotated origin, which most ROS packages
ignore in silence, turns the cells (item 18).
"""

import io
import struct
import warnings
import zlib
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
import yaml
from PIL import Image
from pydantic import ConfigDict, Field, ValidationInfo, field_validator

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.grid import UNKNOWN, OccupancyGrid, as_written
from midnet_bench.io.checked_yaml import Spec, parse, read_yaml
from midnet_bench.io.files import read_bounded, write_atomically

LARGEST_BYTES = 200_000_000  # of an image's file
MOST_PIXELS = 25_000_000
"""250 by 250 m at 5 cm; a larger one would take more than a gigabyte on its way to a grid"""
_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def read_image(path: Path, key: str, takes_jpeg: bool = False) -> npt.NDArray[np.uint8]:
    """A PGM (plain or binary) or PNG as (height, width, channels) uint8, row 0 at the top.

    Other depths are brought to 8 bits. ``key`` names in errors the key of the image. ``takes_jpeg``: read
    JPEG too, whose pixels are not exact, so that no map is made of it. Raises InputError when the image is
    missing, of another kind, too large, or not whole.
    """
    where = f"{key}: {path}"
    try:
        data = read_bounded(path, LARGEST_BYTES)
    except OSError as error:
        raise InputError(f"{where}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise InputError(f"{key}: {str(path)!r}: cannot be read: no file can have this name") from error
    is_png = data.startswith(_PNG_SIGNATURE)
    is_jpeg = takes_jpeg and data.startswith(b"\xff\xd8")
    if not is_png and not is_jpeg and data[:2] not in (b"P2", b"P5"):
        raise InputError(f"{where}: not a PGM (P2, P5){', JPEG' if takes_jpeg else ''} or PNG image")
    damaged = InputError(f"{where}: the image is truncated or damaged; save it again")
    try:
        with warnings.catch_warnings():
            # Pillow warns at half of the size that it refuses
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            image = Image.open(io.BytesIO(data), formats=["PNG" if is_png else "JPEG" if is_jpeg else "PPM"])
            if image.width * image.height > MOST_PIXELS:
                raise InputError(
                    f"{where}: too many pixels for a map ({image.width} x {image.height}); at most"
                    f" {MOST_PIXELS} are read: cut or shrink the image"
                )
            if is_png and not _png_is_whole(data):
                raise damaged
            return _pixels(image)
    except Image.DecompressionBombError as error:
        raise InputError(f"{where}: too many pixels for a map; cut or shrink the image") from error
    # what Pillow raises of damaged files, and of texts in them that unpack to far too much
    except (OSError, IndexError, SyntaxError, ValueError, struct.error, zlib.error) as error:
        raise damaged from error


def _png_is_whole(data: bytes) -> bool:
    """Whether all chunks to the last are there with the checksums that they claim, and enough pixels.

    Pillow paints rows that are missing black, which would be walls. OpenCV refuses such files, but libpng
    then prints its own words on the process's standard error.
    """
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
    if width * height > MOST_PIXELS:  # of several headers Pillow goes by another
        return False
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


Mode = Literal["trinary", "scale", "raw"]

FREE_PIXEL = 254
OCCUPIED_PIXEL = 0
UNKNOWN_PIXEL = 205


class MapFile(Spec):
    """What a map's YAML file says. Keys that map_server does not know are passed over, as it does."""

    model_config = ConfigDict(extra="ignore")

    image: Path
    resolution: float = Field(gt=0.0)  # metres per pixel
    origin: tuple[float, float, float]
    """(x, y), metres, of the lower left corner of the lower left pixel, and its yaw there, radians"""
    negate: Annotated[int, Field(ge=0, le=1)] | bool  # nav2's map_server takes true and false here
    occupied_thresh: float = Field(gt=0.0, le=1.0)
    free_thresh: float = Field(ge=0.0)
    mode: Mode = "trinary"

    @field_validator("image")
    @classmethod
    def _is_a_file(cls, image: Path) -> Path:
        if image == Path():
            raise ValueError("a file name is needed")
        return image

    @field_validator("free_thresh")
    @classmethod
    def _is_below(cls, free: float, info: ValidationInfo) -> float:
        if free >= info.data.get("occupied_thresh", 1.0):
            raise ValueError("must be below occupied_thresh")
        return free


def load_map(yaml_path: str | Path) -> OccupancyGrid:
    """The map as an int8 grid: -1 unknown, 0 free, 100 occupied; 1 to 98 between them in scale mode.

    In raw mode a cell holds its pixel's value as a signed byte, whatever that means to the writer. A map
    whose origin has a yaw is turned into the axes of its frame, unknown about its corners.

    Raises:
        InputError: either file is missing, unreadable, incomplete, or says what no map can.
    """
    path = Path(yaml_path)
    file = _map_file(path)
    cells = occupancy(read_image(path.parent / file.image, f"{path}: image"), file)
    grid = OccupancyGrid(np.ascontiguousarray(cells[::-1]), as_written(file.resolution), file.origin[:2])
    return grid if file.origin[2] == 0.0 else turned(grid, file.origin[2], str(path))


def image_of(yaml_path: str | Path) -> Path:
    """The image of a map. Raises InputError: its YAML file cannot be read, or is none of a map."""
    path = Path(yaml_path)
    return path.parent / _map_file(path).image


def _map_file(path: Path) -> MapFile:
    values = read_yaml(path)
    if isinstance(values, dict):
        values = {key: value for key, value in values.items() if isinstance(key, str) and value is not None}
    return parse(MapFile, values, str(path))


def turned(grid: OccupancyGrid, yaw_rad: float, source: str) -> OccupancyGrid:
    """The grid turned about its origin, its cells along the axes again: each as what lies at its centre.

    Walls stay whole: one of a cell's width covers a centre in each row or each column that it crosses.

    Raises:
        InputError: it has too many cells then; the message begins with ``source``.
    """
    turn = Pose2D(*grid.origin, yaw_rad)
    sides = np.array([(x, y) for x in (0, grid.width) for y in (0, grid.height)]) * grid.resolution
    corners = turn.transform(sides)
    low, size = corners.min(axis=0), np.ptp(corners, axis=0)
    columns, rows = np.maximum(np.ceil(size / grid.resolution - 1e-6).astype(int), 1).tolist()
    if columns * rows > MOST_PIXELS:
        raise InputError(
            f"{source}: origin: turned by its yaw the map has {columns} x {rows} cells; at most"
            f" {MOST_PIXELS} are read: cut it, or turn the image"
        )
    cells = np.full((rows, columns), UNKNOWN, np.int8)
    for y in range(rows):  # one row at a time takes little memory
        centres = np.stack((np.arange(columns) + 0.5, np.full(columns, y + 0.5)), axis=-1)
        placed = turn.inverse().transform(low + centres * grid.resolution)
        column, row = np.floor(placed / grid.resolution).astype(int).T
        inside = (column >= 0) & (row >= 0) & (column < grid.width) & (row < grid.height)
        cells[y, inside] = grid.data[row[inside], column[inside]]
    return OccupancyGrid(cells, grid.resolution, (float(low[0]), float(low[1])))


def occupancy(image: npt.NDArray[np.uint8], file: MapFile) -> npt.NDArray[np.int8]:
    """The cells of an image, in its own order (row 0 at the top), by the rules of the file's mode.

    ``image``: (height, width, channels) uint8; 1 grey, 3 colours, or 4: colours and alpha.
    """
    channels = image.shape[2]
    # in trinary mode map_server averages alpha in, as if it were a colour
    colours = channels if file.mode == "trinary" or channels < 4 else 3
    average = image[:, :, :colours].mean(axis=2)
    if file.negate:
        average = 255.0 - average
    if file.mode == "raw":
        return average.astype(np.uint8).view(np.int8)

    occupied_share = (255.0 - average) / 255.0
    if file.mode == "trinary":
        cells = np.full(average.shape, -1, np.int8)
    else:
        between = (occupied_share - file.free_thresh) / (file.occupied_thresh - file.free_thresh)
        cells = (1.0 + 98.0 * between.clip(0.0, 1.0)).astype(np.int8)
        if channels == 4:
            cells[image[:, :, 3] == 0] = -1
    cells[occupied_share < file.free_thresh] = 0
    cells[occupied_share > file.occupied_thresh] = 100
    return cells


def save_map(grid: OccupancyGrid, yaml_path: Path, occ: int = 65, free: int = 25, comment: str = "") -> None:
    """Write ``yaml_path`` and, beside it under the same name, a binary ``.pgm``, as map_saver does.

    Values of 0 to ``free`` become white, ``occ`` and more black, all else the grey that loads as
    unknown. The thresholds in the YAML are always 0.65 and 0.196: they tell these three apart.
    A reader sees the old file or the new one, never half of one. The grid is int8, -1 unknown or 0 to 100;
    ``comment`` is a line at the top of the YAML file, where a map says what it was made from.

    Raises:
        InputError: not 0 <= ``free`` < ``occ`` <= 100, or a file cannot be written.
        MidnetBenchError: the disk is full.
    """
    if grid.data.dtype != np.int8:
        raise ValueError(f"costs are {grid.data.dtype}; int8 is needed, where -1 means unknown")
    if not 0 <= free < occ <= 100:
        raise InputError(f"{yaml_path}: 0 <= free < occ <= 100 is needed (got free {free}, occ {occ})")
    image = yaml_path.with_suffix(".pgm")
    if image == yaml_path:
        raise InputError(f"{yaml_path}: name the YAML file; the image goes beside it as .pgm")
    values = grid.data
    pixels = np.full(values.shape, UNKNOWN_PIXEL, np.uint8)
    pixels[(values >= 0) & (values <= free)] = FREE_PIXEL
    pixels[values >= occ] = OCCUPIED_PIXEL

    header = f"P5\n# {grid.resolution:.3f} m/pix\n{grid.width} {grid.height}\n255\n"
    # a bare name, because loaders look beside the YAML file
    name = yaml.safe_dump({"image": image.name}, allow_unicode=True)
    heading = f"# {' '.join(comment.split())}\n" if comment else ""
    text = (
        f"{heading}{name}"
        f"resolution: {grid.resolution:.6f}\n"
        f"origin: [{grid.origin[0]:.6f}, {grid.origin[1]:.6f}, {0.0:.6f}]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    write_atomically(image, header.encode() + pixels[::-1].tobytes())
    write_atomically(yaml_path, text)


def save_binary_map(grid: OccupancyGrid, yaml_path: Path) -> None:
    """Write a binary grid (uint8, 0 occupied, 255 free; Eq. 1) as a map that any map_server reads.

    Back it comes through :func:`load_map` and Eq. 1 with any thresh from 1 to 100.
    """
    if grid.data.dtype != np.uint8:
        raise ValueError(f"a binary grid is uint8, this one is {grid.data.dtype}")
    save_map(grid.with_data(np.where(grid.data == 0, 100, 0).astype(np.int8)), yaml_path)
