"""Many readings of the paper's gaps on the same simulated runs: what does each one move, and by how much?

A reading that changes what MIDNet makes of the scans, or how it is scored, does not change what robots and
intruders do. So all of them share one simulation: their differences are theirs alone, and thirty readings
cost little more than one.
"""

import itertools
from collections.abc import Mapping

from midnet_bench.campaign.trial import Row, Scalar, TrialResult
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.experiments.guarded.arena import FRAME_HZ
from midnet_bench.experiments.readings.parameters import ReadingsParameters
from midnet_bench.scoring.frame_counts import FrameCounts, count_frame, total

Readings = Mapping[str, Mapping[str, Scalar]]


def calibration() -> Readings:
    """What section IV leaves open about local costmaps and allies, in all combinations.

    How long a mark is kept (item 8), the side of the local costmap (item 6: costmap_2d takes whole metres,
    TurtleBot3 has 3.5), and what counts as an ally (items 27 and 29: radius or footprint, and t).
    """
    memories: list[Mapping[str, Scalar]] = [
        {"local_map": "persistent", "inf_is_valid": False},
        {"local_map": "persistent", "inf_is_valid": True},
        {"local_map": "decay", "decay_s": 2.0, "inf_is_valid": True},
        {"local_map": "decay", "decay_s": 1.0, "inf_is_valid": True},
        {"local_map": "decay", "decay_s": 0.5, "inf_is_valid": True},
        {"local_map": "single_scan", "inf_is_valid": True},
    ]
    sizes: list[Mapping[str, Scalar]] = [{"local_size_m": size} for size in (3.5, 4.0, 5.0)]
    allies: list[Mapping[str, Scalar]] = [
        {"ally_diameter_m": 0.21, "iou_ally": 0.1},
        {"ally_diameter_m": 0.297, "iou_ally": 0.1},
        {"ally_diameter_m": 0.297, "iou_ally": 0.05},
    ]
    combined = [
        {**size, **memory, **ally} for size, memory, ally in itertools.product(sizes, memories, allies)
    ]
    return {_name(changes): changes for changes in combined}


def items() -> Readings:
    """One item at a time, the rest at its default."""
    one_at_a_time: list[Mapping[str, Scalar]] = [
        {},
        {"thresh_local": 100},
        {"thresh_local": 80},
        {"thresh_local": 50},
        {"thresh_global": 10},
        {"thresh_global": 50},
        {"thresh_global": 99},
        {"cost_scaling": 3.0, "inflation_radius_m": 1.0},
        *({"local_size_m": size} for size in (3.0, 3.5, 5.0)),
        {"obstacle_range_m": 3.0, "raytrace_range_m": 3.5},
        {"local_map": "single_scan"},
        {"local_map": "decay"},
        {"inf_is_valid": False},
        {"footprint_clearing": False},
        {"align": "origin"},
        {"min_area_cells": 20},
        {"deflate_boxes": True},
        {"ally_diameter_m": 0.21},
        {"iou_ally": 0.1},
        {"iou_ally": 0.5},
        {"ally_remove": "best"},
        {"ally_remove": "all"},
        {"iou_fuse": 0.05},
        {"iou_fuse": 0.5},
        {"truth_box": "inflated"},
        {"in_range": "centre"},
        {"require_line_of_sight": True},
    ]
    return {_name(changes): changes for changes in one_at_a_time}


class ReadingsTrial(DetectionTrial):
    """The detection test with a detector node for each of several readings."""

    def __init__(self, parameters: ReadingsParameters, seed: int) -> None:
        """Place everybody; one detector node per reading."""
        readings = calibration() if parameters.readings == "calibration" else items()
        base = parameters.flat()
        self.readings = {
            name: ReadingsParameters.from_flat({**base, **changes}) for name, changes in readings.items()
        }
        super().__init__(parameters, seed, variants=list(self.readings.values()))
        self._detectors = dict(zip(self.readings, self.variant_detectors, strict=True))

    def counts(self) -> dict[str, FrameCounts]:
        """Counts of each reading, summed over all frames."""
        frames: dict[str, list[FrameCounts]] = {name: [] for name in self.readings}
        for _ in self.frames():
            for name, reading in self.readings.items():
                truths = self.truths(reading)
                detections = self._detectors[name].detect(self.guards_poses()).detections
                frames[name].append(count_frame(detections, truths, self.in_range(reading)))
        return {name: total(counts) for name, counts in frames.items()}


def run_readings(parameters: ReadingsParameters, seed: int) -> TrialResult:
    """One trial: ``readings``, a row of summed counts for each."""
    with ReadingsTrial(parameters, seed) as trial:
        rest: Row = {"has_intruders": bool(trial.truths()), "frames": parameters.frames}
        rows = [{"reading": name, **rest, **counts._asdict()} for name, counts in trial.counts().items()]
        return TrialResult({"readings": rows}, simulated_s=parameters.frames / FRAME_HZ)


def _name(changes: Mapping[str, Scalar]) -> str:
    return " ".join(f"{key}={str(value).lower()}" for key, value in changes.items()) or "default"
