"""What stays put and is not on the map: as a list, and as cells to be added to it."""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.binary_map import FREE
from midnet_bench.recording.ray_counts import RayCounts


class Unmapped(NamedTuple):
    """One thing that stays put; map frame, metres, seconds of the scans' clock."""

    x_min_m: float
    y_min_m: float
    x_max_m: float
    y_max_m: float
    cells: int
    hits: int
    first_s: float
    """when it was hit first"""
    last_s: float


def unmapped(
    counts: RayCounts, prior_map: OccupancyGrid, prior: OccupancyGrid
) -> tuple[list[Unmapped], OccupancyGrid]:
    """What stays put off the map's inflated walls, and the map with its cells occupied.

    Args:
        counts: of the whole recording, on the map's lattice; they may reach beyond the map.
        prior_map: int8, 100 occupied.
        prior: the grid that is subtracted, uint8, 0 occupied.
    """
    stays = counts.stays()
    row, column = (
        round((prior_map.origin[axis] - counts.origin[axis]) / counts.resolution_m) for axis in (1, 0)
    )
    place = (slice(row, row + prior_map.height), slice(column, column + prior_map.width))
    on_map = stays[place] & (prior.data == FREE)
    patched = prior_map.data.copy()
    patched[on_map] = 100
    joined = cv2.dilate(on_map.astype(np.uint8), np.ones((3, 3), np.uint8))
    number, blobs = cv2.connectedComponents(joined, connectivity=8)
    hits, first_s, last_s = (part[place] for part in (counts.hits, counts.first_s, counts.last_s))
    found = []
    for blob in range(1, number):
        cells = on_map & (blobs == blob)
        rows, columns = np.nonzero(cells)
        x0, y0 = prior_map.origin
        cell_m = prior_map.resolution
        began_s = counts.began_s or 0.0
        found.append(
            Unmapped(
                x0 + float(columns.min()) * cell_m,
                y0 + float(rows.min()) * cell_m,
                x0 + float(columns.max() + 1) * cell_m,
                y0 + float(rows.max() + 1) * cell_m,
                len(rows),
                int(hits[cells].sum()),
                began_s + float(first_s[cells].min()),
                began_s + float(last_s[cells].max()),
            )
        )
    return sorted(found, key=lambda one: -one.hits), prior_map.with_data(patched)


def csv_of(things: Sequence[Unmapped]) -> str:
    """A table with a row for each."""
    lines = [",".join(Unmapped._fields)]
    for one in things:
        lines.append(",".join(f"{cell:.3f}" if isinstance(cell, float) else str(cell) for cell in one))
    return "\n".join(lines) + "\n"
