"""Experiments by reference, to a file beside the campaign's or to a module; how often cells are checked."""

import shutil
from pathlib import Path

import pytest

from midnet_bench.campaign.definition import Campaign, load_campaign, resolve
from midnet_bench.campaign.runner import plan, run_campaign
from midnet_bench.campaign.store import open_store
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from midnet_bench.workflows.campaigns import run_campaign as run_with_registry
from tests.campaign import dice

CAMPAIGN = """
experiment: own/dice.py:DICE
grid: {sides: [6, 20]}
trials: 2
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A folder with a campaign file and, in a folder below it, the file of its experiment."""
    (tmp_path / "project" / "own").mkdir(parents=True)
    shutil.copy(dice.__file__, tmp_path / "project" / "own" / "dice.py")
    (tmp_path / "project" / "rolling.yaml").write_text(CAMPAIGN)
    return tmp_path / "project"


def rows(directory: Path) -> dict[str, object]:
    """Trial id -> its only row."""
    with open_store(directory / "campaign.sqlite") as store:
        return {trial.trial_id: trial.tables()["rolls"][0] for trial in store.trials()}


@pytest.mark.slow
def test_a_file_beside_the_campaigns_is_found_from_any_folder_and_kept_in_the_store(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(project)
    first = run_with_registry(load_campaign("rolling.yaml"), "results/rolling", jobs=2)
    monkeypatch.chdir("/")
    again = run_with_registry(load_campaign(str(project / "rolling.yaml")), project / "results" / "rolling")

    assert (first.finished, first.ran, again.ran) == (4, 4, 0)
    with open_store(project / "results" / "rolling" / "campaign.sqlite") as store:
        definition = store.definition
    assert definition.experiment == "dice.py:DICE"
    assert definition.experiment_file == "../../own/dice.py"
    found = registry.experiment(definition.reference(project / "results" / "rolling"))
    assert found.summary == "Roll a die."


@pytest.mark.slow
def test_a_project_that_moved_goes_on_where_it_stopped(project: Path) -> None:
    run_with_registry(load_campaign(project / "rolling.yaml"), project / "rolled", jobs=2)
    before = rows(project / "rolled")
    moved = project.rename(project.with_name("moved"))
    campaign = load_campaign(moved / "rolling.yaml").model_copy(update={"trials": 3})

    outcome = run_with_registry(campaign, moved / "rolled", jobs=2)

    assert (outcome.ran, outcome.finished) == (2, 6)
    assert before.items() <= rows(moved / "rolled").items()


def test_an_experiment_file_that_changed_between_runs_is_told(project: Path) -> None:
    campaign = load_campaign(project / "rolling.yaml")
    run_with_registry(campaign, project / "rolled", jobs=2)
    with (project / "own" / "dice.py").open("a") as file:
        file.write("\n# another version\n")

    again = run_with_registry(campaign.model_copy(update={"trials": 3}), project / "rolled", jobs=2)

    (note,) = again.notes
    assert note.startswith("these trials were run by 2 versions of the code: ")
    assert note.count(", experiment ") == 2


def test_a_module_is_referred_to_by_its_name(tmp_path: Path) -> None:
    campaign = Campaign(experiment="tests.campaign.dice:DICE", trials=2)
    assert run_with_registry(campaign, tmp_path, jobs=2).finished == 2
    with open_store(tmp_path / "campaign.sqlite") as store:
        assert store.definition.experiment == "tests.campaign.dice:DICE"
        assert store.definition.reference(tmp_path) == "tests.campaign.dice:DICE"


@pytest.mark.parametrize(
    ("reference", "complaint"),
    [
        ("own/dice.py:DYCE", "no 'DYCE' in .*did you mean 'DICE'"),
        ("own/dice.py:roll", "expected an Experiment, got function"),
        ("dice.py:DICE", "cannot be read: No such file"),
        ("no.such.module:DICE", "cannot be imported"),
    ],
)
def test_a_reference_to_nothing_names_the_campaign_file(
    project: Path, reference: str, complaint: str
) -> None:
    path = project / "rolling.yaml"
    path.write_text(CAMPAIGN.replace("own/dice.py:DICE", reference))
    with pytest.raises(InputError, match=complaint) as caught:
        resolve(load_campaign(path), registry)
    assert str(caught.value).startswith(f"{path}: ")


def test_each_cell_is_checked_once_in_the_campaign_and_once_in_the_worker(tmp_path: Path) -> None:
    grid = {"sides": [2, 4, 6, 8, 20], "colour": ["red", "green", "blue", "black", "white"]}
    dice.validations = 0
    campaign = resolve(
        Campaign.model_validate({"experiment": "tests.campaign.dice:DICE", "grid": grid}), registry
    )
    plan(campaign, tmp_path)
    run_campaign(campaign, tmp_path, jobs=2)
    plan(campaign, tmp_path)
    assert run_campaign(campaign, tmp_path, jobs=2).ran == 0
    assert dice.validations == 25

    # a worker checks types and ranges, but what the parent read from files it does not read again
    assert [row["validations"] for row in rows(tmp_path).values()] == [0] * 25
