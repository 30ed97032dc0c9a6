"""What the program says of itself: without arguments, and for each command."""

from pathlib import Path

import pytest

from tests.cli.command import midnet_bench


def test_without_arguments_the_program_prints_its_help(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    done = midnet_bench(folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert midnet_bench("--help", folder=tmp_path).stdout == done.stdout
    lines = done.stdout.splitlines()
    start = lines.index("Start here")
    assert lines[start + 1].startswith("  midnet-bench detection   the paper's")
    assert lines[start + 2].startswith("  midnet-bench labyrinth   the paper's")
    assert max(map(len, lines)) <= 80
    monkeypatch.setenv("COLUMNS", "60")
    assert "  midnet-bench detection\n      the paper's" in midnet_bench(folder=tmp_path).stdout
