"""PyBullet itself, or a plain word on why it is not there."""

import os
import sys

from midnet_bench.errors import MidnetBenchError

# The library greets every process that loads it from C, past sys.stderr, in the middle of a progress bar.
sys.stderr.flush()
_stderr, _nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
os.dup2(_nowhere, 2)
try:
    import pybullet as bullet
except ImportError as error:
    raise MidnetBenchError(
        "PyBullet is not installed: simulating needs it, and its ready-made wheels end at CPython 3.11 "
        "(use Python 3.11 and install again)"
    ) from error
finally:
    os.dup2(_stderr, 2)
    os.close(_stderr)
    os.close(_nowhere)

__all__ = ["bullet"]
