"""A tiny experiment that goes through the real engine: tossing coins, with ways to go wrong on demand."""

import os
import time
from pathlib import Path

from pydantic import Field

from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments.trial import TrialResult, TrialSpec
from midnet_bench.rng import stream
from midnet_bench.spec import Spec


class CoinParameters(Spec):
    coins: int = Field(3, ge=1)
    bias: float = Field(0.5, ge=0, le=1)
    work_s: float = Field(0.0, ge=0)
    table: str = "wood"
    trouble: str = ""
    trouble_seed: int = -1
    trouble_file: str = ""


def parameters_model(experiment: str) -> type[CoinParameters]:
    if experiment != "coins":
        raise InputError(f"experiment: unknown name '{experiment}'{nearest_name(experiment, ['coins'])}")
    return CoinParameters


def run_trial(spec: TrialSpec) -> TrialResult:
    parameters = CoinParameters.model_validate(dict(spec.parameters))
    time.sleep(parameters.work_s)
    if spec.seed == parameters.trouble_seed:
        cause_trouble(parameters.trouble, parameters.trouble_file)
    tosses = stream(spec.seed, "coins").random(parameters.coins)
    heads = int((tosses < parameters.bias).sum())
    return TrialResult(
        tables={
            "trial": [{"heads": heads, "share": heads / parameters.coins, "undefined": float("nan")}],
            "tosses": [{"toss": k, "height_m": float(toss)} for k, toss in enumerate(tosses)],
        },
        simulated_s=float(parameters.coins),
    )


def cause_trouble(kind: str, file: str) -> None:
    if kind == "once":  # the worker that comes first dies, as if the kernel had killed it
        try:
            Path(file).touch(exist_ok=False)
        except FileExistsError:
            return
        os.kill(os.getpid(), 9)
    elif kind == "die":
        os.kill(os.getpid(), 9)
    elif kind == "segfault":
        import ctypes

        ctypes.string_at(0)
    elif kind == "raise":
        raise ValueError("the coin stands on its edge")
    elif kind == "exit":
        raise SystemExit(3)
    elif kind == "spin":
        while True:
            pass
    elif kind == "sleep":
        time.sleep(3600)
