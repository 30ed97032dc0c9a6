"""``midnet-bench arena``: files of arenas out of plans and maps, and their pictures."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from midnet_bench.arena.arena import MOST_BLOCKS, TEAM, Arena, MobileIntruders, arena_path, load_arena
from midnet_bench.arena.drawn_plan import Drawing, Plan, plan_of, remarks
from midnet_bench.arena.floor_plan import (
    COARSEST_M,
    arena_of,
    arena_yaml,
    blocks_of,
    centred,
    coarser,
    set_part,
    sides_of,
    without_cracks,
)
from midnet_bench.arena.layout import Layout, place, robot_starts
from midnet_bench.arena.prior_maps import render_exact
from midnet_bench.arena.starts import SPACINGS_M, start_of_guards
from midnet_bench.drawing.painter import png_of
from midnet_bench.drawing.plans import draw_plan
from midnet_bench.drawing.scene import FloorPlan, Robot, Scene, Setup
from midnet_bench.drawing.stills import draw_arena
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.guarded.parameters import FRAME_HZ
from midnet_bench.geometry import Point
from midnet_bench.grid import FREE, OCCUPIED_FROM, OccupancyGrid
from midnet_bench.io.checked_yaml import read_text
from midnet_bench.io.files import write_atomically
from midnet_bench.io.map_server import image_of, load_map, read_image
from midnet_bench.workflows.arena_faults import SEEDS, CheckedArena, Fault, check, closed_floor, shown_place

Unknown = Literal["wall", "free"]
SHOWN_FAULTS = 5
INTRUDERS = ((2, 1.0), (1, 1.0), (1, 0.5))
"""of an arena made here: how many, and how far from the guards' starts, metres; the first that fits"""


def shown(name_or_path: str) -> str:
    """The text of an arena's file, comments and all. Raises InputError if there is none, or it is wrong."""
    load_arena(name_or_path)
    return read_text(arena_path(name_or_path))


@dataclass(frozen=True)
class MadeArena:
    """An arena out of a plan or a map."""

    checked: CheckedArena  # the arena, and what is wrong with it
    text: str  # its file
    notes: list[str]  # what to know about it, in lines
    sources: tuple[Path, ...]  # the files that it is made of
    plan: Plan | None = None  # what became of the pixels of a drawing

    def write(self, output: Path) -> list[Path]:
        """Write the arena's file, its picture, and of a drawing what of it became wall; the files.

        Raises:
            InputError: a file cannot be written, or the arena's would replace what it is made of.
            MidnetBenchError: the disk is full.
        """
        if output.exists() and any(source.exists() and output.samefile(source) for source in self.sources):
            raise InputError(f"-o {output}: the arena is made of this file; give another name")
        picture, second = (_picture(output, ending, self.sources) for ending in ("", "_plan"))
        write_atomically(output, self.text)
        write_picture(self.checked.arena, self.checked.faults, picture)
        if self.plan is None:
            return [output, picture]
        ways = [(piece.way.at, piece.way.width_m) for piece in self.checked.closed if piece.way is not None]
        write_atomically(second, png_of(draw_plan(self.plan, self.checked.arena, ways)))
        return [output, picture, second]


def from_image(
    path: Path,
    resolution_m: float,
    drawing: Drawing | None = None,
    team: int | None = None,
    room: Point | None = None,
) -> MadeArena:
    """An arena out of a drawn plan.

    Dark pixels are wall, and floor that they close all around and that is too narrow for a robot. A blank
    margin is cut off; what is left is the enclosure.

    Args:
        path: a PNG, JPEG or PGM.
        resolution_m: side of a pixel, metres.
        drawing: how it is drawn.
        team: so many guards have to fit; None: five, or fewer where they do not fit.
        room: a place in the room where guards start, metres, the arena's frame; None: in the largest.

    Raises:
        InputError: the image cannot be read, is all floor or all wall, has no room for a guard, or is too
            large or ragged for an arena.
    """
    drawing = drawing or Drawing()
    pixels = read_image(path, "arena from-image", takes_jpeg=True)
    plan = plan_of(pixels, resolution_m, drawing)
    notes = []
    grid, whole = plan.walls, plan.kinds
    if grid.data.shape != whole.data.shape:
        wide_m, high_m = (side * resolution_m for side in (whole.width, whole.height))
        notes.append(
            f"the blank margin of the plan is cut off: {grid.width * resolution_m:g} x"
            f" {grid.height * resolution_m:g} m of {wide_m:g} x {high_m:g} m are left"
        )
    notes += remarks(pixels, plan, drawing)
    try:
        walls = _Walls.of(grid, path.stem)
        arena, more = _populated(walls.arena, team, room)
    except InputError as error:
        light = "" if drawing.has_light_walls else "; light walls on a dark ground take --walls light"
        hint = f"; --threshold takes lighter ones{light}" if not grid.data.any() else light
        is_dark = np.count_nonzero(grid.data) > grid.data.size / 2 or not grid.data.any()
        raise InputError(f"{path}: {error}{hint if is_dark else ''}") from error
    heading = [f"From the plan {path.name}: {grid.width} x {grid.height} pixels of {resolution_m:g} m."]
    checked = check(arena)
    faults = [fault.text for fault in checked.faults]
    notes += [*walls.notes, *more, *faults[:SHOWN_FAULTS]]
    if len(faults) > SHOWN_FAULTS:
        notes.append(f"and {len(faults) - SHOWN_FAULTS} more faults: 'midnet-bench arena check' lists them")
    return MadeArena(checked, arena_yaml(arena, heading + walls.notes), notes, (path,), plan)


def from_map(path: Path, unknown: Unknown, team: int | None = None, room: Point | None = None) -> MadeArena:
    """An arena out of a map_server map: the known part of it, moved to the middle of the plane.

    It has no fault: floor that no robot reaches is declared, and what cannot be guarded is refused.

    Args:
        path: the map's YAML file.
        unknown: what cells are that the map knows nothing of.
        team: so many guards have to fit; None: five, or fewer where they do not fit.
        room: a place in the room where guards start, metres, the arena's frame; None: in the largest.

    Raises:
        InputError: the map cannot be read, knows nothing, has no room for a guard, or is too large or ragged
            for an arena.
    """
    grid = load_map(path)
    is_known = grid.data >= FREE
    if not is_known.any():
        raise InputError(f"{path}: no cell of the map is known")
    rows, columns = set_part(is_known)
    known = grid.data[rows, columns]
    dark = known >= OCCUPIED_FROM
    if unknown == "wall":
        dark |= known < FREE
    if dark.all():
        raise InputError(f"{path}: there is no floor in it: no known cell is free")
    try:
        walls = _Walls.of(without_cracks(centred(dark, grid.resolution)), path.stem)
        arena, notes = _populated(walls.arena, team, room)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    arena, closed = _declared(arena)
    checked = check(arena)
    if checked.faults:
        raise InputError(f"{path}: {checked.faults[0].text}")
    x, y = (
        new - cells.start * grid.resolution for new, cells in zip(walls.origin, (columns, rows), strict=True)
    )
    heading = [
        f"From the map {path.name}; cells that it does not know are {unknown}.",
        f"In this arena's frame the map's origin is [{x:.6f}, {y:.6f}, 0]: write that into a copy of its YAML"
        " file to guard by the map itself.",
        *walls.notes,
    ]
    text, notes = arena_yaml(arena, heading), [*walls.notes, *notes, *closed]
    return MadeArena(checked, text, notes, (path, image_of(path)))


class _Walls(NamedTuple):
    """An arena with walls and no robots yet."""

    arena: Arena
    origin: tuple[float, float]  # where the lower left corner of the grid went that it was made of, metres
    notes: list[str]

    @classmethod
    def of(cls, dark: OccupancyGrid, name: str) -> "_Walls":
        """The walls of a grid exactly; in larger cells where they are more rectangles than an arena may have.

        Raises InputError: there is no wall, or it is too large or ragged.
        """
        sides_of(dark)  # the size is told before anything is looked for
        for times in range(1, max(1, int(COARSEST_M / dark.resolution + 1e-6)) + 1):
            grid = coarser(dark, times)
            moved = centred(grid.data, grid.resolution)
            blocks = blocks_of(moved)
            if blocks is not None:
                notes = [] if times == 1 else [_coarse(dark.resolution, grid.resolution, len(blocks))]
                return cls(arena_of(moved, blocks, name), moved.origin, notes)
        raise InputError(
            f"its walls take more than {MOST_BLOCKS} rectangles, even in cells of"
            f" {max(COARSEST_M, dark.resolution):g} m: cut a part out of it, or clear it of noise"
        )


def _coarse(cell_m: float, larger_m: float, blocks: int) -> str:
    return (
        f"the walls take more than {MOST_BLOCKS} rectangles in cells of {cell_m:g} m, and {blocks} in those"
        f" of {larger_m:g} m, which are taken: walls grow by less than one; guard by prior_map=exact"
    )


def _populated(arena: Arena, team: int | None, room: Point | None) -> tuple[Arena, list[str]]:
    """The same with guards and intruders where there is room, and what to know about them.

    Raises InputError: there is no room for a guard, or for so many as ``team``.
    """
    robots = start_of_guards(arena, TEAM if team is None else team, room)
    if team is not None and robots.team < team:
        raise InputError(f"{team} guards fit nowhere together; at most {robots.team}: --robots {robots.team}")
    notes = []
    if robots.team < TEAM and team is None:
        notes.append(
            f"{TEAM} guards fit nowhere together: {robots.team} start at {shown_place(robots.center_m)}"
            f" (--robots {robots.team} of a trial)"
        )
    elif robots.spacing_m < SPACINGS_M[0]:
        notes.append(f"guards start {robots.spacing_m:g} m apart: there is no room for {SPACINGS_M[0]:g} m")
    for count, clear_m in INTRUDERS:
        intruders = MobileIntruders(count=count, clear_of_robots_m=clear_m)
        made = arena.model_copy(update={"robots": robots, "mobile_intruders": intruders})
        if _has_room(made):
            if (count, clear_m) != INTRUDERS[0]:
                notes.append(f"one intruder, {clear_m:g} m from the guards' starts: there is no room for two")
            return made, notes
    notes.append("no intruder: there is no room for one")
    return arena.model_copy(update={"robots": robots, "mobile_intruders": MobileIntruders()}), notes


def _has_room(arena: Arena) -> bool:
    try:
        for seed in range(1, SEEDS + 1):
            place(arena, seed, 1)
    except InputError:
        return False
    return True


def _declared(arena: Arena) -> tuple[Arena, list[str]]:
    """The same with the floor inside it declared that no robot reaches, and a line about it."""
    _, closed = closed_floor(arena, ways=0)
    inside = [piece for piece in closed if not piece.is_outside]
    if not inside:
        return arena, []
    area_m2 = math.fsum(piece.area_m2 for piece in inside)
    many = (
        f"{len(inside)} pieces of floor, {area_m2:.1f} m2,"
        if len(inside) > 1
        else f"{area_m2:.1f} m2 of floor"
    )
    largest = f", the largest {inside[0].area_m2:.1f} m2" if len(inside) > 1 else ""
    x, y = inside[0].at
    note = (
        f"no robot reaches {many} inside{largest} at {shown_place((x, y))}: listed as no_entry_m, where"
        f" 'arena check' finds no fault; --room={x:.2f},{y:.2f} has guards start there"
    )
    points = tuple((round(x, 6), round(y, 6)) for x, y in (piece.at for piece in inside))
    return arena.model_copy(update={"no_entry_m": points}), [note]


def _picture(output: Path, ending: str, sources: Sequence[Path]) -> Path:
    """Where a picture of an arena goes: beside its file, under its name, where that replaces nothing else.

    Args:
        output: the arena's file, not written yet.
        ending: of the picture's name.
        sources: the files that the arena is made of.
    """
    picture = output.with_name(f"{output.stem}{ending}.png")
    is_anothers = picture.exists() and (
        not output.exists() or any(source.exists() and picture.samefile(source) for source in sources)
    )
    return picture.with_stem(f"{picture.stem}_arena") if is_anothers else picture


def write_picture(arena: Arena, faults: Sequence[Fault], path: Path) -> None:
    """Draw an arena as trials in it are drawn: its largest team, seed 1's intruders, and the faults.

    Raises:
        InputError: the file cannot be written.
        MidnetBenchError: the disk is full.
    """
    team = arena.robots.team
    starts = robot_starts(arena, team)
    try:
        layout = place(arena, 1, team)
    except InputError:
        layout = Layout(arena, 1, arena.placed_solids(), starts, ())
    parameters = DetectionParameters()
    prior_map = render_exact(arena)
    setup = Setup(
        FloorPlan.of(arena, layout, 1),
        prior_map,
        prior_map,
        team,
        len(layout.intruders),
        parameters.costmap.obstacle_range_m,
        parameters.costmap.size_m,
        FRAME_HZ,
    )
    robots = [
        Robot(number, is_guard, pose, pose, None, None)
        for is_guard, poses in ((True, starts), (False, layout.intruders))
        for number, pose in enumerate(poses, 1)
    ]
    places = {number: fault.at for number, fault in enumerate(faults, 1) if fault.at is not None}
    write_atomically(path, png_of(draw_arena(setup, Scene(0.0, 0, robots, [], []), places)))
