"""Many readings of the paper's gaps on the same simulated runs: what does each one move, and by how much?

A reading that changes what MIDNet makes of the scans, or how it is scored, does not change what robots and
intruders do. So all of them share one simulation: their differences are theirs alone, and hundreds of
readings cost little more than one.
"""

from collections.abc import Mapping

from midnet_bench.campaign.trial import Row, Scalar, TrialResult
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.experiments.guarded.parameters import FRAME_HZ
from midnet_bench.experiments.readings.parameters import ReadingsParameters
from midnet_bench.experiments.readings.rules import choosing, combined, name_of
from midnet_bench.geometry import Box
from midnet_bench.scoring.frame_counts import (
    FrameCounts,
    FrameMatch,
    count_frame,
    counted_as,
    match_frame,
    total,
)

Readings = Mapping[str, Mapping[str, Scalar]]
Boxes = tuple[Box, ...]


def calibration() -> Readings:
    """The candidates of ``calibration.yaml``."""
    return {name_of(changes): changes for changes in combined(choosing().candidates)}


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
        *({"local_size_m": size} for size in (3.5, 4.0, 5.0)),
        {"obstacle_range_m": 3.0, "raytrace_range_m": 3.5},
        {"local_map": "single_scan"},
        {"decay_s": 2.0},
        {"local_map": "persistent"},
        {"local_map": "persistent", "inf_is_valid": False},
        {"footprint_clearing": False},
        {"align": "origin"},
        {"min_area_cells": 20},
        {"deflate_boxes": True},
        {"ally_diameter_m": 0.21},
        {"ally_diameter_m": 0.297},
        {"iou_ally": 0.05},
        {"iou_ally": 0.5},
        {"ally_remove": "best"},
        {"ally_remove": "all"},
        {"iou_fuse": 0.05},
        {"iou_fuse": 0.5},
        {"truth_box": "inflated"},
        {"in_range": "edge"},
        {"tp_boxes": "one_per_intruder"},
        {"tp_boxes": "surplus_false"},
        {"require_line_of_sight": True},
    ]
    return {name_of(changes): changes for changes in one_at_a_time}


def readings_of(which: str) -> Readings:
    """Name -> what it changes: ``items``, ``calibration`` (with a digest behind it) or ``default``."""
    if which == "items":
        return items()
    return calibration() if which.startswith("calibration") else {"default": {}}


class ReadingsTrial(DetectionTrial):
    """The detection test under several readings.

    What readings have in common is worked out once: costmaps, each robot's own boxes, the team's detections
    and their counts.
    """

    def __init__(self, parameters: ReadingsParameters, seed: int) -> None:
        """Place everybody; one detector node for all readings by which a team detects the same."""
        base = parameters.flat()
        self.readings = {
            name: ReadingsParameters.from_flat({**base, **changes})
            for name, changes in readings_of(parameters.readings).items()
        }
        nodes: dict[object, int] = {}
        scorings: dict[object, int] = {}
        teams: dict[object, list[int]] = {}
        variants: list[ReadingsParameters] = []
        self._scorings: list[ReadingsParameters] = []
        self._pair_of: dict[str, tuple[int, int]] = {}
        for name, reading in self.readings.items():
            eyes = (reading.local_costmap, reading.prior_costmap, reading.prior)
            node = nodes.setdefault((eyes, reading.midnet_settings), len(variants))
            if node == len(variants):
                variants.append(reading)
                teams.setdefault((eyes, reading.midnet_settings.before_the_team), []).append(node)
            scoring = scorings.setdefault(_scoring_key(reading), len(self._scorings))
            if scoring == len(self._scorings):
                self._scorings.append(reading)
            self._pair_of[name] = (node, scoring)
        self._teams = list(teams.values())
        """numbers of the nodes that differ in section IV.C alone"""
        super().__init__(parameters, seed, variants=variants)

    def counts(self) -> dict[str, FrameCounts]:
        """Counts of each reading, summed over all frames."""
        frames: dict[tuple[int, int], list[FrameCounts]] = {pair: [] for pair in self._pair_of.values()}
        for _ in self.frames():
            detections = self._detections()
            worlds = [
                (_grown_m(reading), self.truths(reading), tuple(self.in_range(reading)))
                for reading in self._scorings
            ]
            matches: dict[tuple[Boxes, float], FrameMatch] = {}
            counted: dict[tuple[Boxes, float, tuple[bool, ...]], FrameCounts] = {}
            for (node, scoring), counts in frames.items():
                boxes = detections[node]
                grown_m, truths, in_range = worlds[scoring]
                now = counted.get((boxes, grown_m, in_range))
                if now is None:
                    match = matches.get((boxes, grown_m)) or match_frame(boxes, truths)
                    matches[boxes, grown_m] = match
                    now = counted[boxes, grown_m, in_range] = count_frame(
                        boxes, truths, in_range, match=match
                    )
                counts.append(now)
        return {
            name: counted_as(total(frames[self._pair_of[name]]), reading.tp_boxes)
            for name, reading in self.readings.items()
        }

    def _detections(self) -> list[Boxes]:
        """By each node, what the team detects now."""
        detections: list[Boxes] = [()] * len(self.variant_detectors)
        for team in self._teams:
            first = self.variant_detectors[team[0]]
            observations = self.observations(first)
            found = first.midnet.found_by_each(observations)
            poses = [observation.pose for observation in observations]
            for node in team:
                # a robot alone has no ally, and nobody's boxes to fuse with its own
                if node == team[0] or len(poses) > 1:
                    fused = tuple(self.variant_detectors[node].midnet.fused(found, poses))
                detections[node] = fused
        return detections


def run_readings(parameters: ReadingsParameters, seed: int) -> TrialResult:
    """One trial: ``readings``, a row of summed counts for each."""
    with ReadingsTrial(parameters, seed) as trial:
        rest: Row = {"has_intruders": bool(trial.truths()), "frames": parameters.frames}
        rows = [{"reading": name, **rest, **counts._asdict()} for name, counts in trial.counts().items()]
        return TrialResult({"readings": rows}, simulated_s=parameters.frames / FRAME_HZ)


def _scoring_key(reading: ReadingsParameters) -> object:
    """Equal for readings that count the same detections alike, but for which boxes are true positives."""
    return (
        _grown_m(reading),
        reading.costmap.obstacle_range_m,
        reading.in_range,
        not reading.counts_hidden,
    )


def _grown_m(reading: ReadingsParameters) -> float:
    """What is added to each side of an intruder's true box, metres."""
    reach_m = reading.local_costmap.reach_m(reading.midnet.thresh_local)
    return reach_m if reading.truth_box == "inflated" else 0.0
