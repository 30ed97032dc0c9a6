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


def test_the_package_comes_from_the_wheel(installed: Path, tmp_path: Path) -> None:
    done = run(installed / "python", "-c", "import midnet_bench as m; print(m.__file__)", folder=tmp_path)
    assert Path(done.stdout.strip()).is_relative_to(installed.parent), done.stdout + done.stderr


def test_every_campaign_is_there(installed: Path, tmp_path: Path) -> None:
    done = run(installed / "midnet-bench", "run", "--json", folder=tmp_path)
    assert list(json.loads(done.stdout)) == sorted(
        path.stem for path in (REPOSITORY / "campaigns").glob("*.yaml")
    )


@pytest.mark.parametrize(
    "line",
    [
        "detection --frames 2 --robots 1",
        "labyrinth --trials 1 --robots 1 --intruders 1 --set time_limit_s=2",
        "run readings -n",
        "parameters labyrinth",
        "map map1 --exact",
    ],
)
def test_a_command_runs_in_an_empty_folder(line: str, installed: Path, tmp_path: Path) -> None:
    done = run(installed / "midnet-bench", *line.split(), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_expected_numbers_are_updated_in_a_checkout_only(installed: Path, tmp_path: Path) -> None:
    (tmp_path / "smoke-detection").mkdir()
    done = run(
        installed / "midnet-bench", "compare", "--exact", "--update", "smoke-detection", folder=tmp_path
    )
    assert (done.returncode, "checkout" in done.stderr) == (2, True)


def test_the_expected_numbers_of_smoke_are_there(installed: Path, tmp_path: Path) -> None:
    code = (
        "from pathlib import Path\n"
        "from midnet_bench.io.files import shipped_folder\n"
        "for name in ('smoke-detection', 'smoke-labyrinth'):\n"
        "    print(*sorted(p.name for p in shipped_folder(f'golden/{name}', '').iterdir()))"
    )
    done = run(installed / "python", "-c", code, folder=tmp_path)
    assert done.stdout.splitlines() == [
        "platform.json robots.csv scores.csv",
        "intruders.csv platform.json robots.csv trial.csv",
    ], done.stderr


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
