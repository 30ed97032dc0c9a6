"""What lies in the working folder is not run, and what a machine lacks is done without."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from midnet_bench.compiled import folder
from tests.cli.command import REPOSITORY, worked

MODULES = [
    *("signal", "sitecustomize", "usercustomize", "conftest"),
    *("numpy", "yaml", "joblib", "random", "numba"),
]
TRAP = "open({trap!r}, 'w').close()\nraise SystemExit('a file of the working folder was run')\n"
CAMPAIGN = """
experiment: labyrinth
grid: {robots: [1, 2]}
trials: 1
parameters: {engine: fast, intruders: 1, time_limit_s: 1, prior_map: exact}
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
    return files_in(results), done.stderr


def files_in(results: Path) -> dict[str, bytes]:
    return {
        path.name: path.read_bytes()
        for path in sorted(results.iterdir())
        if path.suffix in (".csv", ".md", ".tex", ".png", ".svg")
        and path.stem not in ("timing", "labyrinth_speed")
    }


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("elsewhere")
    (folder / "small.yaml").write_text(CAMPAIGN)
    worked("run", "small.yaml", folder=folder)
    found = files_in(folder / "results" / "small")
    assert any(name.endswith(".svg") for name in found)
    return found


def make_hostile(folder: Path, trap: Path) -> set[str]:
    """A folder full of files that would make ``trap`` if somebody ran them; their names."""
    folder.mkdir()
    for module in MODULES:
        (folder / f"{module}.py").write_text(TRAP.format(trap=str(trap)))
    for name, text in FILES.items():
        (folder / name).write_text(text.replace("{trap}", str(trap)))
    return {path.name for path in folder.iterdir()}


@pytest.mark.slow
def test_files_of_the_working_folder_are_not_run_and_change_no_byte(
    tmp_path: Path, elsewhere: dict[str, bytes]
) -> None:
    trap = tmp_path / "trap"
    hostile = tmp_path / "hostile"
    before = make_hostile(hostile, trap)

    found, _ = ran(hostile)

    assert not trap.exists()
    assert {path.name for path in hostile.iterdir()} - before == {"small.yaml", "results"}
    assert found.keys() == elsewhere.keys()
    assert [name for name in found if found[name] != elsewhere[name]] == []


NOBODY = 65534
POOR = """
mount --make-rprivate / || exit 1
while read -r _ place _ options _; do
    mount -o "remount,bind,$options,ro" "$place" 2>&-
done < /proc/self/mounts
for place in "$1" "$2" "$HOME" "$3"; do
    touch "$place" 2>&- && exit 1
done
places=$4
mount -t tmpfs -o ro tmpfs /dev/shm && mount -t tmpfs tmpfs $places || exit 1
mkdir $places/folder $places/tmp || exit 1
mount --bind "$1" $places/folder && mount -o remount,bind,rw $places/folder || exit 1
mount --bind "$2" $places/tmp && mount -o remount,bind,rw $places/tmp || exit 1
mount -o remount,ro $places && cd $places/folder && shift 4 && exec "$@"
"""
"""runs a command that can write nowhere but in the folders of the first two arguments; the third is a place
that must not be written, at the fourth the two appear as ``folder`` and ``tmp``"""
PLACES = (
    "/media"  # which each Linux has; in a name space of its own the test mounts an empty file system there
)


@pytest.mark.slow
def test_a_user_who_may_write_nothing_else_gets_the_same_bytes_in_a_hostile_folder(
    tmp_path: Path, elsewhere: dict[str, bytes]
) -> None:
    """No right of root, and everything read-only but the working folder and the one for temporary files."""
    hostile, temporary = tmp_path / "hostile", tmp_path / "temporary"
    before = make_hostile(hostile, Path(PLACES, "folder", "trap"))
    temporary.mkdir()
    kept = folder()
    if kept is not None:  # else everything would be compiled anew, which test_compiled.py does
        shutil.copytree(kept, temporary / "compiled" / kept.name)
    is_root = os.geteuid() == 0
    for place in (hostile, temporary, *temporary.rglob("*")):
        place.chmod(0o777)
    user = ("--reuid", f"{NOBODY}", "--regid", f"{NOBODY}", "--clear-groups", "--no-new-privs")
    inside = (
        *("unshare", "--mount", *(() if is_root else ("--map-root-user",))),
        *("sh", "-c", POOR, "sh", str(hostile), str(temporary), str(REPOSITORY), PLACES),
        *(("setpriv", *user) if is_root else ()),
    )
    # another Python would compile for minutes
    same_python = f"import sys, numba; sys.exit(sys.version != {sys.version!r})"
    probe = [*inside, sys.executable, "-P", "-c", same_python]
    if not shutil.which(inside[0]) or subprocess.run(probe, capture_output=True, check=False).returncode:
        pytest.skip("needs a namespace of its own where all is read-only, and this Python open to all users")

    places = {"HOME": "/", "TMPDIR": f"{PLACES}/tmp", "NUMBA_CACHE_DIR": f"{PLACES}/tmp/compiled"}
    found, complaints = ran(hostile, *inside, **places, XDG_CACHE_HOME="")

    assert "one trial runs at a time, since joblib cannot use /dev/shm" in complaints
    assert "Traceback" not in complaints
    assert {path.name for path in hostile.iterdir()} - before == {"small.yaml", "results"}
    assert {path.name for path in temporary.iterdir()} <= {"compiled"}
    assert found.keys() == elsewhere.keys()
    assert [name for name in found if found[name] != elsewhere[name]] == []
