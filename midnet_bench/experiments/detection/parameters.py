"""What the detection test lets a user set."""

from dataclasses import dataclass
from typing import Literal

from midnet_bench.experiments.guarded import parameters as guarded
from midnet_bench.experiments.guarded.parameters import FRAME_HZ, GuardParameters
from midnet_bench.scoring.frame_counts import InRange, TruePositives
from midnet_bench.settings import option

PAPER_ARENAS = ("map1", "map2", "empty")  # packaged arenas of sections III and V, and Map 1 without intruders


@dataclass(frozen=True)
class DetectionParameters(GuardParameters):
    """Map 1, section V.A: which intruders are seen, frame by frame."""

    frames: int = option(
        1999,
        "Number of MIDNet frames that are scored, at 5 Hz.",
        ge=1,
        le=1_000_000,
        source="paper: V.A, 1999 frames",
    )
    intruders: int | None = option(
        None,
        "Number of Burgers that intrude; null: as many as the arena says.",
        ge=0,
        le=100,
        source="paper: V.A, 8 intruders, 3 of them stationary",
    )
    in_range: InRange = option(
        "centre",
        "When an intruder counts as within a guard's usable range: when its nearest point is (edge), "
        "or when its centre is (centre).",
        source="ours: V.A fits both; both are reported",
    )
    require_line_of_sight: bool | None = option(
        None,
        "Count an intruder as missed only if a beam of some guard could meet it; null: in every arena"
        " but the paper's, whose text counts hidden intruders too.",
        source="paper: V.A, an intruder behind another is a false negative",
    )
    tp_boxes: TruePositives = option(
        "every",
        "Which boxes are true positives: all that overlap an intruder (every), or one for each "
        "intruder, further boxes on it then counting for nothing (one_per_intruder) or as false "
        "positives (surplus_false).",
        source="paper: V.A, definition of tp",
    )
    truth_box: Literal["extent", "inflated"] = option(
        "extent",
        "An intruder's true box: the extent of its shape (extent), or that grown by the local "
        "costmap's inflation (inflated).",
        source="paper: V.A, ground truth bounding boxes",
    )

    @property
    def simulated_s(self) -> float:
        """How long a trial lasts, simulated seconds."""
        return self.frames / FRAME_HZ

    @property
    def counts_hidden(self) -> bool:
        """Whether an intruder in range counts as missed where no beam could meet it."""
        if self.require_line_of_sight is None:
            return self.arena in PAPER_ARENAS
        return not self.require_line_of_sight


def simulation_key(parameters: DetectionParameters) -> DetectionParameters:
    """What the world moves by: the parameters without those of detector, fusion and scoring."""
    scoring = ("record", "oracle", "in_range", "require_line_of_sight", "tp_boxes", "truth_box", "metrics")
    return guarded.with_defaults(parameters, (*guarded.DETECTION_ONLY, *scoring))


def result_key(parameters: DetectionParameters) -> DetectionParameters:
    """What a trial's numbers depend on; see :func:`guarded.parameters.result_key`."""
    # an inflated true box reaches as far as the threshold has it, whatever cells there are
    is_inflated = parameters.truth_box == "inflated"
    return guarded.result_key(parameters, is_inflated, require_line_of_sight=not parameters.counts_hidden)
