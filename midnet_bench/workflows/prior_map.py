"""``prior_map``: section IV.A on a map of the building, without the simulator."""

from pathlib import Path

from midnet_bench.campaign.trial import Scalar
from midnet_bench.detectors.detector_node import binary_prior
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.map_server import load_map

PRIOR_MAP_PARAMETERS = (
    "thresh_global",
    "cost_scaling",
    "inscribed_radius_m",
    "inflation_radius_m",
    "unknown_in_prior",
)
"""what the binary grid depends on besides the map"""


def prior_map(building: OccupancyGrid | str | Path, **parameters: Scalar) -> OccupancyGrid:
    """The binary grid that MIDNet subtracts: global costmap, inflation and threshold of section IV.A.

    Args:
        building: the map, int8, 100 occupied, 0 free, -1 unknown, map frame; or the YAML file of a
            ``map_server`` map.
        parameters: any of ``thresh_global``, ``cost_scaling``, ``inscribed_radius_m``,
            ``inflation_radius_m`` and ``unknown_in_prior``. ``midnet-bench parameters detection`` tells more.

    Returns:
        A grid of the same shape, resolution and origin: uint8, 0 occupied, 255 free (Eq. 1).

    Raises:
        InputError: the map cannot be read or is not int8, or a parameter is unknown or out of range.
    """
    grid = building if isinstance(building, OccupancyGrid) else load_map(building)
    if grid.data.dtype != "int8":
        raise InputError(
            f"prior_map: the map's values are {grid.data.dtype};"
            " int8 is needed: 100 occupied, 0 free, -1 unknown"
        )
    for name in parameters:
        if name not in PRIOR_MAP_PARAMETERS:
            raise InputError(
                f"prior_map: {name}: no such parameter{nearest_name(name, PRIOR_MAP_PARAMETERS)}"
            )
    values = {"prior_map": "exact", "resolution_m": grid.resolution, **parameters}
    return binary_prior(grid, DetectionParameters.parse(values, "prior_map"))
