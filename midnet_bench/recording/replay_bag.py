"""``replay --bag``: what a replay found as topics of a bag, to be looked at beside the recording."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import reduce
from pathlib import Path

from midnet_bench.detectors.detector_node import DetectorNode
from midnet_bench.detectors.tracking import Tracker
from midnet_bench.drawing.palette import EXPLORERS
from midnet_bench.errors import InputError
from midnet_bench.geometry import Box, Pose2D, Scan
from midnet_bench.recording.files import ros_messages as ros
from midnet_bench.recording.files.readings import NS
from midnet_bench.recording.files.ros_messages import MAP, Marked, ros_name, write_layout
from midnet_bench.recording.files.writer import BagWriter, bag_writer, format_of
from midnet_bench.recording.inputs import Note, ReplayInputs
from midnet_bench.recording.plan import AT_ORIGIN, Link, composed, fixed_part
from midnet_bench.recording.replay import ReplayFrame

TOPICS = "/replay"  # what all topics are below: a recording beside it has none of these names
FORGET_S = 1.0  # a track without a box for so long has ended


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
