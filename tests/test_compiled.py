"""Machine code is that of the sources that stand there, wherever it is kept."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import midnet_bench
from midnet_bench import compiled

PACKAGE = Path(midnet_bench.__file__).parent

BELOW = """
from midnet_bench.compiled import njit
from midnet_bench import (
    numbers,
)

@njit
def times(x):
    return numbers.FACTOR * x
"""
ABOVE = """
from midnet_bench.compiled import njit
from midnet_bench.below import times

@njit
def product(x):
    return times(x)
"""
PRINT = "from midnet_bench.above import product; print(product(2.0)); from midnet_bench import compiled"


@pytest.fixture(scope="module")
def compiled_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a package with our ``njit`` and ``kept``, the loops that its first process compiled.

    ``above`` calls ``below``, which takes a number of ``numbers``.
    """
    place = tmp_path_factory.mktemp("compiled")
    folder = place / "place" / "midnet_bench"
    folder.mkdir(parents=True)
    (folder / "__init__.py").write_text("")
    shutil.copy(PACKAGE / "compiled.py", folder)
    (folder / "numbers.py").write_text("FACTOR = 3.0\n")
    (folder / "below.py").write_text(BELOW)
    (folder / "above.py").write_text(ABOVE)
    (place / "hostile").mkdir()
    config = f"cache_dir: {place / 'trap'}\nopt: nonsense\ndisable_jit: 1\n"
    (place / "hostile" / ".numba_config.yaml").write_text(config)
    assert product(folder, place / "kept", cwd=place / "hostile") == "6.0"
    return place


@pytest.fixture
def package(compiled_once: Path, tmp_path: Path) -> Path:
    """The package, for you to change."""
    return Path(shutil.copytree(compiled_once / "place", tmp_path / "place")) / "midnet_bench"


@pytest.fixture
def kept(compiled_once: Path, tmp_path: Path) -> Path:
    """Its compiled loops, for you to change."""
    return Path(shutil.copytree(compiled_once / "kept", tmp_path / "kept"))


def product(package: Path, kept: Path | str, more: str = "", cwd: Path | None = None) -> str:
    """What a fresh process prints that keeps its loops in ``kept``; ``more`` is run after it."""
    return said(package, kept, more, cwd)[0]


def said(
    package: Path, kept: Path | str, more: str = "", cwd: Path | None = None, first: str = ""
) -> tuple[str, str]:
    """The same, and what it says on stderr; ``first`` is run before all."""
    done = subprocess.run(
        [sys.executable, "-c", f"{first}\n{PRINT}\n{more}"],
        cwd=cwd or package.parent.parent,
        env={
            **os.environ,
            "PYTHONPATH": str(package.parent),
            "PYTHONSAFEPATH": "1",
            # else a source that was changed within a second is taken for the one before
            "PYTHONDONTWRITEBYTECODE": "1",
            "NUMBA_CACHE_DIR": str(kept),
        },
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip(), done.stderr


def compiled_files(folder: Path) -> set[Path]:
    return set(folder.rglob("*.nbc"))


@pytest.mark.slow
def test_a_change_in_a_callee_or_in_a_number_changes_the_result_and_back(package: Path, kept: Path) -> None:
    below = package / "below.py"
    below.write_text(BELOW.replace("numbers.FACTOR * x", "numbers.FACTOR + x"))
    assert product(package, kept) == "5.0"

    (package / "numbers.py").write_text("FACTOR = 9.0\n")
    assert product(package, kept) == "11.0"

    # back again, with sources that no loop uses, and in another folder than the first
    below.write_text(BELOW)
    (package / "numbers.py").write_text("FACTOR = 3.0\n")
    (package / "cli").mkdir()
    (package / "cli" / "other.py").write_text("x = 1\n")
    before = compiled_files(kept)
    assert product(package, kept) == "6.0"
    assert compiled_files(kept) == before


@pytest.mark.slow
def test_each_compilation_is_counted_and_a_loop_that_is_kept_is_not(package: Path, kept: Path) -> None:
    more = (
        "import numpy\n"
        "calls = []\n"
        "compiled.after_compiling.append(lambda: calls.append(1))\n"
        "product(2.0); before = len(calls); product(numpy.ones(2))\n"
        "print(before, len(calls))"
    )
    first = product(package, kept, more).split()
    assert first == ["6.0", "0", "2"]  # the second signature of both loops
    again = product(package, kept, more).split()
    assert again == ["6.0", "0", "0"]


@pytest.mark.slow
def test_a_damaged_file_is_compiled_anew(package: Path, kept: Path) -> None:
    for number, path in enumerate(sorted(kept.rglob("*.nb?"))):
        path.write_bytes(path.read_bytes()[: 10 * number])
    assert product(package, kept) == "6.0"


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_without_a_folder_that_can_be_written_a_temporary_one_goes_with_the_process(
    package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("XDG_CACHE_HOME", os.devnull)
    monkeypatch.setenv("TMPDIR", str(temporary))
    told = product(package, "", "print(compiled.folder())").splitlines()
    assert told[0] == "6.0"
    assert Path(told[1]).is_relative_to(temporary)
    assert list(temporary.iterdir()) == []


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
@pytest.mark.parametrize(
    ("which", "mode"), [("root", 0o777), ("root", 0o1777), ("root", 0o720), ("digest", 0o720)]
)
def test_a_folder_that_others_can_write_is_not_taken(
    which: str, mode: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    kept = tmp_path / "kept"
    opened = kept if which == "root" else kept / compiled.digest()
    opened.mkdir(parents=True)
    kept.chmod(0o700)
    opened.chmod(mode)
    monkeypatch.setenv(compiled.VARIABLE, str(kept))
    found = compiled.folder.__wrapped__()
    assert not found.is_relative_to(kept)
    assert [record.getMessage().partition(":")[0] for record in caplog.records] == [str(opened)]
    assert list(opened.iterdir()) == []
    opened.chmod(0o700)
    monkeypatch.setenv(compiled.VARIABLE, str(kept))
    found = compiled.folder.__wrapped__()
    assert found == kept / compiled.digest()
    assert found.stat().st_mode & 0o777 == 0o700


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_machine_code_that_others_could_have_written_is_not_run(package: Path, kept: Path) -> None:
    (folder,) = kept.iterdir()
    for path in compiled_files(kept):
        path.write_bytes(b"planted")
    folder.chmod(0o720)
    before = compiled_files(kept)
    printed, told = said(package, kept)
    assert printed == "6.0"
    assert [line.partition(":")[0] for line in told.splitlines()] == [str(folder)]
    assert compiled_files(kept) == before
    assert {path.read_bytes() for path in before} == {b"planted"}


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="root alone gives files away")
def test_machine_code_of_another_user_is_not_run(tmp_path: Path) -> None:
    os.chown(tmp_path, 65534, 65534)
    assert not compiled._is_private(tmp_path)


@pytest.mark.slow
def test_nowhere_to_write_is_said_once_and_changes_nothing(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # a process and one that it starts; tempfile finds no folder because none is left to it
    more = (
        "import subprocess, sys\n"
        "print(compiled.folder())\n"
        f"child = subprocess.run([sys.executable, '-c', {PRINT!r}], capture_output=True, text=True)\n"
        "print(child.stdout.strip(), repr(child.stderr))"
    )
    refuse = "import tempfile\ndef refuse(*a, **k): raise OSError('read-only')\ntempfile.mkdtemp = refuse"
    monkeypatch.setenv("XDG_CACHE_HOME", os.devnull)
    printed, told = said(package, "", more, first=refuse)
    assert printed.split() == ["6.0", "None", "6.0", "''"]
    assert "each process compiles for a minute" in told
    assert len(told.splitlines()) == 1


@pytest.mark.slow
def test_numba_takes_nothing_from_the_working_folder(compiled_once: Path) -> None:
    assert not (compiled_once / "trap").exists()
    assert len(compiled_files(compiled_once / "kept")) == 2
