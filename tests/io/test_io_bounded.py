"""Files that never end, that wait for a writer, or that unpack to more than a machine has."""

import gzip
import io
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from PIL import Image

from midnet_bench.errors import InputError
from midnet_bench.io.checked_yaml import load_yaml, read_yaml
from midnet_bench.io.files import read_bounded
from midnet_bench.io.map_server import load_map, read_image
from midnet_bench.io.scan_logs import read_lines

MAP = (
    "image: map.png\nresolution: 0.05\norigin: {origin}\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
)


def test_ordinary_files_come_back_whole_gzipped_or_plain(tmp_path: Path) -> None:
    (tmp_path / "plain").write_bytes(b"0123456789")
    (tmp_path / "packed").write_bytes(gzip.compress(b"0123456789"))
    assert read_bounded(tmp_path / "plain", 10) == read_bounded(tmp_path / "packed", 100) == b"0123456789"
    for name in ("plain", "packed"):
        with pytest.raises(OSError, match="holds more than 0 MB"):
            read_bounded(tmp_path / name, 9)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_a_device_and_a_folder_are_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    start_s = time.monotonic()
    for path in (tmp_path / "pipe", Path("/dev/zero")):
        for read in (read_yaml, read_lines, lambda path: read_image(path, "image")):
            with pytest.raises(InputError, match="give an ordinary file"):
                read(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_yaml(tmp_path)
    assert time.monotonic() - start_s < 2.0


def test_references_that_multiply_are_refused(tmp_path: Path) -> None:
    lines = ["a0: &a0 [0, 0, 0, 0, 0, 0, 0, 0, 0, 0]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 9)]
    with pytest.raises(InputError, match="more than 200000 values, references counted each time"):
        load_yaml("\n".join(lines), "f.yaml")
    with pytest.raises(InputError, match="more than 200000 values"):
        load_yaml("a: &a [1, *a]", "f.yaml")
    assert load_yaml("a: &a [1, 2]\nb: *a\nc: [*a, *a]", "f.yaml")["c"] == [[1, 2], [1, 2]]


def test_a_maps_wrong_origin_is_quoted_in_short(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(
        "x: &x [1, 2, 3, 4, 5, 6]\n" + MAP.format(origin="[" + "*x, " * 5000 + "*x]")
    )
    with pytest.raises(InputError, match="origin: ") as refused:
        load_map(tmp_path / "map.yaml")
    assert len(str(refused.value)) < 300 + len(str(tmp_path))


IN_A_GIGABYTE = """
import resource, sys, time
from pathlib import Path
resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))
from midnet_bench.errors import InputError
from midnet_bench.io.map_server import read_image
from midnet_bench.io.scan_logs import read_lines
for read, path in zip((lambda path: read_image(path, "image"), read_lines), sys.argv[1:], strict=True):
    begin_s = time.process_time()
    try:
        read(Path(path))
    except InputError as error:
        print(f"{time.process_time() - begin_s} {error}")
"""


@pytest.mark.slow
def test_bombs_are_refused_within_a_gigabyte(tmp_path: Path) -> None:
    blank = io.BytesIO()
    Image.new("1", (12_000, 12_000)).save(blank, "PNG")
    (tmp_path / "map.png").write_bytes(blank.getvalue())
    (tmp_path / "run.log.gz").write_bytes(300 * gzip.compress(bytes(1_000_000)))
    assert len(blank.getvalue()) < 100_000
    command = [sys.executable, "-c", IN_A_GIGABYTE, tmp_path / "map.png", tmp_path / "run.log.gz"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    image, log = (line.partition(" ") for line in done.stdout.splitlines())
    assert "too many pixels for a map (12000 x 12000)" in image[2]
    assert "it holds more than 200 MB" in log[2]
    assert max(float(image[0]), float(log[0])) < 2.0
