"""How well graph SLAM and GMapping map a recorded log whose relative poses people checked by hand.

Run ``python -m benchmarks.recorded_log SCANS ODOMETRY RELATIONS [SEED ...]``: the log as ``map --from-log``
takes it, the dense odometry (``stamp x y theta`` in driving order) and the relations (``stamp1 stamp2 x y z
roll pitch yaw``; Kuemmerle et al., 2009). Seeds 1, 2 and 3 unless given. The log is mapped as it is, and with
three slips of the wheels put into its odometry, 0.3 m and 0.25 rad each: places and directions are drawn
by the seed, which is GMapping's too. What is printed is ``docs/studies/data/recorded-log.csv``: a row for
each map, with the mean translational error over the relations. The project holds no such log.
"""

import math
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.relations import read_dense_odometry, read_relations, relations_error
from midnet_bench.geometry import Pose2D
from midnet_bench.io.scan_logs import ScanLog, Trajectory, read_scan_log
from midnet_bench.mapping.log_mapping import map_scans
from midnet_bench.mapping.mapping_settings import RECORDED_LOG

SLIPS, SLIP_M, SLIP_RAD = 3, 0.3, 0.25
FIRST_SLIP = 20  # scans of the log before a slip, and after it


def drawn_slips(scans: int, seed: int) -> list[tuple[int, Pose2D]]:
    """Before which scan (an index) the wheels slip, in driving order, and what the odometry gains there."""
    rng = np.random.default_rng(seed)
    places = np.sort(rng.choice(np.arange(FIRST_SLIP, scans - FIRST_SLIP), SLIPS, replace=False))
    slips = []
    for place in places:
        bearing, side = rng.uniform(-math.pi, math.pi), rng.choice([-1.0, 1.0])
        gained = Pose2D(SLIP_M * math.cos(bearing), SLIP_M * math.sin(bearing), side * SLIP_RAD)
        slips.append((int(place), gained))
    return slips


def with_slip(log: ScanLog, dense: Trajectory, place: int, slip: Pose2D) -> tuple[ScanLog, Trajectory]:
    """Log and dense odometry, moved rigidly from scan ``place`` on by a slip seen from the scan before."""
    before = log.scans[place - 1].odometry
    moved = before.compose(slip).compose(before.inverse())
    scans = [scan._replace(odometry=moved.compose(scan.odometry)) for scan in log.scans[place:]]
    first = int(np.argmin(np.abs(dense.stamps_s - log.scans[place].stamp_s)))
    poses = dense.poses.copy()
    for reading in range(first, len(dense)):
        poses[reading] = moved.compose(dense.pose(reading))
    return replace(log, scans=[*log.scans[:place], *scans]), Trajectory(dense.stamps_s, poses)


def main(scans: str, odometry: str, relations: str, *seeds: str) -> None:
    as_it_is, dense = read_scan_log(Path(scans)), read_dense_odometry(Path(odometry))
    checked = read_relations(Path(relations))
    methods = {"graph SLAM": None, "GMapping": RECORDED_LOG.particles}
    print("log,scans,relations,seed,slips,method,mean_error_m,cpu_s")
    for seed in map(int, seeds or ("1", "2", "3")):
        slipped = (as_it_is, dense)
        for place, slip in drawn_slips(len(as_it_is), seed):
            slipped = with_slip(*slipped, place, slip)
        for slips, (log, driven) in {0: (as_it_is, dense), SLIPS: slipped}.items():
            for name, particles in methods.items():
                begin = time.process_time()
                trajectory = map_scans(log, particles, seed).trajectory
                taken_s = time.process_time() - begin
                error_m = relations_error(checked, trajectory, driven).mean_m
                row = (Path(scans).name, len(log), len(checked), seed, slips, name, error_m, f"{taken_s:.1f}")
                print(*row, sep=",", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
