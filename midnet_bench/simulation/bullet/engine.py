"""PyBullet itself, or a plain word on why it is not there."""

import os
import sys

from midnet_bench.errors import MidnetBenchError


class PyBulletMissingError(MidnetBenchError, ImportError):
    """PyBullet is not installed; an ImportError too, so that programs may look for it as for any package."""


# The library prints its build time from C, past sys.stderr, in every process that loads it: in the middle of
# a progress bar. File descriptor 2 is closed to it for as long as the import takes, and only for the first.
sys.stderr.flush()
_stderr, _nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
os.dup2(_nowhere, 2)
try:
    import pybullet as bullet
except ImportError as error:
    raise PyBulletMissingError(
        "PyBullet is not installed: the engine 'bullet' needs it, and its ready-made wheels end at "
        "CPython 3.11 (use Python 3.11 and install again, or take the engine 'fast')"
    ) from error
finally:
    os.dup2(_stderr, 2)
    os.close(_stderr)
    os.close(_nowhere)

_idle: list[int] = []
"""clients of this process that nobody uses, emptied"""


def take_client() -> int:
    """An empty client: one that was given back, or a new one, which takes 20 ms and 28 MB."""
    return _idle.pop() if _idle else int(bullet.connect(bullet.DIRECT))


def give_back(client: int) -> None:
    """Empty a client for whoever takes it next; what is loaded then behaves bit for bit as in a new one."""
    bullet.resetSimulation(physicsClientId=client)
    _idle.append(client)


__all__ = ["PyBulletMissingError", "bullet", "give_back", "take_client"]
