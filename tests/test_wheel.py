"""What a user gets who installs the package: everything that its commands need, from any folder."""

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import venv
from importlib import metadata
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]
SHIPPED = ("smoke", "detection", "standard")
SOURCES = ("midnet_bench", "campaigns", *(f"results/reference/{name}" for name in SHIPPED))
FILES = ("pyproject.toml", "setup.py", "README.md", "LICENSE")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with the wheel in it, and this one's libraries in sight; the folder of its programs."""
    place = tmp_path_factory.mktemp("wheel")
    source = place / "source"  # a build leaves files beside the sources
    for name in SOURCES:
        shutil.copytree(REPOSITORY / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in FILES:
        shutil.copy(REPOSITORY / name, source / name)
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "wheel", "--no-deps", "--wheel-dir", place, source], check=True)
    (wheel,) = place.glob("*.whl")
    venv.create(place / "venv", with_pip=False)
    programs = place / "venv" / "bin"
    python = programs / "python"
    subprocess.run([*pip, "--python", python, "install", "--no-deps", "--no-index", wheel], check=True)
    (site,) = (place / "venv" / "lib").glob("python*/site-packages")
    # a path, not a copy of this environment: its own .pth files, which would show the checkout, stay unread
    (site / "libraries.pth").write_text(sysconfig.get_path("purelib"))
    return programs


def run(program: Path, *arguments: object, folder: Path) -> subprocess.CompletedProcess[str]:
    hidden = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")
    environment = {key: value for key, value in os.environ.items() if key not in hidden}
    command = [program, *map(str, arguments)]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_every_campaign_is_there(installed: Path, tmp_path: Path) -> None:
    done = run(installed / "midnet-bench", "run", "--json", folder=tmp_path)
    assert list(json.loads(done.stdout)) == sorted(
        path.stem for path in (REPOSITORY / "campaigns").glob("*.yaml")
    )


LINES = (
    "detection --frames 2 --robots 1 --jobs 1",
    "labyrinth --trials 1 --robots 1 --intruders 1 --set time_limit_s=2 --jobs 1",
    "run readings -n",
    "parameters labyrinth",
    "map map1 --exact",
    "compare --exact --update smoke-detection",
)
SAY = """
import contextlib, io, json, pathlib, sys
import midnet_bench
from midnet_bench.cli import main
from midnet_bench.io.files import shipped_folder

def said(line):
    sys.argv, out, code = ["midnet-bench", *line.split()], io.StringIO(), 0
    try:
        with contextlib.redirect_stdout(out):
            main()
    except SystemExit as ended:
        code = ended.code or 0
    return [code, out.getvalue()]

def shipped(name):
    return sorted(path.name for path in shipped_folder(f"golden/{name}", "").iterdir())

pathlib.Path("smoke-detection").mkdir()
golden = [shipped("smoke-detection"), shipped("smoke-labyrinth")]
print(json.dumps([midnet_bench.__file__, golden, [said(line) for line in sys.argv[1:]]]))
"""


def test_commands_run_in_an_empty_folder(installed: Path, tmp_path: Path) -> None:
    done = run(installed / "python", "-c", SAY, *LINES, folder=tmp_path)
    file, golden, said = json.loads(done.stdout)
    assert Path(file).is_relative_to(installed.parent)
    assert golden == [
        ["platform.json", "robots.csv", "scores.csv"],
        ["intruders.csv", "platform.json", "robots.csv", "trial.csv"],
    ]
    for line, (code, out) in zip(LINES[:-1], said[:-1], strict=True):
        assert code == 0, f"{line}: {done.stderr}"
        assert out, line
    # expected numbers are updated in a checkout only
    assert said[-1][0] == 2
    assert "checkout" in done.stderr


def test_every_library_that_the_package_needs_is_pinned() -> None:
    """Those of its libraries too: one that floats changes what a fresh machine runs."""
    lines = (REPOSITORY / "constraints.txt").read_text("utf-8").split()
    pinned = {re.sub("[-_.]+", "-", line.partition("==")[0]).lower() for line in lines}
    needed, unread = set(), ["midnet-bench"]
    while unread:
        for line in metadata.requires(unread.pop()) or []:
            name = re.sub("[-_.]+", "-", re.split(r"[^\w.-]", line)[0]).lower()
            # one for another system or another Python is not here
            if "extra ==" not in line and name not in needed and any(metadata.distributions(name=name)):
                needed.add(name)
                unread.append(name)
    assert {"numpy", "apsw"} <= needed
    assert needed - pinned == set()
