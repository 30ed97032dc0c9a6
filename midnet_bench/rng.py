"""Random numbers by name: each consumer owns a generator that no other consumer can shift."""

import hashlib

import numpy as np


def stream(seed: int, *axes: str | int) -> np.random.Generator:
    """The generator of one purpose in one trial: a pure function of ``seed`` and the named ``axes``.

    ``stream(seed, "lidar", 2)`` is independent of ``stream(seed, "patrol", 2)``. What is left out of
    the axes is shared: two trials of one seed that differ in team size alone draw the same arena and
    intruders, so they are compared on the same world (common random numbers, item 71).
    """
    name = "/".join(str(axis) for axis in axes)
    words = np.frombuffer(hashlib.sha256(name.encode()).digest()[:16], dtype="<u4")
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=[int(word) for word in words]))


def standard_exponential(rng: np.random.Generator) -> float:
    """A number of mean 1; those beyond 7.697 are rounded as ``elementary.standard_normals`` does it."""
    draw = float(rng.standard_exponential())
    return round(draw * 1024.0) / 1024.0 if draw > 7.69 else draw
