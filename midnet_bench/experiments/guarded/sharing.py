"""Which trials have something in common: the same motion, or all their numbers."""

from dataclasses import replace
from functools import lru_cache
from typing import TypeVar

import numpy as np

from midnet_bench.experiments.guarded.inputs import EXACT
from midnet_bench.experiments.guarded.parameters import GuardParameters
from midnet_bench.midnet.binary_map import PriorMapSettings
from midnet_bench.midnet.settings import MIDNetSettings
from midnet_bench.navigation.settings import CostmapSettings

Guarded = TypeVar("Guarded", bound=GuardParameters)


def motion(parameters: Guarded) -> Guarded:
    """The parameters without those of detector and fusion, where nobody moves by what is detected."""
    plain = GuardParameters()
    return replace(
        parameters,
        detector=plain.detector,
        fusion=plain.fusion,
        deflate_boxes=plain.deflate_boxes,
        preset=plain.preset,
        prior=plain.prior,
        costmap=plain.costmap,
        midnet=plain.midnet,
        record=plain.record,
        oracle=plain.oracle,
    )


def effective(parameters: Guarded, keep_thresh_local: bool = False) -> Guarded:
    """The parameters with those at their defaults that change nothing: trials of equal ones are the same.

    A threshold stands for the least cost that a costmap can have from there on. In cells of 5 cm there is
    none between 91 and 99, and thresholds from 92 to 99 select the same cells.

    Args:
        parameters: of a trial.
        keep_thresh_local: whether it has another use than to select cells.
    """
    parameters = replace(_without_idle_oracle(parameters), preset=GuardParameters().preset)
    prior, midnet, costmap = parameters.prior, parameters.midnet, parameters.costmap
    plain, deflate_boxes = MIDNetSettings(), parameters.deflate_boxes
    if parameters.detector != "midnet":  # another one has costmaps, and no binary grids
        prior, deflate_boxes = PriorMapSettings(), False
        midnet = replace(
            midnet,
            align=plain.align,
            min_area_cells=plain.min_area_cells,
            min_returns=plain.min_returns,
        )
        if not keep_thresh_local:
            midnet = replace(midnet, thresh_local=plain.thresh_local)
    else:
        local = parameters.local_costmap
        prior = replace(prior, thresh=_least_cost(parameters.prior_costmap, prior.thresh))
        if not (keep_thresh_local or deflate_boxes):
            midnet = replace(midnet, thresh_local=_least_cost(local, midnet.thresh_local))
    if parameters.fusion != "paper":
        midnet = replace(midnet, iou_fuse=plain.iou_fuse)
    if parameters.robots == 1:  # nobody's ally, and nobody's boxes to fuse with its own
        midnet = replace(
            midnet,
            ally_diameter_m=plain.ally_diameter_m,
            iou_ally=plain.iou_ally,
            ally_remove=plain.ally_remove,
            iou_fuse=plain.iou_fuse,
        )
    if costmap.memory != "decay":
        costmap = replace(costmap, decay_s=CostmapSettings().decay_s)
    return replace(parameters, prior=prior, midnet=midnet, costmap=costmap, deflate_boxes=deflate_boxes)


def _without_idle_oracle(parameters: Guarded) -> Guarded:
    """The same without an oracle where it changes nothing, or where options say what it changes."""
    if parameters.oracle in ("window", "marks"):
        local = parameters.local_costmap
        costmap = replace(parameters.costmap, size_m=local.size_m, memory=local.memory)
        return replace(parameters, costmap=costmap, oracle="none")
    if parameters.oracle == "crop":
        return replace(parameters, midnet=replace(parameters.midnet, align="origin"), oracle="none")
    is_idle = (parameters.oracle == "allies" and parameters.robots == 1) or (
        parameters.oracle == "map" and parameters.prior_map == EXACT
    )
    return replace(parameters, oracle="none") if is_idle else parameters


def _least_cost(settings: CostmapSettings, thresh: int) -> int:
    """The least published cost of such a costmap that is ``thresh`` or more."""
    costs = _published_costs(
        settings.inflation_radius_m,
        settings.resolution,
        settings.inscribed_radius_m,
        settings.cost_scaling_factor,
    )
    return min(cost for cost in costs if cost >= thresh)


@lru_cache
def _published_costs(
    radius_m: float, resolution: float, inscribed_radius_m: float, cost_scaling: float
) -> tuple[int, ...]:
    """The costs that cells near an obstacle can have, published; 100 is the obstacle's."""
    from midnet_bench.navigation.costmap import (
        inflation_costs,
        published,
        reach_cells,
    )  # which takes a compiler

    costs = inflation_costs(reach_cells(radius_m, resolution), resolution, inscribed_radius_m, cost_scaling)
    return tuple(np.unique(published(costs[None, :])).tolist())
