"""An experiment of a user's own, in one file: its trials tell how often their parameters were validated."""

from random import Random

from pydantic import BaseModel, model_validator

from midnet_bench.campaign.trial import TrialResult
from midnet_bench.experiments.experiment import Experiment

validations = 0


class DiceParameters(BaseModel):
    """What a campaign file may set."""

    sides: int = 6
    colour: str = "white"

    @model_validator(mode="after")
    def _count(self) -> "DiceParameters":
        global validations
        validations += 1
        return self


def roll(parameters: DiceParameters, seed: int) -> TrialResult:
    """One row: the eyes, and the validations in this process since its last trial."""
    global validations
    since_the_last, validations = validations, 0
    eyes = Random(seed).randint(1, parameters.sides)
    return TrialResult({"rolls": [{"eyes": eyes, "validations": since_the_last}]}, simulated_s=1.0)


DICE = Experiment(name="dice", summary="Roll a die.", parameters=DiceParameters, run=roll)
