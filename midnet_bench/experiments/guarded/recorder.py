"""``Recorder``: a trial frame by frame; ``FrameTrace``: what each return of the guards' LiDARs hit.

The trace keeps each guard's scans and, for every cell, the beam that marked it last. What came of a beam is
worked out only for frames with errors.
"""

import math
from collections.abc import Collection, Sequence
from functools import cache, cached_property, partial

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.mobile_robot import Guard
from midnet_bench.campaign.trial import Row
from midnet_bench.detectors.detector_node import DetectorNode
from midnet_bench.elementary import cos_sin
from midnet_bench.experiments.guarded.guarded_arena import GuardedArena
from midnet_bench.experiments.guarded.parameters import GuardParameters
from midnet_bench.experiments.guarded.record import (
    ERRORS,
    FRAMES,
    RecordedBox,
    RecordedFrame,
    RecordedRobot,
    RecordedTruth,
    recorded_scan,
)
from midnet_bench.geometry import Box, Point, Pose2D, Scan, Solid, lengths
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
    Kind,
    Marks,
    SightLines,
    ally,
    false_box_cause,
    miss_cause,
    moved,
)
from midnet_bench.scoring.frame_counts import FrameMatch, TruthObject, match_frame
from midnet_bench.scoring.metric import NONE, TrialMetrics
from midnet_bench.simulation import sensors as beams_met

FORGET_EVERY = 50  # scans
ON_SURFACE_M = 0.005
"""A true return this near to a stationary intruder, a person or a thing is one of its own."""
_NO_PLACES = np.empty((0, 2))
NO_MARKS = Marks(np.empty(0, np.int64), np.empty(0), np.empty(0, np.bool_), *[_NO_PLACES] * 4)


class TracedScan:
    """One scan of one guard, and the world at that instant."""

    def __init__(self, trial: GuardedArena, scan: Scan, true: beams_met.NoiseFreeScan, corner: Point) -> None:
        """``true``: what its beams met, of this one LiDAR; ``corner``: column and row of the costmap then."""
        self.scan, self.corner = scan, np.array(corner)
        self.sensor = scan.pose.compose(scan.lidar.mount)
        self._trial, self._true = trial, true
        self._solids = solids_of(trial)
        self._poses = trial.world.poses()
        self._others = [member.extent().center for member in trial.crowd.members]

    @cached_property
    def directions(self) -> Floats:
        """(beams, 2) unit vectors, map frame, by the guard's own heading."""
        c, s = cos_sin(self.sensor.yaw)
        x, y = self.scan.lidar.directions.T
        return np.stack((c * x - s * y, s * x + c * y), axis=1)

    @cached_property
    def returns(self) -> Marks:
        """Of each beam, whether something came back or not, at the scan's own instant."""
        (axis, ways), ranges_m, bodies = self._true
        ends = _ends(axis[0], ways[0], ranges_m[0])
        beams = len(ends)
        return Marks(
            sources_of(self._trial, bodies[0], ends, self._solids),
            age_s=np.zeros(beams),
            is_newest=np.ones(beams, dtype=np.bool_),
            believed=_ends(self.sensor[:2], self.directions, self.scan.ranges_m),
            at_true_pose=_ends(axis[0], ways[0], self.scan.ranges_m),
            at_true_range=_ends(self.sensor[:2], self.directions, ranges_m[0]),
            true=ends,
        )

    @cached_property
    def centers(self) -> Floats:
        """(truths, 2) where the truths were, in the order of ``DetectionTrial.truths``."""
        trial = self._trial
        still = [solid.bounding_box().center for solid in trial.layout.stationary]
        mobile = trial.lidars.centers(self._poses[[robot.index for robot in trial.intruders]])
        return np.vstack((np.array(still).reshape(-1, 2), mobile, np.array(self._others).reshape(-1, 2)))

    def reached(self, range_m: float) -> Ints:
        """The beams that a costmap with this obstacle range takes for returns."""
        ranges_m = self.scan.ranges_m
        return np.flatnonzero((ranges_m >= self.scan.lidar.range_min_m) & (ranges_m < range_m))

    def marks(self, beams: Ints, now_s: float, is_newest: bool) -> Marks:
        """The returns of some beams, as they are at ``now_s``; ``is_newest``: whether no scan is newer."""
        return self.returns.where(beams)._replace(
            age_s=np.full(len(beams), now_s - self.scan.stamp_s), is_newest=np.full(len(beams), is_newest)
        )


def _ends(axis: npt.ArrayLike, directions: Floats, ranges_m: Floats) -> Floats:
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
    solid = np.full(np.count_nonzero(is_solid), WALL)
    for truth, one in solids:
        solid[one.distance_to(ends[is_solid]) < ON_SURFACE_M] = truth
    found[is_solid] = solid
    return found


class FrameTrace:
    """What one detector of a trial received, and from it the cause of each of its errors."""

    def __init__(self, trial: GuardedArena, node: DetectorNode) -> None:
        """From now on every scan of the guards is traced."""
        self._trial, self._node = trial, node
        self._settings = settings = node.costmaps[0].settings
        # farther out no cell was marked while its window reached there
        self._margin = reach_cells(settings.obstacle_range_m, settings.resolution) + 2
        height, width = node.prior.data.shape
        self._shape = np.array((width, height)) + 2 * self._margin
        shape = (len(trial.guards), *self._shape[::-1].tolist())
        self._scan = np.full(shape, -1, dtype=np.int64)
        self._beam = np.zeros(shape, dtype=np.int64)
        self._scans: list[dict[int, TracedScan]] = [{} for _ in trial.guards]
        """of each guard those that may have left marks, by their numbers"""
        self._counts = [0] * len(trial.guards)
        self._written = [0] * len(trial.guards)
        trial.add_scan_callback(node, self._add_scan)

    def errors(
        self,
        number: int,
        frame: Frame,
        truths: Sequence[TruthObject],
        in_range: Sequence[bool],
        match: FrameMatch,
    ) -> list[Row]:
        """Rows of the table ``errors``: why intruders in range were missed, what left over boxes are made of.

        Args:
            number: of the newest frame.
            frame: with its explanation, where the detector gives one.
            truths: as they are now.
            in_range: for each truth, whether missing it counts.
            match: of the frame's boxes and the truths.
        """
        pairs = enumerate(zip(in_range, match.detection_of, strict=True))
        missed = [index for index, (counts, box) in pairs if counts and box is None]
        left_over = [index for index, truth in enumerate(match.truth_of) if truth is None]
        if not missed and not left_over:
            return []
        boxes, range_m = frame.detections, self._settings.obstacle_range_m
        views = [self._view(guard, frame) for guard in range(len(self._trial.guards))]
        touched = {truth for each in match.touched for truth in each}
        rows = []
        for index in missed:
            name, box, _ = truths[index]
            near = [view for view in views if box.distance_to_point(*view.sensor) <= range_m]
            row = _error("miss", number, box, miss_cause(index, truths, boxes, near), name)
            rows.append({**row, "paper": index not in touched})
        for index in left_over:
            kind: Kind = "fragment" if match.touched[index] else "false"
            cause = false_box_cause(boxes[index], frame.robots[index], truths, views)
            rows.append({**_error(kind, number, boxes[index], cause), "paper": kind == "false"})
        return rows

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
            removed = frame.explanation.removed
            taken = {one.detection.box: one.ally for one in removed if one.detection.robot == guard}
        return GuardView(
            guard=guard,
            sensor=self._trial.sensor_positions()[guard],
            lines=partial(self._lines, guard),
            returns=partial(self._returns, guard),
            marks=cache(partial(self.marks, guard)),
            shift_m=shift_m,
            window=moved(self._node.window(guard), shift_m),
            reach_m=float(lengths(self._disc.astype(np.float64)).max()) * self._settings.resolution,
            a=a,
            d=d,
            prior=prior,
            disc=self._disc,
            found=found,
            deflated_m=deflated_m,
            taken=[taken.get(box) for box in found],
            centers_at_scan=partial(self._centers_at_scan, guard),
        )

    def _add_scan(self, guard: Guard, scan: Scan, true: beams_met.NoiseFreeScan) -> None:
        index, number = guard.index, self._counts[guard.index]
        self._counts[index] += 1
        costmap = self._node.costmaps[index]
        self._scans[index][number] = TracedScan(self._trial, scan, true, (costmap.column, costmap.row))
        if number % FORGET_EVERY == 0:
            self._forget(index)

    def _put(self, guard: int) -> None:
        """Write the beams of scans that are not yet there into the cells that they marked."""
        since, self._written[guard] = self._written[guard], self._counts[guard]
        for number in range(since, self._counts[guard]):
            scan = self._scans[guard].get(number)
            if scan is None or scan.scan.stamp_s < self._oldest_s:
                continue
            beams = scan.reached(self._settings.obstacle_range_m)
            place, on = self._place(guard, self._cells(scan, beams))
            self._scan[place] = number
            self._beam[place] = beams[on]

    def _place(self, guard: int, cells: Ints) -> tuple[tuple[int, Ints, Ints], Booleans]:
        """Where (n, 2) cells are in the trace's own arrays, those that are there; and which are."""
        on = np.asarray(((cells >= 0) & (cells < self._shape)).all(axis=1))
        columns, rows = cells[on].T
        return (guard, rows, columns), on

    def _forget(self, guard: int) -> None:
        """Drop the scans of which no mark can be left."""
        scans = self._scans[guard]
        if math.isinf(self._settings.memory_s):
            self._put(guard)
            needed = {*np.unique(self._scan[guard]).tolist(), self._counts[guard] - 1}
            self._scans[guard] = {number: scan for number, scan in scans.items() if number in needed}
        else:
            oldest_s = self._oldest_s
            self._scans[guard] = {k: scan for k, scan in scans.items() if scan.scan.stamp_s >= oldest_s}

    def _cells(self, scan: TracedScan, beams: Ints) -> Ints:
        """(n, 2) columns and rows in the trace's own arrays of the ends of some beams of a scan.

        Rounded step by step as the obstacle layer does it: a return may lie on the edge of a cell.
        """
        origin, resolution = self._node.prior.origin, self._settings.resolution
        sensor = (np.array(scan.sensor[:2]) - origin) / resolution - scan.corner
        reaches = scan.scan.ranges_m[beams, None] / resolution
        ends = sensor + reaches * scan.directions[beams]
        return np.asarray(np.floor(ends).astype(np.int64) + scan.corner + self._margin)

    def marks(self, guard: int) -> Marks:
        """The marked cells of a guard's costmap; those of which nothing is known are left out."""
        self._put(guard)
        costmap = self._node.costmaps[guard]
        corner = np.array([costmap.column, costmap.row])
        cells = np.argwhere(costmap.marks == LETHAL)[:, ::-1] + corner + self._margin
        place, _ = self._place(guard, cells)
        numbers, beams = self._scan[place], self._beam[place]
        newest, scans = self._counts[guard] - 1, self._scans[guard]
        parts = [
            scans[number].marks(beams[numbers == number], self._now_s, is_newest=number == newest)
            for number in np.unique(numbers).tolist()
            if number in scans
        ]
        return Marks(*(np.concatenate(columns) for columns in zip(NO_MARKS, *parts, strict=True)))

    def _returns(self, guard: int, source: int) -> tuple[Marks, Booleans]:
        """Of a guard's last scan: the returns from one source, and which are within the obstacle range."""
        number = self._counts[guard] - 1
        if number < 0:
            return NO_MARKS, NO_MARKS.is_newest
        scan = self._scans[guard][number]
        beams = scan.reached(scan.scan.lidar.range_max_m)
        beams = beams[scan.returns.source[beams] == source]
        is_within = scan.scan.ranges_m[beams] < self._settings.obstacle_range_m
        return scan.marks(beams, self._now_s, is_newest=True), is_within

    def _centers_at_scan(self, guard: int) -> Floats:
        """(truths, 2) where the truths were at a guard's last scan; none if it has none."""
        scan = self._scans[guard].get(self._counts[guard] - 1)
        return _NO_PLACES if scan is None else scan.centers

    def _lines(self, guard: int) -> SightLines:
        """What a guard's beams would meet now."""
        trial = self._trial
        (axes, ways), ranges_m, bodies = trial.lidars.true_scan(np.array([guard], dtype=np.int64))
        ends = _ends(axes[0], ways[0], ranges_m[0])
        return SightLines(ways[0], ranges_m[0], sources_of(trial, bodies[0], ends, solids_of(trial)))

    @cached_property
    def _disc(self) -> Ints:
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

    @property
    def _now_s(self) -> float:
        """The frame's instant."""
        return self._trial.fleet.time_s

    @property
    def _oldest_s(self) -> float:
        """Before it, no scan has left a mark that is still there."""
        return self._now_s - self._settings.memory_s - 1.0

    def _shift_m(self, guard: int, crop: Crop) -> Point:
        """By how much the crop moves a guard's cells on the prior map, x and y, metres."""
        if crop.is_empty:
            return 0.0, 0.0
        costmap, resolution = self._node.costmaps[guard], self._settings.resolution
        return (
            (crop.x1_gmap - crop.x1_lmap - costmap.column) * resolution,
            (crop.y1_gmap - crop.y1_lmap - costmap.row) * resolution,
        )


def _error(kind: Kind, number: int, box: Box, cause: Cause, intruder: str = "") -> Row:
    sides = zip(("x_min_m", "y_min_m", "x_max_m", "y_max_m"), box, strict=True)
    return {
        "frame": number,
        "kind": kind,
        "cause": cause.name,
        "guard": 0 if cause.guard is None else cause.guard + 1,
        "intruder": intruder,
        "by": cause.by,
        "age_s": round(cause.age_s, 3),
        "offset_m": round(cause.offset_m, 3),
        **{name: round(side, 3) for name, side in sides},
    }


class Recorder:
    """Of one detector of a trial beside its counts: further metrics, each frame, each error and its cause."""

    def __init__(self, trial: GuardedArena, test: GuardParameters, node: DetectorNode | None) -> None:
        """From now on; errors only of a ``node``."""
        self._trial, self._test = trial, test
        self.trace = FrameTrace(trial, node) if node is not None and test.record else None
        self._metrics = TrialMetrics(test.metrics)
        self._frames: list[Row] = []
        self._errors: list[Row] = []

    def take(
        self,
        number: int,
        frame: Frame,
        truths: Sequence[TruthObject],
        in_range: Sequence[bool],
        match: FrameMatch | None = None,
        pursuers: Collection[Guard] = (),
    ) -> None:
        """The newest frame, with its explanation; ``pursuers``: the guards that drive to a target."""
        if self._metrics:
            self._metrics.update(self._trial.metric_frame(frame, truths, in_range))
        if not self._test.record:
            return
        match = match or match_frame(frame.detections, truths)
        # the scene of a trial with an oracle is that of the trial without, which has the frames
        if self.trace is None or self._test.oracle == "none":
            recorded = self._recorded(number, frame, truths, in_range, match, pursuers)
            self._frames.append(recorded.to_row())
        if self.trace is not None:
            self._errors += self.trace.errors(number, frame, truths, in_range, match)

    def tables(self) -> dict[str, list[Row]]:
        """``metrics``, ``recorded`` and ``errors``, those that have rows."""
        recorded = {FRAMES: self._frames, ERRORS: self._errors}
        return {**self._metrics.tables(), **{name: rows for name, rows in recorded.items() if rows}}

    def _recorded(
        self,
        number: int,
        frame: Frame,
        truths: Sequence[TruthObject],
        in_range: Sequence[bool],
        match: FrameMatch,
        pursuers: Collection[Guard],
    ) -> RecordedFrame:
        poses, active = self._trial.world.poses(), self._trial.world.active
        removed = frame.explanation.removed if frame.explanation else []
        allies = {(each.detection.robot, each.detection.box): each.ally for each in removed}
        views = frame.explanation.views if frame.explanation else []
        scans = [guard.scan for guard in self._trial.guards]
        return RecordedFrame(
            number,
            robots=[
                RecordedRobot(
                    Pose2D(*poses[robot.index].tolist()),
                    robot.pose,
                    robot.goal,
                    robot.goal is not None and robot in pursuers,
                )
                if active[robot.index]
                else None
                for robot in self._trial.fleet.robots
            ],
            truths=[
                RecordedTruth(truth.name, truth.box, bool(near), detection)
                for truth, near, detection in zip(truths, in_range, match.detection_of, strict=True)
            ],
            found=[
                RecordedBox(guard, box, allies.get((guard, box)))
                for guard, view in enumerate(views)
                for box in view.found
            ],
            detections=list(map(RecordedBox, frame.robots, frame.detections, match.truth_of)),
            scans_m=[[] if scan is None else recorded_scan(scan.ranges_m) for scan in scans],
            sensors=[scan and scan.pose.compose(scan.lidar.mount) for scan in scans],
        )


def recorder_of(
    trial: GuardedArena, test: GuardParameters, node: DetectorNode | None = None
) -> Recorder | None:
    """A recorder if the trial is to be recorded or has further metrics; errors are those of ``node``."""
    return Recorder(trial, test, node) if test.record or test.metrics != NONE else None
