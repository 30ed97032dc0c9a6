"""The engine ``mujoco``: its beams against those of ``fast``, how deep bodies get, what to do without it."""

import sys

import numpy as np
import pytest

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.layout import place
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.geometry import Command
from midnet_bench.simulation.engine import Beams
from tests.simulation.overlap import deepest_m
from tests.simulation.scenes import (
    NEEDS_MUJOCO,
    FastWorld,
    MujocoWorld,
    differing,
    fans,
    run,
    scene,
    small_arena,
)


@NEEDS_MUJOCO
@pytest.mark.parametrize(("arena", "seed"), [("map1", 11), ("map2", 14), ("office", 2)])
@pytest.mark.parametrize(("near_m", "far_m"), [(0.0, 0.5), (0.12, 3.5), (2.0, 20.0)])
def test_beams_end_where_those_of_fast_end(arena: str, seed: int, near_m: float, far_m: float) -> None:
    """Sensors stand anywhere, also inside of walls."""
    layout = place(load_arena(arena), seed, 3)
    beams = fans(np.random.default_rng(seed), layout, 24)
    with MujocoWorld(layout) as world, FastWorld(layout) as fast:
        ranges, expected = world.cast(beams, near_m, far_m), fast.cast(beams, near_m, far_m)
    assert len(differing(ranges, expected, 1e-3)) == 0
    assert np.isfinite(ranges).mean() > 0.02


@NEEDS_MUJOCO
def test_no_sensors_and_no_beams_give_empty_ranges() -> None:
    with MujocoWorld(scene([(0.0, 0.0, 0.0)])) as world:
        assert world.cast(Beams(np.empty((0, 2)), np.empty((0, 360, 2))), 0.12, 3.5).shape == (0, 360)
        assert world.cast(Beams(np.zeros((3, 2)), np.empty((3, 0, 2))), 0.12, 3.5).shape == (3, 0)


@NEEDS_MUJOCO
def test_in_a_jam_nobody_gets_as_far_into_another_as_in_pybullet() -> None:
    """Nine robots on a square metre; PyBullet has them 8 to 19 mm deep."""
    rng, places = np.random.default_rng(2), (-0.3, 0.0, 0.3)
    starts = [(x, y, rng.uniform(-3.0, 3.0)) for x in places for y in places]
    layout, deepest = scene(starts, arena=small_arena(1.0)), 0.0
    with MujocoWorld(layout) as world:
        for _ in range(10):
            for index in range(9):
                world.drive(index, Command(rng.uniform(-0.3, 0.3), rng.uniform(-3.0, 3.0)))
            for _ in range(10):
                run(world, 0.1)
                deepest = max(deepest, deepest_m(layout, world.poses()))
        assert (world.collisions() > 0).all()
        assert np.abs(world.poses()[:, :2]).max() < 0.5
    assert deepest < 8e-3


def test_without_mujoco_one_line_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(
        InputError, match=r"engine: mujoco needs mujoco: pip install 'midnet-bench\[mujoco\]'"
    ):
        DetectionParameters.parse({"engine": "mujoco"}, "test")
