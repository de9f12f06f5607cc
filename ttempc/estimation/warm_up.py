"""Compilation of an estimator's kernels before the first control tick."""

from __future__ import annotations

import numpy as np

from ..types import Command, Estimator, Measurement, Sensor
from ..vehicle import Vehicle
from .augmented_state import SIZE
from .measurement_model import LENGTH, predicted_measurement


def run_all_kernels(estimator: Estimator, vehicle: Vehicle) -> None:
    """Update a new `estimator` of `vehicle` with exact readings of a vehicle at rest.

    The updates cover the start, samples of every sensor with and without a command, late samples
    and no samples. numba compiles a kernel for the types of its arguments, so that other values
    need no further compilation.
    """
    at_rest = np.zeros(SIZE)
    stop = Command(0.0, 0.0, 0.0)

    def sample(sensor: Sensor, time_s: float) -> Measurement:
        value, _ = predicted_measurement(sensor, at_rest, vehicle)
        return Measurement(time_s, sensor, tuple(value.tolist()))

    def samples(time_s: float) -> list[Measurement]:
        return [sample(sensor, time_s) for sensor in LENGTH]

    estimator.update(0.0, samples(0.0), None)
    estimator.update(0.2, samples(0.2), None)
    estimator.update(0.4, samples(0.4), stop)
    estimator.update(0.6, samples(0.3), stop)
    estimator.update(0.8, [], stop)
