"""``start_of_guards``: where a team may start in an arena that was drawn without one."""

import cv2
import numpy as np

from midnet_bench.agents.patrol import DRIVABLE_M
from midnet_bench.arena.arena import Arena, RobotStarts
from midnet_bench.arena.free_space import GOAL_CLEARANCE_M, border_labels, open_floor
from midnet_bench.arena.layout import ROBOT_CLEARANCE_M, robot_starts
from midnet_bench.errors import InputError
from midnet_bench.geometry import Booleans, Point
from midnet_bench.grid import OccupancyGrid, connected_to

SPACINGS_M = (0.6, 0.45, 0.3)
"""between the starts of two guards: as in Map 1, else the widest at which the team fits"""
ROOM_SHARE = 0.05  # A room inside has at least this share of the floor of the largest one.


def start_of_guards(arena: Arena, team: int, inside: Point | None = None) -> RobotStarts:
    """Where a team may start: all teams up to its size fit there, near the middle of the largest room.

    A room is the floor that a Burger can drive to from one place. One that the enclosure's edge does not cut
    comes first, if it is no mere nook: what lies around a building is no room of it. Where so many guards fit
    nowhere in that room, fewer start: the ``team`` that comes back.

    Args:
        arena: its walls; its robots and intruders do not matter.
        team: how many guards are to start, at most.
        inside: a place in the room to take instead of the largest, metres, map frame.

    Raises:
        InputError: there is no room for a guard, or none at ``inside``.
    """
    drivable, roomy = open_floor(arena, DRIVABLE_M), open_floor(arena, GOAL_CLEARANCE_M)
    if not drivable.data.any():
        raise InputError(f"there is no floor in it that is {2 * DRIVABLE_M:g} m wide, as a guard needs")
    if not roomy.data.any():
        raise InputError(
            f"there is no room for a guard: no floor in it is {2 * GOAL_CLEARANCE_M:g} m wide, and goals keep"
            f" {GOAL_CLEARANCE_M:g} m from walls"
        )
    if inside is None:
        room = _largest_room(arena, drivable, roomy.data)
    else:
        room = connected_to(*drivable.cell_at(*inside), drivable.data)
        if not (room & roomy.data).any():
            raise InputError(
                f"there is no room for a guard at ({inside[0]:g}, {inside[1]:g}): give a place on floor"
                f" that is {2 * GOAL_CLEARANCE_M:g} m wide somewhere, in metres as the arena's picture has it"
            )
    middle = _largest_piece(roomy.data & room)
    # a start lies up to half a cell's diagonal from the centre of its cell
    clear_m = ROBOT_CLEARANCE_M + 0.7072 * drivable.resolution
    standing = open_floor(arena, clear_m).data & room
    found = RobotStarts(center_m=_nearest_to_middle(drivable.with_data(middle)), team=1)
    for spacing_m in SPACINGS_M:
        size, fits = _largest_team(arena, drivable.with_data(standing), middle, team, spacing_m)
        if size > found.team:
            center_m = _nearest_to_middle(drivable.with_data(fits))
            found = RobotStarts(center_m=center_m, spacing_m=spacing_m, team=size)
        if size == team:
            break
    return found


def _largest_room(arena: Arena, drivable: OccupancyGrid, roomy: Booleans) -> Booleans:
    """The largest room that has a roomy cell."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(drivable.data.astype(np.uint8), connectivity=4)
    areas = np.zeros(len(stats), np.int64)
    with_room = np.unique(labels[roomy])
    areas[with_room] = stats[with_room, cv2.CC_STAT_AREA]
    areas[0] = 0
    inner = areas.copy()
    inner[[*border_labels(np.asarray(labels), arena, drivable)]] = 0
    is_inside = inner.max() >= ROOM_SHARE * areas.max()
    return np.asarray(labels == (inner if is_inside else areas).argmax())


def _largest_piece(cells: Booleans) -> Booleans:
    _, labels, stats, _ = cv2.connectedComponentsWithStats(cells.astype(np.uint8), connectivity=4)
    return np.asarray(labels == 1 + stats[1:, cv2.CC_STAT_AREA].argmax())


def _largest_team(
    arena: Arena, standing: OccupancyGrid, middle: Booleans, team: int, spacing_m: float
) -> tuple[int, Booleans]:
    """Up to which size, at most ``team``, all teams fit about one place of ``middle``, and where that is."""
    about_origin = arena.model_copy(update={"robots": RobotStarts(spacing_m=spacing_m)})
    fits = standing.data & middle
    for size in range(2, team + 1):
        more = fits.copy()
        for pose in robot_starts(about_origin, size):
            up, right = (round(part / standing.resolution) for part in (pose.y, pose.x))
            more &= _moved(standing.data, up, right)
        if not more.any():
            return size - 1, fits
        fits = more
    return team, fits


def _moved(cells: Booleans, up: int, right: int) -> Booleans:
    """Each cell as the one so many rows and columns from it is; unset where that lies off the grid."""
    moved = np.zeros_like(cells)
    height, width = cells.shape
    low, high, left, end = max(-up, 0), height - max(up, 0), max(-right, 0), width - max(right, 0)
    if low < high and left < end:
        moved[low:high, left:end] = cells[low + up : high + up, left + right : end + right]
    return moved


def _nearest_to_middle(cells: OccupancyGrid) -> tuple[float, float]:
    """The centre of the set cell that is nearest to the mean of all of them, map frame, metres."""
    x, y, count = cells.x_centers, cells.y_centers, np.count_nonzero(cells.data)
    middle_x, middle_y = (
        (cells.data.sum(axis=0) * x).sum() / count,
        (cells.data.sum(axis=1) * y).sum() / count,
    )
    away = np.square(x - middle_x) + np.square(y - middle_y)[:, None]
    row, column = divmod(int(np.where(cells.data, away, np.inf).argmin()), cells.width)
    return round(float(x[column]), 6), round(float(y[row]), 6)
