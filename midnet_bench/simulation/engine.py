"""PyBullet itself, or a plain word on why it is not there."""

from midnet_bench.errors import MidnetBenchError

try:
    import pybullet as bullet
except ImportError as error:
    raise MidnetBenchError(
        "PyBullet is not installed: simulating needs it, and its ready-made wheels end at CPython 3.11 "
        "(use Python 3.11 and install again)"
    ) from error

__all__ = ["bullet"]
