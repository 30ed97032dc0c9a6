"""The first stretch of a real log: the Intel Research Lab in Seattle."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from benchmarks.relations import read_dense_odometry, read_relations, relations_error
from midnet_bench.io.scan_logs import read_scan_log
from midnet_bench.io.trajectory import Trajectory
from midnet_bench.mapping.log_mapping import map_scans

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "intel"
pytestmark = pytest.mark.skipif(
    not (DATA / "intel_scans.txt.gz").exists(), reason="the Intel Research Lab log is not beside the checkout"
)
SCANS = 150


@pytest.mark.slow
def test_the_first_150_scans_are_mapped_as_well_as_by_gmapping(tmp_path: Path) -> None:
    """GMapping 0.036 m, raw odometry 3.2 m."""
    lines = gzip.decompress((DATA / "intel_scans.txt.gz").read_bytes()).decode().splitlines()
    path = tmp_path / "part.txt"
    path.write_text("\n".join(lines[: SCANS + 1]), encoding="utf-8")
    relations = read_relations(DATA / "intel.relations")
    odometry = read_dense_odometry(DATA / "intel_odom_dense.txt.gz")

    log = read_scan_log(path)
    raw = Trajectory(
        np.array([scan.stamp_s for scan in log]), np.array([scan.odometry for scan in log], dtype=np.float64)
    )
    by_wheels = relations_error(relations, raw, odometry)
    assert by_wheels.relations == 463
    assert by_wheels.mean_m == pytest.approx(3.2, abs=0.05)

    result = map_scans(log, particles=10, seed=0)
    mapped = relations_error(relations, result.trajectory, odometry)
    assert mapped.relations >= 455
    assert mapped.mean_m < 0.045
