"""Mutated recordings: their bytes, their messages, tables and logs, and the setup that goes with them."""

import json
import random
import shutil
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from midnet_bench.recording.files.ros_messages import Message
from tests.fuzz import mutations, originals
from tests.fuzz.mutations import chance, pick, text_file
from tests.recording import recordings as made
from tests.recording.recordings import Drive, Said

Random = random.Random
DRIVE = Drive(seconds=1.5, lidar=made.lidar_of(24), pose_rate_hz=10.0)
CONTAINERS = ("mcap", "ros1", "ros1-bz2", "ros1-lz4", "ros2")
MOUNT = [0.1, 0.02, 2.86]
SETUP: dict[str, Any] = {
    "map": "map.yaml",
    "scan": "/scan",
    "pose": "/pose",
    "mount": MOUNT,
    "mirrored": False,
    "clock": "header",
    "delay_s": 0.01,
    "no_return": {"nan": "nothing", "zero": "clears"},
    "deskew": True,
    "rate_hz": 5.0,
    "max_pose_age_s": 0.5,
    "allies": {"other": {"topic": "/pose", "diameter_m": 0.3}},
    "truth": "truth.csv",
    "match_distance_m": 0.35,
    "sector_deg": [-90.0, 90.0],
    "window_m": 4.0,
    "preset": "both",
    "settings": {"thresh_local": 50, "detector": "clusters(incidence_deg=20)"},
    "unmapped": True,
}
WAYS: tuple[tuple[str, ...], ...] = (
    ("--map", "map.yaml", "--pose", "/pose"),
    ("--map", "/map", "--pose", "/pose", "--preset", "real"),
    ("--map", "map.yaml", "--pose", "tf", "--bag", "out/found.mcap"),
    (),
    ("--map", "map.yaml", "--pose", "/pose", "--steps", "3"),
    ("--map", "map.yaml", "--pose", "/pose", "--check"),
    ("--setup", "background.yaml", "--pose", "/pose"),
)


@cache
def messages() -> list[Said]:
    """Of a drive on a map, with poses of a topic and by tf."""
    every = [*made.scan_messages(DRIVE), *made.pose_messages(DRIVE), *made.tf_messages(DRIVE)]
    return [made.map_message(), *every]


def write_recordings(folder: Path) -> None:
    """A bag of each kind, tables, and what a replay needs besides."""
    folder.mkdir(parents=True)
    for container in CONTAINERS:
        made.write_bag(folder, messages(), container, container)
    made.write_scan_table(folder / "table.csv", DRIVE, with_poses=True)
    made.write_scan_table(folder / "scans.csv", DRIVE)
    made.write_tum(folder / "poses.tum", DRIVE.poses())
    made.write_pose_table(folder / "poses.csv", DRIVE.poses())
    labels = [(k, said.record_ns / made.NS, "red", 1.0, 1.0) for k, said in enumerate(messages()[1:7])]
    made.write_labels(folder / "truth.csv", labels)
    made.write_map(folder)
    (folder / "run.log").write_bytes(originals.scan_logs()["table"])
    (folder / "background.yaml").write_text("background: first-1\n")
    (folder / "mount.yaml").write_text(f"mount: {MOUNT}\n")


def bag(rng: Random | None, sources: Path, folder: Path) -> tuple[str, ...]:
    """A bag of any kind with its bytes mutated, or its metadata."""
    _beside(sources, folder)
    container = pick(rng, CONTAINERS)
    original = next(path for path in sources.iterdir() if path.stem == container)
    path = folder / original.name
    if original.is_dir():
        shutil.copytree(original, path)
    else:
        shutil.copy(original, path)
    if rng is not None:
        file = rng.choice(sorted(path.iterdir())) if path.is_dir() else path
        data = file.read_bytes()
        is_text = file.suffix == ".yaml"
        file.write_bytes(text_file(data, rng, True) if is_text else mutations.file_bytes(data, rng))
    return path.name, *pick(rng, WAYS)


def bag_messages(rng: Random | None, sources: Path, folder: Path) -> tuple[str, ...]:
    """A sound bag of messages that say what cannot be."""
    _beside(sources, folder)
    said, way = list(messages()), pick(rng, WAYS)
    if rng is not None:
        kinds = sorted({one.message.kind for one in said})
        for _ in range(rng.choice((1, 2, 5))):
            kind = rng.choice(kinds)  # as many maps as scans
            at = rng.choice([k for k, one in enumerate(said) if one.message.kind == kind])
            said[at] = said[at]._replace(message=Message(kind, _mutated(said[at].message.fields, rng)))
    written = [one for one in said if _can_be_written(one, folder)]
    return made.write_bag(folder, written, pick(rng, ("mcap", "ros1")), "said").name, *way


def table(rng: Random | None, sources: Path, folder: Path) -> tuple[str, ...]:
    """Tables of scans and poses and a log, mutated."""
    _beside(sources, folder)
    name = pick(rng, ("table.csv", "scans.csv", "run.log"))
    poses = pick(rng, ("poses.tum", "poses.csv"))
    shutil.copy(sources / name, folder)
    shutil.copy(sources / poses, folder)
    if rng is not None:
        path = folder / rng.choice((name, name, poses))
        path.write_bytes(text_file(path.read_bytes(), rng))
    mount = ("--setup", "mount.yaml", "--map", "map.yaml")
    ways = [(*mount, "--pose", "pose"), (*mount, "--pose", poses), ()]
    return name, *pick(rng, ways[1:] if name == "scans.csv" else ways)


def setup(rng: Random | None, sources: Path, folder: Path) -> tuple[str, ...]:
    """A ``setup.yaml``, or the labels that it names, mutated beside a sound bag."""
    _beside(sources, folder)
    shutil.copy(sources / "mcap.mcap", folder)
    text = json.dumps(SETUP).encode()
    if chance(rng, 0.8):
        text = text_file(text, rng, True)
    elif rng is not None:
        path = folder / "truth.csv"
        path.write_bytes(text_file(path.read_bytes(), rng))
    (folder / "setup.yaml").write_bytes(text)
    return "mcap.mcap", "--setup", "setup.yaml"


RECORDINGS = {"bag": bag, "bag's messages": bag_messages, "recorded table": table, "recording setup": setup}


def _beside(sources: Path, folder: Path) -> None:
    for name in ("map.yaml", "map.pgm", "truth.csv", "background.yaml", "mount.yaml"):
        shutil.copy(sources / name, folder)


def _mutated(fields: Any, rng: Random) -> Any:
    """A message's fields with one of them, at any depth, exchanged for what it should not be."""
    if isinstance(fields, Mapping):
        key = rng.choice(sorted(fields))
        return {**fields, key: _mutated(fields[key], rng)}
    if isinstance(fields, str):
        return rng.choice(mutations.TEXTS)
    if isinstance(fields, int | float):
        numbers = (0, -1, 1e300, float("nan"), float("inf"), fields * 2, fields + 86_400 * 10**9, 2**31)
        return type(fields)(number) if abs(number := rng.choice(numbers)) < 2**62 else float(number)
    if isinstance(fields, list):
        return [_mutated(one, rng) if rng.random() < 0.5 else one for one in fields]
    kind = rng.random()
    if kind < 0.3:
        return fields[: rng.randrange(len(fields) + 1)]
    changed = fields.copy()
    what = rng.choice((0, -1, 1e30, float("nan"), float("inf"))) if changed.dtype.kind == "f" else 127
    changed[rng.randrange(len(changed)) :] = what
    return changed


def _can_be_written(said: Said, folder: Path) -> bool:
    """Whether a message's fields have the types of ROS; not all that is mutated has."""
    try:
        path = made.write_bag(folder, [said], "ros1", "try")
    except Exception:  # whatever rosbags says of numbers that have no place in a message
        return False
    path.unlink()
    return True
