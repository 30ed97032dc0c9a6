"""What lies in the working folder is not run, and what a machine lacks is done without."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.command import REPOSITORY

MODULES = (
    "signal",
    "sitecustomize",
    "usercustomize",
    "numpy",
    "yaml",
    "joblib",
    "random",
    "numba",
    "conftest",
)
TRAP = "open({trap!r}, 'w').close()\nraise SystemExit('a file of the working folder was run')\n"
CAMPAIGN = """
experiment: labyrinth
grid: {robots: [1, 2]}
trials: 2
parameters: {engine: fast, intruders: 1, time_limit_s: 4, prior_map: exact}
"""
FILES = {
    ".numba_config.yaml": "cache_dir: {trap}\ndisable_jit: 1\nopt: 77\n",
    "matplotlibrc": "font.size: 40\nlines.linewidth: 20\nfigure.facecolor: red\nsvg.hashsalt: other\n",
    "pyproject.toml": "[project]\nname = 3\n",
    "setup.cfg": "[metadata]\n",
}


def ran(folder: Path, *before: str, **environment: str) -> tuple[dict[str, bytes], str]:
    """The files of a small campaign that is run in ``folder``, but for those that tell times; and stderr."""
    (folder / "small.yaml").write_text(CAMPAIGN)
    # -P: as the installed command, whose own folder comes first
    command = [*before, sys.executable, "-P", "-m", "midnet_bench", "run", "small.yaml", "--jobs", "2"]
    done = subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY), **environment},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    results = folder / "results" / "small"
    found = {
        path.name: path.read_bytes()
        for path in sorted(results.iterdir())
        if path.suffix in (".csv", ".md", ".tex", ".png", ".svg")
        and path.stem not in ("timing", "labyrinth_speed")
    }
    return found, done.stderr


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    found, _ = ran(tmp_path_factory.mktemp("elsewhere"))
    assert any(name.endswith(".svg") for name in found)
    return found


@pytest.mark.slow
def test_files_of_the_working_folder_are_not_run_and_change_no_byte(
    tmp_path: Path, elsewhere: dict[str, bytes]
) -> None:
    trap = tmp_path / "trap"
    hostile = tmp_path / "hostile"
    hostile.mkdir()
    for module in MODULES:
        (hostile / f"{module}.py").write_text(TRAP.format(trap=str(trap)))
    for name, text in FILES.items():
        (hostile / name).write_text(text.replace("{trap}", str(trap)))
    before = {path.name for path in hostile.iterdir()}

    found, _ = ran(hostile)

    assert not trap.exists()
    assert {path.name for path in hostile.iterdir()} - before == {"small.yaml", "results"}
    assert found.keys() == elsewhere.keys()
    assert [name for name in found if found[name] != elsewhere[name]] == []


@pytest.mark.slow
def test_without_a_folder_for_semaphores_trials_run_one_at_a_time(
    tmp_path: Path, elsewhere: dict[str, bytes]
) -> None:
    inside = ("unshare", "--map-root-user", "--mount")
    mount = "mount -t tmpfs -o ro tmpfs /dev/shm"
    made = shutil.which("unshare") and subprocess.run([*inside, "sh", "-c", mount], capture_output=True)
    if not made or made.returncode:
        pytest.skip("needs a namespace of its own in which /dev/shm can be made read-only")

    found, complaints = ran(tmp_path, *inside, "sh", "-c", f'{mount} && exec "$@"', "sh")

    assert "since /dev/shm cannot be used (Read-only file system): trials run in this process" in complaints
    assert "Traceback" not in complaints
    assert [name for name in found if found[name] != elsewhere[name]] == []
