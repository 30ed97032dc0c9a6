import math
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from midnet_bench.errors import InputError
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.map_server import load_map, save_binary_map, save_map
from midnet_bench.midnet.detection import binary_map

KEYS = {
    "image": "map.pgm",
    "resolution": "0.05",
    "origin": "[-1.0, -2.0, 0.0]",
    "negate": "0",
    "occupied_thresh": "0.65",
    "free_thresh": "0.196",
}
ONE_CELL = OccupancyGrid(np.zeros((1, 1), np.int8), 0.05, (0.0, 0.0))
ALL_GREYS = np.arange(256, dtype=np.uint8).reshape(16, 16)

in_one_folder = settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])


def write_yaml(folder: Path, **changes: str | None) -> Path:
    path = folder / "map.yaml"
    lines = [f"{key}: {value}" for key, value in {**KEYS, **changes}.items() if value is not None]
    path.write_text("\n".join(lines) + "\n")
    return path


def write_pgm(path: Path, pixels: np.ndarray, header: str = "P5\n{width} {height}\n255\n") -> None:
    height, width = pixels.shape
    path.write_bytes(header.format(width=width, height=height).encode() + pixels.tobytes())


def write_png(path: Path, pixels: np.ndarray) -> None:
    written, encoded = cv2.imencode(".png", pixels)
    assert written
    path.write_bytes(encoded.tobytes())


def as_map_server(grey: float, *, negate: int, mode: str, alpha: int = 255) -> int:
    """One pixel by the rules of map_server's image loader, thresholds 0.65 and 0.196."""
    if negate:
        grey = 255 - grey
    if mode == "raw":
        value = math.trunc(grey)
        return value - 256 if value > 127 else value
    occ = (255 - grey) / 255
    if occ > 0.65:
        return 100
    if occ < 0.196:
        return 0
    if mode == "trinary" or alpha == 0:
        return -1
    return math.trunc(1 + 98 * (occ - 0.196) / (0.65 - 0.196))


def test_top_row_of_the_image_is_the_last_of_the_map(tmp_path: Path) -> None:
    write_pgm(tmp_path / "map.pgm", np.array([[0, 254, 254], [205, 205, 254]], np.uint8))
    grid = load_map(write_yaml(tmp_path))
    assert grid.data.dtype == np.int8
    assert grid.data.tolist() == [[-1, -1, 0], [100, 0, 0]]
    assert (grid.resolution, grid.origin) == (0.05, (-1.0, -2.0))


def test_thresholds_are_strict_and_205_stays_unknown(tmp_path: Path) -> None:
    write_pgm(tmp_path / "map.pgm", ALL_GREYS)
    values = load_map(write_yaml(tmp_path)).data[::-1].ravel().tolist()
    assert values == [100] * 90 + [-1] * 116 + [0] * 50
    # exactly at a threshold is neither occupied nor free: 0.2 of 255 is 51
    exact = (
        load_map(write_yaml(tmp_path, occupied_thresh="0.6", free_thresh="0.2")).data[::-1].ravel().tolist()
    )
    assert (exact[101], exact[102], exact[204], exact[205]) == (100, -1, -1, 0)


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("negate", [0, 1])
def test_every_grey_in_every_mode(tmp_path: Path, mode: str, negate: int) -> None:
    write_pgm(tmp_path / "map.pgm", ALL_GREYS)
    grid = load_map(write_yaml(tmp_path, mode=mode, negate=str(negate)))
    expected = [as_map_server(grey, negate=negate, mode=mode) for grey in range(256)]
    assert grid.data[::-1].ravel().tolist() == expected


@pytest.mark.slow
@in_one_folder
@given(
    hnp.arrays(np.uint8, st.tuples(st.integers(1, 4), st.integers(1, 4), st.sampled_from([3, 4]))),
    st.sampled_from(["trinary", "scale", "raw"]),
    st.integers(0, 1),
)
def test_colours_are_averaged_and_alpha_only_in_trinary_mode(
    tmp_path: Path, pixels: np.ndarray, mode: str, negate: int
) -> None:
    write_png(tmp_path / "map.png", pixels)
    grid = load_map(write_yaml(tmp_path, image="map.png", mode=mode, negate=str(negate)))
    counted = pixels if mode == "trinary" else pixels[:, :, :3]
    has_alpha = pixels.shape[2] == 4
    expected = [
        [
            as_map_server(
                sum(counted[r, c].tolist()) / counted.shape[2],
                negate=negate,
                mode=mode,
                alpha=int(pixels[r, c, 3]) if has_alpha else 255,
            )
            for c in range(pixels.shape[1])
        ]
        for r in range(pixels.shape[0])
    ]
    assert grid.data[::-1].tolist() == expected


def test_pixel_without_blue_is_not_taken_for_transparent(tmp_path: Path) -> None:
    # a defect of the original's scale mode that is not copied
    write_png(tmp_path / "map.png", np.array([[[0, 200, 200]]], np.uint8))
    (value,) = load_map(write_yaml(tmp_path, image="map.png", mode="scale")).data.ravel()
    assert value == as_map_server(400 / 3, negate=0, mode="scale") > 0


def png(
    colour_type: int,
    depth: int,
    rows: list[bytes],
    palette: bytes | None = None,
    transparent: bytes | None = None,
    says: tuple[int, int] | None = None,
) -> bytes:
    """A PNG file from its raw rows, one pixel high each, for kinds and sizes that cv2 does not write."""

    def chunk(kind: bytes, body: bytes | None) -> bytes:
        if body is None:
            return b""
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    width = {(4, 8): 2, (3, 8): 1, (0, 16): 2, (0, 8): 1, (2, 8): 3}[colour_type, depth]
    size = says or (len(rows[0]) // width, len(rows))
    header = struct.pack(">IIBBBBB", *size, depth, colour_type, 0, 0, 0)
    body = zlib.compress(b"".join(b"\0" + row for row in rows))
    chunks = chunk(b"IHDR", header) + chunk(b"PLTE", palette) + chunk(b"tRNS", transparent)
    return b"\x89PNG\r\n\x1a\n" + chunks + chunk(b"IDAT", body) + chunk(b"IEND", b"")


def two_headers() -> bytes:
    """A PNG file whose first header says more than any machine holds; Pillow goes by the second."""
    header = b"IHDR" + struct.pack(">IIBBBBB", 2**31 - 1, 2**31 - 1, 16, 6, 0, 0, 0)
    whole = png(0, 8, [b"\0"])
    return whole[:8] + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header)) + whole[8:]


RAW_IMAGES = [
    (png(4, 8, [bytes([10, 255, 20, 0])]), [[10, 20]]),  # grey with alpha
    (png(0, 16, [bytes([10, 7, 20, 250])]), [[10, 20]]),  # 16 bits deep
    (png(3, 8, [bytes([1, 0])], palette=bytes([3, 4, 5, 60, 60, 60])), [[60, 4]]),
    (b"P5 # a comment\n# another 9 9\n 2\t1 \r\n255\n#!", [[35, 33]]),  # pixels may look like a comment
    (b"P2\n# plain\n3 2\n100\n0 50 100 # last of a row\n100\n50 0\n", [[255, 128, 0], [0, 128, 255]]),
    (b"P5\n2 1\n65535\n" + bytes([0, 255, 255, 255]), [[0, 255]]),
    (b"P5\n2 1\n255\n" + bytes([1, 2, 3, 4]), [[1, 2]]),  # what follows the image is not of it
    (b"P5\n2 1\n100\n" + bytes([100, 255]), [[255, 255]]),  # brighter than its own white is white
]


@pytest.mark.parametrize(("content", "values"), RAW_IMAGES, ids=range(len(RAW_IMAGES)))
def test_kinds_headers_and_depths_of_images(tmp_path: Path, content: bytes, values: list[list[int]]) -> None:
    (tmp_path / "map.pgm").write_bytes(content)
    assert load_map(write_yaml(tmp_path, mode="raw")).data.view(np.uint8).tolist() == values


def test_a_clear_colour_of_a_png(tmp_path: Path) -> None:
    one_is_clear = png(2, 8, [bytes([0, 0, 0, 9, 9, 9])], transparent=bytes([0, 9, 0, 9, 0, 9]))
    (tmp_path / "map.png").write_bytes(one_is_clear)
    assert load_map(write_yaml(tmp_path, image="map.png", mode="scale")).data.tolist() == [[100, 100]]


NO_VALUES = {
    "image": ("''", "[a]"),
    "mode": ("trinry", "[1]"),
    "resolution": ("0", "-0.05", ".nan", "true", f"1{'0' * 400}", "fine"),
    "origin": ("0",),
    "free_thresh": ("-0.1",),
    "occupied_thresh": ("1.1", "{}"),
}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        *(({key: None}, f"{key}: ") for key in KEYS),
        *(({key: value}, f"{key}: ") for key, values in NO_VALUES.items() for value in values),
        ({"image": "nowhere.pgm"}, "nowhere.pgm: cannot be read: No such file"),
        ({"image": "map.yaml"}, "map.yaml: not a PGM"),
        ({"origin": "2020-13-45"}, "not valid YAML: line 3: '2020-13-45' is not a valid timestamp"),
        ({"image": '"a\\0b.pgm"'}, "a\\x00b.pgm': cannot be read: no file can have this name"),
        ({"origin": "[0, 0, .nan]"}, "origin.2: "),
        ({"origin": "[0, 0]"}, "origin"),
        ({"origin": "[0, .inf, 0]"}, "origin.1: "),
        ({"negate": "2"}, "negate"),
        ({"free_thresh": "0.65"}, "free_thresh: must be below occupied_thresh"),
    ],
)
def test_bad_yaml_is_one_line_with_file_and_key(
    tmp_path: Path, changes: dict[str, str | None], message: str
) -> None:
    write_pgm(tmp_path / "map.pgm", ALL_GREYS)
    path = write_yaml(tmp_path, **changes)
    with pytest.raises(InputError) as caught:
        load_map(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert message in text
    assert "\n" not in text


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("FOLDER/map.yaml", "just a text", "a mapping of keys"),
        ("FOLDER/empty.yaml", "# nothing\n", r"empty\.yaml: \(top level\): the file is empty"),
        ("FOLDER/other.yaml", None, r"cannot be read: No such file or directory$"),
        ("other.yaml", None, "No such file or directory; the path starts from the working folder"),
    ],
)
def test_yaml_that_is_none(name: str, text: str | None, message: str, tmp_path: Path) -> None:
    path = Path(name.replace("FOLDER", str(tmp_path)))
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=message):
        load_map(path)


DAMAGED = [
    *(b"P5\n4 4\n255\n" + bytes(15), b"P5\n4 4\n1000\n" + bytes(31), b"P5\n4000 4000\n255\n", b"P5\n4 4\n"),
    *(b"P2\n2 2\n255\n1 2 3", b"P2\n2 1\n255\n1 x", b"P2\n2 1\n255\n1 -1", b"P2\n2 1\n255\n1 256"),
    *(b"P5\n" + b"9" * 5000 + b" 4\n255\n", b"P5\n0 4\n255\n", b"P5\n1 1\n65536\n\0\0\0", b"P5\n1 1\n0\n\0"),
    *(png(0, 8, [b"\0"], says=size) for size in ((4_000, 4_000), (0, 1), (1, 2))),
    *(png(0, 8, [b"\0"])[:8] + png(0, 8, [b"\0"])[-12:], two_headers()),
]
IMAGES = [(content, "truncated or damaged") for content in DAMAGED] + [
    (b"P5\n400000 400000\n255\n", "too many pixels for a map"),
    (png(0, 8, [b"\0"], says=(100_000, 100_000)), "too many pixels for a map"),
    (b"P6\n1 1\n255\n\0\0\0", "not a PGM"),
    (b"", "not a PGM"),
]


@pytest.mark.parametrize(("content", "message"), IMAGES, ids=range(len(IMAGES)))
def test_an_image_that_is_none_is_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], content: bytes, message: str
) -> None:
    (tmp_path / "map.pgm").write_bytes(content)  # what it is, its first bytes say
    path = write_yaml(tmp_path)
    with pytest.raises(InputError, match=message) as caught:
        load_map(path)
    assert str(caught.value).startswith(f"{path}: image: {tmp_path / 'map.pgm'}: ")
    assert capfd.readouterr().err == ""


def test_damaged_png_is_refused_without_a_word_on_stderr(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(0)
    write_png(tmp_path / "whole.png", rng.integers(0, 256, (20, 20), dtype=np.uint8))
    whole = (tmp_path / "whole.png").read_bytes()
    path = write_yaml(tmp_path, image="map.png")
    flipped = whole[:100] + bytes([whole[100] ^ 1]) + whole[101:]
    for damaged in [flipped, *(whole[:length] for length in range(8, len(whole), 37)), whole[:-1]]:
        (tmp_path / "map.png").write_bytes(damaged)
        with pytest.raises(InputError, match="truncated or damaged"):
            load_map(path)
    (tmp_path / "map.png").write_bytes(whole)
    assert load_map(path).data.shape == (20, 20)
    assert capfd.readouterr().err == ""


def test_files_are_those_of_map_saver(tmp_path: Path) -> None:
    values = np.array([[-1, 0, 25], [26, 64, 65], [100, 100, 0]], np.int8)
    save_map(OccupancyGrid(values, 0.05, (-1.5, 2.0000004)), tmp_path / "hall.yaml")
    image = (tmp_path / "hall.pgm").read_bytes()
    assert image.startswith(b"P5\n#")
    assert image.endswith(b"\n3 3\n255\n" + bytes([0, 0, 254, 205, 205, 0, 205, 254, 254]))
    assert (tmp_path / "hall.yaml").read_text() == (
        "image: hall.pgm\n"
        "resolution: 0.050000\n"
        "origin: [-1.500000, 2.000000, 0.000000]\n"
        "negate: 0\n"
        "occupied_thresh: 0.65\n"
        "free_thresh: 0.196\n"
    )
    assert {path.name for path in tmp_path.iterdir()} == {"hall.pgm", "hall.yaml"}
    # another reader of PGM agrees on the picture
    np.testing.assert_array_equal(
        cv2.imread(str(tmp_path / "hall.pgm"), cv2.IMREAD_UNCHANGED)[::-1].ravel(),
        [205, 254, 254, 205, 205, 0, 0, 0, 254],
    )


CELLS = hnp.array_shapes(min_dims=2, max_dims=2, max_side=7)


@pytest.mark.slow
@in_one_folder
@given(hnp.arrays(np.int8, CELLS, elements=st.sampled_from([-1, 0, 100])))
def test_trinary_map_comes_back_as_it_was(tmp_path: Path, values: np.ndarray) -> None:
    save_map(OccupancyGrid(values, 0.05, (-3.25, 1.0)), tmp_path / "map.yaml")
    back = load_map(tmp_path / "map.yaml")
    np.testing.assert_array_equal(back.data, values)
    assert (back.resolution, back.origin) == (0.05, (-3.25, 1.0))


@pytest.mark.slow
@in_one_folder
@given(hnp.arrays(np.uint8, CELLS, elements=st.sampled_from([0, 255])), st.sampled_from([1, 30, 99, 100]))
def test_binary_prior_map_comes_back_as_it_was(tmp_path: Path, values: np.ndarray, thresh: int) -> None:
    save_binary_map(OccupancyGrid(values, 0.05, (-3.25, 1.0)), tmp_path / "map.yaml")
    np.testing.assert_array_equal(binary_map(load_map(tmp_path / "map.yaml").data, thresh), values)


@pytest.mark.slow
@in_one_folder
@given(hnp.arrays(np.int8, CELLS, elements=st.integers(-1, 100)), st.integers(1, 100))
def test_map_saved_at_a_threshold_is_the_binary_map_of_eq_1(
    tmp_path: Path, values: np.ndarray, thresh: int
) -> None:
    # the paper's use of map_saver: --occ T --free T-1; unknown stays unknown in the file
    save_map(OccupancyGrid(values, 0.05, (0.0, 0.0)), tmp_path / "map.yaml", occ=thresh, free=thresh - 1)
    back = load_map(tmp_path / "map.yaml").data
    np.testing.assert_array_equal(back == -1, values == -1)
    np.testing.assert_array_equal(binary_map(back, 50), binary_map(values, thresh))


def test_names_that_yaml_would_misread_are_quoted(tmp_path: Path) -> None:
    for stem in ("a: b", "# étage 2", "x" * 120 + " y"):
        save_map(ONE_CELL, tmp_path / f"{stem}.yaml")
        assert load_map(tmp_path / f"{stem}.yaml").data.tolist() == [[0]]


def test_numbers_as_yaml_1_1_writes_them(tmp_path: Path) -> None:
    write_pgm(tmp_path / "map.pgm", ALL_GREYS)
    assert load_map(write_yaml(tmp_path, resolution="5e-2")).resolution == 0.05
    for of_32_bits in ("0.05000000074505806", "0.0500000007"):
        assert load_map(write_yaml(tmp_path, resolution=of_32_bits)).resolution == 0.05
    as_is = load_map(write_yaml(tmp_path, negate="false")).data
    np.testing.assert_array_equal(as_is, load_map(write_yaml(tmp_path, negate="0")).data)


def test_failed_save_is_one_line_and_leaves_the_old_map(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written: Not a directory"):
        save_map(ONE_CELL, tmp_path / "file" / "map.yaml")

    save_map(ONE_CELL, tmp_path / "map.yaml")
    before = (tmp_path / "map.pgm").read_bytes()
    (tmp_path / "map.yaml").unlink()
    (tmp_path / "map.yaml").mkdir()
    with pytest.raises(InputError, match=r"map\.yaml: cannot be written"):
        save_map(ONE_CELL, tmp_path / "map.yaml")
    assert (tmp_path / "map.pgm").read_bytes() == before
    assert {path.name for path in tmp_path.iterdir()} == {"file", "map.pgm", "map.yaml"}


@pytest.mark.parametrize(("occ", "free"), [(65, 65), (25, 65), (101, 25), (65, -1), (0, 0)])
def test_saving_thresholds_out_of_range_are_refused(tmp_path: Path, occ: int, free: int) -> None:
    with pytest.raises(InputError, match="0 <= free < occ <= 100 is needed"):
        save_map(ONE_CELL, tmp_path / "map.yaml", occ=occ, free=free)


def test_grids_of_the_other_kind_are_refused(tmp_path: Path) -> None:
    # saved as costs, a binary grid would come out with walls and floor swapped
    with pytest.raises(ValueError, match="int8 is needed"):
        save_map(ONE_CELL.with_data(np.zeros((1, 1), np.uint8)), tmp_path / "map.yaml")
    with pytest.raises(ValueError, match="a binary grid is uint8"):
        save_binary_map(ONE_CELL, tmp_path / "map.yaml")
    with pytest.raises(InputError, match="name the YAML file"):
        save_map(ONE_CELL, tmp_path / "map.pgm")


def test_a_map_says_in_a_comment_where_it_comes_from(tmp_path: Path) -> None:
    grid = OccupancyGrid(np.array([[0, 100], [-1, 0]], dtype=np.int8), 0.05, (0.0, 0.0))
    save_map(grid, tmp_path / "map.yaml", comment="explored\nby: 1 Burger")
    assert (tmp_path / "map.yaml").read_text().splitlines()[0] == "# explored by: 1 Burger"
    np.testing.assert_array_equal(load_map(tmp_path / "map.yaml").data, grid.data)


@pytest.mark.slow
@pytest.mark.parametrize("size", [(20_000, 1), (4000, 4000)])
def test_a_map_that_its_yaw_makes_too_large_is_refused(tmp_path: Path, size: tuple[int, int]) -> None:
    write_pgm(tmp_path / "map.pgm", np.full(size, 254, np.uint8))
    path = write_yaml(tmp_path, image="map.pgm", origin="[0.0, 0.0, 0.785]")
    with pytest.raises(InputError, match=r"map\.yaml: origin: turned by its yaw .* cells; at most 25000000"):
        load_map(path)
