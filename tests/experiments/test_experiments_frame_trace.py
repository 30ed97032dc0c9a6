"""Causes of errors in small real worlds, each made so that the cause meant is there and no other."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from midnet_bench.arena.arena import Arena, checked_arena
from midnet_bench.arena.prior_maps import render_exact
from midnet_bench.campaign.trial import Row
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial, run_detection
from midnet_bench.geometry import Point
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.map_server import save_map
from midnet_bench.navigation.costmap import LETHAL
from midnet_bench.scoring.error_causes import FALSE_CAUSES, MISS_CAUSES, UNEXPLAINED

pytestmark = pytest.mark.slow

LATE_SCANS = 3  # the seed of a guard whose last scan is 0.167 s old at a frame


def box(x: float, y: float, side_m: float, width_m: float | None = None) -> Row:
    return {"shape": "box", "x_m": x, "y_m": y, "size_m": (side_m, width_m or side_m)}  # type: ignore[dict-item]


def cylinder(x: float, y: float, diameter_m: float) -> Row:
    return {"shape": "cylinder", "x_m": x, "y_m": y, "size_m": (diameter_m, diameter_m)}  # type: ignore[dict-item]


def room(
    *placed: Row,
    side_m: float = 6.0,
    walls: Sequence[Sequence[Point]] = (),
    is_closed: bool = True,
    start: Point = (0.0, 0.0),
    spacing_m: float = 0.6,
    runner: tuple[Point, Point] | None = None,
) -> Arena:
    """A square one about the origin; ``runner``: the ends of the way of a box of 10 cm, at up to 2 m/s."""
    h = side_m / 2.0
    enclosure = [[(-h, -h), (h, -h), (h, h), (-h, h), (-h, -h)]] if is_closed else []
    runs = {"kind": "box", "size_m": (0.1, 0.1), "speed_mps": 2.0, "behaviour": "follow"}
    return checked_arena(
        {
            "name": "room",
            "plane_m": (side_m + 2.0, side_m + 2.0),
            "enclosure_m": (side_m, side_m),
            "wall_thickness_m": 0.15,
            "wall_height_m": 1.0,
            "walls": [*enclosure, *walls],
            "robots": {"center_m": start, "spacing_m": spacing_m},
            "stationary_intruders": {"placed": placed, "clearance_m": 0.0, "clear_of_robots_m": 0.0},
            "other_intruders": [{**runs, "starts_m": runner[:1], "path_m": runner}] if runner else [],
        },
        "room",
    )


EXACTLY = {
    "engine": "fast",
    "record": True,
    "prior_map": "exact",
    "localization": "truth",
    "lidar_noise": "none",
    "require_line_of_sight": False,
    "frames": 3,
}
Options = Mapping[str, object]


def tables(arena: Arena, seed: int = 1, **options: object) -> dict[str, list[Row]]:
    """Of a trial without any error but those that ``options`` bring in."""
    values = {**EXACTLY, "arena": arena.model_dump_json(), **options}
    return run_detection(DetectionParameters.of(**values).with_files_read(), seed).tables


def causes(arena: Arena, seed: int = 1, **options: object) -> Counter[tuple[str, str]]:
    """How often each cause came, with who else had a part."""
    rows = tables(arena, seed, **options).get("errors", [])
    return Counter((str(row["cause"]), str(row["by"])) for row in rows)


def test_an_intruder_in_full_sight_is_found() -> None:
    assert not causes(room(box(1.0, 0.0, 0.3)))


RUNNER = room(runner=((1.0, -1.0), (1.0, 1.0)))
RIM = room(box(1.8, 0.0, 0.1), side_m=4.0, start=(0.8, 0.0))
THIN = {"thresh_local": 100}  # only the cell of a return itself counts
THIN_WALLS = {**THIN, "thresh_global": 100, "patrol_clearance_m": 0.2}

ALONE: dict[str, tuple[Arena, Options, set[tuple[str, str]]]] = {
    "occluded": (room(box(0.7, 0.0, 0.4), box(1.2, 0.0, 0.2)), {}, {("occluded", "stationary 1")}),
    "occluded_outside_window": (
        room(box(1.0, 0.0, 0.6), box(2.0, 0.0, 0.2)),
        {},
        {("occluded_outside_window", "stationary 1")},
    ),
    "occluded_by_wall": (
        room(box(1.4, 0.0, 0.2), walls=[[(0.7, -0.5), (0.7, 0.5)]]),
        {},
        {("occluded_by_wall", "a wall")},
    ),
    # guard 1 hides it from guard 2, and a wall from guard 1, which got it less far
    "occluded_by_guard": (
        room(box(1.2, 0.0, 0.2), walls=[[(0.9, -0.3), (0.9, 0.3)]]),
        {"robots": 2},
        {("occluded_by_guard", "guard 1")},
    ),
    "between_beams": (room(cylinder(1.4, -0.0122, 0.005)), {"frames": 1}, {("between_beams", "")}),
    # a corner of its box is within range, and no point of itself
    "beyond_range": (
        room(cylinder(1.874, 1.874, 0.3)),
        {"frames": 1, "in_range": "edge", "local_size_m": 8},
        {("beyond_range", "")},
    ),
    "outside_window": (room(box(2.2, 0.0, 0.2)), {}, {("outside_window", "")}),
    "under_prior": (room(box(1.87, 0.0, 0.1), side_m=4.0, start=(0.8, 0.0)), {}, {("under_prior", "")}),
    "rim": (RIM, {}, {("under_prior", ""), ("rim", "stationary 1")}),
    "too_small": (room(box(1.0, 0.0, 0.2)), {"min_area_cells": 1000}, {("too_small", "")}),
    # the prior map leaves a strip of it, of which nothing is left
    "deflated": (
        room(box(1.7, 0.02, 0.1), side_m=4.0, start=(0.8, 0.0)),
        {"deflate_boxes": True},
        {("deflated", ""), ("deflated", "stationary 1")},
    ),
    "pose_error": (
        room(box(1.0, 0.0, 0.1)),
        {"localization": "ukf", "start_error_m": 0.3},
        {("pose_error", ""), ("misplaced_by_pose", "stationary 1")},
    ),
    "ally_left": (room(), {"robots": 2, "iou_ally": 1}, {("ally_left", "guard 1"), ("ally_left", "guard 2")}),
    # squares of 2 m, so that a box of an ally itself has too small a part of its one
    "taken_for_ally": (
        room(box(0.3, 0.55, 0.2)),
        {"robots": 2, "ally_diameter_m": 2.0, "iou_ally": 0.02},
        {("taken_for_ally", "guard 2"), ("ally_left", "guard 1"), ("ally_left", "guard 2")},
    ),
    "merged": (room(box(1.0, 0.0, 0.15), box(1.0, 0.2, 0.15)), {}, {("merged", "")}),
    "fragment": (
        room(box(0.0, 1.0, 0.1, 0.9), spacing_m=2.4),
        {"robots": 2, "fusion": "none"},
        {("fragment", "stationary 1")},
    ),
}


@pytest.mark.parametrize("name", ALONE)
def test_a_world_with_one_cause_has_that_and_no_other(name: str) -> None:
    arena, options, expected = ALONE[name]
    assert causes(arena, **options) == dict.fromkeys(expected, options.get("frames", EXACTLY["frames"]))


@pytest.mark.parametrize(
    ("name", "hidden", "outside", "hidden_inside"),
    [("occluded", 3, 0, 3), ("occluded_outside_window", 3, 3, 0), ("outside_window", 0, 3, 0)],
)
def test_misses_inside_and_outside_the_local_costmap_are_counted_without_a_record(
    name: str, hidden: int, outside: int, hidden_inside: int
) -> None:
    (row,) = tables(ALONE[name][0], record=False, local_size_m=3.0)["scores"]
    columns = ("fn", "fn_hidden", "fn_outside_window", "fn_hidden_in_window")
    assert [row[column] for column in columns] == [3, hidden, outside, hidden_inside]


def test_a_wall_is_off_by_the_heading_that_a_guard_takes_itself_to_have() -> None:
    options = {"localization": "ukf", "start_error_deg": 25, "patrol_clearance_m": 0.2}
    assert set(causes(room(side_m=3.0), **options)) == {("wall_by_pose", "a wall")}


def test_a_wall_is_off_by_noise_where_the_prior_map_is_as_thin_as_its_cells() -> None:
    thin = {**THIN_WALLS, "frames": 10}
    assert set(causes(room(side_m=3.0), lidar_noise="gazebo", **thin)) == {("wall_by_noise", "a wall")}
    assert not causes(room(side_m=3.0), **thin)


def test_a_guard_that_drives_on_after_its_scan_shifts_walls_and_intruders() -> None:
    walls = room(side_m=3.0)
    assert set(causes(walls, LATE_SCANS, **THIN_WALLS, frames=30)) == {("wall_by_crop", "a wall")}
    assert not causes(walls, LATE_SCANS, **THIN_WALLS, frames=30, align="origin")

    thin = room(cylinder(1.1, 0.0, 0.04), cylinder(0.0, 1.1, 0.04))
    shifted = causes(thin, LATE_SCANS, **THIN, frames=30)
    assert {cause for cause, _ in shifted} == {"crop_shift", "misplaced_by_crop", "outside_window"}
    unshifted = causes(thin, LATE_SCANS, **THIN, frames=30, align="origin")
    assert {cause for cause, _ in unshifted} == {"outside_window"}


def test_a_thin_intruder_is_off_by_the_noise_of_its_range() -> None:
    thin = {**THIN, "align": "origin", "frames": 10, "local_size_m": 3.0}
    noisy = causes(room(box(1.3, 0.0, 0.02)), LATE_SCANS, lidar_noise="datasheet", **thin)
    assert {cause for cause, _ in noisy} == {"range_noise", "misplaced_by_noise", "outside_window"}
    exact = causes(room(box(1.3, 0.0, 0.02)), LATE_SCANS, **thin)
    assert {cause for cause, _ in exact} == {"outside_window"}


def test_who_runs_is_found_where_it_was_and_leaves_a_trail_where_marks_last() -> None:
    def found(**options: object) -> set[tuple[str, str]]:
        return set(causes(RUNNER, LATE_SCANS, frames=30, align="origin", **options))

    seen = {("delay", ""), ("stale", "box 1"), ("outside_window", "")}
    assert found() == seen
    lasting = {"local_map": "decay", "decay_s": 20, "raytrace_range_m": 0.3}
    assert found(**lasting) == seen | {("intruder_trail", "box 1")}


def test_where_marks_last_guards_leave_trails_of_each_other() -> None:
    lasting = {"local_map": "decay", "decay_s": 20, "raytrace_range_m": 0.3}
    trails = causes(room(), robots=2, frames=100, iou_ally=0.1, **lasting)
    assert trails["ally_trail", "guard 1"] > 10
    assert trails["ally_trail", "guard 2"] > 10
    assert {cause for cause, _ in trails} == {"ally_trail", "ally_left"}


def test_the_age_of_an_error_is_that_of_the_scan() -> None:
    rows = tables(room(box(2.2, 0.0, 0.2)), LATE_SCANS)["errors"]
    assert [row["age_s"] for row in rows] == [pytest.approx(5.0 / 30.0, abs=5e-4)] * 3


def test_a_wall_that_is_missing_in_the_map_makes_a_false_box(tmp_path: Path) -> None:
    arena = room(side_m=4.0, walls=[[(0.8, -0.3), (0.8, 0.3)]])
    save_map(render_exact(room(side_m=4.0)), tmp_path / "old.yaml")
    assert causes(arena, prior_map=str(tmp_path / "old.yaml")) == {("wall_by_map", "a wall"): 3}


def test_what_stands_beyond_the_prior_map_is_lost_there_but_for_its_rim(tmp_path: Path) -> None:
    open_side = [[(1.5, -1.5), (-1.5, -1.5), (-1.5, 1.5), (1.5, 1.5)]]
    arena = room(box(2.1, 0.0, 0.2), side_m=3.0, is_closed=False, walls=open_side, start=(0.5, 0.0))
    whole = render_exact(arena)
    cells = round(0.5 / whole.resolution)
    cut = slice(cells, -cells)
    small = OccupancyGrid(
        whole.data[cut, cut], whole.resolution, (whole.origin[0] + 0.5, whole.origin[1] + 0.5)
    )
    assert small.extent[2] == pytest.approx(2.0)
    save_map(small, tmp_path / "small.yaml")
    found = causes(arena, prior_map=str(tmp_path / "small.yaml"), local_size_m=6)
    assert found == {("outside_prior", ""): 3, ("rim", "stationary 1"): 3}


PARTS = """
class Blind:
    def __init__(self, prior_map, range_m): ...
    def detect(self, team):
        return [[] for _ in team]

class Guesses(Blind):
    def detect(self, team):
        return [[(-2.0, -2.0, -1.8, -1.8)] for _ in team]

class Nothing:
    def fuse(self, boxes, time_s):
        return []
"""


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        ({"detector": "Blind"}, {("not_detected", ""): 3}),
        ({"detector": "Guesses"}, {("not_detected", ""): 3, (UNEXPLAINED, ""): 3}),
        ({"fusion": "Nothing"}, {("dropped_by_fusion", ""): 3}),
    ],
)
def test_parts_of_ones_own(part: Mapping[str, str], expected: object, tmp_path: Path) -> None:
    (tmp_path / "parts.py").write_text(PARTS)
    named = {option: f"{tmp_path / 'parts.py'}:{name}" for option, name in part.items()}
    assert causes(room(box(1.0, 0.0, 0.3)), **named) == expected


def test_every_cause_but_two_came_in_some_world() -> None:
    """A mark that is cleared again takes a guard that drives over an intruder."""
    shown = {cause for _, _, expected in ALONE.values() for cause, _ in expected}
    by_hand = {
        *("wall_by_pose", "wall_by_noise", "wall_by_crop", "wall_by_map", "crop_shift", "misplaced_by_crop"),
        *("range_noise", "misplaced_by_noise", "delay", "stale", "intruder_trail", "ally_trail"),
        *("outside_prior", "not_detected", "dropped_by_fusion", UNEXPLAINED),
    }
    assert {*MISS_CAUSES, *FALSE_CAUSES} - shown - by_hand == {"below_threshold"}


@pytest.mark.parametrize(
    "options",
    [
        {"frames": 15, "robots": 2},
        {"frames": 15, "robots": 2, "local_map": "persistent", "inf_is_valid": False},
        {"frames": 15, "robots": 2, "local_map": "decay", "decay_s": 3, "align": "origin"},
    ],
)
def test_of_every_mark_is_known_which_return_made_it(options: Options) -> None:
    """Where returns end exactly on the edges of cells, too."""
    arena = room(box(1.8, 0.0, 0.1), box(-1.0, 0.5, 0.3), side_m=4.0, start=(0.8, 0.0))
    values = {**EXACTLY, "arena": arena.model_dump_json(), **options}
    with DetectionTrial(DetectionParameters.of(**values).with_files_read(), 1) as trial:
        for _ in trial.frames():
            for guard, costmap in enumerate(trial.detector.costmaps):
                marked = np.count_nonzero(costmap.marks == LETHAL)
                assert len(trial.own.recorder.trace.marks(guard).source) == marked > 0
