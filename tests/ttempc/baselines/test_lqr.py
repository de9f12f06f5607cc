"""LQR: its gains against the linear MPC, and its closed loop."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tests.ttempc.closed_loop import PERIOD_S, drive, seen_truth
from tests.ttempc.horizons import qp_of
from ttempc.baselines.lqr import LqrOptions, step_problem
from ttempc.guidance.controllers import make_controller
from ttempc.laws.options import MpcOptions
from ttempc.mpc.articulated_error import error_dynamics
from ttempc.mpc.lmpc import CondensedHorizon
from ttempc.reference.path import figure_eight, straight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.reference.speed import Backward
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
REFERENCE = Reference(figure_eight(laps=1), VEHICLE, ConstantSpeed(1.0))
OPTIONS = LqrOptions()
WEIGHTS = np.array(OPTIONS.output_weight), np.array(OPTIONS.step_weight)


def test_first_step_is_that_of_a_long_mpc_without_bounds():
    """Riccati from the end of the horizon backwards minimises what the condensed QP minimises."""
    stages = 80
    a, b, c = error_dynamics(REFERENCE, PERIOD_S, stages)
    gain = step_problem(a, b, c, *WEIGHTS).gains()[0]
    tuning = MpcOptions(
        horizon=stages,
        moves=stages,
        step_weight=OPTIONS.step_weight,
        output_weight=OPTIONS.output_weight,
    )
    horizon = CondensedHorizon(a, b, tuning, PERIOD_S, c)
    generator = np.random.default_rng(5)
    for _ in range(5):
        state, before = 0.1 * generator.normal(size=16), 0.1 * generator.normal(size=3)
        qp = qp_of(horizon, 0, state, before)
        steps = np.linalg.solve(qp.hessian, -qp.gradient)
        np.testing.assert_allclose(
            -gain @ np.concatenate([state, before]), steps[:3], rtol=1e-6, atol=1e-8
        )


def test_both_points_stay_on_the_path():
    run = drive(make_controller("lqr", VEHICLE, REFERENCE, PERIOD_S), REFERENCE)
    assert run.largest_m < 0.02


def test_steps_weigh_twice_where_the_swing_is_a_step_of_the_valve_and_more_in_reverse():
    rate = math.radians(4.0) / PERIOD_S
    slow = replace(VEHICLE, steering_rate_t=rate, steering_rate_i=rate)
    front, trailer, hp = OPTIONS.step_weight
    for vehicle, factor in ((slow, 2.0), (replace(slow, reverse=True), 6.0)):
        path, speed = straight(20.0), ConstantSpeed(1.0)
        if vehicle.reverse:
            path, speed = path.reversed(), Backward(speed, path.length_m)
        reference = Reference(path, vehicle, speed)
        state = reference.at(0.0).state + np.array([0.0, 0.1, 0.02, 0.01, 0.0, 0.0, 0.0])
        first, second = (
            make_controller("lqr", vehicle, reference, PERIOD_S, options=options)
            .step(seen_truth(state, 0.0, vehicle), 0)
            .diagnostics.total
            for options in (
                {"swing_deg": 4.0, "reverse_factor": 3.0},
                {
                    "swing_deg": 0.0,
                    "reverse_factor": 1.0,
                    "step_weight": (factor * front, factor * trailer, hp),
                },
            )
        )
        np.testing.assert_allclose(first, second, rtol=1e-9)


def test_saturation_does_not_wind_up():
    """Held at a stop by a far target, the command leaves it as soon as the target is near."""
    controller = make_controller("lqr", VEHICLE, REFERENCE, PERIOD_S)
    far = REFERENCE.at(0.0).state + np.array([0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    for k in range(50):
        controller.step(seen_truth(far, k * PERIOD_S, VEHICLE), k)
    on_reference = seen_truth(REFERENCE.at(10.0).state, 10.0, VEHICLE)
    for _ in range(10):
        command = controller.step(on_reference, 50).command
    assert abs(command.delta_t) < 0.1
