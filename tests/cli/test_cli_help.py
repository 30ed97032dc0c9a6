"""What the program says of itself: without arguments, and for each command."""

import subprocess
import sys
from pathlib import Path

import pytest
import typer.main

from midnet_bench.cli.app import GROUPS, MOVED, PANELS, app
from tests.cli.command import midnet_bench, one_line_of_complaint


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


def test_every_command_stands_under_a_heading_of_the_help() -> None:
    commands = typer.main.get_command(app).commands
    assert sorted(commands) == sorted(name for names in PANELS.values() for name in names)


@pytest.mark.parametrize("name", MOVED)
def test_a_command_of_an_earlier_version_says_where_it_went(name: str, tmp_path: Path) -> None:
    complaint = one_line_of_complaint(midnet_bench(name, "results/detection", "--json", folder=tmp_path))
    assert complaint == f"error: {name}: now 'midnet-bench {MOVED[name]}'"
    assert MOVED[name].split(",")[0].split()[0] in [one for names in PANELS.values() for one in names]


def test_an_option_of_an_earlier_version_says_what_it_is_called(tmp_path: Path) -> None:
    for command in (("detection",), ("labyrinth",), ("render",), ("map", "map1")):
        complaint = one_line_of_complaint(midnet_bench(*command, "--robot", "waffle", folder=tmp_path))
        assert complaint == "error: --robot: now --robot-model"


@pytest.mark.parametrize("name", ["detection", "labyrinth", "run"])
def test_what_runs_campaigns_shares_its_options_in_three_groups(name: str, tmp_path: Path) -> None:
    text = midnet_bench(name, "-h", folder=tmp_path).stdout
    places = [text.index(f"\n{group}:") for group in GROUPS]
    assert places == sorted(places)
    known = {one.name for one in typer.main.get_command(app).commands[name].params}
    assert {option for names in GROUPS.values() for option in names.split()} <= known
    assert "--trials" not in text


@pytest.mark.slow
def test_options_are_the_same_where_python_drops_docstrings(tmp_path: Path) -> None:
    helped = [sys.executable, "-OO", "-m", "midnet_bench", "report", "--help"]
    done = subprocess.run(helped, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == midnet_bench("report", "--help", folder=tmp_path).stdout
