"""Files that never end, that wait for a writer, or that unpack to more than a machine has."""

import gzip
import io
import os
import resource
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


def limited(code: str, *arguments: object) -> tuple[str, float]:
    """What ``code`` prints in a process with a gigabyte of memory, and its processor time, seconds."""
    whole = f"import resource\nresource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))\n{code}"
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-c", whole, *map(str, arguments)], capture_output=True, text=True, timeout=60
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip(), after.ru_utime - before.ru_utime


REFUSED = """
import sys
from pathlib import Path
from midnet_bench.errors import InputError
{imports}
try:
    {call}
except InputError as error:
    print(error)
"""


@pytest.mark.slow
def test_bombs_are_refused_within_a_gigabyte(tmp_path: Path) -> None:
    blank = io.BytesIO()
    Image.new("1", (12_000, 12_000)).save(blank, "PNG")
    (tmp_path / "map.png").write_bytes(blank.getvalue())
    with gzip.open(tmp_path / "run.log.gz", "wb", compresslevel=1) as file:
        for _ in range(300):
            file.write(bytes(1_000_000))
    assert len(blank.getvalue()) < 100_000

    image = REFUSED.format(
        imports="from midnet_bench.io.map_server import read_image",
        call="read_image(Path(sys.argv[1]), 'image')",
    )
    told, spent_s = limited(image, tmp_path / "map.png")
    assert "too many pixels for a map (12000 x 12000)" in told
    assert spent_s < 2.0
    log = REFUSED.format(
        imports="from midnet_bench.io.scan_logs import read_lines", call="read_lines(Path(sys.argv[1]))"
    )
    told, spent_s = limited(log, tmp_path / "run.log.gz")
    assert "it holds more than 200 MB" in told
    assert spent_s < 2.0
