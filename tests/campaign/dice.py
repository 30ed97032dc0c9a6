"""An experiment of a user's own, in one file: its trials tell how often their parameters were validated."""

from dataclasses import dataclass
from random import Random

from midnet_bench.campaign.trial import TrialResult
from midnet_bench.experiments.registry import Experiment, Trials
from midnet_bench.io.checked_yaml import Parameters
from midnet_bench.settings import option

validations = 0


@dataclass(frozen=True)
class DiceParameters(Parameters):
    """What a campaign file may set."""

    sides: int = option(6, "Sides of the die.", ge=2)
    colour: str = option("white", "Colour of the die.")

    def with_files_read(self) -> "DiceParameters":
        """The same; counted, because a full check alone calls it."""
        global validations
        validations += 1
        return self


def roll(parameters: DiceParameters, seed: int) -> TrialResult:
    """One row: the eyes, and the validations in this process since its last trial."""
    global validations
    since_the_last, validations = validations, 0
    eyes = Random(seed).randint(1, parameters.sides)
    return TrialResult({"rolls": [{"eyes": eyes, "validations": since_the_last}]}, simulated_s=1.0)


DICE = Experiment(name="dice", summary="Roll a die.", parameters=DiceParameters, trials=Trials(run=roll))
