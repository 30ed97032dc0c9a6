"""``Watch``: MIDNet over a team of guards, under one reading of what the paper leaves open."""

import math
from collections.abc import Sequence
from dataclasses import replace

from midnet_bench.agents.mobile_robot import Guard
from midnet_bench.experiments.guarded.parameters import GuardParameters
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.binary_map import binary_map
from midnet_bench.midnet.pipeline import Frame, MIDNet, MIDNetSettings, Observation
from midnet_bench.navigation.costmap import CostmapSettings, static_costs

LETHAL_PUBLISHED, INSCRIBED_PUBLISHED = 100, 99


class Watch:
    """The prior map that is subtracted, a local costmap for each guard, and MIDNet."""

    def __init__(
        self,
        parameters: GuardParameters,
        prior_map: OccupancyGrid,
        guards: Sequence[Guard],
        costmap_number: int = 0,
    ) -> None:
        """Over the detection costmap of that number of each guard.

        ``prior_map``: int8, 100 occupied, map frame; the costmaps have ``costmap_settings(parameters)``.
        """
        self.prior = binary_prior(prior_map, parameters)
        self.midnet = MIDNet(self.prior, _midnet_settings(parameters))
        self._guards = guards
        self._costmap_number = costmap_number

    def look(self, explain: bool = False) -> Frame:
        """What MIDNet says now: each guard's latest pose, and the costmap of its last scan."""
        number = self._costmap_number
        return self.midnet.update(
            [Observation(guard.pose, guard.detection_costmaps[number].published()) for guard in self._guards],
            explain,
        )


def binary_prior(prior_map: OccupancyGrid, parameters: GuardParameters) -> OccupancyGrid:
    """The grid that MIDNet subtracts, uint8, 0 occupied: global costmap, then Eq. 1 (section II.A).

    Where unknown cells count as free (item 4) they are free before inflation, as in TurtleBot3's global
    costmap, whose obstacle layer does not track them: an explored wall is one cell thick, and inflation that
    spared the unknown cells behind it would let every noisy return there through.
    """
    track_unknown = parameters.unknown_in_prior == "occupied"
    costs = static_costs(prior_map, replace(costmap_settings(parameters), track_unknown=track_unknown))
    return costs.with_data(binary_map(costs.data, parameters.thresh_global, parameters.unknown_in_prior))


def costmap_settings(parameters: GuardParameters) -> CostmapSettings:
    """The one set of costmap parameters for prior map and local costmaps (item 3)."""
    memory_s = {"persistent": math.inf, "single_scan": 0.0, "decay": parameters.decay_s}
    return CostmapSettings(
        resolution=parameters.resolution_m,
        size_m=parameters.local_size_m,
        obstacle_range_m=parameters.obstacle_range_m,
        raytrace_range_m=parameters.raytrace_range_m,
        inflation_radius_m=parameters.inflation_radius_m,
        cost_scaling_factor=parameters.cost_scaling,
        inscribed_radius_m=parameters.inscribed_radius_m,
        footprint_clearing=parameters.footprint_clearing,
        inf_is_valid=parameters.inf_is_valid,
        memory_s=memory_s[parameters.local_map],
    )


def inflation_m(costmap: CostmapSettings, thresh: int) -> float:
    """How far from a hit a published cost stays at ``thresh`` or above, metres (item 1)."""
    if thresh == LETHAL_PUBLISHED:
        return 0.0
    least_cost = 1 + math.ceil(251 * (thresh - 1) / 97)
    reach = costmap.inscribed_radius_m + math.log(252 / least_cost) / costmap.cost_scaling_factor
    return min(
        costmap.inscribed_radius_m if thresh == INSCRIBED_PUBLISHED else reach, costmap.inflation_radius_m
    )


def _midnet_settings(parameters: GuardParameters) -> MIDNetSettings:
    local_m = inflation_m(costmap_settings(parameters), parameters.thresh_local)
    return MIDNetSettings(
        thresh_local=parameters.thresh_local,
        align=parameters.align,
        min_area_cells=parameters.min_area_cells,
        deflate_boxes_m=local_m if parameters.deflate_boxes else 0.0,
        ally_diameter_m=parameters.ally_diameter_m,
        iou_ally=parameters.iou_ally,
        ally_remove=parameters.ally_remove,
        iou_fuse=parameters.iou_fuse,
    )
