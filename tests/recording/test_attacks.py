"""What a recording from elsewhere must not do: run code, take all memory, wait for ever, end in a trace."""

import ast
import bz2
import contextlib
import gc
import io
import math
import os
import random
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import lz4.frame
import pytest
import yaml

from midnet_bench.analysis.frames import load_results
from midnet_bench.experiments import registry
from midnet_bench.recording.files import bags
from midnet_bench.recording.files.bags import zstd
from midnet_bench.recording.files.writer import bag_writer
from tests.cli.command import REPOSITORY, Done, midnet_bench, one_line_of_complaint
from tests.fuzz import recordings as fuzzed
from tests.recording import recordings as made
from tests.recording.recordings import Drive, Said
from tests.stores import labyrinth_store

DRIVE = Drive(seconds=1.5, lidar=made.lidar_of(60))


def recording(folder: Path, *poses: Said, name: str = "bag") -> Path:
    """A drive on a map, with these poses or its own."""
    said = poses or made.pose_messages(DRIVE)
    return made.write_bag(folder, [made.map_message(), *made.scan_messages(DRIVE), *said], name=name)


def replayed(bag: Path, *arguments: object) -> Done:
    return midnet_bench("replay", bag, "--map", "/map", "-o", "out", *arguments, folder=bag.parent)


def check_taken_or_refused(done: Done) -> None:
    assert done.returncode in (0, 2), done.stderr
    assert "Traceback" not in done.stderr
    assert "Warning" not in done.stderr


LIMIT, BOMB = 2_000_000, 60_000_000


@pytest.fixture
def small_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """A chunk may hold 2 MB here; each bomb unpacks to thirty times as much."""
    monkeypatch.setattr(bags, "MOST_BYTES", LIMIT)
    monkeypatch.setattr(bags, "STEP_BYTES", LIMIT // 8)


def refused_in_little_memory(bag: Path) -> str:
    """The line of a listing, which holds no more than a few chunks at any time."""
    tracemalloc.start()
    try:
        line = one_line_of_complaint(midnet_bench("replay", bag, folder=bag.parent))
        assert tracemalloc.get_traced_memory()[1] < 10 * LIMIT
    finally:
        tracemalloc.stop()
    assert bag.name in line
    return line


def zeros_by(kind: str) -> bytes:
    """The bomb's zeros, packed; by bz2 in a stream for each megabyte."""
    if kind == "bz2":
        return bz2.compress(bytes(1_000_000)) * (BOMB // 1_000_000)
    return lz4.frame.compress(bytes(BOMB)) if kind == "lz4" else zstd.compress(bytes(BOMB))


def bomb(folder: Path, kind: str, says: int | None) -> Path:
    """A bag whose only chunk is a bomb; an MCAP file may say its size, or lie."""
    is_ros1 = kind.startswith("ros1")
    path = folder / ("b.bag" if is_ros1 else "b.mcap")
    with bag_writer(path, "ros1" if is_ros1 else "mcap") as writer:
        packer: Any = writer._writer if is_ros1 else writer._writer.storage  # type: ignore[union-attr]
        packing = kind.rpartition("-")[2]
        packer.compressor = lambda data: zeros_by(packing)
        setattr(packer, "compression_format" if is_ros1 else "compression", packing)
        for one in made.scan_messages(DRIVE):
            writer.write(one.topic, one.record_ns, one.message)
        if says is not None:
            packer.chunk.bio = _Lying(packer.chunk.bio, says)
    return path


class _Lying:
    """A buffer that is as long as it says."""

    def __init__(self, held: io.BytesIO, says: int) -> None:
        self._held, self._says = held, says

    def tell(self) -> int:
        return self._says

    def __getattr__(self, name: str) -> Any:
        return getattr(self._held, name)


@pytest.mark.parametrize(
    ("kind", "says"),
    [
        ("ros1-bz2", None),
        ("ros1-lz4", None),
        ("mcap-zstd", None),
        ("mcap-lz4", None),
        ("mcap-zstd", 9_600_000_000),
        ("mcap-lz4", 9_600_000_000),
    ],
)
def test_a_chunk_that_unpacks_to_far_too_much(
    kind: str, says: int | None, small_limit: None, tmp_path: Path
) -> None:
    is_ros1 = kind.startswith("ros1")
    bag = bomb(tmp_path, kind, says)
    assert "MB; record in smaller chunks" in refused_in_little_memory(bag)
    whole = bag.read_bytes()  # without its index nothing of it is unpacked
    cuts = [whole[: whole.rindex(b"chunk_pos=" if is_ros1 else b"\x0f\x04\x00") - 40 * is_ros1]]
    for data in cuts if is_ros1 else [*cuts, _without_summary(whole)]:
        bag.write_bytes(data)
        assert ("rosbag reindex" if is_ros1 else "mcap recover") in refused_in_little_memory(bag)


def _without_summary(data: bytes) -> bytes:
    """An MCAP file whose footer names no summary."""
    return data[: -8 - 20] + bytes(20) + data[-8:]


def ros2_folder(folder: Path, **metadata: object) -> Path:
    """The folder of a ROS 2 bag with keys of its metadata changed."""
    bag = made.write_bag(folder, made.scan_messages(DRIVE), "ros2")
    file = bag / "metadata.yaml"
    said = yaml.safe_load(file.read_text())
    said["rosbag2_bagfile_information"] |= metadata
    file.write_text(yaml.safe_dump(said))
    return bag


def test_a_file_that_is_packed_as_a_whole(small_limit: None, tmp_path: Path) -> None:
    bag = ros2_folder(
        tmp_path, compression_format="zstd", compression_mode="FILE", relative_file_paths=["bag.db3.zstd"]
    )
    (database,) = bag.glob("*.db3")
    packed = bag / "bag.db3.zstd"
    packed.write_bytes(zstd.compress(database.read_bytes()))
    listed = midnet_bench("replay", bag, folder=tmp_path)
    assert listed.returncode == 0, listed.stderr
    assert "/scan" in listed.stdout
    packed.write_bytes(zeros_by("zstd"))
    assert "bag.db3.zstd: unpacks to more than" in refused_in_little_memory(bag)
    packed.write_bytes(zstd.compress(database.read_bytes())[:-100])
    assert "bag.db3.zstd: damaged" in one_line_of_complaint(midnet_bench("replay", bag, folder=tmp_path))


def test_messages_that_are_packed_one_by_one(small_limit: None, tmp_path: Path) -> None:
    bag = ros2_folder(tmp_path, compression_format="zstd", compression_mode="MESSAGE")
    (database,) = bag.glob("*.db3")
    with contextlib.closing(sqlite3.connect(database)) as file, file:
        for row, data in file.execute("select id, data from messages").fetchall():
            file.execute("update messages set data = ? where id = ?", (zstd.compress(data), row))
    listed = midnet_bench("replay", bag, folder=tmp_path)
    assert listed.returncode == 0, listed.stderr
    assert "60 beams" in listed.stdout
    with contextlib.closing(sqlite3.connect(database)) as file, file:
        file.execute("update messages set data = ?", (zeros_by("zstd"),))
    assert "MB; record in smaller chunks" in refused_in_little_memory(bag)


@contextlib.contextmanager
def soon() -> Iterator[None]:
    """Fails what lasts longer than 20 s, a wait for ever included."""

    def fail(*_: object) -> None:
        raise TimeoutError("it waits for ever")

    before = signal.signal(signal.SIGALRM, fail)
    signal.alarm(20)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def opened_by(path: Path, kind: str) -> None:
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        with contextlib.chdir(path.parent), socket.socket(socket.AF_UNIX) as opened:
            opened.bind(path.name)


@pytest.mark.parametrize("kind", ["pipe", "device", "socket"])
@pytest.mark.parametrize("name", ["b.bag", "b.mcap", "b.db3", "b.csv", "b.log"])
def test_a_bag_that_may_never_end(name: str, kind: str, tmp_path: Path) -> None:
    opened_by(tmp_path / name, kind)
    for given in ((), ("--map", "/map")):
        with soon():
            done = midnet_bench("replay", name, *given, folder=tmp_path)
        assert name in one_line_of_complaint(done)


@pytest.mark.parametrize("kind", ["pipe", "device", "socket"])
@pytest.mark.parametrize("named", ["more.db3", "more.db3.zstd", "metadata.yaml"])
def test_a_folder_that_names_what_may_never_end(named: str, kind: str, tmp_path: Path) -> None:
    mode = {"compression_format": "zstd", "compression_mode": "FILE"} if named.endswith("zstd") else {}
    bag = ros2_folder(tmp_path, relative_file_paths=["bag.db3", named], **mode)
    (bag / named).unlink(missing_ok=True)
    opened_by(bag / named, kind)
    with soon():
        done = midnet_bench("replay", bag, folder=tmp_path)
    assert named in one_line_of_complaint(done)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("given", "far_m"), [("background: first-1", 9e6), ("map: /map", 9e6), ("map: /map", -1e300)]
)
def test_poses_that_lie_beyond_all(given: str, far_m: float, tmp_path: Path) -> None:
    poses = made.pose_messages(DRIVE)
    for number in (0, 3, 7, 8):
        pose = poses[number].message.fields["pose"]
        moved = {**pose, "position": {**pose["position"], "x": far_m}}
        poses[number] = made.edited(poses[number], pose=moved)
    bag = recording(tmp_path, *poses)
    setup = tmp_path / "setup.yaml"
    setup.write_text(f"{given}\npose: /pose\nmount: [0.1, 0.02, 2.86]\n")
    for check in ((), ("--check",)):
        with soon():
            done = midnet_bench("replay", bag, "--setup", setup, "-o", "out", *check, folder=tmp_path)
        check_taken_or_refused(done)
        assert sum(line.startswith("error") for line in done.stderr.splitlines()) == (done.returncode == 2)


@pytest.mark.parametrize("far_m", [200.0, 1e7])
def test_a_laser_that_sits_far_off_its_robot(far_m: float, tmp_path: Path) -> None:
    bag = recording(tmp_path)
    (tmp_path / "setup.yaml").write_text(f"map: /map\npose: /pose\nmount: [{far_m}, 0, 0]\n")
    for check in ((), ("--check",)):
        done = midnet_bench("replay", bag, "--setup", "setup.yaml", *check, folder=tmp_path)
        assert "mount: robot 'robot'" in one_line_of_complaint(done)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("part", "number"),
    [("translation", 1e300), ("rotation", math.nan)],
)
@pytest.mark.parametrize("link", [("base_link", "laser"), ("odom", "base_link"), ("map", "odom")])
def test_transforms_that_are_none(link: tuple[str, str], part: str, number: float, tmp_path: Path) -> None:
    found = made.tf_messages(DRIVE)
    for at, said in enumerate(found):
        (one,) = said.message.fields["transforms"]
        if (one["header"]["frame_id"], one["child_frame_id"]) == link and (at == 0 or at % 5):
            keys = ("x", "y", "z", "w") if part == "rotation" else ("x", "y")
            one = {**one, "transform": {**one["transform"], part: dict.fromkeys(keys, number)}}
            found[at] = made.edited(said, transforms=[one])
    bag = recording(tmp_path, *found)
    for arguments in ((), ("--map", "/map", "--pose", "tf")):
        done = midnet_bench("replay", bag, *arguments, "-o", "out", folder=tmp_path)
        check_taken_or_refused(done)


@pytest.mark.slow
def test_names_with_control_characters_are_escaped(tmp_path: Path) -> None:
    name = "/a\x1b]0;taken\x07\x1b[2J\x1b[H\r\u202egab\nf"
    scans = made.scan_messages(DRIVE, topic=name, frame=f"laser{name}")
    more = made.scan_messages(DRIVE, topic=f"{name}2")
    messages = [made.map_message(), *scans, *more, *made.pose_messages(DRIVE, topic=f"{name}/pose")]
    bag = made.write_bag(tmp_path, messages, name=f"b{name[2:]}")
    for arguments in ((), ("--wide",), ("--json",), ("--map", "/map")):
        done = midnet_bench("replay", bag, *arguments, folder=tmp_path)
        assert done.returncode in (0, 2), done.stderr
        for line in (done.stdout + done.stderr).split("\n"):
            assert line.isprintable() or line == "", repr(line)


def left_by_a_kill(code: str, folder: Path, pattern: str) -> list[Path]:
    """What lies about after a process that runs ``code`` was killed, once it says that it is in the midst."""
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY), "TMPDIR": str(folder)}
    command = [sys.executable, "-c", f"{code}\nprint('now', flush=True)\nimport time; time.sleep(600)"]
    with subprocess.Popen(command, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        assert running.stdout.readline() == "now\n"
        running.kill()
    return list(folder.glob(pattern))


KILLED = """
from pathlib import Path
from midnet_bench.analysis.frames import load_results
from midnet_bench.experiments import registry
from midnet_bench.recording.files.writer import bag_writer
held = [bag_writer(Path(name), name) for name in ("mcap", "ros2")]
opened = [one.__enter__() for one in held]
results = load_results("results", registry.tables_of)
"""
"""exports into a file and into a folder, and a reader of results"""


@pytest.mark.slow
def test_what_a_killed_process_left_is_gone_after_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "results").mkdir()
    labyrinth_store(tmp_path / "results" / "campaign.sqlite", lambda k, q, seed: 1, seeds=1).close()
    left = left_by_a_kill(KILLED, tmp_path, ".*")
    assert len(left) == 3
    for one in left:
        os.utime(one, (time.time() - 10, time.time() - 10))
    for bag_format in ("mcap", "ros2"):
        (draft,) = tmp_path.glob(f".{bag_format}.*.new")
        with bag_writer(tmp_path / bag_format, bag_format):
            assert not draft.exists()
    (copy,) = tmp_path.glob(".*")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    held = load_results(tmp_path / "results", registry.tables_of)
    assert not copy.exists()
    assert len(list(tmp_path.glob(".*"))) == 1
    del held
    gc.collect()
    assert {path.name for path in tmp_path.iterdir()} == {"mcap", "ros2", "results"}


@pytest.mark.slow
@pytest.mark.parametrize("heading", ["inf", "1e308"])
def test_a_table_whose_poses_turn_without_end(heading: str, tmp_path: Path) -> None:
    table = made.write_scan_table(tmp_path / "t.csv", DRIVE, with_poses=True)
    head, first, *lines = table.read_text().splitlines()
    cells = first.split(",")
    cells[head.split(",").index("yaw")] = heading
    table.write_text("\n".join([head, ",".join(cells), *lines]))
    map_file = made.write_map(tmp_path)
    for arguments in ((), ("--map", map_file, "--pose", "pose", "-o", "out")):
        done = midnet_bench("replay", table, *arguments, folder=tmp_path)
        check_taken_or_refused(done)


def try_all(cases: int, seed: int, folder: Path) -> Counter[str]:
    """Replay or list mutated recordings; how many were played, and refused."""
    fuzzed.write_recordings(folder / "sources")
    ends = Counter[str]()
    for case in range(cases):
        rng, place = random.Random(f"{seed} {case}"), folder / "case"
        place.mkdir()
        mutate = (fuzzed.bag, fuzzed.bag, fuzzed.table)[case % 3]
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
def test_9_mutated_recordings(tmp_path: Path) -> None:
    # in a process of its own: a segmentation fault is to end no other test
    code = (
        "import resource, sys, warnings; from pathlib import Path; warnings.simplefilter('error'); "
        "resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30)); "
        "from tests.recording.test_attacks import try_all; "
        f"print(dict(try_all(9, 5, Path({str(tmp_path)!r}))))"
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
    assert min(ends["played"], ends["refused"]) > 1
