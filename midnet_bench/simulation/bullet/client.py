"""PyBullet itself, or a plain word on why it is not there."""

import contextlib
import os
import sys
from collections.abc import Iterator
from functools import partial
from inspect import isbuiltin
from types import SimpleNamespace

from midnet_bench.errors import InputError


class PyBulletMissingError(InputError, ImportError):
    """PyBullet is not installed; an ImportError too, so that programs may look for it as for any package."""


@contextlib.contextmanager
def _stderr_to_nowhere() -> Iterator[None]:
    """Close file descriptor 2 to what C prints, unless it is closed already."""
    try:
        stderr = os.dup(2)
    except OSError:
        yield
        return
    if sys.stderr is not None:
        sys.stderr.flush()
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(nowhere)


# The library prints its build time from C, past sys.stderr, in every process that loads it: in the middle of
# a progress bar. Only the first import has anything to silence.
try:
    with _stderr_to_nowhere():
        import pybullet as bullet
except ImportError as error:
    raise PyBulletMissingError(
        "PyBullet is not installed: the engine 'bullet' needs it, and its ready-made wheels end at "
        "CPython 3.11; take 'fast': --engine fast, or engine=\"fast\" in Python"
    ) from error

_idle: list[int] = []  # unused clients of this process, emptied


class Client(SimpleNamespace):
    """An empty world of PyBullet's, with its functions: ``client.stepSimulation()``."""

    def __init__(self) -> None:
        """Take one that was given back, or a new one, which takes 20 ms and 28 MB."""
        self._number = _idle.pop() if _idle else int(bullet.connect(bullet.DIRECT))
        functions = {name: one for name, one in vars(bullet).items() if isbuiltin(one)}
        super().__init__(
            **{name: partial(one, physicsClientId=self._number) for name, one in functions.items()}
        )

    def close(self) -> None:
        """Empty it for its next user; it is then as a new one, bit for bit. Twice does no harm."""
        if self._number >= 0:
            self.resetSimulation()
            _idle.append(self._number)
            self._number = -1


__all__ = ["Client", "PyBulletMissingError", "bullet"]
