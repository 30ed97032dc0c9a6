"""Recordings made by hand: who drives and walks in the drawn room, what a laser sees, and every container."""

import csv
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.rosbag1 import Writer as Ros1Writer

from midnet_bench.geometry import LidarGeometry, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.map_server import save_map
from midnet_bench.recording.files.ros_messages import (
    Message,
    laser_scan,
    occupancy_grid,
    odometry,
    pose_fields,
    pose_stamped,
    transforms,
)
from midnet_bench.recording.files.writer import BagWriter, bag_writer
from midnet_bench.recording.setup import RecordingSetup
from midnet_bench.workflows.replay import Replayed, replay
from tests.cli.command import rows
from tests.recording.recorded_drives import BARE, MOUNT, WALLS, cast, room, way

NS = 1_000_000_000
BEGIN_S = 1_600_000_000.0  # of all recordings, seconds of the epoch
CONTAINERS = ("ros1", "ros1-bz2", "ros1-lz4", "ros2", "mcap", "csv")
MOUNT_DEG = [MOUNT.x, MOUNT.y, math.degrees(MOUNT.yaw)]  # of the laser of all drives, as a setup has it
LEAD_S = 10.0
"""where on its way the robot is when a recording begins; who is before or behind it goes the same way"""


class Disc(NamedTuple):
    """Something round."""

    x: float
    y: float
    radius_m: float


Mover = Callable[[float], Sequence[Disc]]
"""seconds since the beginning -> what it is made of; the label lies in the middle"""


def on_the_way(ahead_s: float, radius_m: float = 0.12, seconds: float = 60.0) -> Mover:
    """A robot that goes before the recording one, so many seconds; behind it if negative."""
    track = way("turns", seconds + LEAD_S + max(ahead_s, 0.0) + 1.0)
    return lambda time_s: [Disc(*track.at(time_s + LEAD_S + ahead_s)[:2], radius_m)]


def standing(x: float, y: float, radius_m: float = 0.12) -> Mover:
    """It never moves."""
    return lambda time_s: [Disc(x, y, radius_m)]


def walking(
    from_xy: tuple[float, float], to_xy: tuple[float, float], speed_mps: float, leg_m: float = 0.12
) -> Mover:
    """A person to and fro on a line: two legs of this diameter, one before the other in turn."""
    length_m = math.dist(from_xy, to_xy)
    along = ((to_xy[0] - from_xy[0]) / length_m, (to_xy[1] - from_xy[1]) / length_m)

    def at(time_s: float) -> list[Disc]:
        gone_m = (speed_mps * time_s) % (2.0 * length_m)
        at_m = min(gone_m, 2.0 * length_m - gone_m)
        step_m = 0.2 * math.sin(math.tau * 0.9 * time_s)
        return [
            Disc(
                from_xy[0] + along[0] * (at_m + side * step_m) - along[1] * 0.1 * side,
                from_xy[1] + along[1] * (at_m + side * step_m) + along[0] * 0.1 * side,
                leg_m / 2.0,
            )
            for side in (-1.0, 1.0)
        ]

    return at


def middle(discs: Sequence[Disc]) -> tuple[float, float]:
    return sum(one.x for one in discs) / len(discs), sum(one.y for one in discs) / len(discs)


def lidar_of(beams: int = 180, view_rad: float = math.tau, range_m: float = 8.0) -> LidarGeometry:
    """Beams that lie evenly over a view about straight ahead."""
    step = view_rad / (beams if view_rad > 6.28 else beams - 1)
    return LidarGeometry(beams, -view_rad / 2.0, step, 0.12, range_m, BARE)


@dataclass(frozen=True)
class Drive:
    """A robot with a laser among others."""

    seconds: float = 5.0
    rate_hz: float = 10.0
    lidar: LidarGeometry = field(default_factory=lidar_of)  # without its mount
    mount: Pose2D = MOUNT
    upside_down: bool = False
    movers: dict[str, Mover] = field(default_factory=dict)
    pose: Callable[[float], Pose2D] | None = None
    """seconds -> where it is; None: on the way of the drawn drives"""
    noise_m: float = 0.005
    walls: np.ndarray = field(default_factory=lambda: WALLS)
    sweep_s: float = 0.0  # from the first beam to the last
    pose_rate_hz: float = 50.0
    seed: int = 1

    @cached_property
    def track(self) -> Callable[[float], Pose2D]:
        if self.pose is not None:
            return self.pose
        driven = way("turns", self.seconds + LEAD_S + 2.0)
        return lambda time_s: driven.at(time_s + LEAD_S)

    def discs(self, time_s: float) -> list[Disc]:
        return [disc for mover in self.movers.values() for disc in mover(time_s)]

    @property
    def times_s(self) -> list[float]:
        """Of the scans, seconds since the beginning."""
        return np.arange(0.5, self.seconds, 1.0 / self.rate_hz).tolist()

    @cached_property
    def scans(self) -> list[tuple[float, np.ndarray]]:
        """Seconds since the beginning, and (beams,) ranges, inf where nothing came back."""
        rng = np.random.default_rng(self.seed)
        angles = self.lidar.angles_rad * (-1.0 if self.upside_down else 1.0)
        found = []
        for time_s in self.times_s:
            share = np.arange(len(angles)) / len(angles) * self.sweep_s
            parts = (
                zip(share.tolist(), np.split(angles, len(angles)), strict=True)
                if self.sweep_s
                else [(0.0, angles)]
            )
            ranges = np.concatenate([self._cast_at(time_s + late, part) for late, part in parts])
            ranges = ranges + rng.normal(0.0, self.noise_m, len(angles))
            ranges[ranges > self.lidar.range_max_m] = np.inf
            found.append((time_s, ranges.astype(np.float32).astype(np.float64)))
        return found

    def _cast_at(self, time_s: float, angles: np.ndarray) -> np.ndarray:
        return cast(self.track(time_s).compose(self.mount), angles, self.discs(time_s), self.walls)

    def poses(self) -> list[tuple[float, Pose2D]]:
        track = self.track
        return [
            (time_s, track(time_s))
            for time_s in np.arange(0.0, self.seconds, 1.0 / self.pose_rate_hz).tolist()
        ]

    def labels(self, *names: str) -> list[tuple[int, float, str, float, float]]:
        """(scan index, t, id, x, y) of movers at each scan; all of them if none is named."""
        return [
            (index, BEGIN_S + time_s, name, *middle(self.movers[name](time_s)))
            for index, time_s in enumerate(self.times_s)
            for name in names or self.movers
        ]


class Said(NamedTuple):
    """A message on its way into a bag."""

    topic: str
    record_ns: int
    message: Message
    is_kept: bool = False


def ns_of(time_s: float) -> int:
    return round((BEGIN_S + time_s) * 1000.0) * (NS // 1000)


def scan_messages(
    drive: Drive, topic: str = "/scan", frame: str = "laser", lag_s: float = 0.0, **fields: Any
) -> list[Said]:
    """Each scan, recorded ``lag_s`` after its stamp; ``fields``: of the message, instead of its own."""
    found = []
    for time_s, ranges_m in drive.scans:
        kind, said = laser_scan(frame, ns_of(time_s), ranges_m, drive.lidar, 1.0 / drive.rate_hz)
        found.append(Said(topic, ns_of(time_s + lag_s), Message(kind, {**said, **fields})))
    return found


def edited(said: Said, **fields: Any) -> Said:
    """The message with other values of some fields."""
    return said._replace(message=Message(said.message.kind, {**said.message.fields, **fields}))


def stamped(said: Said, stamp_ns: int | None = None, frame: str | None = None) -> Said:
    """The message with another stamp or frame."""
    head = said.message.fields["header"]
    stamp = head["stamp"] if stamp_ns is None else stamp_ns
    return edited(said, header={"stamp": stamp, "frame_id": head["frame_id"] if frame is None else frame})


def pose_messages(drive: Drive, kind: str = "pose", topic: str = "/pose") -> list[Said]:
    """The poses as PoseStamped (pose), PoseWithCovarianceStamped (covariance) or Odometry (odometry)."""
    return track_messages(drive.poses(), kind, topic)


def track_messages(
    poses: Iterable[tuple[float, Pose2D]], kind: str = "pose", topic: str = "/pose"
) -> list[Said]:
    found = []
    for time_s, pose in poses:
        stamp_ns = ns_of(time_s)
        if kind == "odometry":
            message = odometry(stamp_ns, "base_link", pose, 0.0, 0.0)
        elif kind == "covariance":
            head = pose_stamped(stamp_ns, pose).fields["header"]
            message = Message(
                "geometry_msgs/msg/PoseWithCovarianceStamped",
                {"header": head, "pose": {"pose": pose_fields(pose)}},
            )
        else:
            message = pose_stamped(stamp_ns, pose)
        found.append(Said(topic, stamp_ns, message))
    return found


def tf_messages(drive: Drive, slow_hz: float = 0.5, frame: str = "laser") -> list[Said]:
    """map -> odom now and then, odom -> base_link often, base_link -> laser once and for all."""
    found = [Said("/tf_static", ns_of(0.0), mount_message(drive, frame), is_kept=True)]
    rare_s = np.arange(0.0, drive.seconds + 1.0 / slow_hz, 1.0 / slow_hz).tolist()
    links = [
        *(
            (time_s, "odom", "base_link", map_to_odom(time_s).inverse().compose(pose))
            for time_s, pose in drive.poses()
        ),
        *((time_s, "map", "odom", map_to_odom(time_s)) for time_s in rare_s),
    ]
    found += [Said("/tf", ns_of(time_s), transforms(ns_of(time_s), [link])) for time_s, *link in links]
    return found


def map_to_odom(time_s: float) -> Pose2D:
    """An odometry that drifts evenly, without a turn."""
    return Pose2D(0.3 + 0.004 * time_s, -0.2 - 0.003 * time_s, 0.4)


def mount_message(drive: Drive, frame: str = "laser") -> Message:
    """The static transform of the laser, turned over about its own x axis where it hangs upside down."""
    kind, said = transforms(ns_of(0.0), [("base_link", frame, drive.mount)])
    (one,) = said["transforms"]
    if drive.upside_down:
        half = drive.mount.yaw / 2.0
        turned = {**one["transform"], "rotation": {"x": math.cos(half), "y": math.sin(half), "w": 0.0}}
        one = {**one, "transform": turned}
    return Message(kind, {"transforms": [one]})


@contextmanager
def _writer(path: Path, container: str):
    """The package's own packs a ROS 1 bag by bz2."""
    if container not in ("ros1", "ros1-lz4"):
        with bag_writer(path, container.removesuffix("-bz2")) as made:
            yield made
        return
    path.unlink(missing_ok=True)
    writer = Ros1Writer(path)
    if container == "ros1-lz4":
        writer.set_compression(Ros1Writer.CompressionFormat.LZ4)
    with writer:
        yield BagWriter(writer)


def write_bag(folder: Path, messages: Iterable[Said], container: str = "mcap", name: str = "bag") -> Path:
    """The bag in a container; messages in order of their record times."""
    path = folder / f"{name}{'.mcap' if container == 'mcap' else '' if container == 'ros2' else '.bag'}"
    with _writer(path, container) as writer:
        for topic, record_ns, message, is_kept in sorted(messages, key=lambda one: one.record_ns):
            writer.write(topic, record_ns, message, is_kept)
    return path


def write_table(path: Path, heading: Sequence[str], rows: Iterable[Sequence[Any]]) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(heading)
        writer.writerows(rows)
    return path


def write_scan_table(path: Path, drive: Drive, with_poses: bool = False) -> Path:
    """t, the geometry, the ranges; of each scan."""
    lidar, track = drive.lidar, drive.track
    limits = ["angle_min", "angle_increment", "range_min", "range_max"]
    numbers = (lidar.angle_min_rad, lidar.angle_increment_rad, lidar.range_min_m, lidar.range_max_m)
    numbers = np.float32(numbers).tolist()  # as messages have them
    place = ["x", "y", "yaw"] if with_poses else []
    rows = []
    for time_s, ranges_m in drive.scans:
        at = track(time_s) if with_poses else ()
        rows.append([f"{BEGIN_S + time_s:.3f}", *at, *numbers, *ranges_m.tolist()])
    return write_table(path, ["t", *place, *limits, *(f"r{k}" for k in range(lidar.beams))], rows)


def write_pose_table(path: Path, poses: Iterable[tuple[float, Pose2D]]) -> Path:
    return write_table(
        path, ["t", "x", "y", "yaw"], [[f"{BEGIN_S + time_s:.3f}", *pose] for time_s, pose in poses]
    )


def write_tum(path: Path, poses: Iterable[tuple[float, Pose2D]]) -> Path:
    lines = [
        f"{BEGIN_S + time_s:.3f} {pose.x!r} {pose.y!r} 0 0 0 "
        f"{math.sin(pose.yaw / 2.0)!r} {math.cos(pose.yaw / 2.0)!r}"
        for time_s, pose in poses
    ]
    path.write_text("# t x y z qx qy qz qw\n" + "\n".join(lines) + "\n")
    return path


def write_labels(path: Path, labels: Iterable[tuple[int, float, str, float, float]], by: str = "t") -> Path:
    """By ``t`` or by ``scan_index``."""
    rows = [[index if by == "scan_index" else f"{time_s:.3f}", *others] for index, time_s, *others in labels]
    return write_table(path, [by, "id", "x", "y"], rows)


def write_map(folder: Path, grid: OccupancyGrid | None = None) -> Path:
    path = folder / "map.yaml"
    save_map(room() if grid is None else grid, path)
    return path


def map_message(grid: OccupancyGrid | None = None) -> Said:
    return Said("/map", ns_of(0.0), occupancy_grid(ns_of(0.0), room() if grid is None else grid), True)


class Result(NamedTuple):
    """What a replay came to."""

    replayed: Replayed
    notes: list[str]
    boxes: list[dict[str, str]]
    errors: list[dict[str, str]]
    folder: Path

    def score(self, preset: str = "real") -> dict[str, Any]:
        """All that the tables have of a preset; precision and recall are those of one-to-one matching."""
        found: dict[str, Any] = {}
        for table in self.replayed.tables:
            if table.name != "recording_causes":
                found |= next(row for row in table.rows if row["preset"] == preset)
        return found

    def causes(self, preset: str = "real") -> list[str]:
        return [row["cause"] for row in self.errors if row["preset"] == preset]

    @property
    def plain_boxes(self) -> list[tuple[str, ...]]:
        """Preset, frame, and corners of each box."""
        return [
            tuple(row[key] for key in ("preset", "frame", "x_min_m", "y_min_m", "x_max_m", "y_max_m"))
            for row in self.boxes
        ]


def replayed(files: Path | Sequence[Path], folder: Path, output: Path | None = None, **keys: Any) -> Result:
    """``replay`` with the keys of a setup, preset ``real`` unless given."""
    every = [files] if isinstance(files, Path) else list(files)
    setup = RecordingSetup().changed({"preset": "real", **keys})
    notes: list[str] = []
    output = output or folder / "out"
    done = replay(every, setup, notes.append, lambda share: None, output=output)
    tables = [rows(output / name) for name in ("boxes.csv", "errors.csv")]
    return Result(done, notes, *tables, output)


def played(
    folder: Path,
    drive: Drive,
    *,
    scans: Sequence[Said] | None = None,
    poses: Sequence[Said] | None = None,
    more: Sequence[Said] = (),
    labels: Sequence[tuple[int, float, str, float, float]] = (),
    grid: OccupancyGrid | None = None,
    container: str = "ros1",
    **keys: Any,
) -> Result:
    """A drive with its map, mount, scans and poses, or those given, and ``more``, written and replayed."""
    scans = scan_messages(drive) if scans is None else scans
    poses = pose_messages(drive) if poses is None else poses
    if labels:
        keys["truth"] = str(write_labels(folder / "truth.csv", labels))
    keys = {"map": str(write_map(folder, grid)), "mount": MOUNT_DEG, **keys}
    return replayed(write_bag(folder, [*scans, *poses, *more], container), folder, **keys)


def apart_m(one: Result, other: Result) -> float:
    """The farthest that sides of boxes lie apart, frame by frame; inf where one has a box more."""
    farthest = 0.0
    frames = [defaultdict(list), defaultdict(list)]
    for frame, result in zip(frames, (one, other), strict=True):
        for preset, number, *sides in result.plain_boxes:
            frame[preset, number].append(tuple(map(float, sides)))
    for key in {*frames[0], *frames[1]}:
        boxes = [sorted(frame[key]) for frame in frames]
        if len(boxes[0]) != len(boxes[1]):
            return math.inf
        for box in boxes[0]:
            nearest = min(max(abs(a - b) for a, b in zip(box, each, strict=True)) for each in boxes[1])
            farthest = max(farthest, nearest)
    return farthest
