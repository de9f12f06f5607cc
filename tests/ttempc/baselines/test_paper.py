"""Controller of the paper: error model, feedforward, robust law, readings, errata."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.closed_loop import PERIOD_S, seen_truth
from tests.ttempc.numeric import central_differences
from ttempc.baselines.paper import (
    PaperEquations,
    PaperOptions,
    RobustGains,
    linearise,
    paper_controller,
    paper_tables,
    printed_feedforward,
)
from ttempc.baselines.paper_law import robust_action
from ttempc.layout import TICK, estimate_row, new_tick
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


def nonlinear_errors(z_e, u_e, sample, u_r=(0.0, 0.0)):
    """Eq. (errormodel) with the trailer's own errors in its rows (erratum 4).

    u_r = 0 are the reference inputs that the printed A and B have.
    """
    x_t, y_t, psi_t, x_i, y_i, psi_i, v_e = z_e
    v_r = sample.state[-1]
    v, delta_t, lam = v_r - v_e, u_r[0] - u_e[0], u_r[1] - u_e[1]
    ratio = VEHICLE.drawbar_offset / VEHICLE.wheelbase

    def yaw_i(speed, delta, angle):
        return speed * (math.sin(angle) + ratio * math.tan(delta) * math.cos(angle))

    return np.array(
        [
            sample.yaw_rate_t * y_t - v + v_r * math.cos(psi_t),
            -sample.yaw_rate_t * x_t + v_r * math.sin(psi_t),
            (v_r * math.tan(u_r[0]) - v * math.tan(delta_t)) / VEHICLE.wheelbase,
            sample.yaw_rate_i * y_i - v + v_r * math.cos(psi_i),
            -sample.yaw_rate_i * x_i + v_r * math.sin(psi_i),
            (yaw_i(v_r, *u_r) - yaw_i(v, delta_t, lam)) / VEHICLE.trailer_length,
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


CURVE = 35.0  # time on the circle of 10 m [s]


def on_the_circle():
    """Return sample, and the inputs that give its yaw rates in the printed model."""
    sample = REFERENCE.at(CURVE)
    delta_t = math.atan(sample.yaw_rate_t * VEHICLE.wheelbase)
    swing = VEHICLE.drawbar_offset * sample.yaw_rate_t
    turn = sample.yaw_rate_i * VEHICLE.trailer_length  # sin(lambda) + swing cos(lambda)
    return sample, (delta_t, math.asin(turn / math.hypot(1.0, swing)) - math.atan(swing))


def test_printed_a_leaves_out_the_speed_column_of_both_yaw_rows():
    """Erratum 10: on R = 10 m, gamma_r / v_r = 0.10 rad/m is its largest missing entry."""
    sample, u_r = on_the_circle()
    slope = central_differences(
        lambda z: nonlinear_errors(z, np.zeros(3), sample, u_r), np.zeros(7)
    )
    at = REFERENCE.at(np.array([CURVE]))
    printed, _ = linearise(at, VEHICLE, PRINTED)
    missing = np.abs(slope - printed[0])
    rows = [Error.PSI_T, Error.PSI_I]
    np.testing.assert_allclose(slope[rows, Error.V], 0.1, atol=1e-3)
    np.testing.assert_array_equal(printed[0][rows, Error.V], 0.0)
    assert missing[rows, Error.V].min() == pytest.approx(missing.max(), rel=0.02)
    whole, _ = linearise(at, VEHICLE, PaperEquations(yaw_by_speed=True))
    np.testing.assert_allclose(whole[0], slope, atol=1e-6)


@pytest.mark.parametrize(("v_r", "gamma", "rank"), [(1.0, 0.0, 6), (0.0, 0.1, 3), (1.0, 0.1, 7)])
def test_rank_of_the_error_model(v_r, gamma, rank):
    """Erratum 11: either condition of Remark 1 alone does not make the pair controllable."""
    at = REFERENCE.at(np.array([CURVE]))
    circle = replace(at, yaw_rate_t=np.array([gamma]), yaw_rate_i=np.array([gamma]))
    a, b = (each[0] for each in linearise(circle, VEHICLE, PRINTED))
    # the entries with v_r, which divides one of them
    a[Error.Y_T, Error.PSI_T] = a[Error.Y_I, Error.PSI_I] = v_r
    b[[Error.PSI_T, Error.PSI_I], :2] *= v_r
    powers = [np.linalg.matrix_power(a, i) @ b for i in range(7)]
    assert np.linalg.matrix_rank(np.hstack(powers), tol=1e-9) == rank
    if gamma == 0.0:  # the difference of both errors along the path cannot be controlled
        row = np.zeros(7)
        row[[Error.X_T, Error.X_I]] = 1.0, -1.0
        assert np.abs(row @ np.hstack(powers)).max() < 1e-12


def test_inputs_that_the_printed_saturated_law_leaves_to_the_mpc():
    """Erratum 12: U - K Z_m, with the law's range over |z_m| <= 1 for K Z_m.

    The derivative is free, so that the range is that of tanh, +-k_s. What is left of U is no
    empty set: 12 - 11.46 and 6 - 5.73 deg of the steering angles, and 0 of the hydrostat.
    """
    options = PaperOptions()
    left = np.array(options.input_bound) - np.array(options.saturation)
    np.testing.assert_allclose(np.degrees(left[:2]), [0.54, 0.27], atol=0.005)
    assert left[2] == pytest.approx(0.0, abs=1e-12)
    ends = [np.empty(3), np.empty(3)]
    tables = tables_of(options)
    for action, push in zip(ends, (-1.0, 1.0), strict=True):
        robust_action(tables.constants, np.full(4, push), np.full(4, -push), action)
    # The law reaches the ends of that range within z_m in +-1, to the last digits of tanh.
    np.testing.assert_allclose(ends[1], options.saturation, rtol=1e-6)
    np.testing.assert_allclose(ends[0], -ends[1])


@pytest.mark.parametrize(
    ("reading", "sign"), [("added", 1.0), ("subtracted", -1.0), ("reference", 0.0)]
)
def test_the_trailers_steering_takes_the_measured_hitch_angle_by_its_sign(reading, sign):
    """Erratum 9: delta_i = lambda + beta, lambda - beta, or without the measured angle."""
    options = PaperOptions(hitch_angle=reading)
    totals = []
    for beta in (0.0, 0.05):
        controller = paper_controller(VEHICLE, REFERENCE, PERIOD_S, options)
        estimate = seen_truth(REFERENCE.at(0.0).state, 0.0, VEHICLE)
        estimate = replace(estimate, hitch_angle=beta)
        totals.append(controller.step(estimate, 0).diagnostics.total)
    change = totals[1] - totals[0]
    np.testing.assert_allclose(change, [0.0, sign * 0.05, 0.0], atol=1e-12)


def actions(k, estimate, law):
    """Return feedback and robust action of a tick, (3, 2)."""
    tick = new_tick()
    law.act(k, estimate_row(estimate), lambda: estimate, np.zeros(3), tick)
    return tick.view(TICK)[0]["control"][:, 1:3].copy()


def test_with_the_reference_as_nominal_state_the_robust_law_acts_on_the_tracking_error():
    """A saturated PD law on z_e: u_m = -k_s tanh(k_p (0 - z_e) ...) with the sign of erratum 6."""
    law = paper_controller(VEHICLE, REFERENCE, PERIOD_S, PaperOptions()).feedback
    state = REFERENCE.at(4.0).state + np.array([0.0, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0])
    estimate = seen_truth(state, 4.0, VEHICLE)
    point = trailer_point(state, VEHICLE)
    sample = REFERENCE.at(4.0)
    z_e = tracking_error(state, point, sample.state, sample.trailer_xy)
    _, robust = actions(20, estimate, law).T  # the first tick has no rate
    assert robust[0] == pytest.approx(0.2 * math.tanh(2 * z_e[Error.Y_T]))
    assert robust[1] == pytest.approx(0.1 * math.tanh(1 * z_e[Error.Y_I]))
    assert robust[2] == pytest.approx(0.1 * math.tanh(10 * z_e[Error.X_T]))


def test_on_a_one_step_nominal_the_robust_law_does_not_see_where_the_vehicle_stands():
    options = PaperOptions(nominal="one-step")
    law = paper_controller(VEHICLE, REFERENCE, PERIOD_S, options).feedback
    for k, offset in ((20, 0.3), (21, 0.3)):
        state = REFERENCE.at(k * PERIOD_S).state + offset * np.array([0, 1.0, 0, 0, 0, 0, 0])
        _, robust = actions(k, seen_truth(state, k * PERIOD_S, VEHICLE), law).T
        assert abs(robust[0]) < 0.02


@pytest.mark.parametrize(
    ("names", "factors"),
    [
        ({"hp_in_cost": "percent"}, (1.0, 1.0, 100.0**2)),
        ({"hp_in_cost": "fraction"}, (1.0, 1.0, 1.0)),
        ({"steering_in_cost": "deg"}, (math.degrees(1.0) ** 2,) * 2 + (100.0**2,)),
        ({"steering_in_cost": "rad/s"}, (25.0, 25.0, 100.0**2)),
    ],
)
def test_units_of_the_cost_are_weights_of_the_unnamed_one(names, factors):
    """R is for the named unit: a step of 1 % costs 1, as 1e4 times the square of 0.01 does."""
    plain = {"hp_in_cost": "fraction", "steering_in_cost": "rad"}
    laws = (
        PaperOptions(**names),
        PaperOptions(**plain, step_weight=tuple(factors)),
    )
    state = REFERENCE.at(4.0).state + np.array([0.1, 0.05, 0.02, 0.01, 0.0, 0.0, 0.1])
    estimate = seen_truth(state, 4.0, VEHICLE)
    found = [
        actions(20, estimate, paper_controller(VEHICLE, REFERENCE, PERIOD_S, each).feedback)
        for each in laws
    ]
    np.testing.assert_allclose(found[0], found[1], rtol=1e-12)


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


def tables_of(options):
    return paper_tables(options, REFERENCE.on_grid(PERIOD_S), PERIOD_S)


def test_law_is_the_printed_one():
    constants = tables_of(PaperOptions()).constants
    first = np.array([0.01, 0.02, 0.03, 0.04])  # x_t, y_t, x_i, y_i
    second = np.array([0.02, 0.01, 0.03, 0.05])
    u_m = np.empty(3)
    robust_action(constants, second, first, u_m)
    assert u_m[0] == pytest.approx(0.2 * math.tanh(2 * 0.01 + 4 * -0.05))  # y of the tractor
    assert u_m[1] == pytest.approx(0.1 * math.tanh(1 * 0.05 + 2 * 0.05))  # y of the trailer
    assert u_m[2] == pytest.approx(0.1 * math.tanh(10 * 0.02 + 20 * 0.05))  # x of the tractor
