"""Handling and ride of the machine on a firm, level plane; no seed."""

from dataclasses import replace
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ....testbed.validation.bench import Bench
from ....testbed.validation.single_manoeuvres import natural_frequencies, yaw_response
from ..machine import Constant, machine, scaled_law

# Cornering stiffness of all tyres, and the lateral stiffness of their carcasses: with both times a
# factor the relaxation length, which is their quotient, is held.
_STIFFNESS: Final = (
    "side_stiffness_per_rad",
    "side_stiffness_mobility_per_rad",
    "side_stiffness_most_per_rad",
    "carcass_lat",
)
_SPEED_MPS: Final = 4.5
_FREQUENCIES_HZ: Final = (0.2, 0.5, 1.0)


def cornering_stiffness(wrong: Constant) -> list[float]:
    """Return how far yaw rates change when the stiffness of all tyres is 10, 25, 50 % off [%].

    The mean of both bodies, of the frequencies, and of both signs, of the size of the responses.
    """
    bench = machine(wrong).bench
    fast = replace(bench.vehicle.hydrostat, speed_gain_mps=6.0)
    bench = replace(bench, vehicle=replace(bench.vehicle, hydrostat=fast))
    known = _sizes(bench)
    figures = []
    for off in (0.10, 0.25, 0.50):
        changes = []
        for factor in (1.0 - off, 1.0 + off):
            law = scaled_law(bench.vehicle, _STIFFNESS, factor, of=bench.wheel_law)
            changes.append(np.abs(_sizes(replace(bench, wheel_law=law)) / known - 1.0))
        figures.append(100.0 * float(np.mean(changes)))
    return figures


def _sizes(bench: Bench) -> FloatArray:
    """Return yaw rates of both bodies over the steering angle, (frequencies, 2) [1/s]."""
    return np.abs([yaw_response(bench, _SPEED_MPS, each) for each in _FREQUENCIES_HZ])


def ride(wrong: Constant) -> list[float]:
    """Return the frequencies of the tractor's roll, bounce and pitch after a kick [Hz]."""
    return natural_frequencies(machine(wrong).bench)
