"""Without PyBullet each command names the engine to take before its first trial, and smoke runs."""

import importlib.util
import sys
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest

from midnet_bench.workflows.campaigns import load_campaign
from tests.cli.command import midnet_bench


@pytest.mark.parametrize("command", ["detection", "labyrinth", "map map2", "render detection"])
def test_one_line_names_the_engine_to_take(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    find = importlib.util.find_spec

    def missing(name: str, package: str | None = None) -> ModuleSpec | None:
        return None if name == "pybullet" else find(name, package)

    monkeypatch.setitem(sys.modules, "pybullet", None)
    monkeypatch.delitem(sys.modules, "midnet_bench.simulation.bullet_engine", raising=False)
    monkeypatch.setattr(importlib.util, "find_spec", missing)
    done = midnet_bench(*command.split(), "-q", "-o", "out", folder=tmp_path)
    assert done.returncode == 2
    assert ["--engine fast" in line for line in done.stderr.splitlines()] == [True]
    assert not (tmp_path / "out" / "campaign.sqlite").exists()


@pytest.mark.parametrize("name", ["smoke-detection", "smoke-labyrinth"])
def test_smoke_needs_no_pybullet(name: str) -> None:
    file = Path(__file__).parents[2] / "campaigns" / f"{name}.yaml"
    assert load_campaign(file).parameters["engine"] == "fast"
