"""`ttempc`: error model, closed loop, corridor, backup plan, one-step monitor."""

from __future__ import annotations

import math
from dataclasses import astuple, replace

import numpy as np
import pytest

from tests.reference.models.kinematics import advance
from tests.ttempc.closed_loop import PERIOD_S, Supervised, drive, seen_truth
from ttempc.guidance.controllers import make_controller
from ttempc.laws import articulated_mpc
from ttempc.models.kinematics import trailer_point
from ttempc.mpc.articulated_error import (
    corridor_bounds,
    damped,
    error_dynamics,
    held_lambda,
    hitch_bounds,
)
from ttempc.reference.corridor import Corridor
from ttempc.reference.path import figure_eight, straight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.reference.speed import Backward
from ttempc.types import Disturbance, Input, State
from ttempc.vehicle import Vehicle

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


def test_later_laps_share_the_tables_of_the_second_one(monkeypatch):
    def made(laps):
        reference = Reference(figure_eight(laps=laps), VEHICLE, ConstantSpeed(1.0))
        return reference, make_controller("ttempc-nominal", VEHICLE, reference, PERIOD_S)

    (reference, shared), (_, longer) = made(5), made(9)
    rows = [len(law.feedback.mpc.horizon.stages.outputs) for law in (shared, longer)]
    assert rows[0] == rows[1]
    monkeypatch.setattr(articulated_mpc, "_LAPS", 5)
    _, own = made(5)
    for k in (300, 1300, 2050, 2700, 3333):
        off = np.array([0.02, 0.03, 0.02, -0.01, 0.01, 0.0, 0.02])
        seen = seen_truth(reference.at(k * PERIOD_S).state + off, k * PERIOD_S, VEHICLE)
        commands = [astuple(law.step(seen, k).command) for law in (own, shared)]
        # Half a tick turns the tables of a curve by 0.6 deg.
        np.testing.assert_allclose(*commands, atol=1e-9 if k <= 1300 else 5e-3)


LINE = Reference(straight(80.0), VEHICLE, ConstantSpeed(1.0))
BESIDE = {"output_weight": [1.0, 0.0, 1.0, 1.0]}  # the tractor may be beside its path


def kept(half_width_m, reference=LINE, options=None, **corridor):
    along = replace(reference, corridor=Corridor(half_width_m, **corridor))
    return make_controller("ttempc-nominal", VEHICLE, along, PERIOD_S, options=options or BESIDE)


def test_bounds_are_those_of_the_exact_geometry_to_first_order():
    """Errors of the points across their reference and of the hitch angle, by finite differences."""
    reference = Reference(figure_eight(), VEHICLE, ConstantSpeed(1.0))
    a, _, c = error_dynamics(reference, PERIOD_S, 150)
    grid = reference.at(np.arange(151) * PERIOD_S)
    behind, limit = 0.7, math.radians(60.0)
    corridor = Corridor(0.1, hitch_limit=limit, tool_behind_m=behind)
    spread = np.radians([0.0, 2.0, 4.0])
    hitch = hitch_bounds(grid, VEHICLE, limit, spread, 0.3, a, PERIOD_S)
    bounds = corridor_bounds(corridor, grid, c, first=1, horizon=2).beside(hitch)

    def outputs(state):
        x_i, y_i = trailer_point(state, VEHICLE)
        psi_i = state[State.PSI_I]
        tool = x_i - behind * math.cos(psi_i), y_i - behind * math.sin(psi_i)
        return (*state[:2], x_i, y_i, *tool, state[State.PSI_T] - psi_i - state[State.DELTA_I])

    generator = np.random.default_rng(2)
    for k in (0, 60, 110, 150):
        state = grid.state[k]
        error = 1e-5 * generator.normal(size=7)
        moved = np.subtract(outputs(state), outputs(state - error))  # z_r - z = error
        psi_t, psi_i = state[State.PSI_T], state[State.PSI_I]
        expected = [
            -math.sin(psi) * moved[2 * i] + math.cos(psi) * moved[2 * i + 1]
            for i, psi in enumerate((psi_t, psi_i, psi_i))
        ]
        turned, cos, sin = np.zeros(16), math.cos(psi_t), math.sin(psi_t)
        turned[:7] = error
        turned[:2] = cos * error[0] + sin * error[1], cos * error[1] - sin * error[0]
        np.testing.assert_allclose(bounds.rows[k] @ turned, [*expected, moved[6]], atol=1e-9)
        beta = outputs(state)[6]
        room = math.sin(limit)  # lambda - sin lambda is what the linear model leaves out
        np.testing.assert_allclose(bounds.upper[k], [0.1, 0.1, 0.1, beta + room], atol=1e-9)
        np.testing.assert_allclose(bounds.lower[k], [-0.1, -0.1, -0.1, beta - room], atol=1e-9)
    np.testing.assert_array_equal(bounds.spread[1:, 3], spread[1:])


def test_the_held_hitch_angle_is_a_steady_turn_of_the_exact_model():
    held = held_lambda(VEHICLE, 0.3)
    state = np.array([0.0, 0.0, held, 0.0, 0.3, 0.0, -1.0])
    inputs = np.array([0.3, 0.0, -1.0 / VEHICLE.speed_gain])
    turned = after_period(state, inputs, np.zeros(5))
    assert turned[State.PSI_T] - turned[State.PSI_I] == pytest.approx(held, abs=1e-6)


def test_in_reverse_the_bounds_are_on_both_angles_and_what_their_rates_add():
    """The larger the time for turning back, the earlier a plan that folds meets its bound."""
    vehicle = replace(VEHICLE, reverse=True)
    reference = Reference(straight(40.0), vehicle, Backward(ConstantSpeed(1.0), 40.0))
    a, _, _ = error_dynamics(reference, PERIOD_S, 100)
    grid = reference.at(np.arange(101) * PERIOD_S)
    bounds = hitch_bounds(grid, vehicle, math.radians(45.0), np.zeros(21), 0.4, a, PERIOD_S)
    beta = np.array([0, 0, 1, -1, 0, -1, 0, *np.zeros(9)], dtype=float)
    angles = np.stack([beta, beta + np.eye(16)[State.DELTA_I]])  # beta, lambda
    state = np.random.default_rng(3).normal(size=16)
    rates = angles @ (a[50] @ state - state) / PERIOD_S
    added = bounds.rows[50] @ state - angles @ state
    assert added == pytest.approx(added[0] / rates[0] * rates)
    assert added[0] / rates[0] > 0.5
    assert bounds.upper[50, 1] < held_lambda(vehicle, 0.4)


def test_damped_outputs_are_those_of_the_rolled_model_and_their_rates():
    """Without inputs y + tau y' has the difference of y over a period, slip included."""
    a, _, c = error_dynamics(REFERENCE, PERIOD_S, 150)
    rows = damped(a, c, PERIOD_S, 0.7)
    state = np.random.default_rng(3).normal(size=16)
    for k in range(100, 150):  # a straight, then a curve
        y, after = c[k] @ state, c[k + 1] @ (a[k] @ state)
        expected = np.where([False, True] * 2, y + 0.7 / PERIOD_S * (after - y), y)
        np.testing.assert_allclose(rows[k] @ state, expected, atol=1e-9)
        state = a[k] @ state


def test_a_tractor_that_may_stray_is_kept_in_the_corridor_where_it_holds():
    """Side slip of the trailer: with the tractor's error free, the tractor moves aside."""
    slip = np.zeros(5)
    slip[[Disturbance.SLIP_T, Disturbance.SLIP_I]] = 0.0, 0.06
    free = make_controller("ttempc-nominal", VEHICLE, LINE, PERIOD_S, options=BESIDE)
    strayed = drive(free, LINE, ticks=300, disturbance=slip).tractor_m
    half_width = 0.5 * strayed.max()
    inside = drive(kept(half_width), LINE, ticks=300, disturbance=slip).tractor_m
    assert inside.max() < 1.05 * half_width
    assert inside.max() > 0.9 * half_width  # the corridor is used
    closing = kept(half_width, along_m=((30.0, 80.0),))
    later = drive(closing, LINE, ticks=300, disturbance=slip).tractor_m
    np.testing.assert_array_equal(later[:129], strayed[:129])  # a horizon before 30 m
    assert strayed[150:].max() > 1.3 * half_width
    assert later[150:].max() < 1.05 * half_width


def test_half_speed_and_a_reason_while_the_corridor_cannot_be_kept():
    along = replace(LINE, corridor=Corridor(0.05))
    controller = make_controller("ttempc", VEHICLE, along, PERIOD_S)
    supervisor = Supervised(controller, along, PERIOD_S)
    nominal_hp = LINE.at(0.0).inputs[Input.HP]
    moving = LINE.at(0.0).state
    for k in range(60):
        state = moving.copy()
        if 10 <= k < 30:
            state[State.Y] += 0.5
        step = supervisor.step(seen_truth(state, k * PERIOD_S, VEHICLE), k, k * PERIOD_S)
        if k != 30:  # from 32 deg the steering turns back for a tick
            assert ("corridor cannot be kept" in step.diagnostics.fallback) == (10 <= k < 30)
        if 20 <= k < 26:
            assert step.command.hp <= 0.5 * nominal_hp + 1e-12
        moving = after_period(moving, np.array([0.0, 0.0, step.command.hp]), np.zeros(5))
    assert step.command.hp > 0.9 * nominal_hp
