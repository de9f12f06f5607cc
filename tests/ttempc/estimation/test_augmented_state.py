"""Model of the augmented state, and the compiled filter against a plain one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from tests.reference.estimation.augmented_state import (
    augmented_rate,
    density,
    estimate_of,
    predicted_measurement,
)
from tests.reference.models.valves import slew
from tests.ttempc.numeric import central_differences
from ttempc.estimation.filter.correct import CORRECTION_SIZE, Reading, correct
from ttempc.estimation.filter.predict import predict, steps_over
from ttempc.estimation.filter.records import FILTER, SNAPSHOT, filter_parameters
from ttempc.estimation.filter.start import initial_snapshot
from ttempc.estimation.noise import NoiseScale, ProcessNoise, SensorNoise
from ttempc.jit.rows import WIDTH
from ttempc.models.augmented_state import (
    INITIAL_SD,
    SIZE,
    STATES,
    AugmentedState,
    advance_augmented_state,
    state_rate,
    state_rate_jacobian,
    vehicle_parameters,
)
from ttempc.models.kinematics import articulated
from ttempc.sensors import STARTING_SENSORS, SensorIndex
from ttempc.types import Disturbance, Measurement, Sensor, State
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle(hitch_offset=0.4, drawbar_length=0.9, trailer_turning_offset=0.25)
PARAMETERS = vehicle_parameters(VEHICLE)


def random_augmented(generator):
    sds = [5, 5, 3, 0.3, 0.1, 0.1, 0.2, *[0.05] * (SIZE - 9)]
    offsets = 0.03, -0.02
    augmented = np.insert(sds * generator.normal(size=SIZE - 2), AugmentedState.OFFSET_I, offsets)
    augmented[AugmentedState.PSI_I] += augmented[AugmentedState.PSI_T]
    augmented[AugmentedState.WHEEL_SPEED] += generator.choice([1.0, -1.0])
    return augmented


def near(augmented, generator):
    """Inputs (3,) near the steering angles, so that no rate is at its limit."""
    return augmented[AugmentedState.DELTA_T : STATES] + 0.02 * generator.normal(size=3)


@pytest.mark.parametrize("joint", [False, True])
def test_compiled_rate_and_jacobian_are_those_of_the_plain_model(joint):
    generator, parameters = np.random.default_rng(71), vehicle_parameters(VEHICLE, joint)
    for _ in range(20):
        augmented = random_augmented(generator)
        inputs = near(augmented, generator)
        rate, jacobian = np.zeros(7), np.zeros((7, SIZE))
        state_rate(augmented, inputs, parameters, rate)
        state_rate_jacobian(augmented, inputs, parameters, jacobian)

        def plain(x, u=inputs):  # a joint beside its set point: its command is another
            beside = joint * x[AugmentedState.OFFSET_I]
            return augmented_rate(x, u + np.array([0.0, beside, 0.0]), VEHICLE)

        np.testing.assert_allclose(rate, plain(augmented)[:7], atol=1e-12)
        assert not plain(augmented)[7:].any()
        numeric = central_differences(plain, augmented)
        np.testing.assert_allclose(jacobian, numeric[:7], atol=2e-8)


def test_the_estimate_moves_the_articulated_model_as_the_augmented_state_does():
    """Rates of the articulated model under the estimate's disturbance are those of the filter.

    At the hydrostat position that keeps the wheel speed, where the estimate is exact by definition.
    """
    generator = np.random.default_rng(72)
    for _ in range(20):
        augmented = random_augmented(generator)
        steady = (
            augmented[AugmentedState.WHEEL_SPEED]
            - VEHICLE.speed_time_constant * augmented[AugmentedState.DRIVE]
        )
        inputs = near(augmented, generator)
        inputs[2] = steady / VEHICLE.speed_gain
        estimate = estimate_of(augmented, np.eye(SIZE), 0.0, VEHICLE)
        slip = 1.0 - estimate.state[State.V] / augmented[AugmentedState.WHEEL_SPEED]
        assert estimate.disturbance[Disturbance.WHEEL] == pytest.approx(slip, abs=1e-12)
        step = 1e-6
        after = augmented + step * augmented_rate(augmented, inputs, VEHICLE)
        v = [estimate_of(b, np.eye(SIZE), 0.0, VEHICLE).state[State.V] for b in (augmented, after)]
        rate = articulated(estimate.state, inputs, VEHICLE, estimate.disturbance)
        assert (v[1] - v[0]) / step == pytest.approx(rate[State.V], abs=1e-5)
        np.testing.assert_allclose(
            rate[:6], augmented_rate(augmented, inputs, VEHICLE)[:6], atol=1e-12
        )


def test_covariance_of_the_estimate_is_that_of_the_augmented_state_to_first_order():
    generator = np.random.default_rng(74)
    augmented, root = random_augmented(generator), generator.standard_normal((SIZE, SIZE))
    covariance = root @ root.T

    def state(x):
        return estimate_of(x, np.eye(SIZE), 0.0, VEHICLE).state

    jacobian = central_differences(state, augmented)
    estimate = estimate_of(augmented, covariance, 0.0, VEHICLE)
    np.testing.assert_allclose(estimate.covariance, jacobian @ covariance @ jacobian.T, atol=1e-6)


def test_a_step_integrates_the_plain_model_and_its_transition_is_the_derivative():
    generator = np.random.default_rng(75)
    rates, step = np.array([np.full(SIZE - 7, 0.01), np.full(SIZE - 7, 0.02)]), 0.04  # [1/s], [1/m]
    for _ in range(5):
        augmented, command = random_augmented(generator), np.array([0.1, -0.1, 0.8])
        valves = (
            augmented[AugmentedState.DELTA_T : AugmentedState.WHEEL_SPEED] + 0.3
        )  # out of the valves' reach

        def after(x, valves=valves, command=command, transition=None):
            x, v = x.copy(), valves.copy()
            unused = np.empty((SIZE, WIDTH)) if transition is None else transition
            advance_augmented_state(x, v, command, PARAMETERS, rates.ravel(), step, unused)
            return np.concatenate([x, v])

        transition = np.empty((SIZE, WIDTH))
        stepped = after(augmented, transition=transition)
        inputs, set_points = slew(valves, command, VEHICLE, step)
        np.testing.assert_allclose(stepped[SIZE:], set_points, atol=1e-15)
        fine = augmented.copy()
        for _ in range(400):
            rate = augmented_rate(
                fine + step / 800 * augmented_rate(fine, inputs, VEHICLE), inputs, VEHICLE
            )
            fine += step / 400 * rate
        np.testing.assert_allclose(stepped[:7], fine[:7], atol=1e-7)
        fading = np.exp(-step * (rates[0] + abs(augmented[AugmentedState.WHEEL_SPEED]) * rates[1]))
        np.testing.assert_allclose(stepped[7:SIZE], fading * augmented[7:], rtol=1e-3)
        numeric = central_differences(lambda x, run=after: run(x)[:SIZE], augmented)
        # The transition neglects that fading depends on the wheel speed: 1e-5 of a disturbance.
        np.testing.assert_allclose(transition[:, :SIZE], numeric, atol=5e-4)


def samples(augmented, generator, time_s):
    measurements = []
    for sensor in STARTING_SENSORS:
        value = predicted_measurement(sensor, augmented, VEHICLE)[0]
        value = value + SensorNoise().of(sensor) * generator.normal(size=len(value))
        measurements.append(Measurement(time_s, sensor, tuple(value.tolist())))
    return measurements


class Plain:
    """One snapshot of a filter, predicted and corrected by the kernels."""

    def __init__(self, readings, sensors, noise, gate):
        self.parameters = filter_parameters(VEHICLE, sensors, noise, gate)
        self.row = initial_snapshot({m.sensor: m for m in readings}, VEHICLE, sensors, noise)
        self.now = self.row.view(SNAPSHOT)[0]
        self.variance = self.parameters.view(FILTER)[0]["variances"]
        self.augmented = self.now["augmented"][:, :SIZE]
        self.covariances = self.now["covariances"][:, :, :SIZE]

    def predict(self, command, span_s):
        predict(self.parameters, self.row, command, span_s, steps_over(span_s))

    def correct(self, sample):
        index = int(SensorIndex[sample.sensor.name])
        reading = Reading(index, sample.value[0], sample.value[-1], self.variance[index])
        return correct(self.parameters, self.row, reading, False, True, np.empty(CORRECTION_SIZE))


def test_the_filter_is_that_of_the_textbook():
    """Prediction by `expm` and correction without Joseph's form, from the same start.

    Half of the variance of GNSS is slow.
    """
    generator = np.random.default_rng(76)
    noise = ProcessNoise(scale_walk=1e-12, scale_sd=1e-9)
    sensors = SensorNoise(gnss_white_share=0.5, angle_offset=0.01)
    augmented = random_augmented(generator)
    augmented[7:] = 0.0
    now = Plain(samples(augmented, generator, 0.0), sensors, noise, 1e-9)
    np.testing.assert_array_equal(np.diag(now.covariances[0])[7:16], INITIAL_SD**2)
    np.testing.assert_allclose(np.diag(now.covariances[0])[16:18], 0.25 * sensors.gnss**2)
    plain, covariance = now.augmented[0].copy(), now.covariances[0].copy()
    command = np.array(
        [*now.now["valves"], now.augmented[0, AugmentedState.WHEEL_SPEED] / VEHICLE.speed_gain]
    )
    step = 0.02
    for k in range(1, 21):
        now.predict(command, step)
        before = plain.copy()
        for _ in range(100):
            middle = plain + step / 200 * augmented_rate(plain, command, VEHICLE)
            plain = plain + step / 100 * augmented_rate(middle, command, VEHICLE)
        middle = 0.5 * (before + plain)
        per_second, per_metre = noise.fading(sensors)
        fading = -per_second - abs(middle[AugmentedState.WHEEL_SPEED]) * per_metre
        plain[7:] *= np.exp(step * fading)
        jacobian = central_differences(lambda x: augmented_rate(x, command, VEHICLE), middle)
        transition = expm(step * (jacobian + np.diag([*np.zeros(7), *fading])))
        added = step * density(noise, middle, noise.scales, VEHICLE, sensors)
        covariance = transition @ (covariance + added / 2) @ transition.T + added / 2
        np.testing.assert_allclose(now.augmented[0], plain, atol=1e-6)
        np.testing.assert_allclose(now.covariances[0], covariance, rtol=1e-4, atol=1e-9)
        augmented += step * augmented_rate(augmented, command, VEHICLE)
        for sample in samples(augmented, generator, k * step):
            innovation = now.correct(sample)
            reading, by = predicted_measurement(sample.sensor, plain, VEHICLE)
            difference = np.array(sample.value) - reading
            if len(difference) == 1 and sample.sensor is not Sensor.ENCODER:
                difference[0] = math.remainder(difference[0], math.tau)
            spread = by @ covariance @ by.T + sensors.of(sample.sensor) ** 2 * np.eye(len(by))
            gain = covariance @ by.T @ np.linalg.inv(spread)
            whitened = np.linalg.solve(np.linalg.cholesky(spread), difference)
            np.testing.assert_allclose(innovation[2 : 2 + len(by)], whitened, rtol=1e-3, atol=1e-4)
            log_determinant = np.linalg.slogdet(spread).logabsdet
            assert innovation[1] == pytest.approx(log_determinant, abs=1e-3)
            assert innovation[0] == pytest.approx(
                difference @ np.linalg.solve(spread, difference), rel=1e-3, abs=1e-4
            )
            plain = plain + gain @ difference
            covariance = covariance - gain @ spread @ gain.T
            covariance = 0.5 * (covariance + covariance.T)
    np.testing.assert_allclose(now.augmented[0], plain, atol=1e-5)


@pytest.mark.parametrize(
    ("scale", "name", "value"),
    [
        (NoiseScale.GROUND, "roughness", 1.0),
        (NoiseScale.WHEEL, "wheel", 1.0),
        (NoiseScale.VALVES, "valves", 100.0),
    ],
)
def test_a_factor_follows_the_gradient_of_the_likelihood(scale, name, value):
    """Derivatives by a factor, and the score, are central differences of filters with others.

    The filter neglects that its Jacobians depend on the state: 2 to 5 %.
    """
    small = 1e-4 * value

    def run(factor):
        generator = np.random.default_rng(77)
        augmented = random_augmented(generator)
        augmented[AugmentedState.OFFSET_I : AugmentedState.GYRO_T] = 0.0  # neither of them
        augmented[7:] = 0.0
        noise = ProcessNoise(**{name: factor}, scale_sd=1e-4, scale_walk=1e-12)
        now = Plain(samples(augmented, generator, 0.0), SensorNoise(), noise, 1e-12)
        command, likelihood = near(augmented, generator), 0.0
        command[2] = augmented[AugmentedState.WHEEL_SPEED] / VEHICLE.speed_gain
        for k in range(1, 26):
            now.predict(command, 0.04)
            augmented += 0.04 * augmented_rate(augmented, command, VEHICLE)
            for sample in samples(augmented, generator, 0.04 * k):
                by = predicted_measurement(sample.sensor, now.augmented[0], VEHICLE, True)[1]
                variance = SensorNoise().of(sample.sensor) ** 2
                spread = by @ now.covariances[0] @ by.T + variance * np.eye(len(by))
                normalised, *_ = now.correct(sample)
                likelihood -= 0.5 * (normalised + np.log(np.linalg.det(spread)))
        learnt = now.now["scales"][scale]
        information = now.now["information"][scale]  # hardly more than at the start
        score = (learnt - factor) * information / factor**2
        return now, likelihood, score, math.sqrt(information - 1e8) / factor

    one, (less, lower, *_), (more, upper, *_) = (run(value + by) for by in (0.0, -small, small))
    level = 1 + scale
    np.testing.assert_allclose(
        one[0].covariances[level],
        (more.covariances[0] - less.covariances[0]) / (2.0 * small),
        atol=0.02 * np.abs(one[0].covariances[level]).max(),
    )
    np.testing.assert_allclose(
        one[0].augmented[level],
        (more.augmented[0] - less.augmented[0]) / (2.0 * small),
        atol=0.05 * np.abs(one[0].augmented[level]).max(),
    )
    # A score is a sum of terms of both signs; its sd is the root of the information.
    assert one[2] == pytest.approx((upper - lower) / (2.0 * small), rel=0.0, abs=0.02 * one[3])
