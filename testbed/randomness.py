"""One seed a run; every consumer gets a generator of its own, spawned from it by name."""

from __future__ import annotations

import zlib

import numpy as np


def generator(seed: int, name: str) -> np.random.Generator:
    """Return the generator of the consumer `name` in the run with this seed.

    The stream depends on seed and name alone, so that a new consumer never shifts the numbers
    of those that were there before.
    """
    return np.random.default_rng(
        np.random.SeedSequence(seed, spawn_key=(zlib.crc32(name.encode()),))
    )
