"""Who measures, by name; nothing is imported before it is asked for."""

import re
from importlib.util import find_spec

from midnet_bench.errors import InputError
from midnet_bench.seams import Seam, several

METRICS = Seam(
    option="metrics",
    entry_points="midnet_bench.metrics",
    method="frame",
    own={
        "ospa": "midnet_bench.scoring.metrics:Ospa",
        "first_detection": "midnet_bench.scoring.metrics:FirstDetection",
        "idleness": "midnet_bench.scoring.metrics:Idleness",
        "mot": "midnet_bench.scoring.mot:ClearMot",
    },
)
"""see ``scoring/metric.py``"""
NONE = "none"
"""the list without any"""


def pinned_metrics(value: str) -> str:
    """A list of metrics in its one spelling, each pinned; ``none`` for no metrics.

    Raises:
        InputError: as ``Seam.pinned``, one is there twice, or its library is not installed.
    """
    given = several(value)
    if given in ([], [NONE]):
        return NONE
    if any(re.match(r"mot\b", one) for one in given) and find_spec("motmetrics") is None:
        raise InputError("metrics: mot needs motmetrics: pip install 'midnet-bench[mot]'")
    pinned = sorted({METRICS.pinned(one) for one in given})
    if len(pinned) < len(given):
        raise InputError(f"metrics: {value[:80]}: one of them is there twice")
    return "; ".join(pinned)
