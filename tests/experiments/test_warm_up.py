"""What is compiled before workers start, and what an estimate goes by before any trial is measured."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from midnet_bench import compiled
from midnet_bench.campaign.definition import Campaign, ResolvedCampaign, resolve
from midnet_bench.campaign.runner import plan
from midnet_bench.experiments import registry
from midnet_bench.experiments.guarded.parameters import SECONDS_PER_SIMULATED_SECOND, START_S
from midnet_bench.workflows import campaigns


def campaign(experiment: str = "detection", **grid: Any) -> ResolvedCampaign:
    return resolve(Campaign(experiment=experiment, grid=grid), registry)


def test_each_engine_is_compiled_for_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(compiled, "folder", lambda: tmp_path)
    ran: list[Any] = []

    def run_short(name: str, **values: Any) -> None:
        ran.append((name, values["engine"]))
        for call in compiled.after_compiling:
            call()

    monkeypatch.setattr(campaigns, "_run_short", run_short)
    shown: list[tuple[int, int]] = []
    resolved = campaign(engine=["fast", "bullet"], robots=[1, 3])
    for _ in range(2):
        campaigns.compile_ahead(resolved, lambda done, total: shown.append((done, total)))
    assert ran == [("detection", "fast"), ("detection", "bullet")]
    assert shown == [(1, campaigns.LOOPS)] * 2
    campaigns.compile_ahead(campaign("labyrinth", engine=["fast"]))
    assert ran[2:] == [("labyrinth", "fast")]


def test_what_fails_is_left_to_the_trials_and_tried_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(compiled, "folder", lambda: tmp_path)
    calls = []

    def fail(name: str, **values: Any) -> None:
        calls.append(name)
        raise ValueError("broken")

    monkeypatch.setattr(campaigns, "_run_short", fail)
    for _ in range(2):
        campaigns.compile_ahead(campaign())
    assert calls == ["detection"] * 2


def test_every_experiment_of_ours_has_a_short_trial() -> None:
    for name, short in campaigns.SHORT.items():
        model = registry.experiment(name).parameters
        assert model.parse(short, name).expected_wall_s < model().expected_wall_s
    assert list(campaigns.SHORT) == registry.names()[: len(campaigns.SHORT)]


def test_an_estimate_knows_frames_robots_and_engine(tmp_path: Path) -> None:
    def wall_s(*robots: int, **parameters: Any) -> float:
        grid = {"robots": [*robots]}
        asked = Campaign(experiment="detection", grid=grid, parameters=parameters)
        return plan(resolve(asked, registry), tmp_path, jobs=1).wall_s

    short = wall_s(1, frames=5, engine="fast")
    assert short == pytest.approx(START_S + sum(SECONDS_PER_SIMULATED_SECOND["fast"]))
    assert START_S < short < 2.0
    long = wall_s(1, engine="fast")
    assert 5.0 < long < 15.0
    assert long < wall_s(5, engine="fast") < wall_s(5)
    assert wall_s(1, 5) == pytest.approx(wall_s(1) + wall_s(5))


def test_a_dry_run_needs_no_simulator_compiler_tables_and_figures(tmp_path: Path) -> None:
    program = (
        "import atexit, sys; from midnet_bench.cli import main\n"
        "heavy = {'pybullet', 'numba', 'scipy', 'pandas', 'matplotlib'}\n"
        "atexit.register(lambda: print(sorted(heavy & sys.modules.keys())))\n"
        "sys.argv = ['midnet-bench', 'detection', '--robots', '1', '--dry-run']\n"
        "main()"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "[]", done.stderr
