"""How well GMapping maps a recorded log whose relative poses people checked by hand.

Run ``python -m benchmarks.recorded_log SCANS ODOMETRY RELATIONS [SEED ...]``: the log as ``map --from-log``
takes it, the dense odometry (``stamp x y theta`` in driving order) and the relations (``stamp1 stamp2 x y z
roll pitch yaw``; Kuemmerle et al., 2009). Seeds 1, 2 and 3 unless given. The project holds no such data.
"""

import sys
import time
from pathlib import Path

from benchmarks.relations import read_dense_odometry, read_relations, relations_error
from midnet_bench.io.scan_logs import read_scan_log
from midnet_bench.mapping.gmapping.settings import RECORDED_LOG
from midnet_bench.mapping.log_mapping import map_scans


def main(scans: str, odometry: str, relations: str, *seeds: str) -> None:
    dense, checked = read_dense_odometry(Path(odometry)), read_relations(Path(relations))
    print(f"{scans}, {RECORDED_LOG.particles} particles, {len(checked)} relations")
    for seed in map(int, seeds or ("1", "2", "3")):
        begin = time.perf_counter()
        result = map_scans(read_scan_log(Path(scans)), seed=seed)
        taken_s = time.perf_counter() - begin
        error = relations_error(checked, result.trajectory, dense)
        print(f"  seed {seed}: mean translational error {error.mean_m:.3f} m, {taken_s:.0f} s", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
