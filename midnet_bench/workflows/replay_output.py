"""What a replay leaves to be looked at: a film of its frames, and a bag with what it found as topics."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import reduce
from pathlib import Path

import cv2
import numpy as np

from midnet_bench.detectors.detector_node import DetectorNode
from midnet_bench.detectors.tracking import Tracker
from midnet_bench.drawing.films import trial_video
from midnet_bench.drawing.palette import EXPLORERS
from midnet_bench.drawing.scene import Detection, FloorPlan, Robot, Scene, Setup, Truth
from midnet_bench.errors import InputError
from midnet_bench.geometry import Box, Floats, Pose2D, Scan
from midnet_bench.grid import OccupancyGrid
from midnet_bench.recording.files import ros_messages as ros
from midnet_bench.recording.files.readings import NS
from midnet_bench.recording.files.ros_messages import MAP, Marked, ros_name, write_layout
from midnet_bench.recording.files.writer import BagWriter, bag_writer, format_of
from midnet_bench.recording.inputs import Note, ReplayInputs
from midnet_bench.recording.plan import AT_ORIGIN, Link, composed, fixed_part
from midnet_bench.recording.replay import Replay, ReplayFrame
from midnet_bench.recording.scores import FrameScore, Score
from midnet_bench.robots.model import Outline
from midnet_bench.scoring.frame_counts import ratios

LEAST_WALL_CELLS = 3  # an outline of fewer cells is left out of the picture of the place
LABEL_M = 0.3  # side of the square that stands for a label, of which only the middle is known
SPEED = 1.0
TOPICS = "/replay"  # what all topics are below: a recording beside it has none of these names
FORGET_S = 1.0  # a track without a box for so long has ended


@contextmanager
def film(
    preset: str, replay: Replay, inputs: ReplayInputs, labels: int, folder: Path
) -> Iterator[Callable[[ReplayFrame, FrameScore | None, Score], None]]:
    """What appends a frame to ``trial.mp4`` and ``storyboard.png`` in a folder; they are there in the end.

    So many ``labels`` are known; pictures are cropped to where the robots drive, unless poses are corrected.

    Raises:
        InputError: the place cannot be written.
        MidnetBenchError: there is no room, or ffmpeg fails.
    """
    node, prior_map, settings = replay.nodes[preset], replay.prior_map, replay.settings[preset]
    title = f"{inputs.recorded.names[0]}, preset {preset}"
    # of a recorded robot no more than its footprint is known
    model = replace(settings.robot_model, body=boxed(settings.robot_model.footprint))
    route = None
    if not inputs.setup.localize:  # corrected poses are known on the way alone
        route = driven(Replay(inputs.recorded, inputs.robots, prior_map, {}, inputs.setup))
    seen_m = max(settings.range_m, settings.costmap.size_m / 2.0)
    setup = Setup(
        plan=plan_of(title, prior_map, None if route is None else route.shrunk(-seen_m)),
        prior_map=prior_map,
        prior=node.prior,
        guards=len(replay.robots),
        mobile_intruders=0,
        usable_range_m=settings.range_m,
        local_size_m=settings.costmap.size_m,
        frame_hz=_frames_hz(inputs),
        other_intruders=labels,
    )
    first_ns: int | None = None
    with trial_video(setup, folder, SPEED) as append:

        def take(frame: ReplayFrame, frame_score: FrameScore | None, score: Score) -> None:
            nonlocal first_ns
            first_ns = frame.time_ns if first_ns is None else first_ns
            _, observations = frame.outputs[preset]
            made = node.midnet.update(observations, explain=True, allies=frame.fresh_allies)
            robots = [
                Robot(one.robot + 1, True, one.estimate.pose, one.estimate.pose, None, None, model)
                for one in frame.observed
            ]
            truths = _truths(frame_score) if frame_score else []
            counts = score.counts
            append(
                Scene(
                    time_s=(frame.time_ns - first_ns) / 1e9,
                    frame=frame.number + 1,
                    robots=robots,
                    detections=_detections(frame, preset, frame_score),
                    truths=truths,
                    explanation=made.explanation,
                    others=[truth.outlines for truth in truths],
                    is_labelled=frame_score is not None,
                    scans=[one.returns for one in frame.observed],
                    so_far=ratios(counts.tp, counts.fp, counts.fn) if score.labelled else None,
                )
            )

        yield take


def driven(replay: Replay) -> Box | None:
    """The box of all the positions of a replay's robots, map frame, metres; None if it has no frames.

    A fault in a recording ends it here and is reported by the replay that follows.
    """
    positions: list[tuple[float, float]] = []
    with suppress(InputError):
        for frame in replay.frames():
            positions += [(one.estimate.pose.x, one.estimate.pose.y) for one in frame.observed]
    if not positions:
        return None
    return Box(*np.min(positions, axis=0).tolist(), *np.max(positions, axis=0).tolist())


def _frames_hz(inputs: ReplayInputs) -> float:
    """Frames a second that the recording gives."""
    if inputs.setup.rate_hz is not None:
        return inputs.setup.rate_hz
    surveys = inputs.recorded.surveys
    scans = sum(surveys[one.source].streams[one.scan_topic].topic.messages for one in inputs.robots)
    return max(scans / max(max(one.duration_s for one in surveys), 0.1), 0.5)


def _detections(frame: ReplayFrame, preset: str, score: FrameScore | None) -> list[Detection]:
    made, false, second = frame.outputs[preset].frame, set[int](), set[int]()
    for place, k in enumerate(score.scored) if score else ():
        if score is not None and score.match.truth_of[place] is None:
            (second if score.match.touched[place] else false).add(k)
    return [
        Detection(box, frame.observed[robot].robot + 1, k in false, k in second)
        for k, (box, robot) in enumerate(zip(made.detections, made.robots, strict=True))
    ]


def _truths(score: FrameScore) -> list[Truth]:
    half = LABEL_M / 2.0
    corners = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    each = zip(score.labels, score.match.detection_of, score.in_range, strict=True)
    return [
        Truth([corners + np.array((label.x, label.y))], place is not None, is_in_range)
        for label, place, is_in_range in each
    ]


def boxed(outline: Outline) -> Outline:
    """The box around an outline, counter-clockwise, metres."""
    (x0, y0), (x1, y1) = np.min(outline, axis=0).tolist(), np.max(outline, axis=0).tolist()
    return ((x0, y0), (x1, y0), (x1, y1), (x0, y1))


def plan_of(title: str, prior_map: OccupancyGrid, shown: Box | None = None) -> FloorPlan:
    """The outlines of a map's walls, its free and unknown cells, and the rectangle of what it knows.

    Args:
        title: of the recording.
        prior_map: int8, 100 occupied, 0 free, -1 unknown.
        shown: what of it pictures show, map frame, metres; all of it unless given.
    """
    solid = (prior_map.data == 100).astype(np.uint8)
    contours, _ = cv2.findContours(solid, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    cell_m = prior_map.resolution
    walls: list[Floats] = []
    for contour in contours:
        _, _, width, height = cv2.boundingRect(contour)
        if max(width, height) >= LEAST_WALL_CELLS and len(contour) > 1:
            walls.append(prior_map.origin + (contour[:, 0].astype(np.float64) + 0.5) * cell_m)
    known = prior_map.data >= 0
    rows, columns = np.nonzero(known if known.any() else ~known)
    corners = np.array([(columns.min(), rows.min()), (columns.max() + 1, rows.max() + 1)])
    enclosure = Box(*(prior_map.origin + corners * cell_m).ravel().tolist())
    if shown is not None:
        least, most = np.maximum(shown[:2], enclosure[:2]), np.minimum(shown[2:], enclosure[2:])
        # none of it of a drive off the map
        shown = Box(*least.tolist(), *most.tolist()) if (least < most).all() else None
    return FloorPlan(title, enclosure, walls, [], ground=prior_map, shown=shown)


class ReplayBag:
    """Writes the frames of a replay: record times and stamps are those of the scans that made them."""

    def __init__(
        self, bag: BagWriter, inputs: ReplayInputs, nodes: Mapping[str, DetectorNode], note: Note
    ) -> None:
        """Of a replay that has not begun, by the detectors ``nodes`` of its presets."""
        self._bag, self._inputs, self._nodes = bag, inputs, nodes
        self._names = [ros_name(robot.name) for robot in inputs.robots]
        self._trackers = {preset: Tracker() for preset in nodes}
        self._seen_s: dict[str, dict[int, float]] = {preset: {} for preset in nodes}
        """preset -> number of a track -> when it had its last box"""
        self._last: dict[int, Scan] = {}
        self._record_ns = 0
        self._fixed: list[tuple[str, str, Pose2D]] = []
        """the map, a topmost frame of the recording's own, and its place"""
        self._carried: dict[int, tuple[str, Pose2D]] = {}
        """robot -> the topmost frame, which moves with its laser, and the laser's pose in it"""
        self._anchor(note)

    def _anchor(self, note: Note) -> None:
        """Hang the recording's own frames on the map, where its transforms do not lead there themselves.

        Where poses are in the topmost frame, it is fixed on the map; where no frame moves, all are carried.
        Else nothing places them, and ``note`` says so.
        """
        surveys, known = self._inputs.recorded.surveys, {MAP, ""}
        for number, robot in enumerate(self._inputs.robots):
            survey = surveys[robot.source]
            frame = survey.streams[robot.scan_topic].scans[0].frame
            chain = survey.chain(frame)
            top = chain[-1]
            moving = next((link for link in robot.pose.links if isinstance(link, Link)), None)
            if top in known:
                continue
            known.add(top)
            if moving is not None and moving.seen(surveys)[0].frame == top:
                before = itertools.takewhile(lambda link: isinstance(link, Pose2D), robot.pose.links)
                steps = [link for link in before if isinstance(link, Pose2D)]
                self._fixed.append((MAP, top, reduce(Pose2D.compose, steps, AT_ORIGIN)))
            elif fixed_part(survey, frame) == chain:
                self._carried[number] = top, composed(survey, chain)[0]
            else:
                note(f"--bag: the recording's own frames, below '{top}', are not placed on the map")

    def write(self, frame: ReplayFrame) -> None:
        """A frame: the scans that are new, where their robots were, and each preset's boxes."""
        bag, is_first = self._bag, not self._record_ns
        self._record_ns = record_ns = max(self._record_ns, frame.record_ns, 1)
        if is_first:
            robots = zip(self._names, self._inputs.robots, strict=True)
            placed = [(f"replay/{name}", f"replay/{name}/laser", robot.mount) for name, robot in robots]
            fixed = ros.transforms(frame.time_ns, [*placed, *self._fixed])
            bag.write("/tf_static", record_ns, fixed, is_kept=True)
            prior_map = ros.occupancy_grid(frame.time_ns, self._inputs.prior_map)
            bag.write(f"{TOPICS}/map", record_ns, prior_map, is_kept=True)
        for one in frame.observed:
            if one.scan is not None and one.scan is not self._last.get(one.robot):
                self._last[one.robot] = one.scan
                self._write_scan(one.robot, one.scan)
        names = [self._names[one.robot] for one in frame.observed]
        for preset, made in frame.outputs.items():
            node, boxes, topic = self._nodes[preset], made.frame, f"{TOPICS}/{preset}"
            if node.is_the_papers:
                explained = node.midnet.update(made.observations, explain=True, allies=frame.fresh_allies)
                boxes = replace(boxes, explanation=explained.explanation)
            for name, message in ros.frame_messages(frame.time_ns, boxes, names, bag.ros, topic, topic):
                bag.write(name, record_ns, message)
            tracks = self._tracked(preset, boxes.detections, frame.time_ns / NS)
            bag.write(f"{topic}/tracks", record_ns, ros.markers(frame.time_ns, tracks))

    def _tracked(self, preset: str, boxes: Sequence[Box], time_s: float) -> list[Marked]:
        """The boxes with the numbers of their tracks (``detectors/tracking.py``)."""
        tracker, seen_s = self._trackers[preset], self._seen_s[preset]
        for number in [number for number, last_s in seen_s.items() if time_s - last_s > FORGET_S]:
            tracker.drop(number)
            del seen_s[number]
        numbers = tracker.update([box.center for box in boxes], time_s)
        seen_s |= dict.fromkeys(numbers, time_s)
        return [
            Marked(box, f"track_{number}", EXPLORERS[number % len(EXPLORERS)], str(number))
            for number, box in zip(numbers, boxes, strict=True)
        ]

    def _write_scan(self, robot: int, scan: Scan) -> None:
        name, record_ns, stamp_ns = self._names[robot], self._record_ns, round(scan.stamp_s * NS)
        placed = [(MAP, f"replay/{name}", scan.pose)]
        if robot in self._carried:
            frame, laser = self._carried[robot]
            sensor = scan.pose.compose(self._inputs.robots[robot].mount)
            placed.append((MAP, frame, sensor.compose(laser.inverse())))
        self._bag.write("/tf", record_ns, ros.transforms(stamp_ns, placed))
        message = ros.laser_scan(f"replay/{name}/laser", stamp_ns, scan.ranges_m, scan.lidar, 0.0)
        self._bag.write(f"{TOPICS}/{name}/scan", record_ns, message)


def check_place(path: Path, files: Sequence[Path]) -> None:
    """Raises InputError: a bag's name does not say its format, or it is one of the recordings or in one."""
    format_of(path)
    if not {path.resolve(), *path.resolve().parents}.isdisjoint(file.resolve() for file in files):
        raise InputError(f"--bag {path}: is the recording itself; give another name")


@contextmanager
def replay_bag(
    path: Path, inputs: ReplayInputs, nodes: Mapping[str, DetectorNode], note: Note
) -> Iterator[ReplayBag]:
    """Writes ``path``, and a layout for Foxglove beside it; they are there in full after the block.

    Raises InputError: the place cannot be written.
    """
    with bag_writer(path, format_of(path)) as bag:
        yield ReplayBag(bag, inputs, nodes, note)
        kinds = bag.kinds
    write_layout(path, kinds, Box(*inputs.prior_map.extent))
