"""Robots of a recording: their scans, poses and mounts, by a setup or found in topics and transforms."""

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from midnet_bench.errors import InputError, nearest_name
from midnet_bench.geometry import Pose2D
from midnet_bench.recording.files.no_return import NoReturn, found_in
from midnet_bench.recording.files.readings import NO_MOTION, NS, POSE, SCAN, PoseReading
from midnet_bench.recording.files.survey import Stream, Survey
from midnet_bench.recording.setup import LARGEST, RecordingSetup

TF_POSE = "tf"
"""value of key ``pose`` for transforms"""
ONE_ROBOT = "robot"
"""name of the only robot of a recording"""
AT_ORIGIN = Pose2D(0.0, 0.0, 0.0)
NO_POSE = re.compile(r"goal|initial_?pose|target|waypoint|clicked|truth|/plan", re.IGNORECASE)
"""in names of topics that say where a robot is to go or was said to be, not where it is"""
FARTHEST_LASER_M = 100.0
"""from its robot's middle"""


class Link(NamedTuple):
    """One track that a pose is made of: a topic, or a pair of frames of tf."""

    source: int
    topic: str
    """empty for a pair of frames"""
    frame: str = ""
    child: str = ""

    @property
    def in_words(self) -> str:
        """The topic, or ``tf odom -> base_link``."""
        return self.topic or f"tf {self.frame} -> {self.child}"

    def seen(self, surveys: Sequence[Survey]) -> list[PoseReading]:
        """Its readings where the recordings were looked at."""
        survey = surveys[self.source]
        return survey.streams[self.topic].poses if self.topic else survey.transforms[self.frame, self.child]


class PoseChain(NamedTuple):
    """Where something is: the links from the map down to it; a pose where a link never moves."""

    links: tuple[Link | Pose2D, ...]
    in_words: str


class RobotPlan(NamedTuple):
    """One laser of a recording, and the robot that carries it."""

    name: str
    """of the robot; with several lasers each has its topic besides"""
    source: int
    scan_topic: str
    """its stream: the topic, with ``@FRAME`` where scans of several lasers are on it"""
    pose: PoseChain
    mount: Pose2D
    """of the laser on the robot"""
    is_mirrored: bool
    """whether its beams go the other way round, or it is upside down"""
    delay_ns: int
    """by which its scans are stamped too late"""
    no_return: NoReturn
    beam_s: float
    """from one beam to the next"""
    carrier: str
    """the robot's name"""
    frame: str = ""
    """of its scans; empty: any on the topic"""

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


def robots_of(surveys: Sequence[Survey], setup: RecordingSetup, file_names: Sequence[str]) -> list[RobotPlan]:
    """Each laser of the recordings, robot by robot.

    Args:
        surveys: of each source.
        setup: topics, mounts and delays, as far as they are given.
        file_names: a name for each source, for robots of several files.

    Raises:
        InputError: a topic or transforms are missing, do not fit, or it is not clear which to take.
    """
    scans = _scan_topics(surveys, setup, file_names)
    lasers = [laser for own in scans.values() for laser in own]
    names = [*scans, *(topic for _, topic in lasers)]
    poses = setup.of_each("pose", list(scans))
    mounts, mirrored, delays_s = (setup.of_each(key, names) for key in ("mount", "mirrored", "delay_s"))
    robots = []
    for carrier, (source, topic) in ((name, laser) for name, own in scans.items() for laser in own):
        is_alone = len(scans[carrier]) == 1
        name = carrier if is_alone else f"{carrier} {topic.strip('/')}"
        survey, stream, own_mount = (
            surveys[source],
            surveys[source].streams[topic],
            surveys[source].source.mount,
        )
        laser, map_frame = stream.scans[0].frame, setup.map_frame
        above = survey.chain(laser)
        if setup.start and map_frame not in above and above[-1] not in _fixed_part(survey, laser):
            map_frame = above[-1]  # that of odometry, which is placed on the map
        chain, mount, upside_down = _where(surveys, source, laser, poses.get(carrier), map_frame, carrier)
        key_of = {
            key: topic if topic in getattr(setup, key) else carrier
            for key in ("mount", "mirrored", "delay_s")
        }
        if key_of["mount"] in mounts:
            if not is_alone and key_of["mount"] == carrier:
                raise InputError(
                    f"mount: robot '{carrier}' has several lasers; give {{{topic}: [x, y, yaw_deg], ...}}"
                )
            x, y, yaw_deg = mounts[key_of["mount"]]
            mount = Pose2D(x, y, math.radians(yaw_deg))
        elif own_mount is not None and mount == AT_ORIGIN:
            mount = own_mount
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
                upside_down != mirrored.get(key_of["mirrored"], False),
                round(delays_s.get(key_of["delay_s"], 0.0) * NS),
                found_in(stream.scans, setup.no_return),
                beam_time(stream)[0],
                carrier,
                laser if topic != stream.topic.name else "",
            )
        )
    return robots


def _scan_topics(
    surveys: Sequence[Survey], setup: RecordingSetup, file_names: Sequence[str]
) -> dict[str, list[tuple[int, str]]]:
    """Robot's name -> source and stream of each of its lasers."""
    if not setup.scan:
        return _all_scan_topics(surveys, setup, file_names)
    found: dict[str, list[tuple[int, str]]] = {}
    for name, given in setup.scan.items():
        for topic in [given] if isinstance(given, str) else given:
            sources = [number for number, survey in enumerate(surveys) if _lasers_on(survey, topic)]
            if len(surveys) > 1 and name in file_names and file_names.index(name) in sources:
                sources = [file_names.index(name)]
            source = sources[0] if sources else 0
            lasers = _lasers_on(surveys[source], topic) or [topic]
            for laser in lasers:
                check_topic(surveys, source, laser, SCAN, "scan")
                if not surveys[source].streams[laser].has_ranges:
                    raise InputError(f"scan: {topic}: no scan of it holds a range; give another topic")
            found.setdefault(name or ONE_ROBOT, []).extend((source, laser) for laser in lasers)
    return found


def _lasers_on(survey: Survey, topic: str) -> list[str]:
    """Streams of a topic: itself; of one with several frames those in tf, or the one with most scans."""
    if topic in survey.streams:
        return [topic]
    each = [name for name in survey.streams if name.rpartition("@")[0] == topic]
    return [name for name in each if survey.streams[name].scans[0].frame in survey.parents()] or each[:1]


def _all_scan_topics(
    surveys: Sequence[Survey], setup: RecordingSetup, file_names: Sequence[str]
) -> dict[str, list[tuple[int, str]]]:
    found: dict[str, list[tuple[int, str]]] = {}
    for number, survey in enumerate(surveys):
        carriers = _carriers(survey, setup.map_frame)
        if len(surveys) > 1 and len(carriers) > 1:
            raise InputError(
                f"{survey.source.path}: several topics have scans; choose in setup.yaml, "
                f"'scan: {{NAME: TOPIC}}': {', '.join(topic for lasers in carriers for topic in lasers)}"
            )
        names = [file_names[number]] if len(surveys) > 1 else _names([lasers[0] for lasers in carriers])
        each = zip(names, carriers, strict=False)
        found |= {name: [(number, topic) for topic in lasers] for name, lasers in each}
    if not found:
        paths = ", ".join(survey.source.path for survey in surveys)
        if setup.from_s or setup.to_s:
            upto = "the end" if setup.to_s is None else f"{setup.to_s:g} s"
            raise InputError(f"{paths}: no scan from {setup.from_s:g} s to {upto}; change --from or --to")
        raise InputError(f"{paths}: {_no_scans(surveys, any(survey.of_kind(SCAN) for survey in surveys))}")
    return found


def _carriers(survey: Survey, map_frame: str) -> list[list[str]]:
    """The streams of scans of each robot: lasers that tf fixes to one frame are on one."""
    found: dict[str, list[str]] = {}
    for topic in dict.fromkeys(one.topic.name for one in survey.of_kind(SCAN) if one.has_ranges):
        for name in _lasers_on(survey, topic):
            fixed = _fixed_part(survey, survey.streams[name].scans[0].frame)
            fixed = fixed[: fixed.index(map_frame)] if map_frame in fixed else fixed
            found.setdefault(fixed[-1] if len(fixed) > 1 else name, []).append(name)
    return list(found.values())


def _names(topics: Sequence[str]) -> list[str]:
    """A name for each robot by its topic: the first part in which they differ; ``robot`` for one alone."""
    if len(topics) < 2:
        return [ONE_ROBOT] * len(topics)
    first = [topic.strip("/").split("/")[0] for topic in topics]
    return (
        first if len(set(first)) == len(first) else [topic.strip("/").replace("/", "_") for topic in topics]
    )


def _no_scans(surveys: Sequence[Survey], has_topic: bool) -> str:
    if has_topic:
        return "no scan: each scan of it has no range at all; give a recording with ranges"
    known = [name for survey in surveys for name in survey.streams]
    held = f"it holds {', '.join(known)[:120]}" if known else "it is empty"
    return f"no scan: no message of sensor_msgs/LaserScan; {held}"


def check_topic(surveys: Sequence[Survey], source: int, topic: str, kind: str, key: str) -> None:
    """Raises InputError: the source has no such topic, nothing in it, or another kind of message."""
    streams = surveys[source].streams
    if topic not in streams:
        known = [name for survey in surveys for name, one in survey.streams.items() if one.topic.kind == kind]
        raise InputError(f"{key}: no topic '{topic}'{nearest_name(topic, known or streams)}")
    if streams[topic].topic.kind != kind:
        raise InputError(
            f"{key}: '{topic}' is {streams[topic].topic.type}, which gives no {kind}; 'midnet-bench replay "
            f"{surveys[source].source.path}' lists what there is"
        )
    if not (streams[topic].scans or streams[topic].poses):
        raise InputError(f"{key}: '{topic}' has no message where the recording was looked at")


def _where(
    surveys: Sequence[Survey], source: int, laser: str, given: str | None, map_frame: str, name: str
) -> tuple[PoseChain, Pose2D, bool]:
    """A robot's poses, its laser's mount, and whether the laser is upside down."""
    survey = surveys[source]
    above = _fixed_part(survey, laser)
    given = _proposed_pose(survey, laser, map_frame, name) if given is None else given
    if given == TF_POSE:
        if map_frame not in survey.chain(laser):
            raise InputError(_missing_link(survey, laser, map_frame, name))
        if map_frame in above:  # the whole chain is fixed: the laser is at rest
            pose, is_upside_down = _composed(survey, above[: above.index(map_frame) + 1])
            return PoseChain((pose,), "a fixed transform"), AT_ORIGIN, is_upside_down
        return _tf_chain(survey, source, above[-1], map_frame), *_composed(survey, above)
    if given.startswith("at:"):
        return PoseChain((mount_of(given[3:], "pose"),), given), *_composed(survey, above)
    topic_at = source_of(surveys, given, source)
    check_topic(surveys, topic_at, given, POSE, "pose")
    child = surveys[topic_at].streams[given].poses[0].child
    if child and child in above:
        above = above[: above.index(child) + 1]
    return PoseChain((Link(topic_at, given),), given), *_composed(survey, above)


def source_of(surveys: Sequence[Survey], topic: str, first: int) -> int:
    """The source that has a topic, the one of the scans before others."""
    at = [first, *(number for number in range(len(surveys)) if number != first)]
    return next((number for number in at if topic in surveys[number].streams), first)


def _fixed_part(survey: Survey, laser: str) -> list[str]:
    """The laser's frame and those above it that it is fixed to, upwards."""
    above = [laser]
    for frame in survey.chain(laser)[1:]:
        if not survey.is_fixed(frame, above[-1]):
            break
        above.append(frame)
    return above


def _composed(survey: Survey, frames: Sequence[str]) -> tuple[Pose2D, bool]:
    """The first frame's pose in the last one's, and whether it is upside down there."""
    whole = NO_MOTION
    for child, frame in itertools.pairwise(frames):
        whole = survey.fixed(frame, child).then(whole)
    return Pose2D(whole.x, whole.y, whole.yaw), whole.is_upside_down


def _tf_chain(survey: Survey, source: int, base: str, map_frame: str) -> PoseChain:
    frames = survey.chain(base)
    frames = frames[: frames.index(map_frame) + 1][::-1]
    links = [
        _composed(survey, (child, frame))[0]
        if survey.is_fixed(frame, child)
        else Link(source, "", frame, child)
        for frame, child in itertools.pairwise(frames)
    ]
    return PoseChain(tuple(links), "tf " + " -> ".join(frames))


def _missing_link(survey: Survey, laser: str, map_frame: str, name: str) -> str:
    chain, line = survey.chain(laser), f"{survey.source.path}: robot '{name}': "
    if not survey.transforms:
        return (
            f"{line}no transforms: there is no /tf; give --pose TOPIC, FILE.csv, "
            "or at:X,Y,YAW_DEG if it is at rest"
        )
    line += f"tf does not lead from '{map_frame}' to '{laser}': "
    if map_frame not in survey.parents().values():
        line += f"no transform begins at '{map_frame}', the chain ends at '{chain[-1]}'"
        return f"{line}; --place found or --start X,Y,YAW_DEG places odometry; else set map_frame"
    if len(chain) == 1:
        return f"{line}no transform ends at '{laser}'; give --pose TOPIC, and mount in setup.yaml"
    return f"{line}nothing links '{chain[-1]}' to '{map_frame}'; give --pose TOPIC or FILE.csv"


def _proposed_pose(survey: Survey, laser: str, map_frame: str, name: str) -> str:
    """Transforms if they lead to the map, else the only topic with poses. Raises InputError: unclear."""
    if map_frame in survey.chain(laser):
        return TF_POSE
    topics = [one.topic.name for one in survey.of_kind(POSE) if not NO_POSE.search(one.topic.name)]
    if "pose" in topics:
        return "pose"  # of a table or a log
    own = [topic for topic in topics if topic.strip("/").split("/")[0] == name]
    if len(own or topics) == 1:
        return (own or topics)[0]
    if topics:
        raise InputError(
            f"{survey.source.path}: robot '{name}': several topics have poses; choose with --pose TOPIC: "
            f"{', '.join(topics)[:150]}"
        )
    raise InputError(_missing_link(survey, laser, map_frame, name))


def followed_topics(
    surveys: Sequence[Survey], topics: Mapping[str, str], diameters_m: Mapping[str, float], key: str
) -> list[AllyPlan]:
    """Objects whose poses are recorded, by name. Raises InputError: no such topic; ``key`` is named."""
    plans = []
    for name, topic in topics.items():
        source = source_of(surveys, topic, 0)
        check_topic(surveys, source, topic, POSE, f"{key}: {name}")
        plans.append(AllyPlan(name, PoseChain((Link(source, topic),), topic), diameters_m[name]))
    return plans


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


def mount_of(text: str, option: str) -> Pose2D:
    """``X,Y,YAW_DEG``. Raises InputError: these are no three numbers."""
    parts = text.split(",")
    if len(parts) != 3:
        raise InputError(f"{option} {text}: three numbers are needed: X,Y,YAW_DEG (metres, degrees)")
    x, y, yaw_deg = (number_of(part, f"{option} {text}") for part in parts)
    return Pose2D(x, y, math.radians(yaw_deg))


def number_of(text: str, source: str) -> float:
    """A finite number, at most ``LARGEST``. Raises InputError otherwise."""
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"{source}: {text!r} is not a number") from None
    if not abs(value) <= LARGEST:
        raise InputError(f"{source}: {text!r} is out of range; allowed: -{LARGEST:g} to {LARGEST:g}")
    return value
