"""A tiny experiment that goes through the real engine: tossing coins, with ways to go wrong on demand."""

from pydantic import Field

from midnet_bench.errors import InputError, nearest_name
from midnet_bench.io.checked_yaml import Spec
from tests.campaign.coin_trial import run_trial as run_trial


class CoinParameters(Spec):
    coins: int = Field(3, ge=1)
    bias: float = Field(0.5, ge=0, le=1)
    work_s: float = Field(0.0, ge=0)
    noise_bytes: int = 0
    table: str = "wood"
    trouble: str = ""
    trouble_seed: int = -1
    trouble_file: str = ""


def parameters_model(experiment: str) -> type[CoinParameters]:
    if experiment != "coins":
        raise InputError(f"experiment: unknown name '{experiment}'{nearest_name(experiment, ['coins'])}")
    return CoinParameters
