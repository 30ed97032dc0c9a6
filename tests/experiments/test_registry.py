"""How an experiment is found: by its name, by an entry point, by a reference."""

from pathlib import Path

import pytest

from midnet_bench.campaign.trial import TrialSpec
from midnet_bench.errors import InputError
from midnet_bench.experiments.registry import experiment, names, parameters_model, run_trials

DICE = """
from dataclasses import dataclass
from midnet_bench.campaign.trial import TrialResult
from midnet_bench.experiments.registry import Experiment, Trials
from midnet_bench.io.checked_yaml import Parameters
from midnet_bench.rng import stream
from midnet_bench.settings import option

@dataclass(frozen=True)
class DiceParameters(Parameters):
    sides: int = option(6, "Sides of the die.", ge=2)

def roll(parameters, seed):
    return TrialResult({"rolls": [{"eyes": int(stream(seed, "dice").integers(parameters.sides))}]}, 1.0)

DICE = Experiment(name="dice", summary="Roll dice.", parameters=DiceParameters, trials=Trials(run=roll))
NOTHING = 3
"""


def test_each_name_is_the_name_of_its_record() -> None:
    assert names()[:3] == ["detection", "labyrinth", "mapping"]
    for name in names():
        assert experiment(name).name == name
        assert parameters_model(name).defaults()


def test_an_experiment_in_a_file_is_run_by_reference(tmp_path: Path) -> None:
    (tmp_path / "dice.py").write_text(DICE)
    reference = f"{tmp_path}/dice.py:DICE"
    assert experiment(reference).name == "dice"
    assert parameters_model(reference).defaults().keys() == {"sides"}
    first, again = (run_trials([TrialSpec(reference, {"sides": 1000}, 7)])[0] for _ in range(2))
    assert first == again
    assert 0 <= int(first.tables["rolls"][0]["eyes"] or 0) < 1000


def test_options_that_make_no_sense_are_told_with_the_file(tmp_path: Path) -> None:
    (tmp_path / "dice.py").write_text(DICE.replace("ge=2", "ge='two'"))
    with pytest.raises(InputError, match=r"dice\.py:DICE: its parameters cannot be used: "):
        experiment(f"{tmp_path / 'dice.py'}:DICE")


def test_an_installed_package_offers_an_experiment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "dicepack.py").write_text(DICE)
    metadata = tmp_path / "dicepack-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: dicepack\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(
        "[midnet_bench.experiments]\ndice = dicepack:DICE\nwrong = dicepack:NOTHING\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    assert experiment("dice").summary == "Roll dice."
    assert "dice" in names()
    with pytest.raises(InputError, match="dicepack:NOTHING: expected an Experiment, got int"):
        experiment("wrong")


def test_an_unknown_name_gets_the_nearest() -> None:
    with pytest.raises(InputError, match="unknown name 'detektion'; did you mean 'detection'"):
        experiment("detektion")
