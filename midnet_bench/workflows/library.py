"""For programs of one's own: ``simulate``, one trial frame by frame, and the ``prior_map`` of a building."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

from midnet_bench.campaign.trial import Scalar
from midnet_bench.detectors.detector_node import binary_prior
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments import registry
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.map_server import load_map
from midnet_bench.plugins import reference_to

PRIOR_MAP_PARAMETERS = (
    "thresh_global",
    "cost_scaling",
    "inscribed_radius_m",
    "inflation_radius_m",
    "unknown_in_prior",
)
"""what the binary grid depends on besides the map"""


class Simulation(Iterator[Any]):
    """The frames of one trial. The simulator is freed at the last frame, by :meth:`close` or by ``with``."""

    def __init__(self, trial: Any, explain: bool) -> None:
        self._resources = ExitStack()
        self.trial = self._resources.enter_context(trial)
        """the trial as it is now: its ``guards``, ``intruders``, ``arena``, ``prior_map`` and ``world``"""
        self._frames: Iterator[Any] = trial.frames(explain)

    def __next__(self) -> Any:
        try:
            return next(self._frames)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the trial and free the simulator; there are no more frames."""
        self._frames = iter(())
        self._resources.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def simulate(
    experiment: str = "detection",
    *,
    seed: int = 1,
    explain: bool = False,
    **parameters: Scalar | Callable[..., Any],
) -> Simulation:
    """One trial, frame by frame, 5 frames per simulated second.

    Args:
        experiment: ``"detection"`` or ``"labyrinth"``, or a reference to one of your own.
        seed: of everything random; the same seed gives the same frames.
        explain: keep each robot's grids A to D and what happened to each box, in ``frame.explanation``.
        parameters: those that are not to have their default, such as ``robots=5, frames=100``;
            ``midnet-bench parameters`` describes them. A plug-in may be a class or a function.

    Returns:
        An iterator, which is also a context manager: ``with simulate(robots=1) as frames:``. ``detection``
        gives ``ScoredFrame``: ``midnet`` (the detections), ``truths``, ``in_range`` and ``counts``.
        ``labyrinth`` gives MIDNet's own. Both have ``observations``: each guard's pose, costmap and
        last scan. Boxes are in the map frame, metres. ``.trial`` is the trial.

    Raises:
        InputError: an unknown experiment or parameter, a value out of range, or an experiment without frames.
        MidnetBenchError: PyBullet is not installed and ``engine`` is ``"bullet"``.
    """
    found = registry.experiment(experiment)
    if found.trials.frames is None:
        raise InputError(f"simulate: '{experiment}' has no frames; detection and labyrinth have")
    given = {key: reference_to(value) for key, value in parameters.items()}
    checked = found.parameters.parse(given, f"simulate: {experiment}")
    return Simulation(found.trials.frames(checked, seed), explain)


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
