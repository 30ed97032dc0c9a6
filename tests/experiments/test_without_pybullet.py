"""Without PyBullet each command names the engine to take before its first trial, and smoke runs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from midnet_bench.workflows.campaigns import load_campaign

BLOCKED = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("pybullet", "pybullet_data"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Blocked())
import importlib.util
plain = importlib.util.find_spec
importlib.util.find_spec = lambda name, package=None: None if name == "pybullet" else plain(name, package)
from midnet_bench.cli import main
for command in ("detection", "labyrinth", "map map2", "render detection"):
    sys.argv = ["midnet-bench", *command.split(), "-q", "-o", sys.argv[-1]]
    try:
        main()
    except SystemExit as end:
        print(end.code)
"""


@pytest.mark.slow
def test_one_line_names_the_engine_to_take(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", BLOCKED, str(tmp_path / "out")],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
    )
    assert done.stdout.split() == ["2"] * 4, done.stderr
    lines = done.stderr.splitlines()
    assert ["--engine fast" in line for line in lines] == [True] * 4
    assert not (tmp_path / "out" / "campaign.sqlite").exists()


@pytest.mark.parametrize("name", ["smoke-detection", "smoke-labyrinth"])
def test_smoke_needs_no_pybullet(name: str) -> None:
    assert (
        load_campaign(Path(__file__).parents[2] / "campaigns" / f"{name}.yaml").parameters["engine"] == "fast"
    )
