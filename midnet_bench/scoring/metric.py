"""``Metric``: numbers of a trial that the referee, with the truth, takes frame by frame."""

import math
import re
from collections.abc import Mapping
from numbers import Real
from typing import Any, NamedTuple, Protocol

from midnet_bench.errors import InputError
from midnet_bench.geometry import Box, Floats
from midnet_bench.plugins import ExtensionPoint, PluginError, several
from midnet_bench.scoring.frame_counts import TruthObject, touches
from midnet_bench.settings import Scalar

METRICS = ExtensionPoint(
    option="metrics",
    entry_points="midnet_bench.metrics",
    method="frame",
    own={
        "ospa": "midnet_bench.scoring.metrics:Ospa",
        "first_detection": "midnet_bench.scoring.metrics:FirstDetection",
        "idleness": "midnet_bench.scoring.metrics:Idleness",
        "mot": "midnet_bench.scoring.metrics:ClearMot",
        "events": "midnet_bench.scoring.metrics:EventCounts",
    },
    needs={"mot": "motmetrics"},
)
NONE = "none"  # the list without any


def pinned_metrics(value: str) -> str:
    """A list of metrics in its one spelling, each pinned; ``none`` for no metrics.

    Raises:
        InputError: as ``ExtensionPoint.pinned``, or one is there twice.
    """
    given = several(value)
    if given in ([], [NONE]):
        return NONE
    pinned = sorted({METRICS.pinned(one) for one in given})
    if len(pinned) < len(given):
        raise InputError(f"metrics: {value[:80]}: one of them is there twice")
    return "; ".join(pinned)


MOST = 1e12  # no value is farther from 0
_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")


class MetricFrame(NamedTuple):
    """What a metric goes by. Map frame, metres; the arrays cannot be written to."""

    time_s: float  # since the trial's start
    boxes: Floats  # (n, 4) of the team: x_min, y_min, x_max, y_max
    truths: tuple[TruthObject, ...]  # the intruders that are there
    in_range: tuple[bool, ...]  # for each of them, whether missing it counts (item 46)
    guards: Floats  # (k, 2) where the guards that have not died truly are
    points: Floats  # (m, 2) where a guard may be sent; the same at each frame

    @property
    def touched(self) -> list[list[int]]:
        """For each box the intruders that it covers some area of."""
        return [
            [i for i, truth in enumerate(self.truths) if touches(Box._make(box), truth.box)]
            for box in self.boxes.tolist()
        ]

    @property
    def counted_boxes(self) -> list[Box]:
        """The boxes without those on intruders that are all out of range, which cost nothing (item 47)."""
        return [
            Box._make(box)
            for box, on in zip(self.boxes.tolist(), self.touched, strict=True)
            if not on or any(self.in_range[i] for i in on)
        ]


class Metric(Protocol):
    """A class of these is made anew for each trial, of its own options, and may remember what it saw.

    With a method ``trial() -> Mapping[str, float]`` it also gives values of the whole trial, after the last
    frame.
    """

    def frame(self, seen: MetricFrame) -> Mapping[str, float]:
        """Values of this frame by name, ``ospa_m`` say; a trial's value is their mean over frames.

        A value that is not defined is left out.
        """


class TrialMetrics:
    """The chosen metrics, watched: what is wrong with one is said by its name."""

    def __init__(self, value: str) -> None:
        """``value`` is pinned. Raises PluginError if one cannot be made."""
        names = [] if value == NONE else several(value)
        self._metrics = {name: METRICS.make(name) for name in names}
        self._values: dict[str, list[float]] = {}
        self._owner: dict[str, str] = {}

    def __bool__(self) -> bool:
        return bool(self._metrics)

    def update(self, seen: MetricFrame) -> dict[str, float]:
        """The values of a frame by name; frames come in order, each once.

        Raises:
            PluginError: a metric failed, or gave what are no values.
        """
        for array in (seen.boxes, seen.guards, seen.points):
            array.setflags(write=False)
        found: dict[str, float] = {}
        for name, metric in self._metrics.items():
            with METRICS.calling(name):
                found |= self._checked(name, "frame", metric.frame(seen))
        for key, value in found.items():
            self._values.setdefault(key, []).append(value)
        return found

    def values(self) -> dict[str, float]:
        """The trial's values: means over the frames that had one, and those of the whole trial.

        Raises:
            PluginError: as :meth:`update`.
        """
        found = {key: math.fsum(values) / len(values) for key, values in self._values.items()}
        for name, metric in self._metrics.items():
            if hasattr(metric, "trial"):
                with METRICS.calling(name):
                    whole = self._checked(name, "trial", metric.trial())
                if twice := found.keys() & whole.keys():
                    raise METRICS.refused(name, f"trial gave '{min(twice)}', which frame gives already")
                found |= whole
        return dict(sorted(found.items()))

    def tables(self) -> dict[str, list[dict[str, Scalar]]]:
        """The table ``metrics`` of a trial, a row for each of :meth:`values`; nothing if there are none."""
        found = self.values().items()
        return {"metrics": [{"metric": name, "value": value} for name, value in found]} if found else {}

    def _checked(self, name: str, method: str, given: Any) -> dict[str, float]:
        """What a metric gave, as floats by name. Raises PluginError unless it is."""

        def refused(what: str) -> PluginError:
            return METRICS.refused(name, f"{method} gave {what}")

        if not isinstance(given, Mapping):
            raise refused(f"{type(given).__name__}; give a dict, names to numbers")
        for key, value in given.items():
            if not (isinstance(key, str) and _NAME.fullmatch(key)):
                raise refused(f"the name {key!r:.60}; small letters, digits and _ are needed")
            if self._owner.setdefault(key, name) != name:
                raise refused(f"'{key}', as {self._owner[key]} does; give it another name")
            if not isinstance(value, Real) or not abs(float(value)) <= MOST:
                raise refused(f"{value!r:.60} for '{key}'; a finite number is needed")
        return {key: float(value) for key, value in given.items()}
