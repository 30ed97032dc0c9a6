"""What an engine owes its users: the choice, the same bytes, and that ``fast`` needs nothing of PyBullet."""

import contextlib
import io
import os
import subprocess
import sys
from importlib.util import find_spec

import pytest

from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters
from tests.simulation.scenes import WORLDS


def test_without_mujoco_one_line_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(
        InputError, match=r"engine: mujoco needs mujoco: pip install 'midnet-bench\[mujoco\]'"
    ):
        DetectionParameters.parse({"engine": "mujoco"}, "test")


@pytest.mark.slow
def test_a_trial_on_fast_runs_where_pybullet_cannot_be_imported() -> None:
    program = (
        "import sys; sys.modules['pybullet'] = None\n"
        "import midnet_bench\n"
        "with midnet_bench.simulate(engine='fast', robots=1, frames=1) as frames:\n"
        "    print(sum(1 for _ in frames))\n"
        "try: midnet_bench.simulate(robots=1, frames=1)\n"
        "except ImportError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    frames, told = done.stdout.splitlines()
    assert frames == "1"
    assert "take 'fast'" in told


DIGEST = """
import hashlib
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.labyrinth.trial import run_labyrinth
for engine in {engines}:
    parameters = LabyrinthParameters.of(
        engine=engine, robots=3, intruders=3, odometry="encoder", time_limit_s=1
    )
    print(hashlib.sha256(repr(run_labyrinth(parameters, 4).tables).encode()).hexdigest())
"""


@pytest.mark.slow
def test_a_trial_gives_the_same_bytes_in_any_process_with_any_threads() -> None:
    engines = [name for name in WORLDS if name != "mujoco" or find_spec("mujoco")]
    code = DIGEST.format(engines=engines)
    environment = {**os.environ, "NUMBA_NUM_THREADS": "1", "PYTHONHASHSEED": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    with contextlib.redirect_stdout(io.StringIO()) as here:
        exec(code, {})
    assert [len(digest) for digest in done.stdout.split()] == [64] * len(engines)
    assert here.getvalue() == done.stdout
