"""Chooses the last scale of the fit of ``replay --check``, on simulated drives whose mounts are known.

    python -m benchmarks.fit_scale

Runs the second rule of ``docs/studies/recordings-fit.md``, which has both; each was committed before its run.
The scale in the code is the one that the rules name among those that the study leaves them.

A drive is one robot's part of an exported detection trial: scans with the noise and the bias of the LiDAR's
data sheet, poses as the robot's own filter has them, intruders that are on no map, and a map that robots
explored. The mount that the fit is given is wrong, and so is the clock of the scans.
"""

import dataclasses
import math
import tempfile
from pathlib import Path

import numpy as np

from midnet_bench.geometry import Pose2D
from midnet_bench.recording.fitting.fit import Walls, samples_of
from midnet_bench.recording.fitting.setup_check import FULL_BEAMS
from midnet_bench.recording.fitting.setup_search import COARSE_M, MOUNT, Search
from midnet_bench.recording.inputs import prepared
from midnet_bench.recording.setup import RecordingSetup
from midnet_bench.rng import stream
from midnet_bench.workflows.export import export_trial

SCALES_M = (0.02, 0.03, 0.04, 0.06, 0.08)
TIE_M = 0.06  # the scale by which returns are called close
ARENAS, SEEDS, ROBOTS, FRAMES = ("map1", "map2"), (904, 905, 906), 4, 150
FARTHEST_M, LARGEST_TURN_RAD, LARGEST_DELAY_S = 0.15, math.radians(5.0), 0.02


def errors_m(arena: str, seed: int, folder: Path) -> list[list[float]]:
    """Of each robot of one trial: metres by which the mount that is found is off, by each scale."""
    bag = folder / f"{arena}-{seed}.mcap"
    trial = {"arena": arena, "robots": ROBOTS, "frames": FRAMES, "engine": "fast", "lidar_noise": "datasheet"}
    export_trial("detection", trial, seed, bag)
    rng = stream(seed, "fit_scale", arena)
    late_s = float(rng.uniform(-LARGEST_DELAY_S, LARGEST_DELAY_S))
    rows = []
    with prepared([bag], RecordingSetup().changed({"delay_s": late_s}), lambda line: None) as inputs:
        walls = Walls(inputs.prior_map)
        for robot in inputs.robots:
            away_m, way_rad = rng.uniform(0.0, FARTHEST_M), rng.uniform(0.0, math.tau)
            turned_rad = rng.uniform(-LARGEST_TURN_RAD, LARGEST_TURN_RAD)
            x, y, yaw = robot.mount
            wrong = Pose2D(x + away_m * math.cos(way_rad), y + away_m * math.sin(way_rad), yaw + turned_rad)
            samples = [
                one._replace(lidar=dataclasses.replace(one.lidar, mount=wrong))
                for one in samples_of(inputs.recorded, robot, inputs.setup)
            ]
            search = Search(samples, FULL_BEAMS, walls)
            found = [search.refined(search.as_set, MOUNT, (COARSE_M, scale_m)).mount for scale_m in SCALES_M]
            rows.append([mount.distance_to(robot.mount) for mount in found])
    return rows


def main() -> None:
    """Print each drive's errors, their medians and the scale that the rule picks."""
    print("mm off by scale", *(f"{scale_m:g} m" for scale_m in SCALES_M), sep=", ")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for arena in ARENAS:
            for seed in SEEDS:
                for row in errors_m(arena, seed, Path(folder)):
                    print(f"{arena} {seed}", *(f"{1000.0 * error_m:.1f}" for error_m in row), sep=", ")
                    rows.append(row)
    for arena, part in zip(ARENAS, np.split(np.array(rows), len(ARENAS)), strict=True):
        print(f"{arena}, median", *(f"{1000.0 * one:.1f}" for one in np.median(part, axis=0)), sep=", ")
    medians_mm = np.round(1000.0 * np.median(rows, axis=0))
    best = np.array(SCALES_M)[medians_mm == medians_mm.min()]
    picked = best[np.abs(best - TIE_M).argmin()]
    print("median of all", *medians_mm.astype(int), sep=", ")
    print(f"picked: {picked:g} m")


if __name__ == "__main__":
    main()
