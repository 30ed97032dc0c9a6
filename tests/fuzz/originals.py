"""Valid inputs of every reader, which the fuzzer mutates."""

import io
import math
import shutil
import sys
from functools import cache
from pathlib import Path

import numpy as np
import yaml
from PIL import Image

from midnet_bench.geometry import Pose2D
from midnet_bench.io.scan_logs import half_circle
from midnet_bench.workflows.report import write_report
from tests.cli.command import MAP_KEYS
from tests.mapping.gmapping_room import ROOM, ROUND_TRIP, Drive, drive
from tests.stores import detection_store, labyrinth_store

REPOSITORY = Path(__file__).parents[2]
BEAMS = 45

ARENA = {
    "name": "two small rooms",
    "plane_m": [5.0, 4.0],
    "enclosure_m": [4.0, 3.0],
    "wall_thickness_m": 0.15,
    "wall_height_m": 0.5,
    "walls": [[[-2, -1.5], [2, -1.5], [2, 1.5], [-2, 1.5], [-2, -1.5]], [[0.8, -1.5], [0.8, 0.3]]],
    "robots": {"center_m": [-0.6, 0], "spacing_m": 0.6},
}
EXPERIMENT = b"""
from dataclasses import dataclass
from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.trial import TrialResult
from midnet_bench.experiments.registry import Experiment, Report, Trials
from midnet_bench.io.checked_yaml import Parameters
from midnet_bench.settings import option

@dataclass(frozen=True)
class Walk(Parameters):
    steps: int = option(10, "Steps of the walk.", ge=1)
    bias_m: float = option(0.5, "Mean length of a step.", ge=0)

def walk(parameters, seed):
    return TrialResult({"walks": [{"drift_m": parameters.bias_m}]}, simulated_s=1.0)

def tables(results):
    return [Table("drift", "Drift", [{"drift_m": 1.0}])]

WALK = Experiment(name="walk", summary="A walk.", parameters=Walk, trials=Trials(run=walk),
                  report=Report(tables=tables))
"""
WALKING = b"experiment: walk.py:WALK\ngrid: {steps: [10, 20]}\ntrials: 3\n"


@cache
def campaigns() -> dict[str, bytes]:
    """Name -> text of the campaign files that come with the package."""
    return {path.stem: path.read_bytes() for path in sorted((REPOSITORY / "campaigns").glob("*.yaml"))}


@cache
def arenas() -> list[bytes]:
    """Texts of arenas: those of the package, and one of two small rooms."""
    packaged = sorted((REPOSITORY / "midnet_bench" / "arena" / "arenas").glob("*.yaml"))
    return [yaml.safe_dump(ARENA).encode(), *(path.read_bytes() for path in packaged)]


@cache
def images() -> dict[str, bytes]:
    """Map images by file name, each of 160 x 160 pixels: walls round a free square."""
    pixels = np.full((160, 160), 254, np.uint8)
    pixels[:3] = pixels[-3:] = pixels[:, :3] = pixels[:, -3:] = 0
    grey = Image.fromarray(pixels)
    kinds = {"map.pgm": (grey, "PPM"), "grey.png": (grey, "PNG"), "palette.png": (grey.convert("P"), "PNG")}
    kinds["colour.png"] = (grey.convert("RGBA"), "PNG")
    made = {"plain.pgm": b"P2\n160 160\n255\n" + b" ".join(str(value).encode() for value in pixels.flat)}
    for name, (image, kind) in kinds.items():
        file = io.BytesIO()
        image.save(file, kind)
        made[name] = file.getvalue()
    return made


def map_yaml(image: str) -> bytes:
    """The YAML file of a map whose image has that name."""
    return yaml.safe_dump({**MAP_KEYS, "image": image}).encode()


@cache
def driven() -> Drive:
    """Where a robot went in a room and what it saw, every second."""
    journey = drive(ROOM, half_circle(BEAMS), Pose2D(1.0, 1.0, 0.0), ROUND_TRIP[:2], np.random.default_rng(5))
    return Drive(*(part[::5] for part in journey))


@cache
def scan_logs() -> dict[str, bytes]:
    """Recorded logs by their kind."""
    logs: dict[str, list[str]] = {
        "table": ["# stamp x y theta n ranges"],
        "flaser": [],
        "raw": [],
        "robot": [],
    }
    journey = driven()
    head = f"0 {-math.pi / 2} {math.pi} {math.pi / BEAMS} 81.9 0.01 0 {BEAMS}"
    for stamp, (x, y, yaw), ranges_m in zip(
        journey.stamps_s, journey.odometry, journey.ranges_m, strict=True
    ):
        ranges = " ".join(f"{one:.2f}" for one in ranges_m)
        place, end = f"{x:.3f} {y:.3f} {yaw:.4f}", f"{stamp:.2f} host {stamp:.2f}"
        logs["table"].append(f"{stamp:.2f} {place} {BEAMS} {ranges}")
        logs["flaser"].append(f"FLASER {BEAMS} {ranges} {place} {place} {end}")
        logs["raw"] += [f"ODOM {place} 0 0 0 {end}", f"RAWLASER1 {head} {ranges} 0 {end}"]
        logs["robot"].append(f"ROBOTLASER1 {head} {ranges} 0 {place} {place} 0 0 0 0 0 {end}")
    return {name: "\n".join(lines).encode() + b"\n" for name, lines in logs.items()}


@cache
def relations() -> dict[str, bytes]:
    """A dense odometry and hand-checked relations, as ``benchmarks.recorded_log`` takes them."""
    journey = driven()
    dense = [
        f"{stamp} {x} {y} {yaw}"
        for stamp, (x, y, yaw) in zip(journey.stamps_s, journey.odometry, strict=True)
    ]
    checked = [f"{one} {one + 2} 0.2 0 0 0 0 0.1" for one in journey.stamps_s[:-3]]
    return {"odometry": "\n".join(dense).encode(), "relations": "\n".join(checked).encode()}


def write_campaigns(folder: Path) -> None:
    """Below ``folder``: two campaigns as stores, and what ``report`` makes of each without its store."""
    grid = {"intruders": [1, 2], "robots": [1, 2]}
    labyrinth_store(
        _made(folder / "labyrinth") / "campaign.sqlite",
        lambda k, robots, seed: min(k, robots),
        seeds=2,
        grid=grid,
    ).close()
    scores = {robots: {seed: (0.9, 0.6 + 0.02 * seed, 0.7) for seed in (1, 2, 3)} for robots in (1, 5)}
    detection_store(folder / "detection", scores)
    for name in ("labyrinth", "detection"):
        tables = folder / f"{name}-tables"
        shutil.copytree(folder / name, tables)
        write_report(tables, drawn_from=sys.maxsize)
        (tables / "campaign.sqlite").unlink()
        for path in (*tables.glob("*.md"), *tables.glob("*.tex")):
            path.unlink()


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True)
    return folder
