"""Extended Kalman filter with samples that come late, in any order, and from any epoch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.sensed_drive import GNSS, PERIOD_S, VEHICLE, SensedDrive
from ttempc.estimation.ekf import ExtendedKalmanFilter
from ttempc.types import Sensor


@pytest.fixture(scope="module")
def sensed():
    return SensedDrive(11).run(60)


def estimates_of(arrivals, commands, **tuning):
    estimator = ExtendedKalmanFilter(VEHICLE, **tuning)
    return [
        estimator.update(k * PERIOD_S, samples, command)
        for k, (samples, command) in enumerate(zip(arrivals, commands, strict=True))
    ]


@pytest.mark.parametrize("latest", [1, 2, 4])
def test_the_order_of_arrival_does_not_matter(sensed, latest):
    """Every sample comes up to `latest` ticks late, in random order; the last ones are in time.

    The gate rejects one sensor for a while: its patience refers to the times of samples, too.
    """
    ticks, generator = len(sensed.received), np.random.default_rng(latest)
    commands = [command for _, command in sensed.received]
    ordered, mixed = ([[] for _ in range(ticks)] for _ in range(2))
    for k, (samples, _) in enumerate(sensed.received):
        for sample in samples:
            if sample.sensor is Sensor.GNSS_TRAILER and 4.0 < sample.time_s < 7.0:
                sample = replace(sample, value=(sample.value[0] + 2.0, sample.value[1]))
            ordered[k].append(sample)
            late = generator.integers(latest + 1) if 0 < k < ticks - latest else 0
            mixed[k + late].append(sample)
    for samples in mixed:
        generator.shuffle(samples)
    one, other = estimates_of(ordered, commands)[-1], estimates_of(mixed, commands)[-1]
    np.testing.assert_array_equal(other.state, one.state)
    np.testing.assert_array_equal(other.covariance, one.covariance)
    np.testing.assert_array_equal(other.disturbance, one.disturbance)


def test_late_positions_cost_little(sensed):
    """GNSS samples two ticks late: the mean error is at most half as large again."""
    commands = [command for _, command in sensed.received]
    arrivals = [[] for _ in range(len(commands) + 2)]
    for k, (samples, _) in enumerate(sensed.received):
        for sample in samples:
            arrivals[k + 2 * (sample.sensor in GNSS)].append(sample)
    estimates = estimates_of(arrivals[: len(commands)], commands)
    errors = np.array(sensed.states) - np.array([e.state for e in estimates])
    assert np.isnan(estimates[0].state).all(), "no position yet"
    assert np.hypot(*errors[5:, :2].T).mean() < 1.5 * np.hypot(*sensed.errors()[5:, :2].T).mean()
    assert all(i.accepted for e in estimates for i in e.innovations)


def test_samples_older_than_the_memory_and_repeated_ones_are_refused(sensed):
    commands = [command for _, command in sensed.received]
    arrivals = [samples for samples, _ in sensed.received]
    plain = estimates_of(arrivals, commands, memory_s=0.5)
    old = next(m for m in arrivals[40] if m.sensor is Sensor.GNSS_TRACTOR)
    for tick, copies in ((41, 1), (43, 2)):  # repeated; older than 0.5 s
        altered = [list(samples) for samples in arrivals]
        altered[tick] += copies * [replace(old, value=(0.0, 0.0))]
        if tick == 43:
            altered[40].remove(old)
        estimate = estimates_of(altered, commands, memory_s=0.5)[tick]
        refused = [i for i in estimate.innovations if not i.accepted]
        assert [i.sensor for i in refused] == copies * [Sensor.GNSS_TRACTOR]
        if tick == 41:
            np.testing.assert_array_equal(estimate.state, plain[tick].state)


UNIX_TIME_S = 1.7e9


def deviation(estimates, reference):
    """Return the largest difference of two sequences of estimates in standard deviations."""
    sd = [np.sqrt(np.diag(e.covariance)) for e in reference]
    difference = [e.state - r.state for e, r in zip(estimates, reference, strict=True)]
    return np.max(np.abs(difference) / np.array(sd))


@pytest.mark.parametrize("origin_s", [1e6, UNIX_TIME_S, UNIX_TIME_S + 0.123456789])
def test_time_stamps_may_count_from_any_epoch(sensed, origin_s):
    """At Unix time a double resolves 2.4e-7 s, in which the vehicle moves 2.4e-7 m."""
    estimator = ExtendedKalmanFilter(VEHICLE)
    estimates = []
    for k, (samples, command) in enumerate(sensed.received):
        shifted = [replace(m, time_s=origin_s + m.time_s) for m in samples]
        estimates.append(estimator.update(origin_s + k * PERIOD_S, shifted, command))
    assert deviation(estimates, sensed.estimates) < 1e-3
    assert all(i.accepted for e in estimates for i in e.innovations)


def test_stamps_may_be_rounded_to_either_side_at_unix_time(sensed):
    """A sample one unit in the last place after its update is not one from the future."""
    generator, estimator = np.random.default_rng(33), ExtendedKalmanFilter(VEHICLE)
    estimates = []
    for k, (samples, command) in enumerate(sensed.received):
        stamps = [UNIX_TIME_S + m.time_s for m in samples]
        rounded = np.nextafter(stamps, generator.choice([-np.inf, np.inf], len(stamps)))
        shifted = [replace(m, time_s=t) for m, t in zip(samples, rounded.tolist(), strict=True)]
        estimates.append(estimator.update(UNIX_TIME_S + k * PERIOD_S, shifted, command))
    assert deviation(estimates[1:], sensed.estimates[1:]) < 0.05  # samples change their order
    assert all(i.accepted for e in estimates[1:] for i in e.innovations)
