"""An experiment that midnet-bench does not know, in a file of its own, through every command."""

import json
from pathlib import Path

import pytest

from midnet_bench.campaign.definition import load_campaign, resolve
from midnet_bench.campaign.runner import run_campaign
from midnet_bench.experiments import registry
from tests.cli.command import worked

DRIFT = '''
"""How far a walker drifts."""

from dataclasses import dataclass
from functools import partial

from matplotlib.figure import Figure

from midnet_bench.analysis.claims import finding
from midnet_bench.analysis.compare import tidy
from midnet_bench.analysis.statistics import mean
from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.trial import TrialResult
from midnet_bench.experiments.registry import Experiment, Report, Trials
from midnet_bench.io.checked_yaml import Parameters
from midnet_bench.rng import stream
from midnet_bench.settings import option


@dataclass(frozen=True)
class Walk(Parameters):
    steps: int = option(10, "Steps of the walk.", ge=1)
    bias_m: float = option(0.5, "Mean length of a step.", ge=0)


def walk(parameters, seed):
    steps = stream(seed, "walk").normal(parameters.bias_m, 0.02, parameters.steps)
    return TrialResult({"walks": [{"drift_m": float(steps.sum())}]}, simulated_s=float(parameters.steps))


def drift(results):
    walks = results.table("walks")
    return {
        int(steps): mean(rows["drift_m"].tolist())
        for steps, rows in walks.groupby("steps")
    }


def tables(results):
    rows = [{"steps": steps, "drift_m": estimate} for steps, estimate in drift(results).items()]
    return [Table("drift", "Drift (95 % interval over seeds)", rows)]


def figures(results):
    figure = Figure()
    figure.add_subplot().plot(*zip(*((steps, one.value) for steps, one in drift(results).items())))
    return {"drift": figure}


def claims(results):
    walks = results.table("walks").groupby("steps")["drift_m"]
    means = {int(steps): partial(mean, drifts.tolist()) for steps, drifts in walks}
    return [finding(f"{n} steps drift about {n / 2} m", one, 0.4 * n, 0.6 * n) for n, one in means.items()]


def measures(results):
    return tidy(results.table("walks"), results.factors, ["drift_m"])


WALK = Experiment(
    name="walk", summary="A random walk.", parameters=Walk, trials=Trials(run=walk),
    report=Report(tables=tables, figures=figures, claims=claims, measures=measures),
)
'''
CAMPAIGN = """
experiment: walk.py:WALK
grid: {steps: [10, 20]}
trials: 3
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A folder with the file of an experiment and of a campaign of it, and nothing else."""
    (tmp_path / "walk.py").write_text(DRIFT)
    (tmp_path / "walking.yaml").write_text(CAMPAIGN)
    return tmp_path


@pytest.mark.slow
def test_an_experiment_in_its_own_file_runs_reports_plots_and_verifies(project: Path) -> None:
    run = worked("run", "walking.yaml", "--json", folder=project)
    told = json.loads(run.stdout)
    assert (told["schema"], told["experiment"]) == (1, "walk.py:WALK")
    short, long = told["tables"]["drift"]
    assert short["steps"] == 10
    assert short["drift_m"]["low"] < short["drift_m"]["value"] < short["drift_m"]["high"]
    assert long["drift_m"]["value"] == pytest.approx(10.0, abs=1.0)
    results = project / "results" / "walking"
    expected = {"walks.csv", "timing.csv", "drift.csv", "drift.md", "drift.tex", "drift.png", "drift.svg"}
    assert expected | {"configuration.json", "provenance.json"} <= {path.name for path in results.iterdir()}

    first = {path.name: path.read_bytes() for path in results.iterdir() if path.suffix != ".sqlite"}
    worked("report", results, folder=Path("/"))
    assert {path.name: path.read_bytes() for path in results.iterdir() if path.suffix != ".sqlite"} == first
    drawn = worked("report", results, "-o", project / "figures", folder=project)
    assert len(drawn.stdout.split()) == 2
    verified = worked("verify", results, "--json", folder=project)
    assert {row["verdict"] for row in json.loads(verified.stdout)["tables"]["claims"]} == {"holds"}

    # the files alone do as well: in a clone that has no store
    (results / "campaign.sqlite").unlink()
    assert worked("verify", results, "--json", "--trust", folder=project).stdout == verified.stdout


def test_a_plan_of_it_has_no_path_of_this_machine(project: Path) -> None:
    planned = worked("run", "walking.yaml", "--dry-run", "--json", folder=project)
    told = json.loads(planned.stdout)
    assert told["experiment"] == "walk.py:WALK"
    assert told["tables"]["plan"][0]["to_run"] == 6
    assert str(project) not in planned.stdout


@pytest.mark.usefixtures("trials_in_this_process")
def test_an_interrupted_campaign_of_it_goes_on_where_it_stopped(project: Path) -> None:
    whole = resolve(load_campaign(project / "walking.yaml"), registry)
    some = load_campaign(project / "walking.yaml").model_copy(update={"trials": 2})
    assert run_campaign(resolve(some, registry), project / "results" / "walking", jobs=1).ran == 4

    again = worked("run", "walking.yaml", "--json", folder=project)
    assert again.stderr.startswith("4 of 6 trials are")

    run_campaign(whole, project / "results" / "at once", jobs=1)
    worked("report", "results/at once", folder=project)
    parts, at_once = (project / "results" / name / "walks.csv" for name in ("walking", "at once"))
    assert parts.read_bytes() == at_once.read_bytes()


@pytest.mark.usefixtures("trials_in_this_process")
def test_two_campaigns_of_it_are_compared(project: Path) -> None:
    for name, bias_m in (("slow", 0.5), ("fast", 0.75)):
        worked("run", "walking.yaml", "--set", f"bias_m={bias_m}", "-o", name, folder=project)
    told = json.loads(worked("compare", "slow", "fast", "--json", folder=project).stdout)
    first, _ = told["tables"]["differences"]
    assert first["difference"]["value"] == pytest.approx(10 * 0.25)
    assert told["tables"]["settings"] == [{"setting": "bias_m", "slow": "0.5", "fast": "0.75"}]
