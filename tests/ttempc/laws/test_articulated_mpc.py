"""Articulated error model against the exact model, and the closed loop of the MPC on it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.reference.models.kinematics import advance
from tests.ttempc.closed_loop import PERIOD_S, drive
from ttempc.guidance.controllers import make_controller
from ttempc.models.augmented_state import (
    SIZE,
    AugmentedState,
    advance_augmented_state,
    estimate_of,
    vehicle_parameters,
)
from ttempc.models.kinematics import trailer_point
from ttempc.mpc.articulated_error import error_dynamics
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Disturbance, State
from ttempc.vehicle import CommandLimits, Vehicle

VEHICLE = Vehicle()
REFERENCE = Reference(figure_eight(), VEHICLE, ConstantSpeed(1.0))
SUBSTEPS = 20


def after_period(state, inputs, disturbance):
    """Return the state after one period of the exact model with constant inputs, without valves."""
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
        return -turned @ after_period(state, inputs - u_e, disturbance)

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


def controller():
    return make_controller("ttempc-nominal", VEHICLE, REFERENCE, PERIOD_S)


def test_without_disturbance_both_points_stay_on_the_path():
    run = drive(controller(), REFERENCE, ticks=600)
    assert run.largest_m < 0.01
    assert not any(step.diagnostics.fallback for step in run.steps)


def test_a_constant_disturbance_leaves_no_offset():
    disturbance = np.zeros(5)
    disturbance[[Disturbance.SLIP_T, Disturbance.SLIP_I]] = 0.03, 0.02
    disturbance[[Disturbance.STEERING, Disturbance.DRIVE]] = -0.02, -0.03
    run = drive(controller(), REFERENCE, ticks=600, disturbance=disturbance)
    settled = run.after(20.0)
    assert settled.largest_m < 0.03  # slips of both points need more than two steering angles
    assert np.mean([settled.tractor_m, settled.trailer_m]) < 0.01


def test_a_slope_leaves_no_offset_on_curves():
    """Map-fixed slips turn under the vehicle, and the horizon predicts how.

    The estimate is exact. With the same disturbance in the estimate as a body-fixed one, the errors
    are larger.
    """

    def errors(given):
        """Return the distances of both points, (N, 2), where the controller gets `given`."""
        law = controller()
        augmented = np.zeros(SIZE)
        augmented[:7] = REFERENCE.at(0.0).state
        augmented[AugmentedState.SIDE_Y], augmented[AugmentedState.CLIMB_Y] = -0.03, 0.1
        valves, unused = (
            augmented[AugmentedState.DELTA_T : AugmentedState.RIM].copy(),
            np.empty((SIZE, SIZE)),
        )
        table, fading, step_s = vehicle_parameters(VEHICLE), np.zeros((2, 11)), PERIOD_S / SUBSTEPS
        distances = []
        for k in range(340):  # straight and the first curve
            estimate = estimate_of(augmented, np.eye(SIZE), k * PERIOD_S, VEHICLE, ())
            sample = REFERENCE.at(k * PERIOD_S)
            distances.append(
                [
                    np.linalg.norm(estimate.state[:2] - sample.state[:2]),
                    np.linalg.norm(estimate.trailer_xy - sample.trailer_xy),
                ]
            )
            command = law.step(given(estimate), k).command.as_array()
            for _ in range(SUBSTEPS):
                advance_augmented_state(augmented, valves, command, table, fading, step_s, unused)
        return np.array(distances)[50:]

    exact = errors(lambda estimate: estimate)
    body_fixed = errors(lambda estimate: replace(estimate, map_disturbance=np.zeros(4)))
    assert exact.mean() < 0.005
    assert exact.mean() < body_fixed.mean()


def test_recovers_from_a_metre_and_twenty_degrees_within_fifteen_metres_and_the_limits():
    yaw = math.radians(20.0)
    offset = np.array([0.0, 1.0, yaw, yaw, 0.0, 0.0, 0.0])
    run = drive(controller(), REFERENCE, ticks=300, offset=offset)
    assert run.after(15.0).largest_m < 0.10
    limits = CommandLimits.of(VEHICLE, PERIOD_S)
    assert np.all((run.commands >= limits.lower) & (run.commands <= limits.upper))
    assert np.all(np.abs(np.diff(run.commands, axis=0)) <= limits.step + 1e-12)
