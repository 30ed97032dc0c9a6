"""The fuzzer on a few hundred cases, and that it notices what it is there to notice."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

if not hasattr(os, "pidfd_open"):
    pytest.skip("needs Linux", allow_module_level=True)

from tests.fuzz import forked

REPOSITORY = Path(__file__).parents[2]


@pytest.mark.slow
def test_28_mutated_inputs_are_taken_or_refused_in_one_line() -> None:
    # in its own process: a fork of one with threads, as pytest's workers have, may wait for a lock for ever
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz", "--cases", "28", "--seed", "1"],
        cwd=REPOSITORY,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("all "))
    cases, succeeded, refused, finds = map(int, line.split()[1:])
    assert (cases, finds) == (28, 0)
    assert min(succeeded, refused) > 4, "what is never taken, or never refused, tests nothing"


def found(call: Callable[[], object], folder: Path, *named: Path) -> str:
    def run() -> None:
        call()

    return forked.run(run, folder, [folder / "out"], named).find()


def says(text: str, code: int) -> None:
    sys.stderr.write(text)
    raise SystemExit(code)


def busy() -> None:
    while True:
        pass


@pytest.mark.slow
@pytest.mark.parametrize(
    ("call", "find"),
    [
        (lambda: None, ""),
        (lambda: says("a note\nanother\n", 0), ""),
        (lambda: says("error: no\n", 2), ""),
        (lambda: says("", 2), "0 lines of refusal"),
        (lambda: says("error: no\nnor that\n", 2), "2 lines of refusal"),
        (lambda: says("a.py:1: SyntaxWarning: is it?\n  1 is 1\nerror: no\n", 2), ""),
        (lambda: says("x" * 301, 2), "a refusal too long or not printable"),
        (lambda: says("\x1b[31m", 2), "a refusal too long or not printable"),
        (lambda: says("a.py:1: RuntimeWarning: overflow\n", 0), "a warning of Python's"),
        (lambda: says("error: no\n", 1), "exit code 1"),
        (lambda: 1 // 0, "traceback"),
        (lambda: bytearray(2 << 30), "traceback"),
        (lambda: os.kill(os.getpid(), signal.SIGTERM), "dies of SIGTERM"),
        (busy, "takes more than 1 s of processor time"),
    ],
)
def test_what_the_fuzzer_notices(
    call: Callable[[], object], find: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(forked, "CPU_S", 1)
    assert found(call, tmp_path) == find


def test_nothing_is_written_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    assert found(lambda: Path("out/file").write_text("text"), tmp_path) == ""
    assert (tmp_path / "out" / "file").exists()
    for writes in (
        lambda: Path("../file").write_text("text"),
        lambda: os.mkdir("outside"),
        lambda: os.rename("out", "../out"),
        lambda: Path("out/file").rename("file"),
    ):
        assert found(writes, tmp_path).startswith("writes /")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out"]


def test_what_the_user_asked_for_is_no_find(tmp_path: Path) -> None:
    asked = tmp_path / "elsewhere" / "asked"

    def write() -> None:
        try:
            asked.mkdir(parents=True)
        except PermissionError:
            raise SystemExit(0) from None

    assert found(write, tmp_path, asked) == ""
    assert not asked.parent.exists()
