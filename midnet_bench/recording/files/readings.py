"""What a recording says, one reading after the other, whatever file it is from; what no return means.

Of a range REP 117 says: inf, nothing came back; -inf, too near; nan, a void reading. Many drivers write nan,
0, a number below the least range, or the largest range instead. What it means decides whether its beam clears
marks.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from midnet_bench.errors import InputError
from midnet_bench.geometry import Floats, Pose2D
from midnet_bench.grid import FREE, OCCUPIED, OCCUPIED_FROM, UNKNOWN, OccupancyGrid, as_written
from midnet_bench.io.map_server import turned

NS = 1_000_000_000
"""nanoseconds in a second: times are whole nanoseconds, which a float of the epoch cannot separate"""
FARTHEST_M = 1e7  # from the origin of a frame: the Earth's quarter, and UTM's northings, are as long
FINEST_CELL_M, COARSEST_CELL_M, MOST_CELLS = 0.001, 10.0, 25_000_000
"""of a map; as large as one in a file may be"""
SCAN, POSE, TF, GRID = "scan", "pose", "tf", "grid"
KINDS = {
    "sensor_msgs/msg/LaserScan": SCAN,
    "nav_msgs/msg/Odometry": POSE,
    "geometry_msgs/msg/PoseStamped": POSE,
    "geometry_msgs/msg/PoseWithCovarianceStamped": POSE,
    "geometry_msgs/msg/TransformStamped": POSE,
    "tf2_msgs/msg/TFMessage": TF,
    "tf/msg/tfMessage": TF,
    "nav_msgs/msg/OccupancyGrid": GRID,
}
"""message type -> kind of reading; all other types are left out"""
Meaning = Literal["clears", "nothing"]
CODES = {
    "inf": "inf",
    "nan": "nan",
    "zero": "0 or less",
    "below": "below range_min",
    "above": "range_max or more",
}
"""code -> which readings have it, the first that fits; -inf is ``zero``"""
LEAST_SHARE = 0.002
"""of all beams: what is rarer is a fault of a reading, and not how the driver says that nothing came back"""
SAME_VALUE = 0.9
"""of the readings below the least range: so many of one value are a code, else they are near things"""
PILED_SHARE = 0.02
"""of all beams that have one and the same value, the largest: that is the driver's largest range"""


class ScanReading(NamedTuple):
    """sensor_msgs/LaserScan as the file has it."""

    topic: str
    record_ns: int  # when it was recorded
    stamp_ns: int  # what its header says
    frame: str  # of the sensor
    ranges_m: Floats  # (beams,) whatever the driver wrote
    angle_min_rad: float
    angle_increment_rad: float
    range_min_m: float
    range_max_m: float
    time_increment_s: float  # from one beam to the next; drivers write rubbish here

    def geometry(self, range_max_m: float = math.inf) -> tuple[float, float, float, float]:
        """First angle and step, radians; least range, and the largest one or this if it is less, metres."""
        largest_m = min(self.range_max_m, range_max_m)
        return self.angle_min_rad, self.angle_increment_rad, self.range_min_m, largest_m


class Transform(NamedTuple):
    """A rigid motion: metres, and a unit quaternion."""

    x: float
    y: float
    z: float
    qx: float
    qy: float
    qz: float
    qw: float

    @property
    def yaw(self) -> float:
        """The turn about z of its x axis, radians."""
        return math.atan2(
            2.0 * (self.qw * self.qz + self.qx * self.qy), 1.0 - 2.0 * (self.qy * self.qy + self.qz * self.qz)
        )

    @property
    def is_upside_down(self) -> bool:
        """Whether its z axis points down."""
        return self.qx * self.qx + self.qy * self.qy > 0.5

    @property
    def is_pose(self) -> bool:
        """Whether its numbers are finite, it lies within ``FARTHEST_M``, and the quaternion has a length."""
        is_near = max(map(abs, self[:3])) <= FARTHEST_M
        return is_near and all(map(math.isfinite, self)) and 1e-6 < self._squared < 1e6

    @property
    def _squared(self) -> float:
        """The quaternion's squared length."""
        return self.qx * self.qx + self.qy * self.qy + self.qz * self.qz + self.qw * self.qw

    def normalized(self) -> "Transform":
        """The same with a quaternion of length 1."""
        length = math.sqrt(self._squared)
        return Transform(*self[:3], *(part / length for part in self[3:]))

    def then(self, other: "Transform") -> "Transform":
        """First ``other``, then this: the frame that ``other`` places in this one's."""
        ax, ay, az, aw = self.qx, self.qy, self.qz, self.qw
        x, y, z, bx, by, bz, bw = other
        tx, ty, tz = 2.0 * (ay * z - az * y), 2.0 * (az * x - ax * z), 2.0 * (ax * y - ay * x)
        return Transform(
            self.x + (x + aw * tx + ay * tz - az * ty),
            self.y + (y + aw * ty + az * tx - ax * tz),
            self.z + (z + aw * tz + ax * ty - ay * tx),
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        )


NO_MOTION = Transform(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


class PoseReading(NamedTuple):
    """Where a frame was: a pose, an odometry, or one transform of tf."""

    topic: str
    record_ns: int
    stamp_ns: int
    frame: str  # of the pose
    child: str  # the frame with this pose; empty where the message does not name it
    transform: Transform


class GridReading(NamedTuple):
    """nav_msgs/OccupancyGrid."""

    topic: str
    record_ns: int
    cells: npt.NDArray[np.int8]  # (rows, columns), row 0 at the lowest y
    resolution_m: float
    origin: Transform

    def as_map(self) -> OccupancyGrid:
        """The prior map that it is, int8: 100 occupied, 0 free, -1 unknown. Raises InputError: it is none."""
        size = self.cells.size
        if not (FINEST_CELL_M <= self.resolution_m <= COARSEST_CELL_M and 0 < size <= MOST_CELLS):
            raise InputError(f"map: {self.topic}: {size} cells of {self.resolution_m:g} m cannot be")
        if not self.origin.is_pose:
            raise InputError(f"map: {self.topic}: its origin is no pose; its numbers must be finite")
        resolution_m = as_written(self.resolution_m)
        cells = np.where(self.cells >= OCCUPIED_FROM, OCCUPIED, np.where(self.cells < 0, UNKNOWN, FREE))
        grid = OccupancyGrid(cells.astype(np.int8), resolution_m, (self.origin.x, self.origin.y))
        yaw_rad = self.origin.normalized().yaw
        return turned(grid, yaw_rad, f"map: {self.topic}") if abs(yaw_rad) > 1e-6 else grid


Reading = ScanReading | PoseReading | GridReading


class Topic(NamedTuple):
    """One stream of a recording."""

    name: str
    type: str  # of its messages, as ROS 2 writes it: ``sensor_msgs/msg/LaserScan``
    messages: int
    kind: str  # of the readings that it gives, such as ``scan``; empty if it gives none


class Source(Protocol):
    """One recorded file or folder."""

    path: str
    topics: dict[str, Topic]
    start_ns: int
    end_ns: int
    remarks: list[str]  # what was not taken as the file has it, a line each
    mount: Pose2D | None  # of its laser on the robot, if the file says so by itself

    def readings(
        self, topics: set[str], start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[Reading]:
        """What these topics say, in the order in which it was recorded.

        Raises:
            InputError: the file is damaged here; what came before is good.
        """

    def close(self) -> None:
        """Let go of the file."""


def decoded(topic: str, message_type: str, record_ns: int, message: Any) -> Iterator[Reading]:
    """The readings in one message of ROS: one, or of tf as many as there are transforms."""
    of, kind = (topic, record_ns), KINDS[message_type]
    if kind == SCAN:
        angles = float(message.angle_min), float(message.angle_increment)
        limits = float(message.range_min), float(message.range_max)
        ranges_m = np.asarray(message.ranges, dtype=np.float64)
        yield ScanReading(*of, *_stamped(message), ranges_m, *angles, *limits, float(message.time_increment))
    elif kind == TF or message_type.endswith("/TransformStamped"):
        for one in message.transforms if kind == TF else [message]:
            placed = _transform(one.transform.translation, one.transform.rotation)
            yield PoseReading(*of, *_stamped(one), _plain(one.child_frame_id), placed)
    elif kind == POSE:
        pose = message.pose if message_type.endswith("/PoseStamped") else message.pose.pose
        child = _plain(getattr(message, "child_frame_id", ""))
        yield PoseReading(*of, *_stamped(message), child, _transform(pose.position, pose.orientation))
    else:
        info = message.info
        cells = np.asarray(message.data, dtype=np.int8).reshape(info.height, info.width)
        origin = _transform(info.origin.position, info.origin.orientation)
        yield GridReading(*of, cells, float(info.resolution), origin)


def _transform(at: Any, turn: Any) -> Transform:
    return Transform(at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w)


def _stamped(message: Any) -> tuple[int, str]:
    """A header's stamp, nanoseconds, and its frame."""
    stamp = message.header.stamp
    return int(stamp.sec) * NS + int(stamp.nanosec), _plain(message.header.frame_id)


def _plain(frame: str) -> str:
    """Without the leading slash of tf's first version."""
    return frame.removeprefix("/")


class NoReturn(NamedTuple):
    """How the scans of one topic are to be read."""

    shares: dict[str, float]  # code -> of all beams
    meaning: dict[str, Meaning]  # code -> what it says
    range_max_m: float  # as the scans have it, or less where readings pile up below it

    def cleaned(self, scan: ScanReading) -> Floats:
        """(beams,) the ranges, metres: inf where nothing came back, nan where the reading says nothing."""
        kinds = _kinds(scan, self.range_max_m)
        cleaned = np.array([math.inf if self.meaning[code] == "clears" else math.nan for code in CODES])
        return np.where(kinds < 0, scan.ranges_m, cleaned[kinds])

    @property
    def in_words(self) -> str:
        """``inf 12.3 % (clears), nan 0.1 % (says nothing)``."""
        meanings = {"clears": "clears", "nothing": "says nothing"}
        parts = [
            f"{CODES[code]} {share:.1%} ({meanings[self.meaning[code]]})"
            for code, share in self.shares.items()
            if share > 0.0
        ]
        return ", ".join(parts) or "none"


def _kinds(scan: ScanReading, range_max_m: float) -> npt.NDArray[np.int64]:
    """(beams,) the place in ``CODES`` of each reading, -1 for a range."""
    ranges, most_m = scan.ranges_m, min(range_max_m, scan.range_max_m)
    is_zero, is_below, is_above = ranges <= 0.0, ranges < scan.range_min_m, ranges >= most_m
    is_code = (ranges == math.inf, np.isnan(ranges), is_zero, is_below, is_above)
    return np.select(is_code, range(len(CODES)), -1)


def found_in(scans: Sequence[ScanReading], given: Mapping[str, Meaning]) -> NoReturn:
    """How a driver says that nothing came back, from some of its scans.

    inf and a reading at or beyond the largest range clear. Where there is neither, the most frequent of nan,
    0 and one number below the least range is the code, if it is not rare. All else says nothing.

    Args:
        scans: of one topic.
        given: meanings of codes by the user, which count.
    """
    ranges = np.concatenate([np.empty(0), *(scan.ranges_m for scan in scans)])
    range_max_m = max((scan.range_max_m for scan in scans), default=math.inf)
    finite = ranges[np.isfinite(ranges)]
    largest_m = float(finite.max(initial=-math.inf))
    piled = np.count_nonzero(finite >= largest_m - 1e-6)
    if largest_m < range_max_m and piled >= max(PILED_SHARE * len(ranges), 10):
        range_max_m = largest_m
    kinds = np.concatenate([np.empty(0), *(_kinds(scan, range_max_m) for scan in scans)])
    shares = {code: int(np.count_nonzero(kinds == k)) / max(len(kinds), 1) for k, code in enumerate(CODES)}
    meaning: dict[str, Meaning] = {**dict.fromkeys(CODES, "nothing"), "inf": "clears", "above": "clears"}
    candidates = ["nan", "zero"]
    _, counts = np.unique(ranges[kinds == list(CODES).index("below")], return_counts=True)
    if counts.max(initial=0) >= SAME_VALUE * max(counts.sum(), 1):
        candidates.append("below")
    code = max(candidates, key=shares.__getitem__)
    if max(shares["inf"], shares["above"]) < LEAST_SHARE <= shares[code]:
        meaning[code] = "clears"
    return NoReturn(shares, {**meaning, **given}, range_max_m)
