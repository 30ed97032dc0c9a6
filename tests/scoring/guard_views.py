"""A guard's view of a scene by hand: a few returns, and what sections IV.A and IV.B make of them."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from midnet_bench.geometry import Box, Point
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.detection import FREE, OCCUPIED, bounding_boxes, common_occupancy, foreground
from midnet_bench.scoring.diagnosis import Cause, GuardView, Marks, SightLines, moved
from midnet_bench.scoring.frame_counts import TruthObject

RESOLUTION_M = 0.05
REACH_M = 0.1
HALF_M = 2.0  # the prior map reaches so far from the origin, to all four sides
_STEPS = range(-2, 3)
DISC = np.array([(x, y) for x in _STEPS for y in _STEPS if math.hypot(x, y) * RESOLUTION_M <= REACH_M])
_NOBODY: Point = (0.0, 0.0)


def intruder(x: float, y: float, side_m: float = 0.1, name: str = "intruder 1") -> TruthObject:
    return TruthObject(name, Box.square(x, y, side_m), (x, y))


def assert_is(cause: Cause, expected: Cause) -> None:
    assert cause[:3] == expected[:3]
    assert cause[3:] == pytest.approx(expected[3:])


def returns(
    source: int,
    *true: Point,
    age_s: float = 0.1,
    is_newest: bool = True,
    pose: Point = _NOBODY,
    noise: Point = _NOBODY,
) -> Marks:
    """From one source at true places, put off by the guard's ``pose`` and the range's ``noise``."""
    places, off, further = np.array(true).reshape(-1, 2), np.array(pose), np.array(noise)
    count = len(places)
    return Marks(
        np.full(count, source),
        np.full(count, age_s),
        np.full(count, is_newest),
        believed=places + off + further,
        at_true_pose=places + further,
        at_true_range=places + off,
        true=places,
    )


def together(*parts: Marks) -> Marks:
    if not parts:
        return returns(0)
    return Marks(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def sight(sensor: Point, beams: Mapping[float, tuple[float, int]]) -> SightLines:
    """``beams``: of each by its direction in degrees how far it goes, metres, and whom it meets."""
    angles = np.radians(list(beams))
    ranges_m, sources = zip(*beams.values(), strict=True)
    return SightLines(
        np.stack((np.cos(angles), np.sin(angles)), axis=1), np.array(ranges_m), np.array(sources)
    )


def guard_view(
    *scans: Marks,
    truths: Sequence[TruthObject],
    guard: int = 0,
    walls: Sequence[Box] = (),
    shift_cells: tuple[int, int] = (0, 0),
    cleared: Box | None = None,
    window: Box | None = None,
    min_area_cells: int = 1,
    deflated_m: float = 0.0,
    beams: Mapping[float, tuple[float, int]] | None = None,
    in_reach: bool = True,
    taken: Mapping[int, int] | None = None,
    centers_at_scan: Sequence[Point] | None = None,
    detects: bool = True,
) -> GuardView:
    """From a sensor at (0, 0).

    Args:
        scans: what came back, of the last scan and of older ones.
        truths: the intruders as they are now.
        guard: its index.
        walls: what the inflated prior map covers.
        shift_cells: by which the crop moves the costmap's cells.
        cleared: where marks were cleared again.
        window: the costmap before that shift; else larger than the prior map.
        min_area_cells: of MIDNet.
        deflated_m: taken off each side of the boxes.
        beams: as :func:`sight` takes them.
        in_reach: whether the returns of the last scan are within the obstacle range.
        taken: box -> the ally that it was removed for, by index.
        centers_at_scan: of the truths; else where they are now.
        detects: False for another detector than MIDNet's, which explains nothing.
    """
    marks = together(*scans)
    shift_m = (shift_cells[0] * RESOLUTION_M, shift_cells[1] * RESOLUTION_M)
    window = window or Box.square(0.0, 0.0, 3.0 * HALF_M)
    cells = round(2.0 * HALF_M / RESOLUTION_M)
    origin = (-HALF_M, -HALF_M)
    prior = OccupancyGrid(np.full((cells, cells), FREE, np.uint8), RESOLUTION_M, origin)
    for wall in walls:
        prior.data[_within(prior, wall)] = OCCUPIED
    a = prior.with_data(np.full((cells, cells), FREE, np.uint8))
    is_marked = np.array(
        [
            window.distance_to_point(*place) == 0.0
            and (cleared is None or cleared.distance_to_point(*place) > 0.0)
            for place in marks.believed.tolist()
        ],
        dtype=np.bool_,
    )
    for x, y in (marks.believed[is_marked] + shift_m).tolist():
        middle = np.array(a.cell_at(x + 1e-9, y + 1e-9))
        for column, row in (DISC + middle).tolist():
            if a.contains_cell(column, row):
                a.data[row, column] = OCCUPIED
    d = foreground(a.data, common_occupancy(a.data, prior.data))
    boxes = bounding_boxes(d, (0, 0), prior, min_area_cells).tolist()
    found = [Box._make(box).shrunk(deflated_m) for box in boxes]
    newest = marks.where(marks.is_newest)

    def of(source: int) -> tuple[Marks, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
        own = newest.where(newest.source == source)
        return own, np.full(len(own.source), in_reach)

    centers = [truth.center for truth in truths] if centers_at_scan is None else centers_at_scan
    return GuardView(
        guard=guard,
        sensor=(0.0, 0.0),
        lines=lambda: sight((0.0, 0.0), beams or {}),
        returns=of,
        marks=lambda: marks.where(is_marked),
        shift_m=shift_m,
        window=moved(window, shift_m),
        reach_m=REACH_M,
        a=a if detects else None,
        d=a.with_data(d) if detects else None,
        prior=prior if detects else None,
        disc=DISC,
        deflated_m=deflated_m,
        found=found if detects else [],
        taken=[(taken or {}).get(k) for k in range(len(found))] if detects else [],
        centers_at_scan=lambda: np.array(centers, dtype=np.float64).reshape(-1, 2),
    )


def _within(grid: OccupancyGrid, box: Box) -> tuple[slice, slice]:
    """Rows and columns of the cells that a box of whole cells covers."""
    x0, y0 = (round((value + HALF_M) / grid.resolution) for value in box[:2])
    x1, y1 = (round((value + HALF_M) / grid.resolution) for value in box[2:])
    return slice(max(y0, 0), y1), slice(max(x0, 0), x1)
