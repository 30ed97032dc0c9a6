"""How much faster than real time ``replay`` is, from the file to the scores; start-up and memory apart.

    python -m benchmarks.replay_speed RECORDING --setup setup.yaml [--range M] [--preset real]

CPU seconds count. The first pass loads what was compiled and is left out; of the others the quickest
counts, since other work on the machine slows all of them.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from midnet_bench.recording.files.survey import survey
from midnet_bench.recording.inputs import opened
from midnet_bench.recording.setup import RecordingSetup
from midnet_bench.workflows.replay import replay

PASSES = 3


def start_up_s() -> float:
    """CPU seconds until the command line and all that a replay needs are there."""
    code = "import midnet_bench.workflows.replay, midnet_bench.cli.replay, midnet_bench.compiled"
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--setup", type=Path, required=True)
    parser.add_argument("--range", type=float, default=2.5)
    parser.add_argument("--preset", default="real", choices=["real", "paper"])
    given = parser.parse_args()
    with opened([given.recording]) as sources:
        duration_s = survey(sources[0]).duration_s
    with tempfile.TemporaryDirectory() as folder:
        setup = RecordingSetup.load(given.setup)
        values = {**setup.settings, "obstacle_range_m": given.range}
        setup = setup.changed({"preset": given.preset, "settings": values})
        spent = []
        for _ in range(PASSES + 1):
            began = time.process_time()
            replay([given.recording], setup, lambda line: None, lambda share: None, output=Path(folder))
            spent.append(time.process_time() - began)
    best_s = min(spent[1:])
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(f"start-up {start_up_s():.2f} s CPU")
    print(f"recording {duration_s:.1f} s, range {given.range:g} m, preset {given.preset}")
    print(f"from the file to the scores {best_s:.2f} s CPU: {duration_s / best_s:.0f} x real time")
    print(f"most memory {memory_mb:.0f} MB")


if __name__ == "__main__":
    main()
