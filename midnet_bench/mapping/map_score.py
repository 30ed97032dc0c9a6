"""How good a built map is: its coverage, its walls and their places against the arena's true grid."""

import math
from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial import cKDTree

from midnet_bench.geometry import Booleans, Floats, Point
from midnet_bench.grid import (
    OCCUPIED_FROM,
    OccupancyGrid,
    cell_centers,
    cells_to_unset,
    connected_to,
    values_at,
)

_SLACK = 1e-6  # Keeps cells exactly one cell apart within one cell, whatever the rounding.


class MapScore(NamedTuple):
    """A map against the truth; NaN where there is nothing to count."""

    free_covered: float  # share of the free cells a robot can reach that the map knows, 0 to 1
    occupied_precision: float  # share of the map's occupied cells with a true occupied cell within one cell
    occupied_recall: float
    """share of the true occupied cells that face reachable space with one of the map's within one cell"""
    wall_error_m: float
    """mean distance from the map's occupied cells to the nearest true one, between centres, metres"""


def score_map(built: OccupancyGrid, truth: OccupancyGrid, start: Point, robot_radius_m: float) -> MapScore:
    """The four numbers for ``built``, which is in the frame of ``truth``.

    A reachable cell that the map takes for occupied counts as covered, because a wall's surface falls on
    either side of a cell's edge: a wrong wall shows in the precision. Recall counts the faces of walls
    alone, as no LiDAR sees the inside or the far side. Within one cell: at most one of the true grid's cells
    apart in x and in y, from centre to centre.

    Both grids are int8, -1 unknown, 0 to 100, occupied from 65 on; nothing is to be explored where ``truth``
    is -1. ``start``, ``robot_radius_m`` and errors: as for ``reachable_free``.
    """
    reachable, is_wall = reachable_free(truth, start, robot_radius_m), truth.data >= OCCUPIED_FROM
    known = values_at(built.data, built, cell_centers(truth, reachable), outside=-1) >= 0
    faces = is_wall & (cv2.dilate(reachable.view(np.uint8), np.ones((3, 3))) > 0)
    walls, found = cell_centers(truth, is_wall), cell_centers(built, built.data >= OCCUPIED_FROM)
    one_cell = truth.resolution * (1.0 + _SLACK)
    return MapScore(
        free_covered=_mean(known),
        occupied_precision=_mean(cKDTree(walls).query(found, p=math.inf)[0] <= one_cell),
        occupied_recall=_mean(cKDTree(found).query(cell_centers(truth, faces), p=math.inf)[0] <= one_cell),
        wall_error_m=_mean(cKDTree(walls).query(found)[0]),
    )


def reachable_free(truth: OccupancyGrid, start: Point, robot_radius_m: float) -> Booleans:
    """(H, W) bool: the free cells that a disc can cover, driving from ``start`` and touching nothing.

    Cells of ``truth``, int8, are obstacles from 65 on and where unknown. Raises ValueError if the disc does
    not fit at ``start``.
    """
    free = (truth.data >= 0) & (truth.data < OCCUPIED_FROM)
    # From centre to centre; an obstacle begins half a cell earlier, and so does the world beyond the grid.
    around = cells_to_unset(np.pad(free, 1))
    fits = (around[1:-1, 1:-1] - 0.5) * truth.resolution >= robot_radius_m
    within = connected_to(*truth.cell_at(*start), fits)
    if not within.any():
        raise ValueError(f"no robot of radius {robot_radius_m} m fits at ({start[0]}, {start[1]})")
    to_centres = cells_to_unset(~within)
    return free & ((to_centres - 0.5) * truth.resolution <= robot_radius_m)


def closed_spaces(truth: OccupancyGrid, start: Point, robot_radius_m: float) -> Booleans:
    """(H, W) bool: the free cells that ``reachable_free`` leaves out in pieces of a disc's area or more.

    Rooms without a door or with one too narrow; not the odd cells in corners that no disc can cover.
    Arguments and errors as for ``reachable_free``.
    """
    left = (truth.data >= 0) & (truth.data < OCCUPIED_FROM) & ~reachable_free(truth, start, robot_radius_m)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(left.view(np.uint8), connectivity=4)
    least_cells = math.pi * robot_radius_m * robot_radius_m / (truth.resolution * truth.resolution)
    rooms = [piece for piece in range(1, count) if stats[piece, cv2.CC_STAT_AREA] >= least_cells]
    return np.isin(labels, rooms)


def _mean(values: Booleans | Floats) -> float:
    return math.fsum(values.tolist()) / len(values) if len(values) else math.nan
