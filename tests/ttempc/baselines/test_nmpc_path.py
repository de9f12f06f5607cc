"""Published NMPC: equations, discretisation, path-parametrised targets, closed loop."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from tests.ttempc.closed_loop import PERIOD_S
from ttempc.baselines.nmpc_path import NmpcPathOptions, Targets, nmpc_path_controller
from ttempc.models.kinematics import articulated
from ttempc.models.printed import (
    advance_printed,
    along_window,
    geometric_parameters,
    printed_parameters,
)
from ttempc.reference.path import figure_eight, straight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Estimate
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
EIGHT = Reference(figure_eight(laps=1), VEHICLE, ConstantSpeed(1.0))
LINE = Reference(straight(40.0), VEHICLE, ConstantSpeed(1.0))


def printed(z, delta_t, lam, hp):
    """Eq. (kinematicmodel) of the paper, (7,)."""
    _, _, psi_t, _, _, psi_i, v = z
    length_t, length_i, length_d = 1.4, 1.3, 1.1
    return np.array(
        [
            v * np.cos(psi_t),
            v * np.sin(psi_t),
            v * np.tan(delta_t) / length_t,
            v * np.cos(psi_i),
            v * np.sin(psi_i),
            v / length_i * (np.sin(lam) + length_d / length_t * np.tan(delta_t) * np.cos(lam)),
            -v / 2.05 + 1.4 / 2.05 * hp,
        ]
    )


def drawn(seed):
    generator = np.random.default_rng(seed)
    return generator.normal(1.0, 0.5, size=7), generator.uniform(-0.3, 0.3, 4)


def after(z, inputs, disturbance, period_s):
    (delta_t, lam, hp), (*factors, beta, _) = inputs, disturbance
    end, steering = np.array(z, float), np.array([delta_t, lam - beta, hp, beta])
    parameters = printed_parameters(VEHICLE)
    advance_printed(
        end, steering, np.array(factors, float), parameters, period_s, np.empty((7, 13))
    )
    return end


def test_one_step_a_period_of_the_printed_model_is_exact_to_a_micrometre():
    for seed in range(5):
        z, (delta_t, delta_i, hp, beta) = drawn(seed)
        mu, kappa, eta = 0.8, 0.9, 0.6

        def rate(t, z, hp=hp, steering=(kappa * delta_t, eta * delta_i + beta), mu=mu):
            slipping = [*z[:6], mu * z[6]]
            derivative = printed(slipping, *steering, hp)
            derivative[6] = (1.4 * hp - z[6]) / 2.05  # the rim's speed does not slip
            return derivative

        exact = solve_ivp(rate, (0.0, PERIOD_S), z, rtol=1e-11, atol=1e-12).y[:, -1]
        given = [delta_t, delta_i + beta, hp], [mu, kappa, eta, beta, 0.0]
        np.testing.assert_allclose(after(z, *given, PERIOD_S), exact, atol=2e-6)


def test_window_is_the_model_and_its_derivatives_are_its_differences():
    generator = np.random.default_rng(5)
    first = np.array([0.0, 0.0, 0.1, -2.4, 0.0, 0.05, 1.0, 0.9, 0.8, 0.7])
    inputs = np.column_stack([generator.uniform(-0.2, 0.2, (4, 4)), np.full(4, PERIOD_S)])
    parameters = printed_parameters(VEHICLE)
    states, jacobian = along_window(parameters, first, inputs)
    z = first[:7]
    for row, (delta_t, delta_i, hp, beta, _) in zip(states, inputs, strict=True):
        z = after(z, [delta_t, delta_i + beta, hp], [*first[7:], beta, 0.0], PERIOD_S)
        np.testing.assert_allclose(row, [*z, *first[7:]], atol=1e-12)
    for j in range(10):
        change = np.zeros(10)
        change[j] = 1e-6
        higher, lower = (
            along_window(parameters, first + sign * change, inputs)[0] for sign in (1.0, -1.0)
        )
        np.testing.assert_allclose(jacobian[:, :, j], (higher - lower) / 2e-6, atol=1e-7)


def test_fixed_target_lies_ahead_of_the_nearest_point_by_the_look_ahead():
    options = NmpcPathOptions(look_ahead_m=1.6)
    targets = Targets(EIGHT, PERIOD_S, options)
    for s in np.arange(0.5, 60.0, 3.1):
        x, y, heading = EIGHT.path.pose(s)
        rows = targets.at(0, x - 0.4 * np.sin(heading), y + 0.4 * np.cos(heading))
        assert np.all(rows == rows[0])
        ahead = EIGHT.at(s + 1.6)  # at 1 m/s
        expected = [*ahead.state[:3], *ahead.trailer_xy, ahead.state[3], 1.0]
        np.testing.assert_allclose(rows[0], expected, atol=5e-3)


def test_on_its_own_model_it_brings_both_points_back_to_a_line():
    law, start, beta = nmpc_path_controller(VEHICLE, LINE, PERIOD_S), LINE.at(0.0), 0.07
    z = np.array([*start.state[:3], *start.trailer_xy, start.state[3], 1.0])
    z[[1, 4]] += 0.3
    for k in range(150):
        state = np.array([*z[:3], z[5], 0.0, 0.0, z[6]])
        estimate = Estimate(0.0, state, np.zeros((7, 7)), z[3:5], beta)
        command = law.step(estimate, k).command
        z = after(z, [command.delta_t, command.delta_i + beta, command.hp], [1, 1, 1, beta, 0], 0.2)
    assert np.abs(z[[1, 4]]).max() < 0.02


def test_targets_by_time_are_the_reference_of_the_coming_ticks():
    targets = Targets(EIGHT, PERIOD_S, NmpcPathOptions(parametrised_by="time"))
    rows = targets.at(40, 0.0, 0.0)
    ahead = EIGHT.at(PERIOD_S * np.arange(41, 56))
    expected = np.column_stack(
        [ahead.state[:, :3], ahead.trailer_xy, ahead.state[:, 3], ahead.state[:, 6]]
    )
    np.testing.assert_allclose(rows, expected, atol=1e-12)


def test_yaw_by_geometry_is_that_of_the_articulated_model_at_straight_trailer_wheels():
    """Printed and geometric parameters differ in the trailer's yaw equation alone (erratum 1)."""
    z, steering = np.array([0.0, 0.0, 0.3, -2.4, 0.0, 0.1, 1.0]), np.array([0.15, 0.0, 0.7, 0.2])
    state = np.array([0.0, 0.0, 0.3, 0.1, 0.15, 0.0, 1.0])  # lambda = beta, delta_i = 0
    expected = articulated(state, np.array([0.15, 0.0, 0.7]), VEHICLE)
    end, short_s = z.copy(), 1e-6
    advance_printed(
        end, steering, np.ones(3), geometric_parameters(VEHICLE), short_s, np.empty((7, 13))
    )
    yaw_rate = (end[5] - z[5]) / short_s
    np.testing.assert_allclose(yaw_rate, expected[3], rtol=1e-5)
