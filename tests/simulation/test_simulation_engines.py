"""What an engine owes its users: the choice, the same bytes, and that ``fast`` needs nothing of PyBullet."""

import hashlib
import os
import subprocess
import sys
from importlib.util import find_spec

import numba
import pytest

from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.labyrinth.trial import run_labyrinth
from tests.simulation.scenes import WORLDS


def test_without_mujoco_one_line_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(
        InputError, match=r"engine: mujoco needs mujoco: pip install 'midnet-bench\[mujoco\]'"
    ):
        DetectionParameters.parse({"engine": "mujoco"}, "test")


ELSEWHERE = """
import sys
from tests.simulation.test_simulation_engines import digest
sys.modules["pybullet"] = None
print(digest("fast"))
try: digest("bullet")
except ImportError as error: print(error)
del sys.modules["pybullet"]
for engine in sys.argv[1:]: print(digest(engine))
"""


def digest(engine: str) -> str:
    values = {"robots": 3, "intruders": 3, "odometry": "encoder", "time_limit_s": 1.0}
    tables = run_labyrinth(LabyrinthParameters.of(engine=engine, **values), 4).tables
    return hashlib.sha256(repr(tables).encode()).hexdigest()


@pytest.mark.slow
def test_a_trial_has_the_same_bytes_in_any_process_with_any_threads_and_fast_needs_no_pybullet() -> None:
    others = [name for name in WORLDS if name != "fast" and (name != "mujoco" or find_spec("mujoco"))]
    threads = "1" if numba.config.NUMBA_NUM_THREADS > 1 else "2"
    environment = {**os.environ, "NUMBA_NUM_THREADS": threads, "PYTHONHASHSEED": threads}
    command = [sys.executable, "-W", "ignore", "-c", ELSEWHERE, *others]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    fast, told, *elsewhere = done.stdout.splitlines()
    assert "take 'fast'" in told
    assert [fast, *elsewhere] == [digest(engine) for engine in ("fast", *others)]
