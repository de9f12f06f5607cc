"""Observations for tests of detectors."""

import math

import numpy as np

from ttempc.guidance.detection import Observation
from ttempc.types import Estimate, Measurement, Sensor
from ttempc.vehicle import Vehicle

PERIOD_S = 0.2
VEHICLE = Vehicle()


def observation(k, samples=(), command=None, innovations=(), vehicle=VEHICLE):
    nothing = np.zeros(2)
    estimate = Estimate(
        k * PERIOD_S, np.zeros(7), np.eye(7), nothing, 0.0, innovations=tuple(innovations)
    )
    return Observation(k * PERIOD_S, samples, command, estimate, vehicle)


def angles(k, value, rng, sd_deg=1.0, sensor=Sensor.STEERING_TRACTOR):
    """Return the samples of the period before tick `k`, of an angle as a function of time."""
    times = k * PERIOD_S - 0.04 * np.arange(5)[::-1]
    noise = rng.normal(0.0, math.radians(sd_deg), 5)
    values = [float(value(t)) + n for t, n in zip(times, noise, strict=True)]
    return [Measurement(t, sensor, (item,)) for t, item in zip(times, values, strict=True)]
