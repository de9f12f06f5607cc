"""Measurement models, the first state from one reading of each sensor, and noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.reference.estimation.augmented_state import density, predicted_measurement
from tests.ttempc.numeric import central_differences
from ttempc.errors import InvalidTuning
from ttempc.estimation.filter.start import first_state
from ttempc.estimation.noise import ProcessNoise, SensorNoise
from ttempc.models.augmented_state import SIZE, STATES, AugmentedState
from ttempc.models.kinematics import articulated
from ttempc.sensors import ROW_OF, STARTING_SENSORS
from ttempc.types import Measurement, State
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle(hitch_offset=0.4, drawbar_length=0.9)


def random_state(generator):
    state = generator.normal(size=7) * [5, 5, 3, 0.3, 0.2, 0.2, 0.5]
    state[State.PSI_I] += state[State.PSI_T]
    return state


def augmented_by_zeros(state):
    return np.concatenate([state, np.zeros(SIZE - STATES)])


def readings(state, noise=None, generator=None):
    samples = {}
    for sensor in STARTING_SENSORS:
        value, _ = predicted_measurement(sensor, augmented_by_zeros(state), VEHICLE)
        if noise:
            value = value + noise.of(sensor) * generator.normal(size=len(value))
        samples[sensor] = Measurement(0.0, sensor, tuple(value.tolist()))
    return samples


@pytest.mark.parametrize("joint", [False, True])
@pytest.mark.parametrize("sensor", STARTING_SENSORS)
def test_jacobians(sensor, joint):
    generator = np.random.default_rng(61)
    for _ in range(20):
        augmented = np.concatenate(
            [random_state(generator), 0.1 * generator.normal(size=SIZE - STATES)]
        )
        numeric = central_differences(
            lambda x: predicted_measurement(sensor, x, VEHICLE, joint)[0], augmented
        )
        reading, exact = predicted_measurement(sensor, augmented, VEHICLE, joint)
        np.testing.assert_allclose(exact, numeric, atol=1e-6)
        assert len(exact) == len(reading) == ROW_OF[sensor].length


def test_first_state_inverts_the_sensors():
    generator = np.random.default_rng(62)
    for _ in range(50):
        state = random_state(generator)
        estimate, _ = first_state(readings(state), VEHICLE, SensorNoise())
        difference = estimate - state
        difference[2:4] = [math.remainder(angle, math.tau) for angle in difference[2:4]]
        np.testing.assert_allclose(difference, 0.0, atol=1e-9)


@pytest.mark.parametrize("delta_i", [-0.4, 0.3])
def test_noise_of_the_joint_turns_the_trailer_as_the_model_does(delta_i):
    """A joint that turns by w beside its model changes psi_i by d psi_i' / d delta_i' w."""
    noise = ProcessNoise(valves=1e4)
    state = np.array([0.0, 0.0, 0.0, 0.0, 0.0, delta_i, 0.0])
    added = density(noise, augmented_by_zeros(state), noise.scales, VEHICLE, SensorNoise())
    lag, step = VEHICLE.steering_lag_i, 1e-3
    yaw_rates = [
        articulated(state, np.array([0.0, delta_i + lag * rate, 0.0]), VEHICLE)[State.PSI_I]
        for rate in (0.0, step)
    ]
    gain = added[AugmentedState.PSI_I, AugmentedState.DELTA_I]
    gain /= added[AugmentedState.DELTA_I, AugmentedState.DELTA_I]
    assert gain == pytest.approx((yaw_rates[1] - yaw_rates[0]) / step, rel=1e-6)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_noise_must_be_positive(value):
    with pytest.raises(InvalidTuning, match=r"SensorNoise\.gnss"):
        SensorNoise(gnss=value)
    with pytest.raises(InvalidTuning, match=r"ProcessNoise\.drive"):
        ProcessNoise(drive=value)
