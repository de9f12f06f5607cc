"""Data of control ticks for detectors, and one detector that runs alone."""

from __future__ import annotations

import math

import numpy as np

from ttempc.detectors.interface import Observation
from ttempc.detectors.kernel import DETECTORS
from ttempc.detectors.monitors import Monitors
from ttempc.detectors.table import BUILT_IN
from ttempc.layout import estimate_row, innovation_rows, sample_rows
from ttempc.types import Estimate, Innovation, Measurement, Sensor
from ttempc.vehicle import Vehicle

PERIOD_S = 0.2
VEHICLE = Vehicle()


def observation(k, samples=(), command=None, innovations=(), vehicle=VEHICLE):
    """Return the data of tick `k`, with an estimate that stands still."""
    nothing = np.zeros(2)
    estimate = Estimate(
        k * PERIOD_S, np.zeros(7), 1e-4 * np.eye(7), nothing, 0.0, innovations=tuple(innovations)
    )
    return Observation(k * PERIOD_S, samples, command, estimate, vehicle)


def moving(k, x, slips=(0.0,) * 4, slip_t=0.0, whitened=()):
    """Return the data of tick `k`, with an estimate that moves east at 1 m/s and has some slips."""
    state = np.array([x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    disturbance = np.array([slip_t, 0.0, 0.0, 0.0, 0.0])
    given = [Innovation(Sensor.HITCH, z * z, 1, True, (z,), 0.0) for z in whitened]
    estimate = Estimate(
        k * PERIOD_S,
        state,
        1e-4 * np.eye(7),
        np.zeros(2),
        0.0,
        disturbance,
        tuple(given),
        np.array(slips),
    )
    return Observation(k * PERIOD_S, (), None, estimate, VEHICLE)


def observed(monitors, seen):
    """Return the alarms that stand after the data of an observation."""
    sent = np.full(3, math.nan) if seen.command is None else seen.command.as_array()
    innovations = innovation_rows(seen.estimate.innovations)
    rows, row = sample_rows(seen.samples), estimate_row(seen.estimate)
    monitors.observe(rows, seen.time_s, sent, row, innovations, seen.vehicle, lambda: seen.estimate)
    return monitors.alarms


class Alone(Monitors):
    """A built-in detector that runs alone."""

    def __init__(self, index):
        super().__init__([BUILT_IN[index].name])
        self.index = index

    def alarm(self, seen):
        """Return its alarm after the data of a tick, None if there is none."""
        alarms = observed(self, seen)
        assert len(alarms) <= 1
        return alarms[0] if alarms else None

    @property
    def statistic(self):
        """Its present statistic."""
        return float(self.record.view(DETECTORS)[0]["board"]["statistic"][self.index])


def readings(k, values, sensor=Sensor.HITCH):
    """Return the samples of one tick, one every 0.04 s."""
    values = [value if isinstance(value, tuple) else (value,) for value in values]
    return [Measurement(k * PERIOD_S + 0.04 * n, sensor, value) for n, value in enumerate(values)]


def angles(k, value, rng, sd_deg=1.0, sensor=Sensor.STEERING_TRACTOR):
    """Return the samples of the period before tick `k`, of an angle as a function of time."""
    times = k * PERIOD_S - 0.04 * np.arange(5)[::-1]
    noise = rng.normal(0.0, math.radians(sd_deg), 5)
    values = [float(value(t)) + n for t, n in zip(times, noise, strict=True)]
    return [Measurement(t, sensor, (item,)) for t, item in zip(times, values, strict=True)]


def speeds(k, encoder, ground, rng):
    """Return the samples of a tick: five of the encoder, one of each receiver on a straight."""
    times = k * PERIOD_S - 0.04 * np.arange(5)[::-1]
    wheels = [Measurement(t, Sensor.ENCODER, (encoder + rng.normal(0.0, 0.1),)) for t in times]
    places = [
        Measurement(k * PERIOD_S, sensor, (ground + rng.normal(0.0, 0.03), rng.normal(0.0, 0.03)))
        for sensor in (Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER)
    ]
    return [*wheels, *places]


def valve(commands, time_s, lag=VEHICLE.steering_lag_t):
    """Return the angle of a valve that follows steps at the ticks with a lag, in closed form."""
    angle = commands[0]
    for k, command in enumerate(commands):
        span = min(max(time_s - k * PERIOD_S, 0.0), PERIOD_S)
        angle = command + (angle - command) * math.exp(-span / lag)
    return angle
