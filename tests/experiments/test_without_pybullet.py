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
sys.exit(main())
"""


@pytest.mark.slow
@pytest.mark.parametrize("command", ["detection", "labyrinth", "map map2", "render detection"])
def test_one_line_names_the_engine_to_take(command: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", BLOCKED, *command.split(), "-q", "-o", str(tmp_path / "out")],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert "--engine fast" in line
    assert not (tmp_path / "out" / "campaign.sqlite").exists()


@pytest.mark.parametrize("name", ["smoke-detection", "smoke-labyrinth"])
def test_smoke_needs_no_pybullet(name: str) -> None:
    assert (
        load_campaign(Path(__file__).parents[2] / "campaigns" / f"{name}.yaml").parameters["engine"] == "fast"
    )
