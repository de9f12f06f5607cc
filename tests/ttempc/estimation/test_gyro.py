"""Yaw rates of IMUs in the filter: heading, bias and covariance, on level ground and on a slope."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.ttempc.sensed_drive import PERIOD_S, VEHICLE, SensedDrive
from ttempc.errors import InvalidTuning
from ttempc.estimation.ekf import ExtendedKalmanFilter
from ttempc.estimation.filter import _turned
from ttempc.estimation.noise import SensorNoise
from ttempc.models.augmented_state import AugmentedState
from ttempc.types import Command, Estimate, FloatArray, Measurement, Sensor, State

BIAS = {Sensor.IMU_TRACTOR: 0.002, Sensor.IMU_TRAILER: -0.0015}  # [rad/s], twice their sd
IMU_S = 0.04
NOISE = SensorNoise()


@dataclass
class WithGyros:
    """An estimator that also receives samples of IMUs from true yaw rates, (N, 2) every `IMU_S`."""

    rates: FloatArray
    inner: ExtendedKalmanFilter
    generator: np.random.Generator = field(default_factory=lambda: np.random.default_rng(5))

    def update(
        self, time_s: float, measurements: list[Measurement], command: Command | None
    ) -> Estimate:
        first, last = (round(t / IMU_S) for t in (time_s - PERIOD_S, time_s))
        imus = [
            Measurement(k * IMU_S, sensor, (self._read(k, body) + bias, 0.0, 0.0))
            for k in range(max(0, first + 1), last + 1)
            for body, (sensor, bias) in enumerate(BIAS.items())
        ]
        return self.inner.update(time_s, [*imus, *measurements], command)

    def _read(self, k: int, body: int) -> float:
        noise = NOISE.yaw_rate * self.generator.normal() if NOISE.yaw_rate else 0.0
        return float(self.rates[min(k, len(self.rates) - 1), body]) + noise


def drive_of(seed: int, noise: SensorNoise, ticks: int = 250) -> tuple[SensedDrive, WithGyros]:
    """The drive of a seed, with gyros that read the mean yaw rates between its control ticks.

    The drive keeps its states at control ticks; within a tick the gyros read a constant rate.
    """
    plain = SensedDrive(seed).run(ticks)
    yaw = np.unwrap(np.array(plain.states)[:, State.PSI_T : State.DELTA_T], axis=0)
    held = np.repeat(np.diff(yaw, axis=0) / PERIOD_S, round(PERIOD_S / IMU_S), axis=0)
    estimator = WithGyros(held, ExtendedKalmanFilter(VEHICLE, noise))
    again = SensedDrive(seed)
    for k, (samples, command) in enumerate(plain.received):
        again.states.append(plain.states[k])
        again.estimates.append(estimator.update(k * PERIOD_S, samples, command))
    return again, estimator


def test_gyros_give_the_heading_and_their_bias():
    """Headings are at most 0.6 times as far off as without gyros, and as far as claimed."""
    with_gyros, without, nees = [], [], []
    for seed in range(41, 45):
        drive, estimator = drive_of(seed, NOISE)
        plain, _ = drive_of(seed, SensorNoise(yaw_rate=0.0))
        yaw = slice(State.PSI_T, State.DELTA_T)
        with_gyros.append(drive.errors()[60:, yaw])
        without.append(plain.errors()[60:, yaw])
        variance = np.array([np.diag(e.covariance) for e in drive.estimates])[60:, yaw]
        nees.append(drive.errors()[60:, yaw] ** 2 / variance)
        state = estimator.inner._states[-1]
        biases = slice(AugmentedState.GYRO_T, AugmentedState.GYRO_I + 1)
        sd = np.sqrt(np.diag(state.covariances[0])[biases])
        assert (np.abs(state.augmented[0, biases] - list(BIAS.values())) < 4.0 * sd).all()
        assert (sd < 0.5 * NOISE.yaw_rate_bias).all()
    rms = [np.sqrt(np.mean(np.concatenate(errors) ** 2)) for errors in (with_gyros, without)]
    assert rms[0] < 0.6 * rms[1]
    assert 0.3 < np.mean(nees) < 2.0


def test_gyros_without_assumed_noise_are_not_used():
    _, (samples, command) = None, SensedDrive(46).run(1).received[0]
    imu = Measurement(0.0, Sensor.IMU_TRACTOR, (1.0, 0.0, 0.0))
    one, other = (ExtendedKalmanFilter(VEHICLE, SensorNoise(yaw_rate=0.0)) for _ in range(2))
    for k in range(5):
        moved = [Measurement(m.time_s + k * PERIOD_S, m.sensor, m.value) for m in samples]
        gyro = Measurement(k * PERIOD_S, imu.sensor, imu.value)
        with_imu = one.update(k * PERIOD_S, [gyro, *moved], command)
        without = other.update(k * PERIOD_S, moved, command)
        np.testing.assert_array_equal(with_imu.state, without.state)
        np.testing.assert_array_equal(with_imu.covariance, without.covariance)


@pytest.mark.parametrize("slope", [0.0, 0.15])
def test_the_heading_on_a_slope_follows_from_the_rate_about_the_vertical(slope):
    """A vehicle turns on a plane by 1.5 rad; the sum of all steps is the change of its heading."""
    rate, step_s, turned = 0.3, 0.02, 0.0
    plane = Rotation.from_euler("x", slope)

    def attitude(time_s: float) -> tuple[float, float, float]:
        yaw, pitch, roll = (plane * Rotation.from_euler("z", rate * time_s)).as_euler("ZYX")
        return yaw, pitch, roll

    def row(time_s: float) -> list[float]:
        _, pitch, roll = attitude(time_s)
        return [time_s, rate * math.cos(slope), roll, pitch]

    times = np.arange(0.0, 5.0 + 0.5 * step_s, step_s)
    for before, after in itertools.pairwise(times):
        now = row(after)
        turned += _turned(np.array(row(before)), np.array([now[0], 6.0, *now[1:]]))
    heading = attitude(times[-1])[0] - attitude(0.0)[0]
    assert turned == pytest.approx(heading, abs=2e-6)
    if slope:
        assert abs(rate * math.cos(slope) * times[-1] - heading) > 5e-3


@pytest.mark.parametrize("name", ["yaw_rate", "yaw_rate_bias", "yaw_rate_walk"])
def test_noise_of_a_gyro_must_be_a_standard_deviation(name):
    with pytest.raises(InvalidTuning, match=name):
        SensorNoise(**{name: -1.0})
