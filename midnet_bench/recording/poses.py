"""Poses over time: interpolated in one topic, or along a chain of tf, while a recording streams by."""

import bisect
import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Floats, Pose2D, wrap_angle
from midnet_bench.recording.files.readings import NS, PoseReading, ScanReading

Clock = Literal["header", "record"]

KEPT_NS = 5 * NS  # poses older than the current instant by more than this are forgotten
FORGET_EVERY = 512
HOLDS = 3.0  # usual intervals for which a slow transform, such as map -> odom, is trusted after its last word


class InterpolatedPose(NamedTuple):
    """A pose interpolated between two readings, and the gap to the farther one."""

    pose: Pose2D
    age_s: float


def stamp_ns(reading: ScanReading | PoseReading, clock: Clock) -> int:
    """The reading's time stamp by the chosen clock, nanoseconds."""
    return reading.stamp_ns if clock == "header" else reading.record_ns


def interpolated(older: Floats, newer: Floats, share: Floats) -> Floats:
    """(n, 3) poses x, y, yaw between (n, 3) others; x and y go straight, the yaw turns the short way.

    ``share``: (n,) 0 at the older, 1 at the newer. The yaw is within [-pi, pi).
    """
    step = newer - older
    step[:, 2] = (step[:, 2] + math.pi) % math.tau - math.pi
    poses = older + share[:, None] * step
    poses[:, 2] = (poses[:, 2] + math.pi) % math.tau - math.pi
    return np.asarray(poses)


class PoseTrack:
    """The poses of one topic, or of one pair of tf's frames, in order of time; old ones are forgotten."""

    def __init__(self, name: str = "") -> None:
        self.name = name
        self._times: list[int] = []
        self._poses: list[Pose2D] = []
        self._first_ns = 0
        self.taken = 0
        self.void = 0
        """readings that were no pose: nan, inf, too far off, or a quaternion of no length"""
        self.first_void_ns: int | None = None

    def take(self, time_ns: int, reading: PoseReading) -> None:
        """One more pose. One that is late takes its place; of two at one time the later one counts."""
        if not reading.transform.is_pose:
            self.void += 1
            self.first_void_ns = time_ns if self.first_void_ns is None else self.first_void_ns
            return
        turn = reading.transform.normalized()
        self.add(time_ns, Pose2D(turn.x, turn.y, turn.yaw))

    def add(self, time_ns: int, pose: Pose2D) -> None:
        """See :meth:`take`."""
        self._first_ns = self._first_ns if self.taken else time_ns
        self.taken += 1
        index = bisect.bisect_left(self._times, time_ns)
        is_known = index < len(self._times) and self._times[index] == time_ns
        self._times[index : index + is_known] = [time_ns]
        self._poses[index : index + is_known] = [pose]

    @property
    def until_ns(self) -> int | None:
        """The time of the newest pose; None before the first."""
        return self._times[-1] if self._times else None

    @property
    def usual_s(self) -> float:
        """From one pose to the next on the average; inf before the second."""
        return (self._times[-1] - self._first_ns) / NS / (self.taken - 1) if self.taken > 1 else math.inf

    def latest(self, time_ns: int) -> InterpolatedPose | None:
        """The last pose up to an instant; None before the first."""
        after = bisect.bisect_right(self._times, time_ns)
        if after == 0:
            return None
        return InterpolatedPose(self._poses[after - 1], (time_ns - self._times[after - 1]) / NS)

    def at(self, time_ns: int) -> InterpolatedPose | None:
        """The pose at an instant; the last one after the last, None before the first."""
        after = bisect.bisect_right(self._times, time_ns)
        if after in (0, len(self._times)) or self._times[after - 1] == time_ns:
            return self.latest(time_ns)
        older_ns, newer_ns = self._times[after - 1 : after + 1]
        older, newer = (np.array([pose]) for pose in self._poses[after - 1 : after + 1])
        share = np.array([(time_ns - older_ns) / (newer_ns - older_ns)])
        between = Pose2D(*interpolated(older, newer, share)[0].tolist())
        return InterpolatedPose(between, max(time_ns - older_ns, newer_ns - time_ns) / NS)

    def at_times(self, times_ns: npt.NDArray[np.int64]) -> Floats:
        """(n, 3) x, y, yaw at (n,) instants; the first or last pose before and after them."""
        times, poses = np.array(self._times), np.array(self._poses)
        after = np.searchsorted(times, times_ns, side="right")
        older, newer = np.maximum(after - 1, 0), np.minimum(after, len(times) - 1)
        gaps = times[newer] - times[older]
        share = np.divide(times_ns - times[older], gaps, out=np.zeros(len(times_ns)), where=gaps > 0)
        return interpolated(poses[older], poses[newer], share)

    def forget_after(self, limit_ns: float) -> None:
        """Poses whose stamps turned out to be no times."""
        while self._times and self._times[-1] > limit_ns:
            del self._times[-1], self._poses[-1]

    def forget(self, before_ns: int) -> None:
        """What is not needed for instants from ``before_ns`` on."""
        gone = bisect.bisect_right(self._times, before_ns - KEPT_NS) - 1
        if gone > FORGET_EVERY:
            del self._times[:gone], self._poses[:gone]


class PoseInterpolator:
    """Poses of one object in the map: of one track, or of a chain of tf with fixed links."""

    def __init__(self, links: Sequence[PoseTrack | Pose2D]) -> None:
        self.links = links
        self.tracks = [link for link in links if isinstance(link, PoseTrack)]

    def is_known_at(self, time_ns: int) -> bool:
        """Whether each track has a reading at the instant or after it."""
        return all(track.until_ns is not None and track.until_ns >= time_ns for track in self.tracks)

    def at(self, time_ns: int) -> InterpolatedPose | None:
        """The pose at an instant; None before the first reading of a link."""
        return self._joined([track.at(time_ns) for track in self.tracks])

    def latest(self, time_ns: int) -> InterpolatedPose | None:
        """The last readings up to an instant; None before the first of a link."""
        return self._joined([track.latest(time_ns) for track in self.tracks])

    def _joined(self, parts: Sequence[InterpolatedPose | None]) -> InterpolatedPose | None:
        known = [part for part in parts if part is not None]
        if len(known) < len(parts):
            return None
        moving, pose = iter(known), Pose2D(0.0, 0.0, 0.0)
        for number, link in enumerate(self.links):
            step = link if isinstance(link, Pose2D) else next(moving).pose
            pose = step if number == 0 else pose.compose(step)
        if len(self.links) > 1:
            pose = pose._replace(yaw=wrap_angle(pose.yaw))
        # links that never move have no age
        return InterpolatedPose(pose, max(self._ages_s([part.age_s for part in known]), default=0.0))

    def _ages_s(self, ages_s: list[float]) -> list[float]:
        """Of each track what counts: a link slower than the fastest holds for a while until it changes."""
        if len(ages_s) < 2:
            return ages_s
        usual_s = [track.usual_s for track in self.tracks]
        fastest = usual_s.index(min(usual_s))
        return [
            age_s if number == fastest else max(age_s - HOLDS * usual_s[number], 0.0)
            for number, age_s in enumerate(ages_s)
        ]

    def fault(self, time_ns: int, max_age_s: float) -> str:
        """Why no pose at an instant can be used, in words."""
        ages_s = []
        for track in self.tracks:
            estimate = track.at(time_ns)
            if estimate is None:
                return f"has no pose of {track.name} before it"
            ages_s.append(estimate.age_s)
        ages_s = self._ages_s(ages_s)
        return f"lies more than {max_age_s:g} s from a pose of {self.tracks[ages_s.index(max(ages_s))].name}"

    def forget(self, before_ns: int) -> None:
        """See :meth:`PoseTrack.forget`."""
        for track in self.tracks:
            track.forget(before_ns)
