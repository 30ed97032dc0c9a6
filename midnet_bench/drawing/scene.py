"""What the pictures of a guarded trial show, as plain data; metres, map frame."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from midnet_bench.arena.arena import Arena
from midnet_bench.arena.layout import Layout
from midnet_bench.geometry import Box, Floats, Point, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.robots.model import RobotModel
from midnet_bench.robots.turtlebot3 import BURGER
from midnet_bench.scoring.frame_counts import Ratios

if TYPE_CHECKING:  # which takes a compiler
    from midnet_bench.midnet.pipeline import Explanation


BURGER_LENGTH_M = float(np.ptp([x for x, _ in BURGER.body]))


def body_at(pose: Pose2D, enlarged: float = 1.0, model: RobotModel = BURGER) -> Floats:
    """(n, 2) the outline of a robot at ``pose``, ``enlarged`` times its true size."""
    return pose.transform(np.array(model.body) * enlarged)


@dataclass(frozen=True)
class FloorPlan:
    """What never moves in an arena."""

    title: str  # which trial it is, in a line
    enclosure: Box  # the walled region, from wall centre to wall centre
    walls: list[Floats]  # the outline of each wall, (n, 2)
    stationary: list[Floats]  # the outline of each stationary intruder, (n, 2)
    ground: OccupancyGrid | None = None
    """int8 map whose free cells are floor, of a place known by its map alone; else all of ``enclosure``"""
    shown: Box | None = None  # what pictures show; unless given, all of the place

    @classmethod
    def of(cls, arena: Arena, layout: Layout, seed: int) -> "FloorPlan":
        """The plan of an arena with the stationary intruders of a seed's layout."""
        x, y = (side / 2.0 for side in arena.enclosure_m)
        walls = [solid.outline for solid in arena.wall_solids()]
        stationary = [solid.outline for solid in layout.stationary]
        return cls(f"{arena.name}, seed {seed}", Box(-x, -y, x, y), walls, stationary)

    def hides(self, point: Point) -> bool:
        """Whether a point lies in a stationary intruder, under which goals are not drawn."""
        return any(
            cv2.pointPolygonTest(outline.astype(np.float32), point, False) >= 0 for outline in self.stationary
        )

    def view(self, margin_m: float) -> Box:
        """What a picture from above shows, ``margin_m`` around it: ``shown``, or enclosure and walls."""
        if self.shown is not None:
            return self.shown.shrunk(-margin_m)
        corners = np.concatenate([np.array(self.enclosure).reshape(2, 2), *self.walls, *self.stationary])
        return Box(*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist()).shrunk(-margin_m)


@dataclass(frozen=True)
class Setup:
    """What stays the same during a guarded trial."""

    plan: FloorPlan
    prior_map: OccupancyGrid  # int8: 100 occupied, 0 free, -1 unknown; before inflation
    prior: OccupancyGrid  # the binary grid that MIDNet subtracts, uint8: 0 occupied, 255 free
    guards: int
    mobile_intruders: int  # when the trial begins
    usable_range_m: float  # of a guard's LiDAR
    local_size_m: float  # side of a guard's local costmap
    frame_hz: float  # MIDNet frames per simulated second
    other_intruders: int = 0  # people and things that move
    shows_scans: bool = False  # whether pictures show the returns of the guards' LiDARs

    def window(self, guard: "Robot") -> Box:
        """A guard's local costmap: a square about its believed position."""
        return Box.square(guard.believed.x, guard.believed.y, self.local_size_m)


@dataclass(frozen=True)
class Robot:
    """A robot that is in the arena."""

    number: int  # counted from 1, guards and intruders apart
    is_guard: bool
    pose: Pose2D  # true pose
    believed: Pose2D  # pose by its own localization
    goal: Point | None
    plan: Floats | None  # (n, 2) its path to the goal
    model: RobotModel = BURGER

    @property
    def outline(self) -> Floats:
        """(n, 2) its body from above."""
        return body_at(self.pose, model=self.model)

    @property
    def sensor(self) -> Point:
        """Where its LiDAR is."""
        return self.pose.compose(self.model.lidar.mount)[:2]


@dataclass(frozen=True)
class Detection:
    """One fused detection."""

    box: Box
    guard: int  # number of the guard whose box it is, from 1
    is_false: bool  # whether it touches no intruder
    is_further: bool = False  # whether each intruder that it touches has another one as its own


@dataclass(frozen=True)
class Truth:
    """One intruder that is there, stationary or mobile."""

    outlines: Sequence[Floats]  # (n, 2) each: its body from above, of a person both legs
    is_found: bool  # whether a detection touches it
    in_range: bool  # whether not finding it is an error, by the trial's own rule

    @property
    def is_missed(self) -> bool:
        """Whether it is a false negative."""
        return self.in_range and not self.is_found

    @property
    def is_out_of_range(self) -> bool:
        """Whether it was not found and out of range."""
        return not self.in_range and not self.is_found


@dataclass(frozen=True)
class Chase:
    """How far the guards are in a trial that is about catching."""

    intruders: int  # when it began
    caught: int
    escaped: int
    events: Sequence[str] = ()  # catches and escapes so far, a line each, in order of time


@dataclass(frozen=True)
class Scene:
    """A trial at one instant. Intruders that were caught or have escaped are not in it."""

    time_s: float
    frame: int  # number of the MIDNet frame, from 1
    robots: list[Robot]  # guards first
    detections: list[Detection]
    truths: list[Truth]  # all intruders that the trial looks for, the stationary ones first
    explanation: "Explanation | None" = None
    """each guard's grids and boxes; without them, pictures show the detections alone"""
    others: Sequence[Sequence[Floats]] = ()
    """for each person or thing that intrudes, the outlines, (n, 2), of its legs or of itself"""
    chase: Chase | None = None  # in a trial that is about catching
    so_far: Ratios | None = None
    """precision and recall of all frames up to this one, in a trial that is about finding"""
    scans: Sequence[Floats] = ()
    """(n, 2) of each guard: the returns of its last scan, placed by its believed pose"""
    is_labelled: bool = True  # whether it is known where intruders are

    @property
    def counter(self) -> str:
        """How it stands, in a few words: catches, or intruders found at this instant."""
        if self.chase is not None:
            escaped = f", {self.chase.escaped} escaped" if self.chase.escaped else ""
            return f"caught {self.chase.caught} of {self.chase.intruders}{escaped}"
        if not self.is_labelled:
            return f"{len(self.detections)} detection{'s' * (len(self.detections) != 1)}, no labels"
        near = [truth.is_found for truth in self.truths if truth.in_range]
        found = f"found {sum(near)} of {len(near)}" if near else "no intruder"
        return f"{found} in range, {sum(detection.is_false for detection in self.detections)} false"

    @property
    def remark(self) -> str:
        """What is written beside the counter: the last catch or escape, or the scores so far; or nothing."""
        if self.chase is not None:
            return self.chase.events[-1] if self.chase.events else ""
        if self.so_far is None:
            return ""
        scores = {"recall": self.so_far.recall, "precision": self.so_far.precision}
        known = [f"{name} {value:.2f}" for name, value in scores.items() if not math.isnan(value)]
        return f"so far: {', '.join(known)}" if known else ""

    @property
    def guards(self) -> list[Robot]:
        """The guards."""
        return [robot for robot in self.robots if robot.is_guard]


@dataclass(frozen=True)
class Demo:
    """A trial that can be drawn frame by frame: what an experiment gives to ``midnet-bench render``."""

    setup: Setup
    max_frames: int  # the trial has no more; it may end earlier
    scenes: Iterator[Scene]  # one per MIDNet frame; each is simulated when it is drawn
