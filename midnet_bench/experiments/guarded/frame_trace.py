"""``FrameTrace``: what each return of the guards' LiDARs hit, and what became of it.

It keeps each guard's scans and, for every cell, the beam that marked it last. What came of a beam is worked
out only for frames with errors.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache, cached_property, partial

import numpy as np

from midnet_bench.agents.mobile_robot import Guard
from midnet_bench.detectors.detector_node import DetectorNode
from midnet_bench.elementary import cos_sin
from midnet_bench.experiments.guarded.guarded_arena import GuardedArena
from midnet_bench.geometry import Box, Scan, Solid, lengths
from midnet_bench.midnet.detection import Crop
from midnet_bench.midnet.pipeline import Frame
from midnet_bench.navigation.costmap import LETHAL, inflate, inflation_costs, published, reach_cells
from midnet_bench.scoring.diagnosis import (
    NOTHING,
    WALL,
    Booleans,
    Cause,
    Floats,
    GuardView,
    Ints,
    Marks,
    SightLines,
    ally,
    false_box_cause,
    miss_cause,
    moved,
)
from midnet_bench.scoring.frame_counts import FrameMatch, TruthObject
from midnet_bench.simulation import sensors as beams_met

FORGET_EVERY = 50
"""scans"""
ON_SURFACE_M = 0.005
"""A true return this near to a stationary intruder, a person or a thing is one of its own."""


class TracedScan:
    """One scan of one guard, and the world at that instant."""

    def __init__(
        self, trial: GuardedArena, scan: Scan, true: beams_met.NoiseFreeScan, corner: tuple[int, int]
    ) -> None:
        """``true``: what its beams met, of this one LiDAR; ``corner``: column and row of the costmap then."""
        self.corner = corner
        self.time_s = scan.stamp_s
        self.ranges_m = scan.ranges_m
        self.sensor = scan.pose.compose(scan.lidar.mount)
        self.lidar = scan.lidar
        self._axis, self._directions = true.beams.axes[0], true.beams.directions[0]
        self._true_ranges_m, self._bodies = true.ranges_m[0], true.bodies[0]
        self._trial = trial
        self._solids = solids_of(trial)
        self._poses = trial.world.poses()
        self._others = [member.extent().center for member in trial.crowd.members]

    @cached_property
    def sources(self) -> Ints:
        """(beams,) what each return came from, as ``Marks`` has it."""
        return sources_of(self._trial, self._bodies, self.true, self._solids)

    @cached_property
    def believed(self) -> Floats:
        """(beams, 2) where the guard put each return, map frame, metres."""
        return self._ends(self.sensor[:2], self.believed_directions, self.ranges_m)

    @cached_property
    def at_true_pose(self) -> Floats:
        """(beams, 2) where the guard would have put them by its true pose."""
        return self._ends(self._axis, self._directions, self.ranges_m)

    @cached_property
    def at_true_range(self) -> Floats:
        """(beams, 2) where the guard would have put them without noise."""
        return self._ends(self.sensor[:2], self.believed_directions, self._true_ranges_m)

    @cached_property
    def true(self) -> Floats:
        """(beams, 2) what the beams met."""
        return self._ends(self._axis, self._directions, self._true_ranges_m)

    @cached_property
    def centers(self) -> Floats:
        """(truths, 2) where the truths were, in the order of ``DetectionTrial.truths``."""
        trial = self._trial
        still = [solid.bounding_box().center for solid in trial.layout.stationary]
        rows = [robot.index for robot in trial.intruders]
        mobile = trial.lidars.centers(self._poses[rows])
        return np.vstack((np.array(still).reshape(-1, 2), mobile, np.array(self._others).reshape(-1, 2)))

    def reached(self, range_m: float) -> Ints:
        """The beams that a costmap with this obstacle range takes for returns."""
        low = self.lidar.range_min_m
        return np.flatnonzero((self.ranges_m >= low) & (self.ranges_m < range_m))

    def marks(self, beams: Ints, now_s: float, is_newest: bool) -> Marks:
        """The returns of some beams, as they are at ``now_s``; ``is_newest``: whether no scan is newer."""
        return Marks(
            self.sources[beams],
            np.full(len(beams), now_s - self.time_s),
            np.full(len(beams), is_newest),
            self.believed[beams],
            self.at_true_pose[beams],
            self.at_true_range[beams],
            self.true[beams],
        )

    @cached_property
    def believed_directions(self) -> Floats:
        """(beams, 2) unit vectors, map frame, by the guard's own heading."""
        c, s = cos_sin(self.sensor.yaw)
        x, y = self.lidar.directions.T
        return np.stack((c * x - s * y, s * x + c * y), axis=1)

    @staticmethod
    def _ends(axis: Sequence[float] | Floats, directions: Floats, ranges_m: Floats) -> Floats:
        known = np.where(np.isfinite(ranges_m), ranges_m, 0.0)
        return np.asarray(np.asarray(axis) + known[:, None] * directions)


def solids_of(trial: GuardedArena) -> list[tuple[int, Solid]]:
    """What of the truths is no robot, as it stands now: the index of a truth, and a solid of it."""
    first = len(trial.layout.stationary) + len(trial.intruders)
    still = list(enumerate(trial.layout.stationary))
    return still + [(first + k, one) for k, other in enumerate(trial.crowd.members) for one in other.solids()]


def sources_of(trial: GuardedArena, bodies: Ints, ends: Floats, solids: Sequence[tuple[int, Solid]]) -> Ints:
    """(beams,) what each beam met, as ``Marks`` has it: ``bodies`` of LiDARs, ``ends`` (beams, 2)."""
    first = len(trial.layout.stationary)
    robots = [ally(k) for k in range(len(trial.guards))] + [first + k for k in range(len(trial.intruders))]
    found = np.full(len(bodies), NOTHING, dtype=np.int64)
    is_robot, is_solid = bodies >= 0, bodies == beams_met.SOLID
    found[is_robot] = np.array(robots)[bodies[is_robot]]
    points = ends[is_solid]
    solid = np.full(len(points), WALL)
    for truth, one in solids:
        solid[one.distance_to(points) < ON_SURFACE_M] = truth
    found[is_solid] = solid
    return found


class FrameTrace:
    """What one detector of a trial received, and from it the cause of each of its errors."""

    def __init__(self, trial: GuardedArena, node: DetectorNode) -> None:
        """From now on every scan of the guards is traced."""
        self._trial, self._node = trial, node
        settings = node.costmaps[0].settings
        self._settings = settings
        # farther out no cell was marked while its window reached there
        self._margin = reach_cells(settings.obstacle_range_m, settings.resolution) + 2
        height, width = node.prior.data.shape
        shape = (len(trial.guards), height + 2 * self._margin, width + 2 * self._margin)
        self._scan = np.full(shape, -1, dtype=np.int64)
        self._beam = np.zeros(shape, dtype=np.int64)
        self._scans: list[dict[int, TracedScan]] = [{} for _ in trial.guards]
        self._counts = [0] * len(trial.guards)
        self._written = [0] * len(trial.guards)
        self.guards = trial.guards
        trial.add_scan_callback(node, self._add_scan)

    def causes(
        self,
        frame: Frame,
        truths: Sequence[TruthObject],
        match: FrameMatch,
        in_range: Sequence[bool],
        guards_near: Callable[[int], Sequence[int]],
    ) -> tuple[dict[int, Cause], dict[int, Cause]]:
        """Of the newest frame, by index: why missed intruders were lost, what left over boxes are made of.

        Args:
            frame: with its explanation, where the detector gives one.
            truths: as they are now.
            match: of the frame's boxes and the truths.
            in_range: for each truth, whether missing it counts.
            guards_near: truth -> the indices of the guards that have it in range.
        """
        missed = [
            index
            for index, (counts, box) in enumerate(zip(in_range, match.detection_of, strict=True))
            if counts and box is None
        ]
        left_over = [index for index, truth in enumerate(match.truth_of) if truth is None]
        if not missed and not left_over:
            return {}, {}
        views = [self._view(guard, frame) for guard in range(len(self.guards))]
        return (
            {
                index: miss_cause(index, truths, frame.detections, [views[g] for g in guards_near(index)])
                for index in missed
            },
            {
                index: false_box_cause(frame.detections[index], frame.robots[index], truths, views)
                for index in left_over
            },
        )

    def _view(self, guard: int, frame: Frame) -> GuardView:
        """What a guard's detections of one frame came from; what takes time is found at its first use."""
        a = d = prior = None
        shift_m, deflated_m = (0.0, 0.0), 0.0
        found: list[Box] = []
        taken: dict[Box, int] = {}
        if frame.explanation is not None:
            view, prior = frame.explanation.views[guard], self._node.prior
            a, d, found, shift_m = view.a, view.d, view.found, self._shift_m(guard, view.crop)
            deflated_m = self._node.midnet.settings.deflate_boxes_m
            taken = {
                removed.detection.box: removed.ally
                for removed in frame.explanation.removed
                if removed.detection.robot == guard
            }
        return GuardView(
            guard=guard,
            sensor=self._trial.sensor_positions()[guard],
            lines=partial(self.lines, guard),
            returns=partial(self.returns, guard),
            marks=cache(partial(self.marks, guard)),
            shift_m=shift_m,
            window=moved(self._node.window(guard), shift_m),
            reach_m=self.reach_m,
            a=a,
            d=d,
            prior=prior,
            disc=self.disc,
            found=found,
            deflated_m=deflated_m,
            taken=[taken.get(box) for box in found],
            centers_at_scan=partial(self.centers_at_scan, guard),
        )

    def _add_scan(self, guard: Guard, scan: Scan, true: beams_met.NoiseFreeScan) -> None:
        number = self._counts[guard.index]
        self._counts[guard.index] += 1
        layer = self._node.costmaps[guard.index].layer
        self._scans[guard.index][number] = TracedScan(self._trial, scan, true, (layer.column, layer.row))
        if number % FORGET_EVERY == 0:
            self._forget(guard.index)

    def _put(self, guard: int) -> None:
        """Write the beams of scans that are not yet there into the cells that they marked."""
        since, self._written[guard] = self._written[guard], self._counts[guard]
        oldest_s = self.now_s - self._settings.memory_s - 1.0
        for number in range(since, self._counts[guard]):
            scan = self._scans[guard].get(number)
            if scan is None or scan.time_s < oldest_s:
                continue
            beams = scan.reached(self._settings.obstacle_range_m)
            columns, rows = self._cells(scan, beams)
            on = self._is_on(columns, rows)
            place = guard, rows[on], columns[on]
            self._scan[place] = number
            self._beam[place] = beams[on]

    def _is_on(self, columns: Ints, rows: Ints) -> Booleans:
        height, width = self._scan.shape[1:]
        return np.asarray((columns >= 0) & (rows >= 0) & (columns < width) & (rows < height))

    def _forget(self, guard: int) -> None:
        """Drop the scans of which no mark can be left."""
        scans, memory_s = self._scans[guard], self._settings.memory_s
        if math.isinf(memory_s):
            self._put(guard)
            needed = {*np.unique(self._scan[guard]).tolist(), self._counts[guard] - 1}
            kept = {number: scan for number, scan in scans.items() if number in needed}
        else:
            oldest_s = self.now_s - memory_s - 1.0
            kept = {number: scan for number, scan in scans.items() if scan.time_s >= oldest_s}
        self._scans[guard] = kept

    def _cells(self, scan: TracedScan, beams: Ints) -> tuple[Ints, Ints]:
        """(columns, rows) in the trace's own arrays of the ends of some beams of a scan.

        Rounded step by step as the obstacle layer does it: a return may lie on the edge of a cell.
        """
        origin, resolution = self._node.prior.origin, self._settings.resolution
        corner = np.array(scan.corner)
        sensor = (np.array(scan.sensor[:2]) - origin) / resolution - corner
        reaches = scan.ranges_m[beams, None] / resolution
        ends = sensor + reaches * scan.believed_directions[beams]
        cells = np.floor(ends).astype(np.int64) + corner + self._margin
        return cells[:, 0], cells[:, 1]

    def marks(self, guard: int) -> Marks:
        """The marked cells of a guard's costmap; those of which nothing is known are left out."""
        self._put(guard)
        layer = self._node.costmaps[guard].layer
        rows, columns = np.nonzero(layer.cells == LETHAL)
        rows, columns = rows + layer.row + self._margin, columns + layer.column + self._margin
        on = self._is_on(columns, rows)
        place = guard, rows[on], columns[on]
        return self._gathered(guard, self._scan[place], self._beam[place])

    def returns(self, guard: int, source: int) -> tuple[Marks, Booleans]:
        """Of a guard's last scan: the returns from one source, and which are within the obstacle range."""
        number = self._counts[guard] - 1
        if number < 0:
            return NO_MARKS, np.empty(0, dtype=np.bool_)
        scan = self._scans[guard][number]
        beams = scan.reached(scan.lidar.range_max_m)
        beams = beams[scan.sources[beams] == source]
        marks = scan.marks(beams, self.now_s, is_newest=True) if len(beams) else NO_MARKS
        return marks, scan.ranges_m[beams] < self._settings.obstacle_range_m

    def centers_at_scan(self, guard: int) -> Floats:
        """(truths, 2) where the truths were at a guard's last scan; none if it has none."""
        scans, number = self._scans[guard], self._counts[guard] - 1
        return scans[number].centers if number in scans else np.empty((0, 2))

    def lines(self, guard: int) -> SightLines:
        """What a guard's beams would meet now."""
        trial = self._trial
        true = trial.lidars.true_scan(np.array([guard], dtype=np.int64))
        ranges_m, directions = true.ranges_m[0], true.beams.directions[0]
        known = np.where(np.isfinite(ranges_m), ranges_m, 0.0)
        ends = true.beams.axes[0] + known[:, None] * directions
        return SightLines(directions, ranges_m, sources_of(trial, true.bodies[0], ends, solids_of(trial)))

    @cached_property
    def disc(self) -> Ints:
        """(k, 2) columns and rows from a mark's cell to the cells that have the cost that counts."""
        settings = self._settings
        reach = reach_cells(settings.inflation_radius_m, settings.resolution)
        one = np.zeros((2 * reach + 1, 2 * reach + 1), dtype=np.uint8)
        one[reach, reach] = LETHAL
        by_distance = inflation_costs(
            reach, settings.resolution, settings.inscribed_radius_m, settings.cost_scaling_factor
        )
        costs = published(inflate(one, by_distance, reach))
        return np.argwhere(costs >= self._node.midnet.settings.thresh_local)[:, ::-1] - reach

    @cached_property
    def reach_m(self) -> float:
        """How far from a mark's cell a cell has the cost that counts, metres."""
        return float(lengths(self.disc.astype(np.float64)).max()) * self._settings.resolution

    @property
    def now_s(self) -> float:
        """The frame's instant."""
        return self._trial.fleet.time_s

    def _shift_m(self, guard: int, crop: Crop) -> tuple[float, float]:
        """By how much the crop moves a guard's cells on the prior map, x and y, metres."""
        if crop.is_empty:
            return 0.0, 0.0
        layer, resolution = self._node.costmaps[guard].layer, self._settings.resolution
        return (
            (crop.x1_gmap - crop.x1_lmap - layer.column) * resolution,
            (crop.y1_gmap - crop.y1_lmap - layer.row) * resolution,
        )

    def _gathered(self, guard: int, numbers: Ints, beams: Ints) -> Marks:
        newest = self._counts[guard] - 1
        scans = self._scans[guard]
        parts = [
            scans[number].marks(beams[numbers == number], self.now_s, is_newest=number == newest)
            for number in np.unique(numbers).tolist()
            if number in scans
        ]
        if not parts:
            return NO_MARKS
        return Marks(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


_NO_PLACES = np.empty((0, 2))
NO_MARKS = Marks(
    np.empty(0, dtype=np.int64),
    np.empty(0),
    np.empty(0, dtype=np.bool_),
    *(_NO_PLACES, _NO_PLACES, _NO_PLACES, _NO_PLACES),
)
