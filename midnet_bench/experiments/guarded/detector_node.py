"""``Watch``: MIDNet over a team of guards, under one reading of what the paper leaves open."""

from collections.abc import Sequence

from midnet_bench.agents.mobile_robot import Guard
from midnet_bench.experiments.guarded.parameters import GuardParameters
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.binary_map import binary_map
from midnet_bench.midnet.pipeline import Frame, MIDNet, Observation
from midnet_bench.navigation.costmap import static_costs


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

        ``prior_map``: int8, 100 occupied, map frame; the costmaps have ``parameters.local_costmap``.
        """
        self.prior = binary_prior(prior_map, parameters)
        self.midnet = MIDNet(self.prior, parameters.detector)
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
    """The grid that MIDNet subtracts, uint8, 0 occupied: global costmap, then Eq. 1 (section II.A)."""
    costs = static_costs(prior_map, parameters.prior_costmap)
    prior = parameters.prior
    return costs.with_data(binary_map(costs.data, prior.thresh, prior.unknown))
