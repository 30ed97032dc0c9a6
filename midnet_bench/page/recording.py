"""A recorded trial as the page's player takes it: whole numbers, as differences, deflated, in base64.

``trial.js`` is the other side of this file.
"""

import base64
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Point

if TYPE_CHECKING:
    from midnet_bench.drawing.scene import FloorPlan

STEP_MM = 5  # lengths and places on the page are whole multiples of it, angles of as many milliradians
COLUMNS: Mapping[str, tuple[str, ...]] = {
    "robots": ("robot", "here", "x", "y", "yaw", "off_x", "off_y", "off_yaw", "goal", "goal_x", "goal_y"),
    "truths": ("name", "x", "y", "width", "height", "counts", "detection"),
    "found": ("track", "x", "y", "width", "height", "ally"),
    "detections": ("track", "x", "y", "width", "height", "truth"),
    "errors": ("who", "kind", "cause", "guard", "by", "age", "offset", "x", "y", "width", "height"),
}
"""What each row of a frame holds, list by list; by the first column a row is known from frame to frame.

Names and causes are places in :attr:`Recording.words`; indices count from 1, 0 is none. ``off_...`` is
the estimated pose of a guard less its true one; ``goal`` is 0 for none, 1 for a goal, 2 for a target.
``track`` is a guard and ``TEAM`` times a number of its own, see :func:`tracked`. ``kind`` is a place in
:data:`KINDS`, ``age`` is in hundredths of a second.
"""
SCAN_COLUMNS: Mapping[str, tuple[str, ...]] = {
    "sensors": ("guard", "here", "x", "y", "yaw"),
    "beams": ("beam", "range"),
}
"""the same of the scans: beams of all guards, guard by guard; ``range`` in steps, 128 for none"""
TEAM = 32  # more than there are guards
NEAR = 40  # a box moves less than so many steps from frame to frame, along x and y together
KINDS = ("miss", "false", "fragment")

Rows = Sequence[Sequence[int]] | npt.NDArray[np.int64]
Words = npt.NDArray[np.uint16]


class Event(NamedTuple):
    """An event of an intruder."""

    frame: int  # counted from 1
    what: str  # a word for it, such as ``caught``
    text: str


@dataclass(frozen=True)
class Recording:
    """One trial; lengths in ``STEP_MM``, map frame."""

    cell: str  # the cell's name, such as ``5-robot``
    seed: int
    plan: "FloorPlan"
    hz: float  # frames per simulated second
    robots: Sequence[tuple[str, bool]]  # name, and whether it is a guard; guards first
    body: "Sequence[Point]"  # outline of a robot about its base frame, metres
    beams: tuple[float, float, float]
    """angles of a LiDAR's first beam and from each recorded one to the next, radians, and the metres of a
    step of ``range``"""
    words: Sequence[str]  # names of intruders and causes
    frames: Mapping[str, Sequence[Rows]]  # list -> for each frame its rows; see :data:`COLUMNS`
    scans: Mapping[str, Sequence[Rows]]  # likewise; see :data:`SCAN_COLUMNS`
    explained: bool
    """whether errors have causes; else ``errors`` is empty and the player finds misses and false boxes"""
    window_m: float | None = None  # side of a guard's local costmap, metres; None where it is not known
    range_m: float | None = None  # usable range of a guard's LiDAR, metres; None where it is not known
    sensor: tuple[float, float] = (0.0, 0.0)  # x, y of the LiDAR about a robot's base frame, metres
    events: Sequence[Event] = field(default=())
    summary: str = ""  # what came of the trial, in a line

    def head(self) -> dict[str, Any]:
        """What the page has of it without unpacking anything, ready for JSON."""
        return {
            "cell": self.cell,
            "seed": self.seed,
            "hz": self.hz,
            "robots": [{"name": name, "guard": is_guard} for name, is_guard in self.robots],
            "body": [list(point) for point in self.body],
            "beams": self.beams,
            "window": self.window_m,
            "range": self.range_m,
            "sensor": self.sensor,
            "words": list(self.words),
            "explained": self.explained,
            "events": [list(event) for event in self.events],
            "summary": self.summary,
            "frames": len(self.frames["robots"]),
            "errors": sum(map(len, self.frames["errors"])),
            "plan": _plan(self.plan),
        }


def tracked(frames: Sequence[Rows]) -> list[Rows]:
    """Rows of (guard, x, y, ...) with (track, x, y, ...): a box near one of the frame before has its track.

    A box is packed as its difference from the last one of its track, which is small.
    """
    before: dict[int, Sequence[int]] = {}
    result: list[Rows] = []
    for rows in frames:
        now: dict[int, Sequence[int]] = {}
        for guard, *box in rows:
            far = {
                track: abs(box[0] - was[0]) + abs(box[1] - was[1])
                for track, was in before.items()
                if track % TEAM == guard and track not in now
            }
            track = min(far, key=far.__getitem__, default=-1)
            if track < 0 or far[track] >= NEAR:
                track = guard
                while track in now or track in before:
                    track += TEAM
            now[track] = box
        before = now
        result.append([[track, *box] for track, box in now.items()])
    return result


def packed(columns: Mapping[str, Sequence[str]], frames: Mapping[str, Sequence[Rows]]) -> str:
    """Lists of rows, frame by frame, as text.

    Of each list first how many rows each frame has; then column by column: the first less the number in
    the same place of the frame before, the others less that of the last row with the same first number;
    0, -1, 1, -2 becoming 0, 1, 2, 3, all low bytes before all high bytes. The whole is deflated (zlib) and
    in base64.
    """
    parts = [part for name, names in columns.items() for part in _columns(frames[name], len(names))]
    planes = [plane.astype(np.uint8).tobytes() for part in parts for plane in (part & 0xFF, part >> 8)]
    return base64.b64encode(zlib.compress(b"".join(planes), 9)).decode()


def _columns(frames: Sequence[Rows], width: int) -> Iterable[Words]:
    counts = np.array([len(rows) for rows in frames], dtype=np.int64)
    values = np.concatenate([np.asarray(rows, dtype=np.int64).reshape(-1, width) for rows in frames])
    starts = np.cumsum(counts) - counts
    frame = np.repeat(np.arange(len(counts)), counts)
    place = np.arange(len(values)) - starts[frame]
    in_same_place = np.where(place < counts[frame - 1], starts[frame - 1] + place, -1)
    in_same_place[frame == 0] = -1
    by_key = np.argsort(values[:, 0], kind="stable")
    of_same_key = np.full(len(values), -1)
    same = values[by_key[1:], 0] == values[by_key[:-1], 0]
    of_same_key[by_key[1:][same]] = by_key[:-1][same]
    yield _zigzag(np.diff(counts, prepend=0))
    for number, column in enumerate(values.T):
        before = of_same_key if number else in_same_place
        yield _zigzag(column - np.where(before >= 0, column[before], 0))


def _zigzag(differences: npt.NDArray[np.int64]) -> Words:
    short = differences.astype(np.int16)  # beyond it the sum wraps, there and here
    return ((short << 1) ^ (short >> 15)).astype(np.uint16)


def _plan(plan: "FloorPlan") -> dict[str, Any]:
    view = plan.view(margin_m=0.3)
    outlines = {"walls": plan.walls, "stationary": plan.stationary}
    return {
        "title": plan.title,
        "view": [round(side, 3) for side in view],
        "enclosure": [round(side, 3) for side in plan.enclosure],
        **{name: [np.round(one, 3).reshape(-1).tolist() for one in each] for name, each in outlines.items()},
    }
