"""``midnet-bench arena``: files of arenas out of plans and maps, and what is wrong with one."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import cv2
import numpy as np

from midnet_bench.agents.patrol import DRIVABLE_M, patrol_points
from midnet_bench.arena.arena import Arena, arena_path, checked_arena, load_arena
from midnet_bench.arena.floor_plan import arena_yaml, centred, cropped, dark_cells, specks, without_specks
from midnet_bench.arena.free_space import cells_near
from midnet_bench.arena.layout import ROBOT_CLEARANCE_M, TEAM, Layout, place, robot_starts
from midnet_bench.arena.prior_maps import render_exact
from midnet_bench.drawing.painter import png_of
from midnet_bench.drawing.scene import FloorPlan, Robot, Scene, Setup
from midnet_bench.drawing.stills import draw_arena
from midnet_bench.elementary import directions
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.guarded.parameters import FRAME_HZ
from midnet_bench.geometry import Point, Solid, dense_outline, lengths
from midnet_bench.grid import FREE, OCCUPIED_FROM, OccupancyGrid, cells_of, cells_to_unset, connected_to
from midnet_bench.io.checked_yaml import parsed_yaml, read_text
from midnet_bench.io.files import write_atomically
from midnet_bench.io.map_server import load_map, read_image
from midnet_bench.simulation.fast.outlines import cast_on_outlines, outlines_of

Unknown = Literal["wall", "free"]

SEEDS = 5  # whose layouts are tried
ROOM_M2 = 0.25  # Less floor than this, where a Burger's centre may be, is no room.
SPECK_M = 0.6  # up to this length a piece of wall that touches no other may be dirt or a letter
SHOWN_SPECKS = 5
_BEAMS = 180
_STEP_M = 0.05


def shown(name_or_path: str) -> str:
    """The text of an arena's file, comments and all. Raises InputError if there is none, or it is wrong."""
    load_arena(name_or_path)
    return read_text(arena_path(name_or_path))


def from_image(path: Path, resolution_m: float, drop_specks_m: float = 0.0) -> tuple[str, list[str]]:
    """An arena's file out of a drawn plan, and what to know about it, in lines.

    Dark pixels are wall. A blank margin is cut off; what is left is the enclosure.

    Args:
        path: a PNG, JPEG or PGM.
        resolution_m: side of a pixel, metres.
        drop_specks_m: pieces of wall that touch no other and are no longer than this are floor.

    Raises:
        InputError: the image cannot be read, is all floor or all wall, or too large or ragged for an arena.
    """
    drawn = dark_cells(read_image(path, "arena from-image", takes_jpeg=True), resolution_m)
    grid = cropped(without_specks(drawn, drop_specks_m))
    heading = [f"From the plan {path.name}: {grid.width} x {grid.height} pixels of {resolution_m:g} m."]
    notes = []
    if grid.data.shape != drawn.data.shape:
        wide_m, high_m = (side * resolution_m for side in (drawn.width, drawn.height))
        notes.append(
            f"the blank margin of the plan is cut off: {grid.width * resolution_m:g} x"
            f" {grid.height * resolution_m:g} m of {wide_m:g} x {high_m:g} m are left"
        )
    if small := specks(grid, SPECK_M):
        places = ", ".join(_place(speck.at) for speck in small[:SHOWN_SPECKS])
        more = ", ..." if len(small) > SHOWN_SPECKS else ""
        size_m = math.ceil(small[0].size_m * 100.0 - 1e-6) / 100.0
        notes.append(
            f"{len(small)} small piece{'s' if len(small) > 1 else ''} of wall up to {size_m:g} m long, at"
            f" {places}{more}: specks or lettering? --drop-specks {size_m:g} makes them floor"
        )
    return _text(grid, path, heading + notes), notes


def from_map(path: Path, unknown: Unknown) -> str:
    """An arena's file out of a map_server map: the known part of it, moved to the middle of the plane.

    Args:
        path: the map's YAML file.
        unknown: what cells are that the map knows nothing of.

    Raises:
        InputError: the map cannot be read, knows nothing, or is too large or ragged for an arena.
    """
    grid = load_map(path)
    rows, columns = np.nonzero(grid.data >= FREE)
    if not len(rows):
        raise InputError(f"{path}: no cell of the map is known")
    low, left = int(rows.min()), int(columns.min())
    known = grid.data[low : rows.max() + 1, left : columns.max() + 1]
    dark = known >= OCCUPIED_FROM
    if unknown == "wall":
        dark |= known < FREE
    moved = centred(dark, grid.resolution)
    x, y = (new - cells * grid.resolution for new, cells in zip(moved.origin, (left, low), strict=True))
    heading = [
        f"From the map {path.name}; cells that it does not know are {unknown}.",
        f"In this arena's frame the map's origin is [{x:.6f}, {y:.6f}, 0]: write that into a copy of its YAML"
        " file to guard by the map itself.",
    ]
    return _text(moved, path, heading)


def _text(dark: OccupancyGrid, path: Path, heading: list[str]) -> str:
    try:
        text = arena_yaml(dark, path.stem, heading)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    checked_arena(parsed_yaml(text, str(path)), str(path))
    return text


class Fault(NamedTuple):
    """Something that is wrong with an arena."""

    text: str  # a line
    at: Point | None  # where, metres, map frame


class ClosedFloor(NamedTuple):
    """A piece of floor that no robot can enter."""

    area_m2: float  # where a Burger's centre could be
    at: Point  # a place in it, metres, map frame
    is_outside: bool  # whether it reaches the enclosure's edge


class CheckedArena(NamedTuple):
    """An arena and its faults."""

    arena: Arena
    faults: list[Fault]
    closed: list[ClosedFloor]
    """of at least ``ROOM_M2`` each, the largest first; floor around the building is among them"""


def check(name_or_path: str) -> CheckedArena:
    """An arena, and what is wrong with it: starts, rooms, patrols, and the layouts of the first seeds.

    Raises:
        InputError: the file cannot be read, or is none of an arena.
    """
    arena = load_arena(name_or_path)
    solids = arena.wall_solids() + arena.placed_solids()
    faults = _starts(arena, solids)
    reachable, closed = _floor(arena)
    if reachable.data.any():
        for room in closed:
            text = (
                f"a room at {_place(room.at)} cannot be reached: no way to its {room.area_m2:.1f} m2 that a "
                f"Burger passes, which needs {2 * DRIVABLE_M:g} m; open a door or fill it"
            )
            faults += [] if room.is_outside else [Fault(text, room.at)]
        try:
            patrol_points(render_exact(arena), arena.robots.center_m, arena.enclosure_m)
        except InputError as error:
            faults.append(Fault(str(error).removeprefix("prior_map: "), arena.robots.center_m))
    layouts: list[Layout] = []
    for seed in range(1, SEEDS + 1):
        try:
            layouts.append(place(arena, seed, 1))
        except InputError as error:
            text = str(error).removeprefix(f"arena '{arena.name}': ")
            # a start that collides is listed already, with its place
            if not text.startswith("robots: ") and not any(fault.text == text for fault in faults):
                faults.append(Fault(text, None))
    faults += _never_seen(arena, reachable, layouts)
    return CheckedArena(arena, faults, sorted(closed, key=lambda piece: -piece.area_m2))


def _floor(arena: Arena) -> tuple[OccupancyGrid, list[ClosedFloor]]:
    """Where a guard can drive, bool, and where it has room but cannot come."""
    near = cells_near(arena, arena.placed_solids(), DRIVABLE_M)
    half_x, half_y = arena.enclosure_m[0] / 2.0, arena.enclosure_m[1] / 2.0
    inside = (np.abs(near.x_centers) < half_x) & (np.abs(near.y_centers) < half_y)[:, None]
    floor = ~near.data & inside
    reachable = near.with_data(connected_to(*near.cell_at(*arena.robots.center_m), floor))
    closed = (floor & ~reachable.data).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=4)
    room_m = cells_to_unset(np.pad(closed, 1))[1:-1, 1:-1]
    rows, columns = np.nonzero(inside)
    borders = {int(rows.min()), int(rows.max())}, {int(columns.min()), int(columns.max())}
    pieces = []
    for label, (left, low, width, height, cells) in enumerate(stats.tolist()):
        area_m2 = cells * near.resolution**2
        if label == 0 or area_m2 < ROOM_M2:
            continue
        is_outside = borders[0] & {low, low + height - 1} or borders[1] & {left, left + width - 1}
        # the cell that is farthest from the piece's edge
        row, column = divmod(int(np.where(labels == label, room_m, 0.0).argmax()), near.width)
        pieces.append(ClosedFloor(area_m2, near.center_of(column, row), bool(is_outside)))
    return reachable, pieces


def _starts(arena: Arena, solids: tuple[Solid, ...]) -> list[Fault]:
    """Starts of teams that stand in or at something."""
    faults = []
    for team in range(1, TEAM + 1):
        starts = np.array([(pose.x, pose.y) for pose in robot_starts(arena, team)])
        gaps_m = np.min([solid.distance_to(starts) for solid in solids], axis=0)
        worst = int(gaps_m.argmin())
        if gaps_m[worst] < ROBOT_CLEARANCE_M:
            at = (float(starts[worst, 0]), float(starts[worst, 1]))
            text = (
                f"robots: guard {worst + 1} of {team} starts at {_place(at)}, "
                f"{max(float(gaps_m[worst]), 0.0):.2f} m from a wall or an intruder; "
                f"{ROBOT_CLEARANCE_M:g} m are needed: move center_m or lower spacing_m"
            )
            faults.append(Fault(text, at))
    return faults


def _never_seen(arena: Arena, reachable: OccupancyGrid, layouts: Sequence[Layout]) -> list[Fault]:
    """Stationary intruders that no beam of a guard meets from anywhere within its usable range."""
    range_m, placed = DetectionParameters().costmap.obstacle_range_m, len(arena.placed_solids())
    first: dict[Solid, tuple[int, Layout]] = {}
    for layout in layouts:
        for number, solid in enumerate(layout.stationary):
            first.setdefault(solid, (number, layout))
    faults = []
    for solid, (number, layout) in first.items():
        if not is_seen(solid, layout.solids, reachable, range_m):
            at = (solid.pose.x, solid.pose.y)
            name = f"stationary_intruders.placed.{number}"
            if number >= placed:
                name = f"stationary_intruders: number {number + 1} of seed {layout.seed}"
            faults.append(Fault(f"{name} at {_place(at)}: no guard can ever see it within {range_m:g} m", at))
    return faults


def is_seen(solid: Solid, solids: tuple[Solid, ...], reachable: OccupancyGrid, range_m: float) -> bool:
    """Whether a straight line of at most ``range_m`` joins a solid's surface to a cell of ``reachable``.

    ``solids``: all that hides, ``solid`` among them. The surface is taken every 5 cm or less.
    """
    points = dense_outline(solid.outline, _STEP_M)
    away = points - (solid.pose.x, solid.pose.y)
    # off the surface, so that lines into the solid itself end at once
    points = points + 0.005 * away / lengths(away)[:, None]
    ways = directions(2.0 * math.pi * np.arange(_BEAMS) / _BEAMS)
    fans = np.broadcast_to(ways, (len(points), *ways.shape)).copy()
    ranges_m = np.minimum(cast_on_outlines(points, fans, outlines_of(solids)[:], 0.0, range_m), range_m)
    along = np.arange(0.0, range_m, _STEP_M)
    for point, free_m in zip(points, ranges_m, strict=True):
        lines = point + along[None, :, None] * ways[:, None]
        column, row = np.moveaxis(cells_of(reachable, lines), -1, 0)
        lit = (along[None] < free_m[:, None]) & (column >= 0) & (row >= 0)
        lit &= (column < reachable.width) & (row < reachable.height)
        if reachable.data[row[lit], column[lit]].any():
            return True
    return False


def _place(at: Point) -> str:
    return f"({at[0]:.2f}, {at[1]:.2f})"


def write_picture(arena: Arena, faults: Sequence[Fault], path: Path) -> None:
    """Draw an arena as trials in it are drawn: a team at its starts, seed 1's intruders, and the faults.

    Raises:
        InputError: the file cannot be written.
        MidnetBenchError: the disk is full.
    """
    starts = robot_starts(arena, TEAM)
    try:
        layout = place(arena, 1, TEAM)
    except InputError:
        layout = Layout(arena, 1, arena.placed_solids(), starts, ())
    parameters = DetectionParameters()
    prior_map = render_exact(arena)
    setup = Setup(
        FloorPlan.of(arena, layout, 1),
        prior_map,
        prior_map,
        TEAM,
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
