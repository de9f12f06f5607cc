"""Errors of both receivers along a drive."""

from dataclasses import astuple

import numpy as np
from proving_ground.testbed.sensing.receivers import NORMALS, advance, new_state, receiver


def drive(place, speed, n, seed, period=0.2):
    """Rows (n, 6): x, y [m] of tractor and trailer, and their states."""
    normals = np.random.default_rng(seed).standard_normal((n, NORMALS))
    parameters, state, out = np.array(astuple(receiver(place))), new_state(), np.empty((n, 6))
    for k in range(n):
        advance(state, parameters, normals[k], k * period, speed * period, out[k])
    return out
