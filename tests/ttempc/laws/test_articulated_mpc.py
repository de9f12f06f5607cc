"""The articulated error model and the controller on it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.reference.models.kinematics import advance
from tests.reference.models.valves import slew
from ttempc.estimation.augmented_state import SIZE, AugmentedState, estimate_of
from ttempc.estimation.augmented_state_kernel import advance_augmented_state, vehicle_parameters
from ttempc.guidance.controllers import make_controller
from ttempc.laws.articulated_mpc import TUNING
from ttempc.limits import CommandLimits
from ttempc.models.kinematics import hitch_angle, trailer_point
from ttempc.mpc.articulated_error import error_dynamics
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Disturbance, Estimate, State
from ttempc.vehicle import Vehicle

PERIOD_S = 0.2
VEHICLE = Vehicle()
REFERENCE = Reference(figure_eight(), VEHICLE, ConstantSpeed(1.0))
SUBSTEPS = 20


def held(state, inputs, disturbance):
    """Exact model over one period with held inputs, valves left out as in the error model."""
    for _ in range(SUBSTEPS):
        state = advance(state, inputs, VEHICLE, PERIOD_S / SUBSTEPS, disturbance)
    return state


def rotation(angle):
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


@pytest.mark.parametrize("k", [5, 60, 100, 300])  # straight, blend, first curve, second curve
def test_the_linear_model_is_the_derivative_of_the_exact_one(k):
    """Errors after a period, and of both axle points, by central differences of the model."""
    a, b, c = error_dynamics(REFERENCE, PERIOD_S, 400)
    grid = REFERENCE.at(np.arange(401) * PERIOD_S)
    inputs = REFERENCE.at((k + 0.5) * PERIOD_S).inputs
    turn, turned = (np.eye(7) for _ in range(2))
    turn[:2, :2] = rotation(-grid.state[k, State.PSI_T])
    turned[:2, :2] = rotation(-grid.state[k + 1, State.PSI_T])

    def after(error, u_e, disturbance):
        state = grid.state[k] - turn.T @ error
        return -turned @ held(state, inputs - u_e, disturbance)

    def points(error):
        state = grid.state[k] - turn.T @ error
        x, y = -rotation(-grid.state[k, State.PSI_I]) @ trailer_point(state, VEHICLE)
        return np.array([*(-(turn @ state)[:2]), x, y])

    step = 1e-5
    for column in range(7):
        e = step * np.eye(7)[column]
        slope = (after(e, np.zeros(3), np.zeros(5)) - after(-e, np.zeros(3), np.zeros(5))) / step
        # The Jacobian is held over the period, while the state moves on by 20 cm.
        np.testing.assert_allclose(a[k, :7, column], 0.5 * slope, atol=6e-3)
        slope = (points(e) - points(-e)) / step
        np.testing.assert_allclose(c[k, :, column], 0.5 * slope, atol=1e-6)
    for column in range(3):
        u = step * np.eye(3)[column]
        slope = (after(np.zeros(7), u, np.zeros(5)) - after(np.zeros(7), -u, np.zeros(5))) / step
        np.testing.assert_allclose(b[k, :7, column], 0.5 * slope, atol=6e-3)
    for column in range(5):
        s = step * np.eye(5)[column]
        slope = (after(np.zeros(7), np.zeros(3), s) - after(np.zeros(7), np.zeros(3), -s)) / step
        np.testing.assert_allclose(a[k, :7, 7 + column], 0.5 * slope, atol=6e-3)


def estimate(state, time_s, disturbance):
    return Estimate(
        time_s,
        state,
        np.zeros((7, 7)),
        trailer_point(state, VEHICLE),
        hitch_angle(state),
        disturbance,
    )


def drive(ticks, offset=(0.0, 0.0), disturbance=(0.0,) * 5):
    """Drive the exact model, valves included; return errors of both points, and commands."""
    controller = make_controller("ttempc-nominal", VEHICLE, REFERENCE, PERIOD_S)
    lateral, yaw = offset
    state = REFERENCE.at(0.0).state.copy()
    state[:2] += lateral * rotation(state[State.PSI_T])[:, 1]
    state[[State.PSI_T, State.PSI_I]] += yaw
    valves, disturbance = state[State.DELTA_T : State.V].copy(), np.array(disturbance)
    errors, commands = [], []
    for k in range(ticks):
        sample = REFERENCE.at(k * PERIOD_S)
        errors.append(
            [
                np.linalg.norm(state[:2] - sample.state[:2]),
                np.linalg.norm(trailer_point(state, VEHICLE) - sample.trailer_xy),
            ]
        )
        said = controller.step(estimate(state, k * PERIOD_S, disturbance), k)
        assert said.diagnostics.fallback == ""
        commands.append(said.command.as_array())
        for _ in range(SUBSTEPS):
            inputs, valves = slew(valves, commands[-1], VEHICLE, PERIOD_S / SUBSTEPS)
            state = advance(state, inputs, VEHICLE, PERIOD_S / SUBSTEPS, disturbance)
    return np.array(errors), np.array(commands)


def test_without_disturbance_both_points_stay_on_the_path():
    errors, _ = drive(600)
    assert errors.max() < 0.01


def test_a_lasting_disturbance_leaves_no_offset():
    disturbance = np.zeros(5)
    disturbance[[Disturbance.SLIP_T, Disturbance.SLIP_I]] = 0.03, 0.02
    disturbance[[Disturbance.STEERING, Disturbance.DRIVE]] = -0.02, -0.03
    errors, _ = drive(600, disturbance=disturbance)
    assert errors[100:].max() < 0.03  # slips ask both points for more than two angles can give
    assert errors[100:].mean() < 0.01


def test_a_slope_leaves_no_offset_on_curves():
    """Slips that stay with the field turn under the vehicle; the horizon knows where they go.

    Nothing is learnt here: the estimate is exact. Told of the same disturbance as one that turns
    with the vehicle, the controller does worse.
    """

    def errors(told):
        controller = make_controller("ttempc-nominal", VEHICLE, REFERENCE, PERIOD_S)
        belief = np.zeros(SIZE)
        belief[:7] = REFERENCE.at(0.0).state
        belief[AugmentedState.SIDE_Y], belief[AugmentedState.CLIMB_Y] = -0.03, 0.1
        valves, unused = (
            belief[AugmentedState.DELTA_T : AugmentedState.RIM].copy(),
            np.empty((SIZE, SIZE)),
        )
        found = []
        for k in range(340):  # straight and the first curve
            seen = estimate_of(belief, np.eye(SIZE), k * PERIOD_S, VEHICLE, ())
            sample = REFERENCE.at(k * PERIOD_S)
            found.append(
                [
                    np.linalg.norm(seen.state[:2] - sample.state[:2]),
                    np.linalg.norm(seen.trailer_xy - sample.trailer_xy),
                ]
            )
            command = controller.step(told(seen), k).command.as_array()
            for _ in range(SUBSTEPS):
                advance_augmented_state(
                    *(belief, valves, command, vehicle_parameters(VEHICLE)),
                    *(np.full(9, 1e9), PERIOD_S / SUBSTEPS, unused),
                )
        return np.array(found)[50:]

    whole = errors(lambda seen: seen)
    turning = errors(lambda seen: replace(seen, map_disturbance=np.zeros(4)))
    assert whole.mean() < 0.005
    assert whole.mean() < turning.mean()


def test_recovers_from_a_metre_and_twenty_degrees_within_fifteen_metres_and_the_limits():
    errors, commands = drive(300, offset=(1.0, math.radians(20.0)))
    assert errors[75:].max() < 0.10  # 15 s at 1 m/s
    limits = CommandLimits.of(VEHICLE, PERIOD_S)
    assert np.all((commands >= limits.lower) & (commands <= limits.upper))
    assert np.all(np.abs(np.diff(commands, axis=0)) <= limits.step + 1e-12)


def test_horizon_reaches_over_the_vehicle():
    assert TUNING.horizon * PERIOD_S >= VEHICLE.drawbar_offset + VEHICLE.trailer_length
