"""Controller of the paper: error model, feedforward, robust law, nominal states."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.ttempc.numeric import central_differences
from ttempc.baselines.paper import (
    PaperEquations,
    RobustGains,
    RobustLaw,
    linearise,
    printed_feedforward,
)
from ttempc.models.kinematics import Error, tracking_error, trailer_point
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
REFERENCE = Reference(figure_eight(), VEHICLE, ConstantSpeed(1.0))
PRINTED = PaperEquations()


def test_tracking_error_is_the_reference_seen_from_the_vehicle():
    """The printed matrix T times z_r - z."""
    generator = np.random.default_rng(2)
    sample = REFERENCE.at(20.0)
    state = sample.state + 0.1 * generator.normal(size=7)
    trailer = trailer_point(state, VEHICLE)
    transform = np.eye(7)
    for row, yaw in ((0, state[2]), (3, state[3])):
        cos, sin = math.cos(yaw), math.sin(yaw)
        transform[row : row + 2, row : row + 2] = [[cos, sin], [-sin, cos]]

    def arranged(x, trailer_xy):
        return np.array([x[0], x[1], x[2], *trailer_xy, x[3], x[6]])

    difference = arranged(sample.state, sample.trailer_xy) - arranged(state, trailer)
    error = tracking_error(state, trailer, sample.state, sample.trailer_xy)
    np.testing.assert_allclose(error, transform @ difference, atol=1e-12)


def nonlinear_errors(z_e, u_e, sample):
    """Eq. (errormodel) with the trailer's own errors in its rows (erratum 4)."""
    x_t, y_t, psi_t, x_i, y_i, psi_i, v_e = z_e
    v_r = sample.state[-1]
    v, delta_t, lam = v_r - v_e, -u_e[0], -u_e[1]  # u_r = 0, as the printed A and B have it
    ratio = VEHICLE.drawbar_offset / VEHICLE.wheelbase

    def yaw_i(speed, delta, angle):
        return speed * (math.sin(angle) + ratio * math.tan(delta) * math.cos(angle))

    return np.array(
        [
            sample.yaw_rate_t * y_t - v + v_r * math.cos(psi_t),
            -sample.yaw_rate_t * x_t + v_r * math.sin(psi_t),
            -v * math.tan(delta_t) / VEHICLE.wheelbase,
            sample.yaw_rate_i * y_i - v + v_r * math.cos(psi_i),
            -sample.yaw_rate_i * x_i + v_r * math.sin(psi_i),
            -yaw_i(v, delta_t, lam) / VEHICLE.trailer_length,
            -v_e / VEHICLE.speed_time_constant
            + VEHICLE.speed_gain / VEHICLE.speed_time_constant * u_e[2],
        ]
    )


def test_printed_matrices_are_the_derivative_of_the_printed_errors():
    """On a straight; on curves the printed A and B leave out the reference's own angles."""
    a, b = linearise(REFERENCE.at(np.array([4.0])), VEHICLE, PRINTED)
    sample = REFERENCE.at(4.0)
    by_state = central_differences(lambda z: nonlinear_errors(z, np.zeros(3), sample), np.zeros(7))
    by_input = central_differences(lambda u: nonlinear_errors(np.zeros(7), u, sample), np.zeros(3))
    np.testing.assert_allclose(a[0], by_state, atol=1e-6)
    np.testing.assert_allclose(b[0], by_input, atol=1e-6)


def test_each_reading_changes_its_own_entries():
    sample = REFERENCE.at(np.array([35.0]))
    a, b = linearise(sample, VEHICLE, PRINTED)
    _, b_geometry = linearise(sample, VEHICLE, PaperEquations(hitch_sign=-1))
    assert b_geometry[0, Error.PSI_I, 0] == -b[0, Error.PSI_I, 0]
    a_typo, _ = linearise(sample, VEHICLE, PaperEquations(trailer_error_frame="tractor"))
    assert a_typo[0, Error.X_I, Error.Y_T] == a[0, Error.X_I, Error.Y_I] != 0.0
    entering = REFERENCE.at(np.array([11.5]))
    a_exact, _ = linearise(entering, VEHICLE, PaperEquations(trailer_speed="exact"))
    assert a_exact[0, Error.Y_I, Error.PSI_I] == entering.speed_i[0] != 1.0


@pytest.mark.parametrize(
    ("sign", "expected"), [(1, (-0.32, 0.89)), (-1, (-0.29 - 0.45j, -0.29 + 0.45j))]
)
def test_sign_of_the_robust_law_decides_over_stability(sign, expected):
    """Erratum 6: lateral eigenvalues at 1 m/s with the nominal state at rest.

    y' = v psi, psi' = v delta_e / L with delta_e = -u_m, u_m = k_s (k_p z_m + k_d z_m') and
    z_m = sign (0 - y): the law's slope at the origin, where tanh is the identity.
    """
    a, b = linearise(REFERENCE.at(np.array([4.0])), VEHICLE, PRINTED)
    gains = RobustGains()
    lateral = [Error.Y_T, Error.PSI_T]
    drift = a[0][np.ix_(lateral, lateral)]
    push = b[0][lateral, 0]
    slope = sign * gains.saturation[0] * np.array([gains.proportional[0], gains.derivative[0]])
    closed = drift + np.outer(push, slope @ np.array([[1.0, 0.0], drift[0]]))
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(closed)), expected, atol=0.006)


@pytest.mark.parametrize(("sign", "degrees"), [(1, 1.15), (-1, 13.75)])
def test_printed_feedforward_on_the_circle(sign, degrees):
    """Erratum 1: lambda on R = 10 m as printed, and with the sign that geometry gives."""
    sample = REFERENCE.at(np.array([35.0]))
    u_f = printed_feedforward(sample, VEHICLE, PaperEquations(hitch_sign=sign))
    assert math.degrees(u_f[0, 1]) == pytest.approx(degrees, abs=0.01)
    assert u_f[0, 2] == pytest.approx(1.0 / 1.4)


PERIOD_S = 0.2


def law(sign=-1):
    return RobustLaw(RobustGains(), sign, PERIOD_S)


def test_law_is_the_printed_one():
    robust, zero = law(sign=1), np.zeros(7)
    first = np.array([0.01, 0.02, 0.0, 0.03, 0.04, 0.0, 0.0])
    robust.step(0, first, zero)
    second = np.array([0.02, 0.01, 0.0, 0.03, 0.05, 0.0, 0.0])
    u_m, z_m = robust.step(1, second, zero)
    np.testing.assert_allclose(z_m, [0.02, 0.01, 0.03, 0.05])
    assert u_m[0] == pytest.approx(0.2 * math.tanh(2 * 0.01 + 4 * -0.05))  # y of the tractor
    assert u_m[1] == pytest.approx(0.1 * math.tanh(1 * 0.05 + 2 * 0.05))  # y of the trailer
    assert u_m[2] == pytest.approx(0.1 * math.tanh(10 * 0.02 + 20 * 0.05))  # x of the tractor
