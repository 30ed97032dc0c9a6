"""What an engine owes its users: the choice, the same bytes, and that ``fast`` needs nothing of PyBullet."""

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
        "with midnet_bench.simulate(engine='fast', robots=2, frames=3) as frames:\n"
        "    print(sum(1 for _ in frames))\n"
        "try: midnet_bench.simulate(robots=2, frames=3)\n"
        "except ImportError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    frames, told = done.stdout.splitlines()
    assert frames == "3"
    assert "take 'fast'" in told


DIGEST = """
import hashlib, sys
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.labyrinth.trial import run_labyrinth
for engine in sys.argv[1:]:
    parameters = LabyrinthParameters.of(
        engine=engine, robots=3, intruders=3, odometry="encoder", time_limit_s=3
    )
    print(hashlib.sha256(repr(run_labyrinth(parameters, 4).tables).encode()).hexdigest())
"""


@pytest.mark.slow
def test_a_trial_gives_the_same_bytes_in_any_process_with_any_threads() -> None:
    engines = [name for name in WORLDS if name != "mujoco" or find_spec("mujoco")]
    said = []
    for threads in ("1", "2"):
        environment = {**os.environ, "NUMBA_NUM_THREADS": threads, "PYTHONHASHSEED": threads}
        command = [sys.executable, "-c", DIGEST, *engines]
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
        said.append(done.stdout.split())
    assert said[0] == said[1]
    assert [len(digest) for digest in said[0]] == [64] * len(engines)
