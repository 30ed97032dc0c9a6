"""``--engine`` on the commands that simulate."""

from pathlib import Path

import pytest

from midnet_bench.analysis.frames import load_results
from tests.cli.command import midnet_bench


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["detection", "--engine", "fasst", "-n"], "engine: "),
        (["labyrinth", "--engine", "fast", "--set", "engine=fast", "-n"], "'engine' without --set too"),
        (["run", "detection", "--engine", "ode", "-n"], "engine: "),
        (["map", "map1", "--engine", "ode"], "engine: "),
        (["map", "map1", "--exact", "--engine", "fast"], "--engine has no meaning with --exact"),
        (["render", "detection", "--engine", "ode"], "engine: "),
    ],
)
def test_a_wrong_engine_gets_one_line(tmp_path: Path, arguments: list[str], told: str) -> None:
    done = midnet_bench(*arguments, folder=tmp_path)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert told in line


@pytest.mark.slow
def test_a_campaign_runs_on_the_engine_asked_for_and_goes_on_there_alone(tmp_path: Path) -> None:
    small = ["detection", "--robots", "1", "--frames", "2", "--jobs", "1", "-o", "out", "-q"]
    done = midnet_bench(*small, "--engine", "fast", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert load_results(tmp_path / "out").definition.parameters["engine"] == "fast"
    other = midnet_bench(*small, folder=tmp_path)
    assert other.returncode == 2
    assert "engine fast -> bullet" in other.stderr
