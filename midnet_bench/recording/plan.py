"""Robots of a recording: their scans, poses and mounts, by a setup or found in topics and transforms."""

import itertools
import math
import re
from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from midnet_bench.errors import InputError, nearest_name
from midnet_bench.geometry import LidarGeometry, Pose2D
from midnet_bench.recording.files.readings import (
    NO_MOTION,
    NS,
    POSE,
    SCAN,
    NoReturn,
    PoseReading,
    Source,
    found_in,
)
from midnet_bench.recording.files.survey import EVER_NS, Stream, Survey, survey
from midnet_bench.recording.setup import RecordingSetup, mount_of

TF_POSE = "tf"  # value of key ``pose`` for transforms
ONE_ROBOT = "robot"  # name of the only robot of a recording
AT_ORIGIN = Pose2D(0.0, 0.0, 0.0)
NO_POSE = re.compile(r"goal|initial_?pose|target|waypoint|clicked|truth|/plan", re.IGNORECASE)
"""in names of topics that say where a robot is to go or was said to be, not where it is"""
FARTHEST_LASER_M = 100.0  # from its robot's middle
LEAST_BEAM_ANGLE_RAD = 1e-5


class Recorded(NamedTuple):
    """Open recordings, one element of each list for each source."""

    surveys: list[Survey]
    names: list[str]  # those of the files without their endings, numbered where two are alike
    offsets_ns: list[int]  # added to the times of each source
    part_ns: tuple[int, int]
    """first and last record time of the scans that are used, by the sources' common clock"""
    end_ns: int  # of the last message, by that clock

    @classmethod
    def of(cls, sources: list[Source], setup: RecordingSetup) -> "Recorded":
        """A look into each source. Raises InputError: damaged, no such part, or offset_s of no file."""
        stems = [Path(source.path).name.split(".")[0] for source in sources]
        names = [one if stems.count(one) == 1 else f"{one}_{k}" for k, one in enumerate(stems, start=1)]
        given = setup.of_each("offset_s", names)
        offsets_ns = [round(given.get(name, 0.0) * NS) for name in names]
        every = list(zip(sources, offsets_ns, strict=True))
        begin_ns = min(source.start_ns + own_ns for source, own_ns in every)
        end_ns = max(source.end_ns + own_ns for source, own_ns in every)
        from_ns = begin_ns + round(setup.from_s * NS) if setup.from_s else -EVER_NS
        to_ns = EVER_NS if setup.to_s is None else begin_ns + round(setup.to_s * NS)
        if from_ns > end_ns:
            length_s = (end_ns - begin_ns) / NS
            raise InputError(f"from_s: {setup.from_s:g} s is after the recording's end, {length_s:.1f} s")
        if setup.to_s is not None and setup.to_s <= setup.from_s:
            raise InputError(f"to_s: {setup.to_s:g} s is not after from_s, {setup.from_s:g} s")
        surveys = [survey(source, from_ns - own_ns, to_ns - own_ns) for source, own_ns in every]
        return cls(surveys, names, offsets_ns, (from_ns, to_ns), end_ns)

    def holder(self, topic: str, first: int = 0) -> int:
        """The source that has a topic, ``first`` before others."""
        at = (first, *range(len(self.surveys)))
        return next((number for number in at if topic in self.surveys[number].streams), first)

    def check_topic(self, source: int, topic: str, kind: str, key: str) -> None:
        """Raises InputError: the source has no such topic, nothing in it, or another kind of message."""
        streams = self.surveys[source].streams
        if topic not in streams:
            known = [
                name for each in self.surveys for name, one in each.streams.items() if one.topic.kind == kind
            ]
            raise InputError(f"{key}: no topic '{topic}'{nearest_name(topic, known or streams)}")
        if streams[topic].topic.kind != kind:
            raise InputError(
                f"{key}: '{topic}' is {streams[topic].topic.type}, which gives no {kind}; "
                f"'midnet-bench replay {self.surveys[source].source.path}' lists what there is"
            )
        if not streams[topic].seen:
            raise InputError(f"{key}: '{topic}' has no message where the recording was looked at")


class Link(NamedTuple):
    """One track that a pose is made of: a topic, or a pair of frames of tf, whose ``topic`` is empty."""

    source: int
    topic: str
    frame: str = ""
    child: str = ""

    @property
    def in_words(self) -> str:
        """The topic, or ``tf odom -> base_link``."""
        return self.topic or f"tf {self.frame} -> {self.child}"

    def seen(self, surveys: Sequence[Survey]) -> list[PoseReading]:
        """Its readings where the recordings were looked at."""
        each = surveys[self.source]
        return each.streams[self.topic].poses if self.topic else each.transforms[self.frame, self.child]


class PoseChain(NamedTuple):
    """Where something is: the links from the map down to it; a pose where a link never moves."""

    links: tuple[Link | Pose2D, ...]
    in_words: str


class RobotPlan(NamedTuple):
    """One laser of a recording, and the robot that carries it."""

    name: str  # of the robot; with several lasers each has its topic besides
    source: int
    scan_topic: str  # its stream: the topic, with ``@FRAME`` where scans of several lasers are on it
    pose: PoseChain
    mount: Pose2D
    is_mirrored: bool  # whether its beams go the other way round, or it is upside down
    delay_ns: int  # by which its scans are stamped too late
    no_return: NoReturn
    beam_s: float  # from one beam to the next
    carrier: str  # the robot's name
    frame: str = ""  # of its scans; empty: any on the topic

    @property
    def topic(self) -> str:
        """The topic of its scans."""
        return self.scan_topic.removesuffix(f"@{self.frame}")

    def moved(self, by: Pose2D) -> "RobotPlan":
        """The same with its poses moved."""
        if by == AT_ORIGIN:
            return self
        return self._replace(pose=PoseChain((by, *self.pose.links), self.pose.in_words))

    @property
    def pose_key(self) -> str:
        """Its pose as key ``pose`` of a setup takes it."""
        return TF_POSE if self.pose.in_words.startswith(("tf", "a fixed")) else self.pose.in_words


class AllyPlan(NamedTuple):
    """An object whose poses are recorded: an ally, or an intruder as a label."""

    name: str
    pose: PoseChain
    diameter_m: float


def followed_topic(recorded: Recorded, key: str, name: str, topic: str, diameter_m: float) -> AllyPlan:
    """An object whose poses are recorded. Raises InputError: no such topic; ``key`` is named."""
    source = recorded.holder(topic)
    recorded.check_topic(source, topic, POSE, f"{key}: {name}")
    return AllyPlan(name, PoseChain((Link(source, topic),), topic), diameter_m)


class _Laser(NamedTuple):
    """A stream of scans, and the name of the robot that carries its laser."""

    carrier: str
    source: int
    stream: str


def robots_of(recorded: Recorded, setup: RecordingSetup) -> list[RobotPlan]:
    """Each laser of the recordings, robot by robot.

    Raises:
        InputError: a topic or transforms are missing, do not fit, or it is not clear which to take.
    """
    lasers = _named_lasers(recorded, setup) if setup.scan else _all_lasers(recorded, setup)
    counts = Counter(laser.carrier for laser in lasers)
    names = [*counts, *(laser.stream for laser in lasers)]
    poses = setup.of_each("pose", list(counts))
    each = {key: setup.of_each(key, names) for key in ("mount", "mirrored", "delay_s")}
    robots = []
    for laser in sorted(lasers, key=lambda one: list(counts).index(one.carrier)):
        carrier, source, topic = laser
        given = {
            key: values.get(topic if topic in getattr(setup, key) else carrier)
            for key, values in each.items()
        }
        is_alone, look = counts[carrier] == 1, recorded.surveys[source]
        if given["mount"] is not None and not is_alone and topic not in setup.mount:
            several = f"robot '{carrier}' has several lasers; give {{{topic}: [x, y, yaw_deg], ...}}"
            raise InputError(f"mount: {several}")
        name, stream = carrier if is_alone else f"{carrier} {topic.strip('/')}", look.streams[topic]
        frame = stream.scans[0].frame
        above, map_frame = look.chain(frame), setup.map_frame
        if setup.start and map_frame not in above and above[-1] not in fixed_part(look, frame):
            map_frame = above[-1]  # that of odometry, which is placed on the map
        chain, (mount, upside_down) = _pose_and_mount(recorded, laser, frame, poses.get(carrier), map_frame)
        if given["mount"] is not None:
            x, y, yaw_deg = given["mount"]
            mount = Pose2D(x, y, math.radians(yaw_deg))
        elif look.source.mount is not None and mount == AT_ORIGIN:
            mount = look.source.mount
        if max(abs(mount.x), abs(mount.y)) > FARTHEST_LASER_M:
            raise InputError(
                f"mount: robot '{name}': its laser sits {mount.x:g}, {mount.y:g} m off; give mount, in metres"
            )
        robots.append(
            RobotPlan(
                name,
                source,
                topic,
                chain,
                mount,
                upside_down != (given["mirrored"] or False),
                round((given["delay_s"] or 0.0) * NS),
                found_in(stream.scans, setup.no_return),
                beam_time(stream)[0],
                carrier,
                frame if topic != stream.topic.name else "",
            )
        )
    return robots


def _named_lasers(recorded: Recorded, setup: RecordingSetup) -> list[_Laser]:
    found = []
    for name, given in setup.scan.items():
        for topic in [given] if isinstance(given, str) else given:
            sources = [number for number, look in enumerate(recorded.surveys) if _streams_on(look, topic)]
            if len(recorded.names) > 1 and name in recorded.names and recorded.names.index(name) in sources:
                sources = [recorded.names.index(name)]
            source = sources[0] if sources else 0
            look = recorded.surveys[source]
            for stream in _streams_on(look, topic) or [topic]:
                recorded.check_topic(source, stream, SCAN, "scan")
                if not look.streams[stream].has_ranges:
                    raise InputError(f"scan: {topic}: no scan of it holds a range; give another topic")
                found.append(_Laser(name or ONE_ROBOT, source, stream))
    return found


def _streams_on(look: Survey, topic: str) -> list[str]:
    """Streams of a topic: itself; of one with several frames those in tf, or the one with most scans."""
    if topic in look.streams:
        return [topic]
    each = [name for name in look.streams if name.rpartition("@")[0] == topic]
    return [name for name in each if look.streams[name].scans[0].frame in look.parents()] or each[:1]


def _all_lasers(recorded: Recorded, setup: RecordingSetup) -> list[_Laser]:
    found, is_one = [], len(recorded.surveys) == 1
    for number, look in enumerate(recorded.surveys):
        carriers = _carriers(look, setup.map_frame)
        if not is_one and len(carriers) > 1:
            topics = ", ".join(topic for streams in carriers for topic in streams)
            raise InputError(
                f"{look.source.path}: several topics have scans; choose in setup.yaml, "
                f"'scan: {{NAME: TOPIC}}': {topics}"
            )
        names = _names([streams[0] for streams in carriers]) if is_one else [recorded.names[number]]
        for name, streams in zip(names, carriers, strict=False):
            found += [_Laser(name, number, stream) for stream in streams]
    if found:
        return found
    paths = ", ".join(look.source.path for look in recorded.surveys)
    if setup.from_s or setup.to_s:
        upto = "the end" if setup.to_s is None else f"{setup.to_s:g} s"
        raise InputError(f"{paths}: no scan from {setup.from_s:g} s to {upto}; change from_s or to_s")
    if any(look.of_kind(SCAN) for look in recorded.surveys):
        raise InputError(
            f"{paths}: no scan: each scan of it has no range at all; give a recording with ranges"
        )
    known = ", ".join(name for look in recorded.surveys for name in look.streams)[:120]
    held = f"it holds {known}" if known else "it is empty"
    raise InputError(f"{paths}: no scan: no message of sensor_msgs/LaserScan; {held}")


def _carriers(look: Survey, map_frame: str) -> list[list[str]]:
    """The streams of scans of each robot: lasers that tf fixes to one frame are on one."""
    found: dict[str, list[str]] = {}
    for topic in dict.fromkeys(one.topic.name for one in look.of_kind(SCAN) if one.has_ranges):
        for name in _streams_on(look, topic):
            fixed = fixed_part(look, look.streams[name].scans[0].frame)
            fixed = fixed[: fixed.index(map_frame)] if map_frame in fixed else fixed
            found.setdefault(fixed[-1] if len(fixed) > 1 else name, []).append(name)
    return list(found.values())


def _names(topics: Sequence[str]) -> list[str]:
    """A name for each robot by its topic: the first part in which they differ; ``robot`` for one alone."""
    if len(topics) < 2:
        return [ONE_ROBOT] * len(topics)
    plain = [topic.strip("/") for topic in topics]
    first = [name.split("/")[0] for name in plain]
    return first if len(set(first)) == len(first) else [name.replace("/", "_") for name in plain]


def _pose_and_mount(
    recorded: Recorded, laser: _Laser, frame: str, given: str | None, map_frame: str
) -> tuple[PoseChain, tuple[Pose2D, bool]]:
    """A robot's poses, its laser's mount, and whether the laser is upside down."""
    look = recorded.surveys[laser.source]
    above = fixed_part(look, frame)
    given = _proposed_pose(look, frame, map_frame, laser.carrier) if given is None else given
    if given == TF_POSE:
        if map_frame not in look.chain(frame):
            raise InputError(_missing_link(look, frame, map_frame, laser.carrier))
        if map_frame in above:  # the whole chain is fixed: the laser is at rest
            pose, is_upside_down = composed(look, above[: above.index(map_frame) + 1])
            return PoseChain((pose,), "a fixed transform"), (AT_ORIGIN, is_upside_down)
        return _tf_chain(look, laser.source, above[-1], map_frame), composed(look, above)
    if given.startswith("at:"):
        return PoseChain((mount_of(given[3:], "pose"),), given), composed(look, above)
    source = recorded.holder(given, laser.source)
    recorded.check_topic(source, given, POSE, "pose")
    child = recorded.surveys[source].streams[given].poses[0].child
    if child and child in above:
        above = above[: above.index(child) + 1]
    return PoseChain((Link(source, given),), given), composed(look, above)


def fixed_part(look: Survey, laser: str) -> list[str]:
    """The laser's frame and those above it that it is fixed to, upwards."""
    chain = look.chain(laser)
    fixed = itertools.takewhile(lambda pair: look.is_fixed(pair[1], pair[0]), itertools.pairwise(chain))
    return [laser, *(frame for _, frame in fixed)]


def composed(look: Survey, frames: Sequence[str]) -> tuple[Pose2D, bool]:
    """The first frame's pose in the last one's, and whether it is upside down there."""
    whole = NO_MOTION
    for child, frame in itertools.pairwise(frames):
        whole = look.transforms[frame, child][0].transform.normalized().then(whole)
    return Pose2D(whole.x, whole.y, whole.yaw), whole.is_upside_down


def _tf_chain(look: Survey, source: int, base: str, map_frame: str) -> PoseChain:
    frames = look.chain(base)
    frames = frames[: frames.index(map_frame) + 1][::-1]
    links = [
        composed(look, (child, frame))[0] if look.is_fixed(frame, child) else Link(source, "", frame, child)
        for frame, child in itertools.pairwise(frames)
    ]
    return PoseChain(tuple(links), "tf " + " -> ".join(frames))


def _missing_link(look: Survey, laser: str, map_frame: str, name: str) -> str:
    chain, line = look.chain(laser), f"{look.source.path}: robot '{name}': "
    if not look.transforms:
        return (
            f"{line}no transforms: there is no /tf; give --pose TOPIC, FILE.csv, "
            "or at:X,Y,YAW_DEG if it is at rest"
        )
    line += f"tf does not lead from '{map_frame}' to '{laser}': "
    if map_frame not in look.parents().values():
        line += f"no transform begins at '{map_frame}', the chain ends at '{chain[-1]}'"
        return f"{line}; --start found or --start X,Y,YAW_DEG places odometry; else set map_frame"
    if len(chain) == 1:
        return f"{line}no transform ends at '{laser}'; give --pose TOPIC, and mount in setup.yaml"
    return f"{line}nothing links '{chain[-1]}' to '{map_frame}'; give --pose TOPIC or FILE.csv"


def _proposed_pose(look: Survey, laser: str, map_frame: str, name: str) -> str:
    """Transforms if they lead to the map, else the only topic with poses. Raises InputError: unclear."""
    if map_frame in look.chain(laser):
        return TF_POSE
    topics = [one.topic.name for one in look.of_kind(POSE) if not NO_POSE.search(one.topic.name)]
    if "pose" in topics:
        return "pose"  # of a table or a log
    own = [topic for topic in topics if topic.strip("/").split("/")[0] == name]
    if len(own or topics) == 1:
        return (own or topics)[0]
    if topics:
        several = "several topics have poses; choose with --pose TOPIC: " + ", ".join(topics)[:150]
        raise InputError(f"{look.source.path}: robot '{name}': {several}")
    raise InputError(_missing_link(look, laser, map_frame, name))


def beam_time(stream: Stream) -> tuple[float, str]:
    """Seconds from one beam to the next, and why they are not what the scans say; empty if they are.

    A laser turns once from one scan to the next. A driver's ``time_increment`` that does not make about one
    turn of it is rubbish.
    """
    scan = next(scan for scan in stream.scans if len(scan.ranges_m))
    stated_s, period_s = scan.time_increment_s, stream.period_ns / NS
    step_rad = max(abs(scan.angle_increment_rad), 1e-6)
    if not (period_s > 0.0 and step_rad < math.tau):
        return 0.0, f"{len(stream.scans)} scans do not show how fast the laser turns"
    turn = math.tau / step_rad
    if 0.5 * period_s <= stated_s * turn <= 1.2 * period_s:
        return stated_s, ""
    beam_s = period_s / turn
    return beam_s, (
        f"time_increment {stated_s:g} s does not fit a turn of {turn:.0f} beams in {period_s:.3g} s; "
        f"{beam_s:.3g} s are taken"
    )


@lru_cache(maxsize=256)
def geometry_of(numbers: tuple[float, ...], beams: int, mount: Pose2D, is_mirrored: bool) -> LidarGeometry:
    """A LiDAR by :meth:`ScanReading.geometry`, the same one each time. Raises InputError: it cannot be."""
    first, step, least_m, most_m = numbers
    if not (math.isfinite(first) and math.isfinite(step) and abs(step) > LEAST_BEAM_ANGLE_RAD):
        raise InputError(f"has angle_min {first:g} and angle_increment {step:g}, which no LiDAR has")
    if abs(step) * (beams - 1) > 2.0 * math.tau or abs(first) > 2.0 * math.tau:
        raise InputError(f"has {beams} beams {step:g} rad apart, which go round more than once; in degrees?")
    if math.isnan(least_m) or math.isnan(most_m):
        raise InputError("has a range limit that is not a number")
    side = -1.0 if is_mirrored else 1.0
    return LidarGeometry(beams, side * first, side * step, max(least_m, 0.0), most_m, mount)
