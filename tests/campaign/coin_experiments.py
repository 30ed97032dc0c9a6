"""A tiny experiment that goes through the real engine: tossing coins, with ways to go wrong on demand."""

import ctypes
import os
import time
from pathlib import Path

from pydantic import Field

from midnet_bench.campaign.trial import Row, TrialResult, TrialSpec
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.io.checked_yaml import Spec
from midnet_bench.rng import stream


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


def run_trial(spec: TrialSpec) -> TrialResult:
    parameters = CoinParameters.model_validate(dict(spec.parameters))
    time.sleep(parameters.work_s)
    tosses = stream(spec.seed, "coins").random(parameters.coins)
    heads = int((tosses < parameters.bias).sum())
    row: Row = {"heads": heads, "share": heads / parameters.coins, "undefined": float("nan")}
    if parameters.noise_bytes:  # a result that does not compress below this size
        row["noise"] = stream(spec.seed, "noise").bytes(parameters.noise_bytes).hex()
    tables: dict[str, list[Row]] = {
        "trial": [row],
        "tosses": [{"toss": k, "height_m": float(toss)} for k, toss in enumerate(tosses)],
    }
    if parameters.table == "threads":
        tables["threads"] = [threads()]
    if spec.seed == parameters.trouble_seed:
        make_trouble(parameters.trouble, Path(parameters.trouble_file), tables)
    return TrialResult(tables, simulated_s=float(parameters.coins))


def make_trouble(kind: str, file: Path, tables: dict[str, list[Row]]) -> None:
    if kind in ("first", "once") and not file.exists():
        file.mkdir()  # a file would count as an input of the campaign
        if kind == "first":
            raise ValueError("the first time it goes wrong")
        os.kill(os.getpid(), 9)  # as the kernel does when memory runs out
    elif kind == "die":
        os.kill(os.getpid(), 9)
    elif kind == "segfault":
        ctypes.string_at(0)
    elif kind == "raise":
        raise ValueError("the coin stands on its edge")
    elif kind == "refuse":
        raise InputError("table: nothing stands on it")
    elif kind == "exit":
        raise SystemExit(3)
    elif kind == "odd":
        tables["trial"][0]["heads"] = 1j  # type: ignore[assignment]
    elif kind == "spin":
        while True:
            pass
    elif kind == "wait":
        while not file.exists():
            time.sleep(0.01)
    elif kind == "sleep":
        time.sleep(3600)


def threads() -> Row:
    import cv2

    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS")
    return {**{name: int(os.environ[name]) for name in names}, "cv2": cv2.getNumThreads()}
