"""One trial of tossing coins. It imports little, because many workers of these tests begin with it."""

import ctypes
import gc
import os
import time
import weakref
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

from midnet_bench.campaign.trial import Row, TrialResult, TrialSpec
from midnet_bench.errors import InputError

HOARD: list[bytes] = []  # what a worker never gives back
RINGS: "list[weakref.ref[Ring]]" = []


class Ring:
    """What refers to itself, as objects of a user's detector may."""

    def __init__(self) -> None:
        self.itself = self


def leave_rings(specs: Sequence[TrialSpec]) -> list[TrialResult | Exception]:
    """Each trial leaves one, and counts those that earlier ones left."""
    gc.disable()
    left = sum(ring() is not None for ring in RINGS)
    RINGS.append(weakref.ref(Ring()))
    return [TrialResult({"trial": [{"left": left}]}, 0.0)]


def run_trials(specs: Sequence[TrialSpec]) -> list[TrialResult | Exception]:
    """Whoever has the same coins shares their tosses, which take the time."""
    time.sleep(max(float(spec.parameters["work_s"] or 0.0) for spec in specs))
    return [_counted(spec) for spec in specs]


def _counted(spec: TrialSpec) -> TrialResult | Exception:
    try:
        return run_trial(spec)
    except Exception as error:
        return error


def run_trial(spec: TrialSpec) -> TrialResult:
    parameters: dict[str, Any] = dict(spec.parameters)
    chance = Random(spec.seed)
    tosses = [chance.random() for _ in range(parameters["coins"])]
    heads = sum(toss < parameters["bias"] for toss in tosses)
    row: Row = {"heads": heads, "share": heads / len(tosses), "undefined": float("nan")}
    if parameters["noise_bytes"]:  # a result that does not compress below this size
        row["noise"] = chance.randbytes(parameters["noise_bytes"]).hex()
    tables: dict[str, list[Row]] = {
        "trial": [row],
        "tosses": [{"toss": k, "height_m": toss} for k, toss in enumerate(tosses)],
    }
    if parameters["table"] == "threads":
        tables["threads"] = [threads()]
    if spec.seed == parameters["trouble_seed"]:
        make_trouble(parameters["trouble"], Path(parameters["trouble_file"]), tables)
    return TrialResult(tables, simulated_s=float(len(tosses)))


def make_trouble(kind: str, file: Path, tables: dict[str, list[Row]]) -> None:
    if kind in ("first", "once"):
        try:
            file.mkdir()  # a file would count as an input of the campaign
        except FileExistsError:  # another process may make it at the same instant
            return
        if kind == "first":
            raise ValueError("the first time it goes wrong")
        os.kill(os.getpid(), 9)  # as the kernel does when memory runs out
    elif kind == "grow":
        HOARD.append(b"\1" * 400_000_000)  # written to, or it takes no memory
    elif kind == "desert":
        if os.fork() == 0:
            time.sleep(600.0)
        os.kill(os.getpid(), 9)
    elif kind == "die":
        os.kill(os.getpid(), 9)
    elif kind == "orphan":  # on a cluster its parent is the worker
        os.kill(os.getppid(), 9)
        time.sleep(60.0)
    elif kind == "print":
        print("heads or tails?")
        os.system("echo tails")  # past Python's sys.stdout
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
    elif kind == "native":
        sum(range(10**13))  # Python looks at no signal inside


def threads() -> Row:
    import cv2

    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS")
    return {**{name: int(os.environ[name]) for name in names}, "cv2": cv2.getNumThreads()}
