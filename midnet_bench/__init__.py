"""midnet-bench: how well does a team of LiDAR robots guard a building?

The names in ``__all__`` are the public API; ``docs/api.md`` describes them. Importing this package loads
nothing heavy: each name is imported when it is first used. Only ``simulate``, ``run`` and ``run_campaign``
need PyBullet, and with ``engine="fast"`` neither do they.

    >>> import midnet_bench as mb
    >>> detector = mb.MIDNet(mb.prior_map("map.yaml"))
    >>> frame = detector.update([mb.Observation(mb.Pose2D(0.0, 0.0, 0.0), costmap)])
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from midnet_bench.campaign.definition import Campaign
    from midnet_bench.errors import InputError, MidnetBenchError
    from midnet_bench.experiments.experiment import Experiment
    from midnet_bench.geometry import Box, Pose2D
    from midnet_bench.grid import OccupancyGrid
    from midnet_bench.io.map_server import load_map
    from midnet_bench.midnet.pipeline import MIDNet, MIDNetSettings, Observation
    from midnet_bench.workflows.campaigns import load_campaign, run_campaign
    from midnet_bench.workflows.data_frames import compare, error_causes, results, run, verify
    from midnet_bench.workflows.prior_map import prior_map
    from midnet_bench.workflows.simulate import simulate

__version__ = "0.1.0"

_HOMES = {
    "Box": "midnet_bench.geometry:Box",
    "Campaign": "midnet_bench.campaign.definition:Campaign",
    "Experiment": "midnet_bench.experiments.experiment:Experiment",
    "InputError": "midnet_bench.errors:InputError",
    "MIDNet": "midnet_bench.midnet.pipeline:MIDNet",
    "MIDNetSettings": "midnet_bench.midnet.pipeline:MIDNetSettings",
    "MidnetBenchError": "midnet_bench.errors:MidnetBenchError",
    "Observation": "midnet_bench.midnet.pipeline:Observation",
    "OccupancyGrid": "midnet_bench.grid:OccupancyGrid",
    "Pose2D": "midnet_bench.geometry:Pose2D",
    "compare": "midnet_bench.workflows.data_frames:compare",
    "error_causes": "midnet_bench.workflows.data_frames:error_causes",
    "load_campaign": "midnet_bench.workflows.campaigns:load_campaign",
    "load_map": "midnet_bench.io.map_server:load_map",
    "prior_map": "midnet_bench.workflows.prior_map:prior_map",
    "results": "midnet_bench.workflows.data_frames:results",
    "run": "midnet_bench.workflows.data_frames:run",
    "run_campaign": "midnet_bench.workflows.campaigns:run_campaign",
    "simulate": "midnet_bench.workflows.simulate:simulate",
    "verify": "midnet_bench.workflows.data_frames:verify",
}
"""public name -> where it is defined"""

__all__ = [
    "Box",
    "Campaign",
    "Experiment",
    "InputError",
    "MIDNet",
    "MIDNetSettings",
    "MidnetBenchError",
    "Observation",
    "OccupancyGrid",
    "Pose2D",
    "compare",
    "error_causes",
    "load_campaign",
    "load_map",
    "prior_map",
    "results",
    "run",
    "run_campaign",
    "simulate",
    "verify",
]


def __getattr__(name: str) -> object:
    """A public name, imported on first use (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, _, original = _HOMES[name].partition(":")
    value = getattr(import_module(module), original)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, *(name for name in globals() if name.startswith("__"))])
