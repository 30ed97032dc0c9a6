"""``Recorder``: what a trial keeps beside its counts: further metrics, frames, errors and their causes."""

from collections.abc import Collection, Sequence
from functools import cache, cached_property, partial
from itertools import compress
from weakref import proxy

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.mobile_robot import Guard
from midnet_bench.campaign.trial import Row
from midnet_bench.detectors.detector_node import DetectorNode
from midnet_bench.elementary import cos_sin
from midnet_bench.experiments.guarded.guarded_arena import GuardedArena, ScoredFrame
from midnet_bench.experiments.guarded.parameters import GuardParameters
from midnet_bench.experiments.guarded.record import (
    ERRORS,
    FRAMES,
    RecordedBox,
    RecordedFrame,
    RecordedRobot,
    RecordedTruth,
    recorded_scan,
    scan_step_cm,
)
from midnet_bench.geometry import Booleans, Box, Floats, Indices, Point, Pose2D, Scan, Solid, lengths
from midnet_bench.midnet.detection import Crop
from midnet_bench.navigation.costmap import LETHAL, inflate, inflation_costs, published, reach_cells
from midnet_bench.scoring.diagnosis import (
    NOTHING,
    WALL,
    Cause,
    GuardView,
    Marks,
    SightLines,
    ally,
    false_box_cause,
    miss_cause,
    moved,
)
from midnet_bench.scoring.frame_counts import truths_in_range
from midnet_bench.scoring.metric import TrialMetrics
from midnet_bench.simulation import sensors as beams_met

FORGET_EVERY = 50  # scans
ON_SURFACE_M = 0.005
"""A true return this near to a stationary intruder, a person or a thing is one of its own."""
_NO_PLACES = np.empty((0, 2))
NO_MARKS = Marks(np.empty(0, np.int64), np.empty(0), np.empty(0, np.bool_), *[_NO_PLACES] * 4)


class Recorder:
    """Takes one detector's frames in order, for the trial's metrics and its record."""

    def __init__(self, trial: GuardedArena, test: GuardParameters, node: DetectorNode | None = None) -> None:
        """From now on; errors only of a ``node``."""
        self._trial: GuardedArena = proxy(trial)
        self._test = test
        self.trace = (
            FrameTrace(trial, node, test.usable_range_m) if node is not None and test.record else None
        )
        self._metrics = TrialMetrics(test.metrics)
        self._frames: list[Row] = []
        self._errors: list[Row] = []

    def take(self, frame: ScoredFrame, pursuers: Collection[Guard] = ()) -> None:
        """The newest frame, with its explanation; ``pursuers``: the guards that drive to a target."""
        if self._metrics:
            self._metrics.update(self._trial.metric_frame(frame))
        # the scene of a trial with an oracle is that of the trial without, which has the frames
        if self._test.record and (self.trace is None or self._test.oracle == "none"):
            self._frames.append(self._recorded(frame, pursuers).to_row())
        if self.trace is not None:
            self._errors += self.trace.errors(frame)

    def tables(self) -> dict[str, list[Row]]:
        """``metrics``, ``recorded`` and ``errors``, those that have rows."""
        recorded = {FRAMES: self._frames, ERRORS: self._errors}
        return {**self._metrics.tables(), **{name: rows for name, rows in recorded.items() if rows}}

    def _recorded(self, frame: ScoredFrame, pursuers: Collection[Guard]) -> RecordedFrame:
        poses, active = self._trial.world.poses(), self._trial.world.active
        explanation, midnet, match = frame.midnet.explanation, frame.midnet, frame.match
        removed = explanation.removed if explanation else []
        allies = {(each.detection.robot, each.detection.box): each.ally for each in removed}
        scans = [guard.scan for guard in self._trial.guards]
        step_cm = scan_step_cm(self._test.usable_range_m)
        return RecordedFrame(
            frame.number,
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
                for truth, near, detection in zip(
                    frame.truths, frame.in_range, match.detection_of, strict=True
                )
            ],
            found=[
                RecordedBox(guard, box, ally=allies.get((guard, box)))
                for guard, view in enumerate(explanation.views if explanation else ())
                for box in view.found
            ],
            detections=[
                RecordedBox(guard, box, truth=truth)
                for guard, box, truth in zip(midnet.robots, midnet.detections, match.truth_of, strict=True)
            ],
            scans_m=[[] if scan is None else recorded_scan(scan.ranges_m, step_cm) for scan in scans],
            sensors=[scan and scan.pose.compose(scan.lidar.mount) for scan in scans],
            scan_step_cm=step_cm,
        )


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

    def reached(self, range_m: float) -> Indices:
        """The beams that a costmap with this obstacle range takes for returns."""
        ranges_m = self.scan.ranges_m
        return np.flatnonzero((ranges_m >= self.scan.lidar.range_min_m) & (ranges_m < range_m))

    def marks(self, beams: Indices, now_s: float, is_newest: bool) -> Marks:
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


def sources_of(
    trial: GuardedArena, bodies: Indices, ends: Floats, solids: Sequence[tuple[int, Solid]]
) -> Indices:
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


class _GuardTrace:
    """The scans of one guard, and which beam made each mark of its costmap."""

    def __init__(self) -> None:
        self.scans: dict[int, TracedScan] = {}  # by number: those that may have left marks, and the last one
        self.newest = -1  # number of the last scan
        self.unread: list[int] = []  # scans whose beams are not yet in ``makers``
        self.makers = np.empty((0, 4), dtype=np.int64)
        """(marks, 4) column and row of a marked cell, and number of the scan and beam that made it"""


class FrameTrace:
    """What one detector of a trial received, and from it the cause of each of its errors.

    What came of a beam is worked out only for frames with errors.
    """

    def __init__(self, trial: GuardedArena, node: DetectorNode, usable_range_m: float) -> None:
        """From now on every scan of the guards is traced; ``usable_range_m``: as of ``GuardParameters``."""
        self._trial: GuardedArena = proxy(trial)
        self._node = node
        self._settings = node.costmaps[0].settings
        self._range_m = usable_range_m
        self._traces = [_GuardTrace() for _ in trial.guards]
        trial.add_scan_callback(node, self._add_scan)

    def errors(self, frame: ScoredFrame) -> list[Row]:
        """Rows of the table ``errors``: why intruders in range were missed, what left over boxes are made of.

        ``frame``: the newest one, with its explanation where the detector gives one.
        """
        truths, boxes, match = frame.truths, frame.midnet.detections, frame.match
        missed = [k for k in compress(range(len(truths)), frame.in_range) if match.detection_of[k] is None]
        left_over = [index for index, truth in enumerate(match.truth_of) if truth is None]
        if not missed and not left_over:
            return []
        views = [self._view(guard, frame) for guard in range(len(self._trial.guards))]
        touched = {truth for each in match.touched for truth in each}
        rows = []
        fields, sought = self._trial.fields_of_view(), [truths[index] for index in missed]
        are_near = [
            truths_in_range(sought, [view.sensor], self._range_m, views=fields[view.guard : view.guard + 1])
            for view in views
        ]
        for index, *is_near in zip(missed, *are_near, strict=True):
            name, box, _ = truths[index]
            cause = miss_cause(index, truths, boxes, [*compress(views, is_near)])
            rows.append(_error(frame.number, "miss", box, cause, index not in touched, name))
        for index in left_over:
            is_false = not match.touched[index]
            cause = false_box_cause(boxes[index], frame.midnet.robots[index], truths, views)
            rows.append(
                _error(frame.number, "false" if is_false else "fragment", boxes[index], cause, is_false)
            )
        return rows

    def marks(self, guard: int) -> Marks:
        """The marked cells of a guard's costmap; those of which nothing is known are left out."""
        self._read(guard)
        trace = self._traces[guard]
        _, _, numbers, beams = trace.makers.T
        parts = [
            trace.scans[number].marks(beams[numbers == number], self._now_s, number == trace.newest)
            for number in np.unique(numbers).tolist()
        ]
        return Marks(*(np.concatenate(columns) for columns in zip(NO_MARKS, *parts, strict=True)))

    def _add_scan(self, guard: Guard, scan: Scan, true: beams_met.NoiseFreeScan) -> None:
        trace, costmap = self._traces[guard.index], self._node.costmaps[guard.index]
        trace.newest += 1
        trace.scans[trace.newest] = TracedScan(self._trial, scan, true, (costmap.column, costmap.row))
        trace.unread.append(trace.newest)
        if len(trace.unread) == FORGET_EVERY:
            self._read(guard.index)

    def _read(self, guard: int) -> None:
        """Find the beam that made each mark, the last one that ended in its cell; forget all other scans."""
        trace, costmap = self._traces[guard], self._node.costmaps[guard]
        oldest_s = self._now_s - self._settings.memory_s - 1.0  # no mark is older
        unread = [number for number in trace.unread if trace.scans[number].scan.stamp_s >= oldest_s]
        trace.unread = []
        makers = np.concatenate(
            [trace.makers, *(self._hits(number, trace.scans[number]) for number in unread)]
        )
        height, width = costmap.marks.shape
        columns, rows = (makers[:, :2] - (costmap.column, costmap.row)).T
        inside = np.flatnonzero((columns >= 0) & (columns < width) & (rows >= 0) & (rows < height))
        last = np.full((height, width), -1)
        last[rows[inside], columns[inside]] = inside
        made_by = last[costmap.marks == LETHAL]
        trace.makers = makers[made_by[made_by >= 0]]
        needed = {*np.unique(trace.makers[:, 2]).tolist(), trace.newest}
        trace.scans = {number: scan for number, scan in trace.scans.items() if number in needed}

    def _hits(self, number: int, scan: TracedScan) -> Indices:
        """(n, 4) cells in which a scan's beams ended, its number and the beams.

        Rounded step by step as the obstacle layer does it: a return may lie on the edge of a cell.
        """
        beams, resolution = scan.reached(self._range_m), self._settings.resolution
        sensor = (np.array(scan.sensor[:2]) - self._node.prior.origin) / resolution - scan.corner
        ends = sensor + scan.scan.ranges_m[beams, None] / resolution * scan.directions[beams]
        cells = np.floor(ends).astype(np.int64) + scan.corner
        return np.column_stack((cells, np.full(len(beams), number), beams))

    def _view(self, guard: int, frame: ScoredFrame) -> GuardView:
        """What a guard's detections of one frame came from; what takes time is found at its first use."""
        a = d = prior = None
        shift_m, deflated_m = (0.0, 0.0), 0.0
        found: list[Box] = []
        taken: dict[Box, int] = {}
        explanation = frame.midnet.explanation
        if explanation is not None:
            view, prior = explanation.views[guard], self._node.prior
            a, d, found, shift_m = view.a, view.d, view.found, self._shift_m(guard, view.crop)
            deflated_m = self._node.midnet.settings.deflate_boxes_m
            removed = explanation.removed
            taken = {one.detection.box: one.ally for one in removed if one.detection.robot == guard}
        return GuardView(
            guard=guard,
            sensor=self._trial.sensor_positions()[guard],
            lines=partial(self._lines, guard),
            returns=partial(self._returns, guard),
            marks=cache(partial(self.marks, guard)),
            shift_m=shift_m,
            window=moved(self._node.costmaps[guard].extent, shift_m),
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

    def _returns(self, guard: int, source: int) -> tuple[Marks, Booleans]:
        """Of a guard's last scan: the returns from one source, and which are within the obstacle range."""
        trace = self._traces[guard]
        if trace.newest < 0:
            return NO_MARKS, NO_MARKS.is_newest
        scan = trace.scans[trace.newest]
        beams = scan.reached(scan.scan.lidar.range_max_m)
        beams = beams[scan.returns.source[beams] == source]
        is_within = scan.scan.ranges_m[beams] < self._range_m
        return scan.marks(beams, self._now_s, is_newest=True), is_within

    def _centers_at_scan(self, guard: int) -> Floats:
        """(truths, 2) where the truths were at a guard's last scan; none if it has none."""
        trace = self._traces[guard]
        return _NO_PLACES if trace.newest < 0 else trace.scans[trace.newest].centers

    def _lines(self, guard: int) -> SightLines:
        """What a guard's beams would meet now."""
        trial = self._trial
        (axes, ways), ranges_m, bodies = trial.lidars.true_scan(np.array([guard], dtype=np.int64))
        ends = _ends(axes[0], ways[0], ranges_m[0])
        return SightLines(ways[0], ranges_m[0], sources_of(trial, bodies[0], ends, solids_of(trial)))

    @cached_property
    def _disc(self) -> Indices:
        """(k, 2) columns and rows from a mark's cell to the cells that have the cost that counts."""
        settings = self._settings
        reach = reach_cells(settings.inflation_radius_m, settings.resolution)
        one = np.zeros((2 * reach + 1, 2 * reach + 1), dtype=np.uint8)
        one[reach, reach] = LETHAL
        costs = published(inflate(one, inflation_costs(settings, settings.inflation_radius_m)))
        return np.argwhere(costs >= self._node.midnet.settings.thresh_local)[:, ::-1] - reach

    @property
    def _now_s(self) -> float:
        """The frame's instant."""
        return self._trial.fleet.time_s

    def _shift_m(self, guard: int, crop: Crop) -> Point:
        """By how much the crop moves a guard's cells on the prior map, x and y, metres."""
        if crop.is_empty:
            return 0.0, 0.0
        costmap, resolution = self._node.costmaps[guard], self._settings.resolution
        return (
            (crop.x1_gmap - crop.x1_lmap - costmap.column) * resolution,
            (crop.y1_gmap - crop.y1_lmap - costmap.row) * resolution,
        )


def _error(number: int, kind: str, box: Box, cause: Cause, is_papers: bool, intruder: str = "") -> Row:
    """``is_papers``: whether section V.A counts it, too."""
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
        "paper": is_papers,
    }
