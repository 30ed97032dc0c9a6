"""Which trials have something in common: the same motion, or all their numbers."""

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from midnet_bench.experiments.guarded.inputs import EXACT
from midnet_bench.experiments.guarded.parameters import GuardParameters
from midnet_bench.midnet.midnet_settings import PriorMapSettings
from midnet_bench.navigation.navigation_settings import CostmapSettings

AnySettings = TypeVar("AnySettings", bound=Any)
Guarded = TypeVar("Guarded", bound=GuardParameters)

DETECTION_ONLY = ("detector", "fusion", "deflate_boxes", "preset", "prior", "costmap", "midnet")
"""parameters that no robot drives by, unless it drives by what is detected"""
ALLIES_ONLY = ("ally_diameter_m", "iou_ally", "ally_remove", "iou_fuse")
"""MIDNet's settings without a use in a team of one"""
GRIDS_ONLY = ("align", "min_area_cells", "min_returns")
"""MIDNet's settings without a use in another detector, which has costmaps and no binary grids"""


def with_defaults(settings: AnySettings, names: Iterable[str]) -> AnySettings:
    """The settings with those of these names at their defaults."""
    return settings.but(**{name: getattr(type(settings), name) for name in names})


def simulation_key(parameters: Guarded, names: Sequence[str] = ()) -> Guarded:
    """What the robots' motion depends on, where detections move no robot.

    ``names``: of further parameters that have no part in it.
    """
    return with_defaults(parameters, (*DETECTION_ONLY, "record", "oracle", *names))


def result_key(parameters: Guarded, keep_thresh_local: bool = False, **changes: Any) -> Guarded:
    """The parameters with those at their defaults that change nothing: trials of equal ones are the same.

    A threshold stands for the least cost that a costmap can have from there on. In cells of 5 cm there is
    none between 91 and 99, and thresholds from 92 to 99 select the same cells. ``keep_thresh_local``: whether
    it has another use than to select cells.
    """
    parameters = _without_idle_oracle(parameters)
    prior, midnet, costmap = parameters.prior, parameters.midnet, parameters.costmap
    deflate_boxes, unused = parameters.deflate_boxes, set[str]()
    if parameters.detector != "midnet":
        prior, deflate_boxes = PriorMapSettings(), False
        unused.update(GRIDS_ONLY, () if keep_thresh_local else ("thresh_local",))
    else:
        prior = prior.but(thresh=_least_cost(parameters.prior_costmap, prior.thresh))
        if not (keep_thresh_local or deflate_boxes):
            least = _least_cost(parameters.local_costmap, midnet.thresh_local)
            midnet = midnet.but(thresh_local=least)
    unused.update(("iou_fuse",) * (parameters.fusion != "paper"), ALLIES_ONLY * (parameters.robots == 1))
    return parameters.but(
        preset=GuardParameters.preset,
        prior=prior,
        midnet=with_defaults(midnet, unused),
        costmap=costmap if costmap.memory == "decay" else with_defaults(costmap, ("decay_s",)),
        deflate_boxes=deflate_boxes,
        **changes,
    )


def _without_idle_oracle(parameters: Guarded) -> Guarded:
    """The same without an oracle where it changes nothing, or where other options have the same effect."""
    oracle, changes = parameters.oracle, dict[str, Any]()
    if oracle in ("window", "marks"):
        local = parameters.local_costmap
        changes = {"costmap": parameters.costmap.but(size_m=local.size_m, memory=local.memory)}
    elif oracle == "crop":
        changes = {"midnet": parameters.midnet.but(align="origin")}
    elif (oracle, parameters.robots) != ("allies", 1) and (oracle, parameters.prior_map) != ("map", EXACT):
        return parameters
    return parameters.but(oracle="none", **changes)


@lru_cache
def _least_cost(settings: CostmapSettings, thresh: int) -> int:
    """The least published cost that cells near an obstacle of such a costmap can have from ``thresh`` on."""
    from midnet_bench.navigation import costmap  # which takes a compiler

    costs = costmap.inflation_costs(settings, settings.inflation_radius_m)
    published = np.unique(costmap.published(costs[None, :]))
    return int(published[published >= thresh].min())
