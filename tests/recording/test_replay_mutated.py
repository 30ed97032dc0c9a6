"""Bags and tables with bytes flipped, cut and doubled are read, or refused in one line; nothing escapes."""

import ast
import os
import random
import shutil
import subprocess
import sys
from collections import Counter

import pytest

from tests.cli.command import REPOSITORY, midnet_bench
from tests.fuzz import recordings


def try_all(cases, seed, folder):
    """Replay or list mutated recordings; how many were played, and refused."""
    recordings.write_recordings(folder / "sources")
    ends = Counter()
    for case in range(cases):
        rng, place = random.Random(f"{seed} {case}"), folder / "case"
        place.mkdir()
        mutate = (recordings.bag, recordings.bag, recordings.table)[case % 3]
        line = mutate(rng, folder / "sources", place)
        done = midnet_bench("replay", *line, "-o", "out", folder=place)
        errors = [text for text in done.stderr.splitlines() if text.startswith("error")]
        assert done.returncode in (0, 2), (case, line, done)
        assert len(errors) == (done.returncode == 2), (case, line, done)
        assert "Traceback" not in done.stderr, (case, line, done)
        ends["refused" if done.returncode else "played"] += 1
        shutil.rmtree(place)
    return ends


@pytest.mark.slow
def test_15_mutated_recordings(tmp_path):
    # in a process of its own: a segmentation fault is to end no other test
    code = (
        "import resource, sys, warnings; from pathlib import Path; warnings.simplefilter('error'); "
        "resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30)); "
        "from tests.recording.test_replay_mutated import try_all; "
        f"print(dict(try_all(15, 5, Path({str(tmp_path)!r}))))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=REPOSITORY,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        capture_output=True,
        text=True,
        timeout=1800,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    ends = ast.literal_eval(done.stdout.splitlines()[-1])
    assert min(ends["played"], ends["refused"]) > 3
