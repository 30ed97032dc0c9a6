"""Bags and tables with bytes flipped, cut and doubled are read, or refused in one line; nothing escapes."""

import ast
import os
import random
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from midnet_bench.errors import InputError
from midnet_bench.recording.inputs import list_topics
from tests.cli.command import REPOSITORY, midnet_bench
from tests.fuzz import mutations
from tests.recording import recordings as made
from tests.recording.recordings import Drive, replayed

DRIVE = Drive(seconds=1.5, lidar=made.lidar_of(24), pose_rate_hz=10.0)


def originals(folder):
    """A bag of each kind, small, so that a byte that is flipped is often one that counts."""
    messages = [*made.scan_messages(DRIVE), *made.pose_messages(DRIVE), *made.tf_messages(DRIVE)]
    return [
        made.write_bag(folder, messages, "ros1"),
        made.write_bag(folder, messages, "ros1-bz2", "small"),
        made.write_bag(folder, messages, "mcap"),
        made.write_bag(folder, messages, "ros2", "folder"),
        made.write_scan_table(folder / "table.csv", DRIVE, with_poses=True),
    ]


def mutated(original, folder, rng):
    """The recording again in another folder, mutated."""
    if original.is_dir():
        folder = folder / original.name
        folder.mkdir()
        for file in original.iterdir():
            (folder / file.name).write_bytes(file.read_bytes())
        file = rng.choice(sorted(folder.iterdir()))
        is_tree = file.suffix == ".yaml"
        data = file.read_bytes()
        file.write_bytes(
            mutations.text_file(data, rng, is_tree) if is_tree else mutations.file_bytes(data, rng)
        )
        return folder
    data = original.read_bytes()
    path = folder / original.name
    is_text = original.suffix == ".csv"
    path.write_bytes(mutations.text_file(data, rng) if is_text else mutations.file_bytes(data, rng))
    return path


def taken(path, case, seed, listing, folder, **keys):
    """Whether a recording was played or refused."""
    try:
        if listing:
            list_topics([path])
        else:
            replayed(path, folder, **keys)
    except InputError as error:
        if len(str(error).splitlines()) != 1:
            raise
        return "refused"
    except BaseException:
        print(f"case {case} of seed {seed}: {path}", file=sys.stderr)
        raise
    return "played"


def try_all(cases, seed, folder):
    """Replay and list mutated recordings; how many were played, and refused."""
    rng, ends = random.Random(seed), Counter()
    map_file = str(made.write_map(folder))
    every = originals(folder)
    for case in range(cases):
        place = folder / f"case{case}"
        place.mkdir()
        path = mutated(every[case % len(every)], place, rng)
        keys = {} if path.suffix == ".csv" else {"pose": rng.choice(["/pose", "tf"])}
        if rng.random() < 0.3:
            keys |= {"rate_hz": 20.0, "deskew": True}
        if rng.random() < 0.3:
            keys["clock"] = "record"
        for listing in (True, False):
            ends[taken(path, case, seed, listing, place, map=map_file, **keys)] += 1
        for file in sorted(place.rglob("*"), reverse=True):
            file.rmdir() if file.is_dir() else file.unlink()
        place.rmdir()
    return ends


@pytest.mark.slow
def test_200_mutated_recordings(tmp_path):
    # in a process of its own: a segmentation fault is to end no other test
    code = (
        "import resource, sys, warnings; from pathlib import Path; warnings.simplefilter('error'); "
        "resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30)); "
        "from tests.recording.test_replay_mutated import try_all; "
        f"print(dict(try_all(200, 1, Path({str(tmp_path)!r}))))"
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
    assert ends["played"] > 60
    assert ends["refused"] > 60


@pytest.mark.slow
def test_a_few_mutated_recordings_on_the_command_line(tmp_path):
    map_file, rng = made.write_map(tmp_path), random.Random(2)
    for case, original in enumerate(originals(tmp_path)):
        place = Path(tmp_path / f"case{case}")
        place.mkdir()
        path = mutated(original, place, rng)
        done = midnet_bench("replay", path, "--map", map_file, "-o", place / "out", folder=place)
        assert done.returncode in (0, 2)
        assert "Traceback" not in done.stderr
        assert sum(line.startswith("error") for line in done.stderr.splitlines()) == (done.returncode == 2)
