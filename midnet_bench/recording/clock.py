"""Where a robot is at an instant of a recording that streams by: poses of a topic, or along a chain of tf."""

import bisect
import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

from midnet_bench.geometry import Pose2D, wrap_angle
from midnet_bench.recording.files.readings import NS, PoseReading, ScanReading

Clock = Literal["header", "record"]

KEPT_NS = 5 * NS
"""poses that are older than what is asked for by more than this are forgotten"""
FORGET_EVERY = 512
HOLDS = 3.0
"""usual intervals for which a slow transform, such as map -> odom, is trusted after its last word"""


class Told(NamedTuple):
    """A pose at an instant, and how far in time from what it is made of."""

    pose: Pose2D
    age_s: float
    """from the instant to the further of the two readings that it lies between"""


def time_of(reading: ScanReading | PoseReading, clock: Clock) -> int:
    """The reading's time by the clock that is gone by, nanoseconds."""
    return reading.stamp_ns if clock == "header" else reading.record_ns


class Track:
    """The poses of one topic, or of one pair of tf's frames, in order of time; old ones are forgotten."""

    def __init__(self) -> None:
        self._times: list[int] = []
        self._poses: list[Pose2D] = []
        self.void = 0
        """readings that were no pose: nan, inf, or a quaternion of no length"""
        self.first_void_ns: int | None = None
        self.taken = 0
        self._first_ns = 0

    def take(self, time_ns: int, reading: PoseReading) -> None:
        """One more pose. One that is late takes its place; of two at one time the later one counts."""
        if not reading.transform.is_finite:
            self.void += 1
            self.first_void_ns = time_ns if self.first_void_ns is None else self.first_void_ns
            return
        turn = reading.transform.normalized()
        pose = Pose2D(turn.x, turn.y, turn.yaw)
        self._first_ns = self._first_ns if self.taken else time_ns
        self.taken += 1
        if not self._times or time_ns > self._times[-1]:
            self._times.append(time_ns)
            self._poses.append(pose)
            return
        place = bisect.bisect_left(self._times, time_ns)
        if place < len(self._times) and self._times[place] == time_ns:
            self._poses[place] = pose
        else:
            self._times.insert(place, time_ns)
            self._poses.insert(place, pose)

    @property
    def until_ns(self) -> int | None:
        """The time of the newest pose; None before the first."""
        return self._times[-1] if self._times else None

    @property
    def usual_s(self) -> float:
        """From one pose to the next on the average; inf before the second."""
        return (self._times[-1] - self._first_ns) / NS / (self.taken - 1) if self.taken > 1 else math.inf

    def at(self, time_ns: int) -> Told | None:
        """The pose at an instant, between the two that it lies between; None before the first."""
        after = bisect.bisect_right(self._times, time_ns)
        if after == 0:
            return None
        older_ns, older = self._times[after - 1], self._poses[after - 1]
        if older_ns == time_ns:
            return Told(older, 0.0)
        if after == len(self._times):
            return Told(older, (time_ns - older_ns) / NS)
        newer_ns, newer = self._times[after], self._poses[after]
        share = (time_ns - older_ns) / (newer_ns - older_ns)
        turned = wrap_angle(newer.yaw - older.yaw)
        between = Pose2D(
            older.x + share * (newer.x - older.x),
            older.y + share * (newer.y - older.y),
            wrap_angle(older.yaw + share * turned),
        )
        return Told(between, max(time_ns - older_ns, newer_ns - time_ns) / NS)

    def latest(self, time_ns: int) -> Told | None:
        """The last pose that was told by an instant; None before the first."""
        after = bisect.bisect_right(self._times, time_ns)
        if after == 0:
            return None
        return Told(self._poses[after - 1], (time_ns - self._times[after - 1]) / NS)

    def forget(self, before_ns: int) -> None:
        """What is not needed for instants from ``before_ns`` on."""
        gone = bisect.bisect_right(self._times, before_ns - KEPT_NS) - 1
        if gone > FORGET_EVERY:
            del self._times[:gone], self._poses[:gone]


class Whereabouts:
    """Where one thing is: one track, or a chain of tf from the map down to it, with fixed links."""

    def __init__(self, links: Sequence["Track | Pose2D"]) -> None:
        self.links = links
        self.tracks = [link for link in links if isinstance(link, Track)]

    def is_known_at(self, time_ns: int) -> bool:
        """Whether each track has a reading at the instant or after it."""
        return all(track.until_ns is not None and track.until_ns >= time_ns for track in self.tracks)

    def at(self, time_ns: int) -> Told | None:
        """The pose at an instant, interpolated; None where a link was never told before it."""
        return self._joined([track.at(time_ns) for track in self.tracks])

    def latest(self, time_ns: int) -> Told | None:
        """What was told last by an instant."""
        return self._joined([track.latest(time_ns) for track in self.tracks])

    def _joined(self, told: list[Told | None]) -> Told | None:
        if None in told:
            return None
        moving, pose = iter(told), Pose2D(0.0, 0.0, 0.0)
        for number, link in enumerate(self.links):
            if isinstance(link, Pose2D):
                step = link
            else:
                one = next(moving)
                assert one is not None
                step = one.pose
            pose = step if number == 0 else pose.compose(step)
        if len(self.links) > 1:
            pose = pose._replace(yaw=wrap_angle(pose.yaw))
        # what never moves is as old as nothing
        return Told(pose, max(self._ages_s([one.age_s for one in told if one is not None]), default=0.0))

    def _ages_s(self, ages_s: Sequence[float]) -> list[float]:
        """Of each track what counts: a link slower than the fastest holds for a while until it changes."""
        if len(ages_s) < 2:
            return list(ages_s)
        usual_s = [track.usual_s for track in self.tracks]
        fastest = usual_s.index(min(usual_s))
        return [
            age_s if number == fastest else max(age_s - HOLDS * usual_s[number], 0.0)
            for number, age_s in enumerate(ages_s)
        ]

    def missing(self, time_ns: int) -> list[int]:
        """The tracks, by number, that have no pose before an instant."""
        return [number for number, track in enumerate(self.tracks) if track.at(time_ns) is None]

    def oldest(self, time_ns: int) -> int:
        """The track, by number, whose pose lies farthest from an instant where all have one."""
        ages_s = self._ages_s([one.age_s for track in self.tracks if (one := track.at(time_ns)) is not None])
        return ages_s.index(max(ages_s))

    def forget(self, before_ns: int) -> None:
        """See :meth:`Track.forget`."""
        for track in self.tracks:
            track.forget(before_ns)
