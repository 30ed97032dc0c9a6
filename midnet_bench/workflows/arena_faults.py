"""``midnet-bench arena check``: what is wrong with an arena."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from midnet_bench.agents.patrol import DRIVABLE_M, patrol_points
from midnet_bench.arena.arena import Arena
from midnet_bench.arena.free_space import GOAL_CLEARANCE_M, border_labels, free_space, marked, open_floor
from midnet_bench.arena.layout import ROBOT_CLEARANCE_M, Layout, place, robot_starts
from midnet_bench.arena.prior_maps import render_exact
from midnet_bench.elementary import directions
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.geometry import Booleans, Indices, Point, Solid, dense_outline, lengths
from midnet_bench.grid import OccupancyGrid, cells_to_unset, connected_to, values_at
from midnet_bench.simulation.fast.outlines import cast_on_outlines, outlines_of

SEEDS = 5  # whose layouts are tried
WAYS = 10  # rooms whose widest way is looked for
ROOM_M2 = 0.25  # Less floor than this, where a Burger's centre may be, is no room.
_BEAMS = 180
_STEP_M = 0.05
_WAY_M, _WAY_MARGIN_M, _WAY_CELLS = 0.01, 0.6, 4_000_000
"""cells on which the widest way into a room is looked for, how far around it, and how many of them at most"""


class Fault(NamedTuple):
    """Something that is wrong with an arena."""

    text: str  # a line
    at: Point | None  # where, metres, map frame


class Way(NamedTuple):
    """The widest way between a piece of floor and that which robots reach."""

    width_m: float  # at its narrowest place, to a cell of 1 cm
    at: Point  # there, metres, map frame


class ClosedFloor(NamedTuple):
    """A piece of floor that no robot can enter."""

    area_m2: float  # where a Burger's centre could be
    at: Point  # a place in it, metres, map frame
    is_outside: bool  # whether it reaches the enclosure's edge
    is_declared: bool  # whether the arena says so itself, by ``no_entry_m``
    way: Way | None  # None: there is none, or it was not looked for


class CheckedArena(NamedTuple):
    """An arena and its faults."""

    arena: Arena
    faults: list[Fault]
    closed: list[ClosedFloor]
    """of at least ``ROOM_M2`` each, the largest first; floor around the building is among them"""


def check(arena: Arena) -> CheckedArena:
    """What is wrong with an arena: starts, rooms, patrols, goals, and the layouts of the first seeds."""
    solids = arena.wall_solids() + arena.placed_solids()
    faults = _starts(arena, solids)
    reachable, closed = closed_floor(arena)
    if reachable.data.any():
        faults += [_unreachable(room) for room in closed if not room.is_outside and not room.is_declared]
        try:
            patrol_points(render_exact(arena), arena.robots.center_m, arena.enclosure_m)
        except InputError as error:
            faults.append(Fault(str(error).removeprefix("prior_map: "), arena.robots.center_m))
    layouts: list[Layout] = []
    for seed in range(1, SEEDS + 1):
        try:
            layouts.append(place(arena, seed, 1))
            if layouts[-1].intruders:
                free_space(arena, GOAL_CLEARANCE_M, layouts[-1].stationary)  # of their goals
        except InputError as error:
            text = str(error).removeprefix(f"arena '{arena.name}': ")
            # a start that collides is listed already, with its place
            if not text.startswith("robots: ") and not any(fault.text == text for fault in faults):
                faults.append(Fault(text, None))
    faults += _never_seen(arena, reachable, layouts)
    return CheckedArena(arena, faults, closed)


def closed_floor(arena: Arena, ways: int = WAYS) -> tuple[OccupancyGrid, list[ClosedFloor]]:
    """Where a guard can drive, bool, and where it has room but cannot come, the largest piece first.

    The widest way is looked for into so many of the largest pieces inside.
    """
    floor = open_floor(arena, DRIVABLE_M, arena.placed_solids())
    reachable = floor.with_data(connected_to(*floor.cell_at(*arena.robots.center_m), floor.data))
    closed = (floor.data & ~reachable.data).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=4)
    room_m = cells_to_unset(np.pad(closed, 1))[1:-1, 1:-1]
    outside = border_labels(labels, arena, floor)
    cells = [floor.cell_at(*point) for point in arena.no_entry_m]
    declared = {int(labels[row, column]) for column, row in cells if floor.contains_cell(column, row)}
    pieces = []
    for label, (left, low, width, height, count) in enumerate(stats.tolist()):
        area_m2 = count * floor.resolution**2
        if label == 0 or area_m2 < ROOM_M2:
            continue
        part = (slice(low, low + height), slice(left, left + width))
        # the cell that is farthest from the piece's edge
        row, column = divmod(int(np.where(labels[part] == label, room_m[part], 0.0).argmax()), width)
        at = floor.center_of(left + column, low + row)
        pieces.append(ClosedFloor(area_m2, at, label in outside, label in declared, None))
    pieces.sort(key=lambda piece: -piece.area_m2)
    asked = [k for k, piece in enumerate(pieces) if not piece.is_outside and not piece.is_declared]
    for k in asked[:ways]:
        column, row = floor.cell_at(*pieces[k].at)
        room = floor.with_data(labels == labels[row, column])
        pieces[k] = pieces[k]._replace(way=widest_way(arena, room, reachable))
    return reachable, pieces


def _unreachable(room: ClosedFloor) -> Fault:
    widest = ""
    if room.way is not None:
        widest = f"; the widest, at {shown_place(room.way.at)}, has {room.way.width_m:.2f} m"
    return Fault(
        f"a room at {shown_place(room.at)} cannot be reached: no way to its {room.area_m2:.1f} m2 that a "
        f"Burger passes, which needs {2 * DRIVABLE_M:g} m{widest}; open a door or fill it",
        room.at,
    )


def widest_way(arena: Arena, room: OccupancyGrid, reachable: OccupancyGrid) -> Way | None:
    """The widest way from a piece of floor to what robots reach, None where there is none.

    Both are bool over the plane. A way leaves the rectangle about the piece by no more than 0.6 m.
    """
    rows, columns = np.nonzero(room.data)
    x, y = room.x_centers[columns], room.y_centers[rows]
    low = float(x.min()) - _WAY_MARGIN_M, float(y.min()) - _WAY_MARGIN_M
    sides = [float(np.ptp(axis)) + 2.0 * _WAY_MARGIN_M for axis in (x, y)]
    cell_m = max(_WAY_M, math.sqrt(sides[0] * sides[1] / _WAY_CELLS))
    width, height = (math.ceil(side / cell_m) for side in sides)
    fine = OccupancyGrid(np.zeros((height, width), np.bool_), cell_m, low)
    walls = marked(fine, arena.wall_solids() + arena.placed_solids(), 1e-6)
    room_m = (cells_to_unset(~walls.data) - 0.5) * cell_m
    ends = [_on(fine, part) & ~walls.data for part in (room, reachable)]
    if not ends[0].any() or not ends[1].any():
        return None
    least, most = 0, math.ceil(DRIVABLE_M / cell_m) + 1  # cells of room on either side of a way's middle
    if not _meet(room_m > least * cell_m, *ends):
        return None
    while most - least > 1:
        middle = (least + most) // 2
        least, most = (middle, most) if _meet(room_m > middle * cell_m, *ends) else (least, middle)
    way = (room_m > least * cell_m) | ends[0] | ends[1]
    steps = _steps(way, *ends) + _steps(way, *ends[::-1])
    rows, columns = np.nonzero(steps == steps.min())  # of a shortest way
    narrow = room_m[rows, columns] <= room_m[rows, columns].min() + 1e-6
    rows, columns = rows[narrow], columns[narrow]
    off_middle = np.square(rows - rows.mean()) + np.square(columns - columns.mean())
    nearest = int(off_middle.argmin())
    return Way((2 * least + 1) * cell_m, fine.center_of(int(columns[nearest]), int(rows[nearest])))


def _steps(way: Booleans, start: Booleans, end: Booleans) -> Indices:
    """(H, W) steps over set cells from ``start`` to each one no farther off than ``end``; many elsewhere."""
    steps = np.where(start, 0, way.size)
    seen, cross = start.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    for step in range(1, way.size):
        grown = cv2.dilate(seen, cross) * way
        new = (grown > 0) & (seen == 0)
        steps[new] = step
        if not new.any() or (new & end).any():
            break
        seen = grown.astype(np.uint8)
    return steps


def _on(grid: OccupancyGrid, part: OccupancyGrid) -> Booleans:
    """Which cells of a grid have their centre in set cells of another one."""
    columns = [part.cell_at(x, 0.0)[0] for x in grid.x_centers.tolist()]
    rows = [part.cell_at(0.0, y)[1] for y in grid.y_centers.tolist()]
    on_x = (np.array(columns) >= 0) & (np.array(columns) < part.width)
    on_y = (np.array(rows) >= 0) & (np.array(rows) < part.height)
    found = part.data[np.ix_(np.clip(rows, 0, part.height - 1), np.clip(columns, 0, part.width - 1))]
    return np.asarray(found & on_x & on_y[:, None])


def _meet(cells: Booleans, one: Booleans, other: Booleans) -> bool:
    """Whether cells lead from one set to another; both sets belong to them."""
    _, labels = cv2.connectedComponents((cells | one | other).astype(np.uint8), connectivity=4)
    return bool(np.intersect1d(labels[one], labels[other]).size)


def _starts(arena: Arena, solids: tuple[Solid, ...]) -> list[Fault]:
    """Starts of teams that stand in or at something."""
    faults = []
    for team in range(1, arena.robots.team + 1):
        starts = np.array([(pose.x, pose.y) for pose in robot_starts(arena, team)])
        gaps_m = np.min([solid.distance_to(starts) for solid in solids], axis=0)
        worst = int(gaps_m.argmin())
        if gaps_m[worst] < ROBOT_CLEARANCE_M:
            at = (float(starts[worst, 0]), float(starts[worst, 1]))
            text = (
                f"robots: guard {worst + 1} of {team} starts at {shown_place(at)}, "
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
            faults.append(
                Fault(f"{name} at {shown_place(at)}: no guard can ever see it within {range_m:g} m", at)
            )
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
        lit = lines[along[None] < free_m[:, None]]
        if values_at(reachable.data, reachable, lit, outside=False).any():
            return True
    return False


def shown_place(at: Point) -> str:
    """A place as lines name it."""
    return f"({at[0]:.2f}, {at[1]:.2f})"
