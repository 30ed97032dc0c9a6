"""A look into a recording: what it holds, how it is stamped, and a sample of its scans and poses."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from midnet_bench.errors import InputError
from midnet_bench.geometry import Floats
from midnet_bench.recording.files.readings import (
    NS,
    POSE,
    SCAN,
    TF,
    PoseReading,
    ScanReading,
    Source,
    Topic,
    found_in,
)

T = TypeVar("T")

EVER_NS = 1 << 62
WHOLE_S = 30.0  # a recording that lasts no longer is looked at whole
WINDOWS = 10
WINDOW_S = 2.4  # of a longer one so many stretches of this length
MOST_SCANS = 400  # kept of one topic
SAME_CLOCK_S = 3600.0  # stamps that differ by more, against the time of recording, are of two clocks
STILL = 1e-6  # metres, and parts of a quaternion, by which a fixed transform may seem to move


@dataclass
class Stream:
    """What was seen of one topic."""

    topic: Topic
    scans: list[ScanReading] = field(default_factory=list)
    poses: list[PoseReading] = field(default_factory=list)
    period_ns: int = 0  # from one scan to the next, as most of them are; 0 where no two were seen

    @property
    def seen(self) -> Sequence[ScanReading | PoseReading]:
        """Its scans, or its poses."""
        return self.scans or self.poses

    @property
    def has_ranges(self) -> bool:
        """Whether a scan of it holds a range."""
        return any(len(scan.ranges_m) for scan in self.scans)


@dataclass
class Survey:
    """Of one source."""

    source: Source
    streams: dict[str, Stream]
    transforms: dict[tuple[str, str], list[PoseReading]]  # (frame, child) -> what tf said of them
    fault: str = ""  # where it is damaged, if it is: what came before was looked at
    remarks: list[str] = field(default_factory=list)  # on topics with several publishers, a line each

    @property
    def duration_s(self) -> float:
        """From the first to the last message."""
        return max(self.source.end_ns - self.source.start_ns, 0) / NS

    def of_kind(self, kind: str) -> list[Stream]:
        """In the order of their names; those of which nothing was seen are left out."""
        found = (one for one in self.streams.values() if one.topic.kind == kind)
        return [one for one in found if one.seen]

    def parents(self) -> dict[str, str]:
        """Child -> frame, of all of tf."""
        return {child: frame for frame, child in self.transforms}

    def chain(self, frame: str) -> list[str]:
        """The frame, its parent, and so on up to the root of tf."""
        parents, found = self.parents(), [frame]
        while found[-1] in parents and parents[found[-1]] not in found:
            found.append(parents[found[-1]])
        return found

    def is_fixed(self, frame: str, child: str) -> bool:
        """Whether a transform never changed while it was looked at."""
        seen = np.array([one.transform for one in self.transforms[frame, child]])
        return bool(np.ptp(seen, axis=0).max() < STILL)


def survey(source: Source, from_ns: int = -EVER_NS, to_ns: int = EVER_NS) -> Survey:
    """Look into a recording: whole if it is short, else at stretches all over it.

    Topics with few messages are looked at whole, and all of tf where it does not hang together otherwise.
    Scans before ``from_ns`` and after ``to_ns``, record time, are left out.

    Raises:
        InputError: it is damaged wherever it was looked at.
    """
    found = Survey(source, {name: Stream(topic) for name, topic in source.topics.items()}, {})
    windows = _windows(source, max(from_ns, source.start_ns), min(to_ns, source.end_ns))
    wanted = {name for name, topic in source.topics.items() if topic.kind in (SCAN, POSE, TF)}
    large = {name for name in wanted if windows and source.topics[name].messages > MOST_SCANS}
    _sample(found, wanted - large)
    for start_ns, stop_ns in windows if large else ():
        _sample(found, large, start_ns, stop_ns)
    tf = {name for name in large if source.topics[name].kind == TF}
    roots = {frame for frame, _ in found.transforms} - {child for _, child in found.transforms}
    if tf and len(roots) > 1:
        _sample(found, tf, is_sparse=True)
    if found.fault and not any(stream.seen for stream in found.streams.values()):
        raise InputError(found.fault)
    for stream in found.streams.values():
        stream.scans = [scan for scan in stream.scans if from_ns <= scan.record_ns <= to_ns]
    _split_by_frame(found)
    for stream in found.streams.values():
        clock = "record_ns" if stand_still(stream.seen) else "stamp_ns"
        if len(stream.scans) > 1:
            stream.period_ns = int(np.median(np.diff([getattr(scan, clock) for scan in stream.scans])))
        stream.scans = spread(stream.scans, MOST_SCANS)
    return found


def _windows(source: Source, from_ns: int, to_ns: int) -> list[tuple[int, int]]:
    """The stretches of a long recording that are looked at; none of a short one."""
    if source.end_ns - source.start_ns <= WHOLE_S * NS:
        return []
    if to_ns - from_ns <= WHOLE_S * NS:
        return [(from_ns, to_ns + 1)]
    length_ns = round(WINDOW_S * NS)
    starts = np.linspace(from_ns, to_ns - length_ns, WINDOWS)
    return [(int(start), int(start) + length_ns) for start in starts]


def _sample(
    survey: Survey,
    topics: set[str],
    start_ns: int | None = None,
    stop_ns: int | None = None,
    is_sparse: bool = False,
) -> None:
    """Add the readings of topics; ``is_sparse``: only of pairs of frames that were not seen before."""
    known = set(survey.transforms) if is_sparse else set()
    try:
        for reading in survey.source.readings(topics, start_ns, stop_ns):
            stream = survey.streams[reading.topic]
            if isinstance(reading, ScanReading):
                stream.scans.append(reading)
            elif isinstance(reading, PoseReading) and stream.topic.kind != TF:
                stream.poses.append(reading)
            elif isinstance(reading, PoseReading) and reading.transform.is_pose:
                pair = reading.frame, reading.child
                if pair in known:
                    continue
                seen = survey.transforms.setdefault(pair, [])
                seen.append(reading)
                if not is_sparse:
                    stream.poses.append(reading)
                elif len(seen) > 2 * MOST_SCANS:
                    del seen[1::2]
    except InputError as error:
        survey.fault = survey.fault or str(error)


def _split_by_frame(survey: Survey) -> None:
    """Make a stream ``TOPIC@FRAME`` of each frame where scans of several lasers are on one topic."""
    streams: dict[str, Stream] = {}
    for name, stream in survey.streams.items():
        counts = Counter(scan.frame for scan in stream.scans)
        if len(counts) > 1:
            parts = {}
            for frame, count in counts.most_common():
                share = round(stream.topic.messages * count / counts.total())
                scans = [scan for scan in stream.scans if scan.frame == frame]
                parts[f"{name}@{frame}"] = Stream(stream.topic._replace(messages=share), scans)
            apart_s = float(np.ptp([np.median(lags_s(part.scans)) for part in parts.values()]))
            clocks = f", whose clocks are {apart_s:.6g} s apart" if apart_s > SAME_CLOCK_S else ""
            survey.remarks.append(
                f"{name}: scans of {len(parts)} lasers{clocks}: {', '.join(parts)}; to take some alone set "
                f"'scan: {next(iter(parts))}' in setup.yaml"
            )
        else:
            parts = {name: stream}
        for key, part in parts.items():
            if len(part.scans) > 1 and float(np.ptp(lags_s(part.scans))) > SAME_CLOCK_S:
                survey.remarks.append(
                    f"{key}: stamps of two clocks; 'clock: record' in setup.yaml takes the record times"
                )
        streams |= parts
    survey.streams = streams


def lags_s(seen: Sequence[ScanReading | PoseReading]) -> Floats:
    """(n,) record time minus header stamp, seconds."""
    return np.array([(one.record_ns - one.stamp_ns) / NS for one in seen], dtype=np.float64)


def stand_still(seen: Sequence[ScanReading | PoseReading]) -> bool:
    """Whether several readings all have one stamp."""
    return len(seen) > 1 and len({one.stamp_ns for one in seen}) == 1


def spread(items: Sequence[T], most: int) -> list[T]:
    """At most so many of a list, evenly all over it, in order."""
    if len(items) <= most:
        return list(items)
    return [items[k] for k in np.linspace(0, len(items) - 1, most).astype(int)]


def listing(survey: Survey) -> list[dict[str, str]]:
    """A row for each topic: type, rate, and a summary of its readings."""
    return [
        {
            "topic": name,
            "type": stream.topic.type,
            "messages": str(stream.topic.messages),
            "rate_hz": f"{stream.topic.messages / survey.duration_s:.1f}" if survey.duration_s > 0.0 else "",
            "what": "; ".join(_summary(stream)),
        }
        for name, stream in survey.streams.items()
    ]


def _summary(stream: Stream) -> Iterator[str]:
    if stream.scans:
        beams = " or ".join(map(str, sorted({len(scan.ranges_m) for scan in stream.scans})))
        scan = stream.scans[0]
        sweep_deg = math.degrees(abs(scan.angle_increment_rad) * max(len(scan.ranges_m) - 1, 0))
        yield f"{beams} beams over {sweep_deg:.0f} deg, {scan.range_min_m:g} to {scan.range_max_m:g} m"
        yield f"no return: {found_in(stream.scans, {}).in_words}"
    if stream.seen and stream.topic.type != "text":
        yield lag_in_words(lags_s(stream.seen))
    if stand_still(stream.seen):
        yield "its stamps stand still: use 'clock: record' in setup.yaml"


def lag_in_words(lags: Floats) -> str:
    """``stamped 84 ms before it was recorded``, with the spread if it exceeds 1 ms."""
    middle_ms, low_ms, high_ms = (1000.0 * float(np.quantile(lags, at)) for at in (0.5, 0.05, 0.95))
    words = f"{abs(middle_ms):.3g} ms" if abs(middle_ms) < 10_000.0 else f"{abs(middle_ms) / 1000.0:.6g} s"
    side = "before" if middle_ms >= 0.0 else "after"
    spread_ms = f" ({low_ms:.3g} to {high_ms:.3g})" if high_ms - low_ms > 1.0 else ""
    return f"stamped {words} {side} it was recorded{spread_ms}"
