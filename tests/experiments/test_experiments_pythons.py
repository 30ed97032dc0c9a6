"""A campaign on ``fast``: the same bytes on another version of Python."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.campaign.campaign_process import REPOSITORY

VARIABLE = "MIDNET_BENCH_OTHER_PYTHON"
"""names an interpreter of another version that has the package's requirements, but for PyBullet"""
COMMAND = "detection --engine fast --robots 1,2 --frames 8 --seeds 2 --metric ospa --record --jobs 1 -q -o"
IMPORTS = "import cv2, jinja2, joblib, matplotlib, numba, pandas, pydantic, rich, scipy, tabulate, typer"


def run(python: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    env = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    return subprocess.run([python, "-W", "ignore", *arguments], env=env, capture_output=True, text=True)


def other_python() -> str:
    """One that can import what the campaign needs; the test is skipped where there is none."""
    others = [f"python3.{minor}" for minor in (11, 12, 13) if minor != sys.version_info.minor]
    reasons = []
    for name in [os.environ[VARIABLE]] if VARIABLE in os.environ else others:
        python = shutil.which(name)
        if python is None:
            reasons.append(f"no {name}")
            continue
        tried = run(python, "-c", IMPORTS)
        if not tried.returncode:
            return python
        why = [line for line in tried.stderr.splitlines() if "Error" in line or "not found" in line]
        reasons.append(f"{name}: {why[0] if why else 'does not run'}")
    pytest.skip(f"{'; '.join(reasons)} (set {VARIABLE})")


def tables(python: str, folder: Path) -> dict[str, bytes]:
    """The CSV files by name that a campaign writes, but for its wall times."""
    done = run(python, "-m", "midnet_bench", *COMMAND.split(), str(folder))
    assert not done.returncode, done.stderr
    return {path.name: path.read_bytes() for path in folder.glob("*.csv") if path.stem != "timing"}


@pytest.mark.slow
def test_another_python_gives_the_same_tables(tmp_path: Path) -> None:
    other = other_python()
    here, elsewhere = tables(sys.executable, tmp_path / "here"), tables(other, tmp_path / "elsewhere")
    assert {"scores.csv", "frames.csv", "metrics.csv", "errors.csv", "detection_summary.csv"} <= here.keys()
    assert [name for name in here | elsewhere if here.get(name) != elsewhere.get(name)] == []
