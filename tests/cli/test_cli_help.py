"""What the program says of itself: without arguments, and for each command."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer.main

from midnet_bench.agents.agent_settings import PATROLS, PURSUITS
from midnet_bench.cli.app import PANELS, app
from midnet_bench.cli.options import OPTIONS
from midnet_bench.plugins import DETECTORS, FUSIONS, ExtensionPoint
from midnet_bench.robots.model import ROBOTS
from midnet_bench.scoring.metric import METRICS
from midnet_bench.simulation.engine import SIMULATORS
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


@pytest.mark.parametrize("name", ["detection", "labyrinth", "run"])
def test_what_runs_campaigns_shares_its_options_under_three_headings(name: str, tmp_path: Path) -> None:
    text = midnet_bench(name, "-h", folder=tmp_path).stdout
    headings = ("What runs", "What is swapped in", "Where it goes", "Options")
    places = [text.index(f"\n{heading}:\n") for heading in headings]
    assert places == sorted(places)
    for option, place in (
        ("--seeds, --trials N", 0),
        ("--detector NAME", 1),
        ("--jobs N", 2),
        ("--quiet", 3),
    ):
        assert places[place] < text.index(option)
        assert all(text.index(option) < later for later in places[place + 1 :])


def test_every_argument_and_option_has_help_or_is_a_parameter_that_the_command_s_experiment_lacks() -> None:
    commands = typer.main.get_command(app).commands
    listed = [*commands.values(), *commands["arena"].commands.values()]
    without = {(command.name, one.name) for command in listed for one in command.params if not one.help}
    assert without == {("labyrinth", "frames"), ("detection", "pursuit")}
    assert all(one.hidden == (not one.help) for command in listed for one in command.params)


def test_trials_is_another_name_of_seeds(tmp_path: Path) -> None:
    plans = {
        midnet_bench("labyrinth", name, 20, "-n", folder=tmp_path).stdout for name in ("--trials", "--seeds")
    }
    assert [plan.split(";")[0] for plan in plans] == ["25 cells, 500 trials, 500 of them to run"]
    for name in ("--trials", "--seeds"):
        complaint = one_line_of_complaint(midnet_bench("labyrinth", name, "many", folder=tmp_path))
        assert complaint == "error: --seeds / --trials: a whole number is needed"


@pytest.mark.parametrize("words", ["campaigns", "plot results/detection", "detection --robot waffle"])
def test_what_there_is_not_is_refused_with_a_near_name(words: str, tmp_path: Path) -> None:
    assert "No such" in one_line_of_complaint(midnet_bench(*words.split(), folder=tmp_path))


@pytest.mark.parametrize(
    "point",
    [DETECTORS, FUSIONS, PATROLS, PURSUITS, METRICS, SIMULATORS, ROBOTS],
    ids=lambda point: point.option,
)
def test_help_names_what_comes_with_the_package_at_each_extension_point(
    point: ExtensionPoint, tmp_path: Path
) -> None:
    option = OPTIONS.get(point.option, point.option)
    text = midnet_bench("run", "-h", folder=tmp_path).stdout.partition(f"\n  --{option} NAME ")[2]
    words = re.findall(r"\w+", re.split(r"\n  -|\n\n", text)[0])
    assert set(point.own) <= set(words)
    assert "file.py:NAME" in re.split(r"\n  -|\n\n", text)[0]
    kind = option.removesuffix("-model")
    assert kind in re.findall(r"\w+", midnet_bench("check", "-h", folder=tmp_path).stdout)


@pytest.mark.slow
def test_options_are_the_same_where_python_drops_docstrings(tmp_path: Path) -> None:
    helped = [sys.executable, "-OO", "-m", "midnet_bench", "report", "--help"]
    done = subprocess.run(helped, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60)
    arguments = done.stdout.index("Arguments:")
    assert done.stdout[arguments:] in midnet_bench("report", "--help", folder=tmp_path).stdout
    assert "$ midnet-bench report results/detection" in done.stdout[:arguments]
