"""Readings: a sensor that repeats itself or has lost its noise, and one that has not."""

import math

import numpy as np
import pytest

from tests.ttempc.detectors.observed import Alone, observation, observed, readings
from ttempc.detectors.interface import Reaction
from ttempc.detectors.monitors import Monitors
from ttempc.detectors.table import DetectorIndex
from ttempc.layout import measurements_of, sample_rows
from ttempc.types import Measurement, Sensor

JUDGED = tuple(Sensor)[:6]
LENGTH = {Sensor.GNSS_TRACTOR: 2, Sensor.GNSS_TRAILER: 2}


def noisy(sensor, rng, count):
    """Return values of a sensor with noise."""
    return [tuple(rng.normal(0.0, 0.01, LENGTH.get(sensor, 1)).tolist()) for _ in range(count)]


@pytest.mark.parametrize("index", range(len(JUDGED)))
def test_the_third_repetition_of_any_sensor_is_an_alarm_the_second_is_none(index):
    rng, monitor, sensor = np.random.default_rng(3), Alone(DetectorIndex(index)), JUDGED[index]
    for k in range(20):
        values = noisy(sensor, rng, 5)
        assert not monitor.alarm(observation(k, readings(k, values, sensor)))
    assert not monitor.alarm(observation(20, readings(20, [values[-1]] * 2, sensor)))
    alarm = monitor.alarm(observation(21, readings(21, [values[-1]], sensor)))
    assert alarm.reaction is Reaction.WARN
    assert alarm.unused == {sensor}


@pytest.mark.parametrize("index", range(len(JUDGED)))
def test_a_sensor_that_repeats_one_reading_in_a_hundred_in_good_health_is_not_judged(index):
    rng, monitor, sensor = np.random.default_rng(4), Alone(DetectorIndex(index)), JUDGED[index]
    for k in range(60):
        values = noisy(sensor, rng, 5)
        values = [*values[:4], values[3]] if k % 20 == 0 else values
        assert not monitor.alarm(observation(k, readings(k, values, sensor)))
    assert not monitor.alarm(observation(60, readings(60, [values[-1]] * 5, sensor)))


def test_a_sensor_that_repeats_itself_is_not_used_until_it_changes():
    """Three repetitions in succession; duplicates under one stamp are none."""
    rng, monitors = np.random.default_rng(8), Monitors()
    for k in range(20):
        samples = readings(k, rng.normal(0.0, 0.01, 5).tolist())
        assert not observed(monitors, observation(k, [*samples, *samples]))
    last = samples[-1].value[0]
    assert not observed(monitors, observation(20, readings(20, [last, last])))
    stuck = readings(21, [last])
    (alarm,) = observed(monitors, observation(21, stuck))
    assert alarm.reaction is Reaction.WARN
    other = Measurement(4.2, Sensor.ENCODER, (1.0,))
    assert measurements_of(monitors.usable(sample_rows([*stuck, other]))) == [other]
    changed = readings(22, [last + 1e-9])
    assert not observed(monitors, observation(22, changed))
    assert measurements_of(monitors.usable(sample_rows(changed))) == changed


@pytest.mark.parametrize(
    ("resolution_deg", "noise_deg"), [(0.0, 0.02), (0.01, 0.0), (0.1, 0.0), (0.25, 0.0), (0.1, 0.1)]
)
def test_an_angle_that_has_lost_its_noise_is_not_used(resolution_deg, noise_deg):
    """A sensor of 1 deg noise, stuck from 60 s on; with less than a tenth of its noise at most."""
    rng, monitor = np.random.default_rng(9), Alone(DetectorIndex.READINGS_HITCH)
    step, first = math.radians(resolution_deg), None
    for k in range(1, 320):
        stuck = k >= 300
        noise = noise_deg if stuck else 1.0
        values = rng.normal(0.1 if stuck else 0.2 * math.sin(0.04 * k), math.radians(noise), 5)
        if step and not stuck:
            values = step * np.round(values / step)
        alarm = monitor.alarm(observation(k, readings(k, values.tolist())))
        first = first or (k if alarm else None)
    assert 300 < first <= 310
    assert alarm.unused == {Sensor.HITCH}


def test_a_sensor_that_is_quiet_by_nature_is_used():
    """Noise of 0.02 deg at a resolution of 0.1 deg: readings change where the angle does."""
    rng, monitor = np.random.default_rng(10), Alone(DetectorIndex.READINGS_HITCH)
    step = math.radians(0.1)
    for k in range(1, 1000):
        angle = 0.2 * max(0.0, math.sin(0.03 * k))
        values = step * np.round(rng.normal(angle, math.radians(0.02), 5) / step)
        assert monitor.alarm(observation(k, readings(k, values.tolist()))) is None
