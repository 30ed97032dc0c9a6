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
    from midnet_bench.campaign.definition import Campaign as Campaign
    from midnet_bench.errors import InputError as InputError
    from midnet_bench.errors import MidnetBenchError as MidnetBenchError
    from midnet_bench.experiments.registry import Experiment as Experiment
    from midnet_bench.experiments.registry import Report as Report
    from midnet_bench.experiments.registry import Trials as Trials
    from midnet_bench.geometry import Box as Box
    from midnet_bench.geometry import Pose2D as Pose2D
    from midnet_bench.grid import OccupancyGrid as OccupancyGrid
    from midnet_bench.io.map_server import load_map as load_map
    from midnet_bench.midnet.pipeline import MIDNet as MIDNet
    from midnet_bench.midnet.pipeline import MIDNetSettings as MIDNetSettings
    from midnet_bench.midnet.pipeline import Observation as Observation
    from midnet_bench.workflows.campaigns import load_campaign as load_campaign
    from midnet_bench.workflows.campaigns import run_campaign as run_campaign
    from midnet_bench.workflows.data_frames import compare as compare
    from midnet_bench.workflows.data_frames import error_causes as error_causes
    from midnet_bench.workflows.data_frames import results as results
    from midnet_bench.workflows.data_frames import run as run
    from midnet_bench.workflows.data_frames import verify as verify
    from midnet_bench.workflows.library import prior_map as prior_map
    from midnet_bench.workflows.library import simulate as simulate

__version__ = "0.1.0"

_NAMES = {
    "campaign.definition": ("Campaign",),
    "errors": ("InputError", "MidnetBenchError"),
    "experiments.registry": ("Experiment", "Report", "Trials"),
    "geometry": ("Box", "Pose2D"),
    "grid": ("OccupancyGrid",),
    "io.map_server": ("load_map",),
    "midnet.pipeline": ("MIDNet", "MIDNetSettings", "Observation"),
    "workflows.campaigns": ("load_campaign", "run_campaign"),
    "workflows.data_frames": ("compare", "error_causes", "results", "run", "verify"),
    "workflows.library": ("prior_map", "simulate"),
}
"""module -> the public names that it defines"""
_HOMES = {name: f"midnet_bench.{module}" for module, names in _NAMES.items() for name in names}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> object:
    """A public name, imported on first use (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, *(name for name in globals() if name.startswith("__"))])
