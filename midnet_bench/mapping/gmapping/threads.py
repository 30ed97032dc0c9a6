"""Particles over the cores of a machine. Each is worked on by itself, so the threads change nothing."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import TypeVar

from midnet_bench.compiled import numba

PartT = TypeVar("PartT")

PARTS_PER_THREAD = 4
"""some particles climb longer than others; a thread that is done takes the next part"""


def cores() -> int:
    """How many threads a process that works alone should take; ``NUMBA_NUM_THREADS`` says it if set."""
    return int(numba().config.NUMBA_NUM_THREADS)


class ParticleThreads:
    """Calls compiled loops that leave Python's lock alone (``nogil``) for parts of the particles at once."""

    def __init__(self, particles: int, threads: int) -> None:
        parts = min(particles, threads * PARTS_PER_THREAD) if threads > 1 else 1
        ends = [particles * part // parts for part in range(parts + 1)]
        self._parts = [slice(begin, end) for begin, end in pairwise(ends)]
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def over_particles(self, loop: Callable[[slice], PartT]) -> list[PartT]:
        """What ``loop`` gives for each part, in the order of the particles."""
        return list(map(loop, self._parts) if self._pool is None else self._pool.map(loop, self._parts))
