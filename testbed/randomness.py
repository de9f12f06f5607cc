"""Random generators: one seed a run, one generator per consumer, derived by name."""

import zlib

import numpy as np


def generator(seed: int, name: str) -> np.random.Generator:
    """Return the generator of the consumer `name` in the run with this seed.

    The stream depends on seed and name alone: a new consumer does not change the numbers of the
    others.
    """
    return np.random.default_rng(
        np.random.SeedSequence(seed, spawn_key=(zlib.crc32(name.encode()),))
    )
