"""Labels of a recording, from a table or from topics with poses, and the boxes that match them."""

import itertools
import math
from bisect import bisect_left
from collections.abc import Sequence
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from midnet_bench.errors import InputError
from midnet_bench.geometry import Box
from midnet_bench.io.scan_logs import read_lines
from midnet_bench.recording.files.readings import NS
from midnet_bench.recording.files.tables import number_in, rows_of, time_in
from midnet_bench.recording.plan import AllyPlan
from midnet_bench.recording.replay import ReplayFrame
from midnet_bench.scoring.frame_counts import FrameMatch

SAME_NS = NS // 50  # a label that is no farther from a scan in time is taken for the scan's own
LARGEST_GAP_NS = NS // 2  # labels that lie farther apart leave a gap without a label
FAR = 1e6


class Label(NamedTuple):
    """One object that is to be found."""

    name: str
    x: float  # map frame, metres
    y: float


class Labels(NamedTuple):
    """What is known of a frame."""

    there: list[Label]
    gaps: list[Label]  # between two labels of one object that lie too far apart in time: where it may be now


class LabelTable:
    """``truth.csv``: t or scan_index, id, x, y; a row without id is a scan without intruders."""

    def __init__(self, path: Path) -> None:
        """Read it. Raises InputError: file, line and column of what is wrong."""
        self.by_index: dict[int, list[Label]] = {}
        self.by_time: dict[str, list[tuple[int, float, float]]] = {}
        self._index_ns: dict[int, int] = {}
        """of labels that have both, the time of their scan"""
        self._path, empty_ns = path, []
        for where, cells in rows_of(path, read_lines(path)):
            name, index = cells.get("id", ""), None
            if "scan_index" in cells:
                index = int(number_in(cells, "scan_index", where))
                if cells.get("t"):
                    self._index_ns[index] = time_in(cells, where)
                self.by_index.setdefault(index, [])
            if not name and not cells.get("x"):
                if index is None:
                    empty_ns.append(time_in(cells, where))
                continue
            x, y = number_in(cells, "x", where), number_in(cells, "y", where)
            name = name or "object"
            if index is not None:
                self.by_index[index].append(Label(name, x, y))
            else:
                self.by_time.setdefault(name, []).append((time_in(cells, where), x, y))
        for rows in self.by_time.values():
            rows.sort()
        self._empty_ns = sorted(empty_ns)
        if not (self.by_index or self.by_time or empty_ns):
            raise InputError(f"{path}: holds no label; give rows t,id,x,y or scan_index,id,x,y")

    def at(self, time_ns: int, scan_index: int | None) -> Labels | None:
        """What is known at a scan or an instant; None where it was not labelled.

        Raises:
            InputError: labels by scan_index where frames are at a rate, or whose t is of another scan.
        """
        if self.by_index:
            return self._at_index(time_ns, scan_index)
        found, gaps = list[Label](), list[Label]()
        first_empty = bisect_left(self._empty_ns, time_ns - SAME_NS)
        is_labelled = any(one <= time_ns + SAME_NS for one in self._empty_ns[first_empty : first_empty + 1])
        for name, rows in self.by_time.items():
            after = bisect_left(rows, time_ns, key=itemgetter(0))
            nearest = min(rows[max(after - 1, 0) : after + 1], key=lambda row: abs(row[0] - time_ns))
            if abs(nearest[0] - time_ns) <= SAME_NS:
                found.append(Label(name, *nearest[1:]))
            elif 0 < after < len(rows):
                (t0, x0, y0), (t1, x1, y1) = rows[after - 1], rows[after]
                share = (time_ns - t0) / (t1 - t0)
                between = Label(name, x0 + share * (x1 - x0), y0 + share * (y1 - y0))
                (found if t1 - t0 <= LARGEST_GAP_NS else gaps).append(between)
        return Labels(found, gaps) if found or is_labelled else None

    def _at_index(self, time_ns: int, scan_index: int | None) -> Labels | None:
        if scan_index is None:
            raise InputError(f"{self._path}: its labels have scan_index; with rate_hz give labels with t")
        there = self.by_index.get(scan_index)
        said_ns = self._index_ns.get(scan_index, time_ns)
        if abs(said_ns - time_ns) > LARGEST_GAP_NS:
            raise InputError(
                f"{self._path}: scan_index {scan_index} has t {said_ns / NS:.3f}, but that scan is of "
                f"{time_ns / NS:.3f} s; leave out the column that is wrong"
            )
        return None if there is None else Labels(there, [])

    @property
    def span(self) -> str:
        """From where to where labels go, in words."""
        if self.by_index:
            return f"scan_index {min(self.by_index)} to {max(self.by_index)}"
        every = [*self._empty_ns, *(row[0] for rows in self.by_time.values() for row in rows)]
        return f"t {min(every) / NS:.3f} to {max(every) / NS:.3f}"


class Truth:
    """The labels of a recording: of a table, or the recorded poses of intruders; or none."""

    def __init__(self, table: LabelTable | None, followed: Sequence[AllyPlan], max_age_s: float) -> None:
        """``followed``: intruders with recorded poses, which count up to an age of ``max_age_s``."""
        self._table, self.followed, self._max_age_s = table, followed, max_age_s

    def at(self, frame: ReplayFrame) -> Labels | None:
        """What is known at a frame; None where it was not labelled. Raises InputError, as the table does."""
        if self._table is not None:
            return self._table.at(frame.time_ns, frame.scan_index)
        labels = [
            Label(plan.name, estimate.pose.x, estimate.pose.y)
            for plan, estimate in frame.followed
            if estimate is not None and estimate.age_s <= self._max_age_s
        ]
        return Labels(labels, []) if labels else None

    @property
    def objects(self) -> int:
        """How many are labelled."""
        if self._table is None:
            return len(self.followed)
        every = itertools.chain(*self._table.by_index.values())
        return len({label.name for label in every} | self._table.by_time.keys())

    @property
    def span(self) -> str:
        """What there is, for a recording of which nothing is scored."""
        held = self._table and self._table.span
        return f"its labels have {held}" if held else "no pose of it lies at a frame"


def matched(boxes: Sequence[Box], labels: Sequence[Label], distance_m: float) -> FrameMatch:
    """Pairs of boxes and labels: as many as there can be, then the least sum of distances.

    A box is right for a label that lies in it or no farther than ``distance_m`` from its nearest point.
    """
    apart = np.array([[box.distance_to_point(one.x, one.y) for one in labels] for box in boxes])
    apart = apart.reshape(len(boxes), len(labels))
    touched = [np.flatnonzero(row <= distance_m).tolist() for row in apart]
    truth_of: list[int | None] = [None] * len(boxes)
    detection_of: list[int | None] = [None] * len(labels)
    if any(touched):
        # centres settle which of two boxes on one label is its own
        centres = np.array([[math.dist(box.center, (one.x, one.y)) for one in labels] for box in boxes])
        cost = np.where(apart <= distance_m, apart + 1e-3 * centres, FAR)
        rows, columns = linear_sum_assignment(cost)
        for box, label in zip(rows.tolist(), columns.tolist(), strict=True):
            if cost[box, label] < FAR:
                truth_of[box], detection_of[label] = label, box
    return FrameMatch(touched, truth_of, detection_of)
