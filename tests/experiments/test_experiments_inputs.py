"""What a trial's parameters take in from files, and what they refuse, before any trial runs."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from midnet_bench.arena.arena import arena_names, load_arena
from midnet_bench.arena.layout import robot_starts
from midnet_bench.arena.prior_maps import render_exact
from midnet_bench.campaign.trial import TrialSpec, encode_tables
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.guarded.inputs import _as_text, prior_map_from
from midnet_bench.experiments.registry import run_trials
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.map_server import save_map
from midnet_bench.mapping.map_score import score_map
from midnet_bench.robots.turtlebot3 import BURGER


def free_map(path: Path, side_m: float, center: tuple[float, float] = (0.0, 0.0)) -> Path:
    cells = round(side_m / 0.05)
    origin = (center[0] - side_m / 2.0, center[1] - side_m / 2.0)
    save_map(OccupancyGrid(np.zeros((cells, cells), np.int8), 0.05, origin), path)
    return path


def refused(values: dict[str, Any], source: str = "f.yaml: parameters") -> str:
    with pytest.raises(InputError) as caught:
        DetectionParameters.parse(values, source)
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize("side_m", [5.8, 30.0])
def test_a_map_that_reaches_the_walls_or_beyond_is_taken(tmp_path: Path, side_m: float) -> None:
    path = free_map(tmp_path / "map.yaml", side_m)
    assert DetectionParameters.of(prior_map=str(path)).prior_map.startswith("{")


@pytest.mark.parametrize(("side_m", "center"), [(5.6, (0.0, 0.0)), (8.0, (2.0, 0.0))])
def test_a_map_that_ends_inside_the_arena_is_refused(
    tmp_path: Path, side_m: float, center: tuple[float, float]
) -> None:
    path = free_map(tmp_path / "map.yaml", side_m, center)
    low, high = center[0] - side_m / 2.0, center[0] + side_m / 2.0
    message = refused({"prior_map": str(path)})
    assert message.startswith(f"f.yaml: parameters: prior_map: {path}: it reaches from ({low:g}, ")
    assert f"to ({high:g}, " in message


@pytest.mark.parametrize("name", arena_names())
def test_exact_maps_from_files_cover_their_arenas(tmp_path: Path, name: str) -> None:
    save_map(render_exact(load_arena(name)), tmp_path / "map.yaml")
    DetectionParameters.of(arena=name, prior_map=str(tmp_path / "map.yaml"))


def test_the_worst_explored_maps_cover_their_arenas_and_are_worse() -> None:
    for arena in ("map1", "map2", "empty"):
        parameters = DetectionParameters.of(prior_map="explored-worst", arena=arena)
        assert parameters.prior_map.startswith(f"explored-worst:{arena}:")
        assert DetectionParameters.of(**parameters.flat_values()) == parameters
        truth = render_exact(load_arena(arena))
        start = robot_starts(load_arena(arena), 1)[0]
        f1 = []
        for name in ("explored", "explored-worst"):
            score = score_map(prior_map_from(name, arena, 0.05), truth, (start.x, start.y), BURGER.radius_m)
            f1.append(score.occupied_precision * score.occupied_recall)
        assert f1[1] < f1[0]


def test_what_is_wrong_with_a_map_names_its_file(tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    full = OccupancyGrid(np.full((160, 160), 100, np.int8), 0.05, (-4.0, -4.0))
    for grid, said in (
        (render_exact(load_arena("map1"), 0.1), "resolution 0.1 m differs"),
        (full, "no cell is 0.4 m from walls"),
    ):
        save_map(grid, path)
        assert refused({"prior_map": str(path)}).startswith(f"f.yaml: parameters: prior_map: {path}: {said}")
    assert "prior_map: absent.yaml: cannot be read: No such file" in refused({"prior_map": "absent.yaml"})
    assert "prior_map: explored: resolution 0.05 m" in refused({"resolution_m": 0.1})


def test_a_map_whose_resolution_was_rounded_is_the_same_map(tmp_path: Path) -> None:
    for cell_m, written in (
        (0.05, ("0.05", "0.05000000074505806", "0.0500000007")),
        (1.0 / 30.0, ("0.033333", "0.03333333507446289", repr(1.0 / 30.0))),
    ):
        taken = []
        for number, resolution in enumerate(written):
            path = tmp_path / f"{cell_m:.3f}-{number}.yaml"
            save_map(render_exact(load_arena("map1"), cell_m), path)
            path.write_text(
                path.read_text().replace(f"resolution: {cell_m:.6f}", f"resolution: {resolution}")
            )
            parameters = DetectionParameters.of(prior_map=str(path), resolution_m=cell_m)
            grid = prior_map_from(parameters.prior_map, "map1", cell_m)
            taken.append((grid.resolution, grid.extent, grid.data.tobytes()))
        assert taken[0][0] == cell_m
        assert taken == taken[:1] * len(taken)


@pytest.mark.slow
def test_a_trial_runs_alike_on_a_map_of_32_bits(tmp_path: Path) -> None:
    found = []
    for resolution in ("0.050000", "0.05000000074505806"):
        path = tmp_path / f"{resolution}.yaml"
        save_map(render_exact(load_arena("map1"), 0.05), path)
        path.write_text(path.read_text().replace("resolution: 0.050000", f"resolution: {resolution}"))
        parameters = DetectionParameters.of(engine="fast", robots=1, frames=5, prior_map=str(path))
        (result,) = run_trials([TrialSpec("detection", parameters.flat_values(), 1)])
        found.append(encode_tables(result))
    assert found[0] == found[1]


def test_what_is_wrong_with_an_arena_names_its_key_and_file(tmp_path: Path) -> None:
    path = tmp_path / "arena.yaml"
    for text, said in (
        ("name: 2020-13-45\n", "not valid YAML: line 1: '2020-13-45'"),
        ("name: a\nplain_m: [8, 8]\n", "plain_m: unknown"),
    ):
        path.write_text(text)
        assert refused({"arena": str(path)}).startswith(f"f.yaml: parameters: arena: {path}: {said}")
    assert refused({"arena": "absent.yaml"}).startswith(
        "f.yaml: parameters: arena: absent.yaml: cannot be read"
    )
    assert refused({"arena": "a\0b.yaml"}).endswith("cannot be read: no file can have this name")
    assert refused({"arena": "map9"}).startswith("f.yaml: parameters: arena: no arena is called 'map9'")


def changed(change: Callable[[dict[str, Any]], None]) -> str:
    """What the package writes down of a map, with one thing about it changed."""
    cells = OccupancyGrid(np.zeros((160, 160), np.int8), 0.05, (-4.0, -4.0))
    values = json.loads(_as_text(cells))
    change(values)
    return json.dumps(values)


@pytest.mark.parametrize(
    "text",
    [
        "{}",
        "{",
        '{"a":' * 5000,
        changed(lambda values: values.pop("int8")),
        changed(lambda values: values.update(int8="not base64")),
        changed(lambda values: values.update(int8="bm90IHpsaWI=")),
        changed(lambda values: values.update(shape=[160, 161])),
        changed(lambda values: values.update(resolution=float("nan"))),
        changed(lambda values: values.update(origin=[-4.0])),
        changed(lambda values: values.update(more=1)),
    ],
)
def test_a_text_that_only_begins_like_a_map_is_none(text: str) -> None:
    assert "is no map; give a YAML file, explored or exact" in refused({"prior_map": text})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{}", "arena: '{}': name: Field required"),
        ("{", "arena: '{' is no arena; give a name or a YAML file"),
        ('{"a":' * 5000, "is no arena"),
        (load_arena("map1").model_dump_json().replace("3.0", "9.0"), "is off the plane"),
    ],
)
def test_a_text_that_only_begins_like_an_arena_is_none(text: str, words: str) -> None:
    assert words in refused({"arena": text})


def test_what_was_taken_in_is_taken_again_as_it_is(tmp_path: Path) -> None:
    own = tmp_path / "own.yaml"
    own.write_text(load_arena("map1").model_dump_json())
    first = DetectionParameters.of(arena=str(own), prior_map=str(free_map(tmp_path / "map.yaml", 8.0)))
    assert DetectionParameters.of(**first.flat_values()) == first
    assert changed(lambda values: None) == first.prior_map
