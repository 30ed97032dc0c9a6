"""The benchmarks run, on sizes that say nothing about speed."""

import importlib
from pathlib import Path

import pytest

import benchmarks
from benchmarks import compare, gmapping, growth, midnet, physics, scale, standing, trial

NAMES = sorted(path.stem for path in Path(benchmarks.__file__).parent.glob("*.py") if path.stem[0] != "_")
CHECKOUT = str(Path(benchmarks.__file__).parents[1])


@pytest.mark.parametrize("name", NAMES)
def test_each_benchmark_imports(name: str) -> None:
    assert callable(getattr(importlib.import_module(f"benchmarks.{name}"), "main", print))


@pytest.mark.slow
def test_a_trial_against_bare_pybullet(capsys: pytest.CaptureFixture[str]) -> None:
    trial.main(simulated_s=0.4, repeats=1)
    said = capsys.readouterr().out
    for engine in ("bullet", "fast"):
        assert f"whole trial, {engine}" in said
    assert said.count("times bare PyBullet") == 2


@pytest.mark.slow
def test_both_engines_steps_and_scans(capsys: pytest.CaptureFixture[str]) -> None:
    physics.main(simulated_s=1, repeats=1)
    assert len(capsys.readouterr().out.splitlines()) == 2 + 3 * 2 + 1 + 3


@pytest.mark.slow
def test_midnet_against_bare_opencv(capsys: pytest.CaptureFixture[str]) -> None:
    midnet.main(frames=5, teams=(5, 10), repeats=1)
    said = capsys.readouterr().out.splitlines()
    assert [int(line.split()[0]) for line in said[1:]] == [1, 5, 10]


@pytest.mark.slow
def test_gmapping(capsys: pytest.CaptureFixture[str]) -> None:
    gmapping.main(seconds=4.0)
    assert "TURTLEBOT3" in capsys.readouterr().out


@pytest.mark.slow
def test_growth_with_robots_and_area(capsys: pytest.CaptureFixture[str]) -> None:
    growth.table("fast", [2, 4], [1.0], 0.4, 1)
    said = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in said[2:4]] == ["2", "4"]
    assert said[-1].startswith("growth per robot from 2 to 4: ")


@pytest.mark.slow
def test_a_trials_commands_and_beams_by_pybullet_alone(capsys: pytest.CaptureFixture[str]) -> None:
    standing.main(["--seeds", "1", "--seconds", "0.6", "--engines", "fast", "--skip", "fixed"])
    said = capsys.readouterr().out.splitlines()
    figures = [line.strip("|").split("|")[1] for line in said if line.startswith(("| bare", "| whole"))]
    assert [float(figure) > 0.0 for figure in figures] == [True, True, True]


def test_a_recorded_trial_has_ten_robots_commands_and_scans() -> None:
    given = standing.recorded({**standing.DRIVING_ON, "time_limit_s": 1.0}, 1)
    assert given.ticks == 30
    assert {number for _, number, _ in given.commands} == set(range(10))
    assert sum(len(starts) for _, starts, _ in given.beams) == 5 * 10 * 360
    assert 0 < min(tick for tick, _, _ in given.beams) <= max(tick for tick, _, _ in given.beams) <= 30


@pytest.mark.slow
def test_two_checkouts_are_compared(capsys: pytest.CaptureFixture[str]) -> None:
    tiny = ["--cases", "1+1", "--repeats", "1", "--seconds", "0.4"]
    compare.main([CHECKOUT, CHECKOUT, *tiny, "--old-set", "engine=fast", "--new-set", "engine=fast"])
    assert "NEW/OLD" in capsys.readouterr().out


@pytest.mark.slow
def test_a_folder_that_is_no_checkout_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"is no checkout of midnet-bench|its process ended"):
        compare.main([str(tmp_path), CHECKOUT])


def test_fusions_of_growing_teams(capsys: pytest.CaptureFixture[str]) -> None:
    scale.main(teams=(2, 20, 40), scenes=1)
    said = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in said] == ["fusion", *scale.FUSIONS, "IoUs"]
    assert float(said[-1].split()[-1]) > 1.5, "pairs as written grow with the square of the team"
