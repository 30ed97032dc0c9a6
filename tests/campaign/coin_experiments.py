"""A tiny experiment that goes through the real engine: tossing coins, with ways to go wrong on demand."""

from dataclasses import dataclass, replace
from typing import ClassVar

from midnet_bench.campaign.trial import Column, Columns, Sharing, Tables
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.io.checked_yaml import Parameters
from midnet_bench.settings import option
from tests.campaign.coin_trial import run_trial as run_trial
from tests.campaign.coin_trial import run_trials as run_trials


@dataclass(frozen=True)
class CoinParameters(Parameters):
    coins: int = option(3, "Coins tossed.", ge=1)
    bias: float = option(0.5, "Probability of heads.", ge=0, le=1)
    work_s: float = option(0.0, "How long a trial takes.", ge=0)
    noise_bytes: int = option(0, "Size of a result that does not compress.")
    table: str = option("wood", "What the coins fall on.")
    trouble: str = option("", "What goes wrong.")
    trouble_seed: int = option(-1, "Seed of the trial that goes wrong.")
    trouble_file: str = option("", "File that trouble needs.")


class Coins:
    """As an experiment of the registry."""

    parameters = CoinParameters
    columns: ClassVar[Tables] = {"tosses": Columns({"heads": Column(int), "noise_bytes": Column(int)})}

    def sharing(self, parameters: CoinParameters) -> Sharing:
        """Coins of any bias are tossed once; none is below 0 or above 1."""
        return Sharing(replace(parameters, bias=0.0, trouble=""), parameters)


def experiment(name: str) -> Coins:
    if name != "coins":
        raise InputError(f"experiment: unknown name '{name}'{nearest_name(name, ['coins'])}")
    return Coins()
