"""Metrics by name; imported on demand."""

from midnet_bench.errors import InputError
from midnet_bench.seams import ExtensionPoint, several

METRICS = ExtensionPoint(
    option="metrics",
    entry_points="midnet_bench.metrics",
    method="frame",
    own={
        "ospa": "midnet_bench.scoring.metrics:Ospa",
        "first_detection": "midnet_bench.scoring.metrics:FirstDetection",
        "idleness": "midnet_bench.scoring.metrics:Idleness",
        "mot": "midnet_bench.scoring.mot:ClearMot",
    },
    needs={"mot": "motmetrics"},
)
"""see ``scoring/metric.py``"""
NONE = "none"
"""the list without any"""


def pinned_metrics(value: str) -> str:
    """A list of metrics in its one spelling, each pinned; ``none`` for no metrics.

    Raises:
        InputError: as ``ExtensionPoint.pinned``, or one is there twice.
    """
    given = several(value)
    if given in ([], [NONE]):
        return NONE
    pinned = sorted({METRICS.pinned(one) for one in given})
    if len(pinned) < len(given):
        raise InputError(f"metrics: {value[:80]}: one of them is there twice")
    return "; ".join(pinned)
