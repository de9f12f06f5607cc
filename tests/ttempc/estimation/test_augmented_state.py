"""The belief's model, and the compiled filter on it against one written plainly."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from tests.reference.estimation.augmented_state import augmented_rate
from tests.reference.models.valves import slew
from tests.ttempc.numeric import central_differences
from ttempc.estimation.augmented_state import (
    INITIAL_SD,
    SIZE,
    AugmentedState,
    estimate_of,
    map_gain,
)
from ttempc.estimation.augmented_state_kernel import (
    advance_augmented_state,
    state_rate,
    state_rate_jacobian,
    vehicle_parameters,
)
from ttempc.estimation.kalman_filter import KalmanFilter
from ttempc.estimation.measurement_model import LENGTH, predicted_measurement
from ttempc.estimation.noise import ProcessNoise, SensorNoise
from ttempc.models.kinematics import articulated
from ttempc.types import Measurement, Sensor, State
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle(hitch_offset=0.4, drawbar_length=0.9)
TABLE = vehicle_parameters(VEHICLE)


def random_belief(generator):
    belief = generator.normal(size=SIZE) * [5, 5, 3, 0.3, 0.1, 0.1, 0.2, *[0.05] * 9]
    belief[AugmentedState.PSI_I] += belief[AugmentedState.PSI_T]
    belief[AugmentedState.RIM] += generator.choice([1.0, -1.0])
    return belief


def near(belief, generator):
    """Inputs near the steering angles, so that no rate is at its limit."""
    return belief[AugmentedState.DELTA_T : AugmentedState.RIM + 1] + 0.02 * generator.normal(size=3)


def test_compiled_motion_and_its_slope_are_those_of_the_clear_version():
    generator = np.random.default_rng(71)
    for _ in range(20):
        belief = random_belief(generator)
        inputs = near(belief, generator)
        rate, slope = np.zeros(7), np.zeros((7, SIZE))
        state_rate(belief, inputs, TABLE, rate)
        state_rate_jacobian(belief, inputs, TABLE, slope)
        clear = augmented_rate(belief, inputs, VEHICLE)
        np.testing.assert_allclose(rate, clear[:7], atol=1e-12)
        assert not clear[7:].any()
        numeric = central_differences(lambda x, u=inputs: augmented_rate(x, u, VEHICLE), belief)
        np.testing.assert_allclose(slope, numeric[:7], atol=2e-8)


def test_what_the_controller_is_told_moves_the_vehicle_as_the_belief_does():
    """d v / dt of the articulated model under the estimate's disturbance is that of the belief.

    At the hydrostat position that holds the rim, where the estimate is defined to be exact.
    """
    generator = np.random.default_rng(72)
    for _ in range(20):
        belief = random_belief(generator)
        hold = (
            belief[AugmentedState.RIM] - VEHICLE.speed_time_constant * belief[AugmentedState.DRIVE]
        )
        inputs = near(belief, generator)
        inputs[2] = hold / VEHICLE.speed_gain
        told = estimate_of(belief, np.eye(SIZE), 0.0, VEHICLE, ())
        step = 1e-6
        after = belief + step * augmented_rate(belief, inputs, VEHICLE)
        v = [estimate_of(b, np.eye(SIZE), 0.0, VEHICLE, ()).state[State.V] for b in (belief, after)]
        rate = articulated(told.state, inputs, VEHICLE, told.disturbance)
        assert (v[1] - v[0]) / step == pytest.approx(rate[State.V], abs=1e-5)
        np.testing.assert_allclose(
            rate[:6], augmented_rate(belief, inputs, VEHICLE)[:6], atol=1e-12
        )


def test_a_slope_pulls_downhill_in_reverse_too():
    """Heading east on a slope that rises to the north: drift to the south whatever the gear.

    And on the way north, wheels lose speed whether the vehicle climbs with its front or its back.
    """
    for gear in (1.0, -1.0):
        across = np.zeros(SIZE)
        across[AugmentedState.RIM], across[AugmentedState.SIDE_Y] = gear, -0.03
        assert augmented_rate(across, np.zeros(3), VEHICLE)[AugmentedState.Y] == pytest.approx(
            -0.03
        )
        climbing = np.zeros(SIZE)
        climbing[AugmentedState.RIM], climbing[AugmentedState.CLIMB_Y] = gear, 0.1
        climbing[[AugmentedState.PSI_T, AugmentedState.PSI_I]] = gear * math.pi / 2.0
        assert augmented_rate(climbing, np.zeros(3), VEHICLE)[AugmentedState.Y] == pytest.approx(
            0.9
        )


def test_map_gain_is_the_share_of_the_slope_in_the_disturbance():
    generator = np.random.default_rng(73)
    for _ in range(20):
        belief = random_belief(generator)
        belief[AugmentedState.SLIP_T : AugmentedState.SIDE_X] = 0.0
        belief[AugmentedState.SIDE_X :] *= 1e-3
        told = estimate_of(belief, np.eye(SIZE), 0.0, VEHICLE, ())
        share = map_gain(told, VEHICLE) @ told.map_disturbance
        np.testing.assert_allclose(share, told.disturbance, atol=1e-6)


def test_covariance_of_the_estimate_is_carried_from_the_belief():
    belief = random_belief(np.random.default_rng(74))

    def state(x):
        return estimate_of(x, np.eye(SIZE), 0.0, VEHICLE, ()).state

    jacobian = central_differences(state, belief)
    told = estimate_of(belief, np.diag(np.arange(1.0, SIZE + 1)), 0.0, VEHICLE, ())
    carried = jacobian @ np.diag(np.arange(1.0, SIZE + 1)) @ jacobian.T
    np.testing.assert_allclose(told.covariance, carried, atol=1e-7)


def test_a_step_is_that_of_the_exact_motion_and_its_transition_the_derivative():
    generator = np.random.default_rng(75)
    memory, step = np.full(9, 50.0), 0.04
    for _ in range(5):
        belief, command = random_belief(generator), np.array([0.1, -0.1, 0.8])
        valves = (
            belief[AugmentedState.DELTA_T : AugmentedState.RIM] + 0.3
        )  # out of the valves' reach

        def after(x, valves=valves, command=command, transition=None):
            x, v = x.copy(), valves.copy()
            unused = np.empty((SIZE, SIZE)) if transition is None else transition
            advance_augmented_state(x, v, command, TABLE, memory, step, unused)
            return np.concatenate([x, v])

        transition = np.empty((SIZE, SIZE))
        found = after(belief, transition=transition)
        inputs, set_points = slew(valves, command, VEHICLE, step)
        np.testing.assert_allclose(found[SIZE:], set_points, atol=1e-15)
        fine = belief.copy()
        for _ in range(400):
            rate = augmented_rate(
                fine + step / 800 * augmented_rate(fine, inputs, VEHICLE), inputs, VEHICLE
            )
            fine += step / 400 * rate
        np.testing.assert_allclose(found[:7], fine[:7], atol=1e-7)
        fading = np.exp(-step * abs(belief[AugmentedState.RIM]) / memory)
        np.testing.assert_allclose(found[7:SIZE], fading * belief[7:], rtol=1e-3)
        numeric = central_differences(lambda x, run=after: run(x)[:SIZE], belief)
        # The fading with the rim's speed is left out of the transition: 1e-5 of a disturbance.
        np.testing.assert_allclose(transition, numeric, atol=5e-4)


def samples(belief, generator, time_s):
    made = []
    for sensor in LENGTH:
        value = predicted_measurement(sensor, belief, VEHICLE)[0]
        value = value + SensorNoise().of(sensor) * generator.normal(size=len(value))
        made.append(Measurement(time_s, sensor, tuple(value.tolist())))
    return made


def test_the_filter_is_the_textbook_s():
    """Prediction by `expm` and correction by the plain formulas, from the same start."""
    generator = np.random.default_rng(76)
    noise = ProcessNoise(roughness_walk=1e-12, roughness_sd=1e-9)
    kalman = KalmanFilter(VEHICLE, SensorNoise(), noise, 1e-9)
    belief = random_belief(generator)
    belief[7:] = 0.0
    now = kalman.start({m.sensor: m for m in samples(belief, generator, 0.0)})
    np.testing.assert_array_equal(np.diag(now.covariances[0])[7:], INITIAL_SD**2)
    plain, covariance = now.augmented[0].copy(), now.covariances[0].copy()
    command = np.array([*now.valves, now.augmented[0, AugmentedState.RIM] / VEHICLE.speed_gain])
    step = 0.02
    for k in range(1, 21):
        kalman.predict(now, k * step, command)
        before = plain.copy()
        for _ in range(100):
            middle = plain + step / 200 * augmented_rate(plain, command, VEHICLE)
            plain = plain + step / 100 * augmented_rate(middle, command, VEHICLE)
        middle = 0.5 * (before + plain)
        fading = -abs(middle[AugmentedState.RIM]) / noise.fading_m()
        plain[7:] *= np.exp(step * fading)
        slope = central_differences(lambda x: augmented_rate(x, command, VEHICLE), middle)
        transition = expm(step * (slope + np.diag([*np.zeros(7), *fading])))
        added = step * noise.density(
            middle[AugmentedState.PSI_T], middle[AugmentedState.RIM], noise.roughness
        )
        covariance = transition @ (covariance + added / 2) @ transition.T + added / 2
        np.testing.assert_allclose(now.augmented[0], plain, atol=1e-6)
        np.testing.assert_allclose(now.covariances[0], covariance, rtol=1e-4, atol=1e-9)
        belief += step * augmented_rate(belief, command, VEHICLE)
        for sample in samples(belief, generator, k * step):
            said = kalman.correct(now, sample)
            reading, by = predicted_measurement(sample.sensor, plain, VEHICLE)
            difference = np.array(sample.value) - reading
            if len(difference) == 1 and sample.sensor is not Sensor.ENCODER:
                difference[0] = math.remainder(difference[0], math.tau)
            spread = by @ covariance @ by.T + SensorNoise().of(sample.sensor) ** 2 * np.eye(len(by))
            gain = covariance @ by.T @ np.linalg.inv(spread)
            assert said.normalised_squared == pytest.approx(
                difference @ np.linalg.solve(spread, difference), rel=1e-3, abs=1e-4
            )
            plain = plain + gain @ difference
            covariance = covariance - gain @ spread @ gain.T
            covariance = 0.5 * (covariance + covariance.T)
    np.testing.assert_allclose(now.augmented[0], plain, atol=1e-5)


def test_the_roughness_follows_the_state_rate_jacobian_the_likelihood():
    """Slopes by r are those of filters with r a little more and less; so is the score.

    But for the Jacobians, which move with the belief and are taken as fixed: 2 to 5 %.
    """
    small = 1e-4

    def run(roughness):
        generator = np.random.default_rng(77)
        belief = random_belief(generator)
        belief[7:] = 0.0
        noise = ProcessNoise(roughness=roughness, roughness_sd=1e-4, roughness_walk=1e-12)
        kalman = KalmanFilter(VEHICLE, SensorNoise(), noise, 1e-12)
        now = kalman.start({m.sensor: m for m in samples(belief, generator, 0.0)})
        command, likelihood = near(belief, generator), 0.0
        command[2] = belief[AugmentedState.RIM] / VEHICLE.speed_gain
        for k in range(1, 26):
            kalman.predict(now, 0.04 * k, command)
            belief += 0.04 * augmented_rate(belief, command, VEHICLE)
            for sample in samples(belief, generator, 0.04 * k):
                by = predicted_measurement(sample.sensor, now.augmented[0], VEHICLE)[1]
                variance = SensorNoise().of(sample.sensor) ** 2
                spread = by @ now.covariances[0] @ by.T + variance * np.eye(len(by))
                said = kalman.correct(now, sample)
                likelihood -= 0.5 * (said.normalised_squared + np.log(np.linalg.det(spread)))
        moved = (now.roughness[0] - roughness) * now.roughness[1]  # scores over a fixed precision
        return now, likelihood, moved

    one, (less, lower, _), (more, upper, _) = run(1.0), run(1.0 - small), run(1.0 + small)
    np.testing.assert_allclose(
        one[0].covariances[1],
        (more.covariances[0] - less.covariances[0]) / (2.0 * small),
        atol=0.02 * np.abs(one[0].covariances[1]).max(),
    )
    np.testing.assert_allclose(
        one[0].augmented[1],
        (more.augmented[0] - less.augmented[0]) / (2.0 * small),
        atol=0.05 * np.abs(one[0].augmented[1]).max(),
    )
    assert one[2] == pytest.approx((upper - lower) / (2.0 * small), rel=0.05)
