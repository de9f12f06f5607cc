"""NMPCs: solutions, limit of small errors, information, fallbacks."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.ttempc.closed_loop import PERIOD_S, drive, seen_truth
from tests.ttempc.exact_qp import residuals
from tests.ttempc.numeric import central_differences
from ttempc.baselines import nmpc
from ttempc.baselines.nmpc import GaussNewton, NmpcOptions, nmpc_controller
from ttempc.guidance.controllers import make_controller
from ttempc.mpc.qp import QP
from ttempc.reference.path import figure_eight, straight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
EIGHT = Reference(figure_eight(laps=1), VEHICLE, ConstantSpeed(1.0))
LINE = Reference(straight(60.0), VEHICLE, ConstantSpeed(1.0))
NAMES = ("nmpc", "nmpc-rti")
NOISE = np.array([0.01, 0.01, 0.006, 0.006, 0.002, 0.002, 0.02])
DIRECTION = np.array([0.5, 1.0, 0.2, -0.1, 0.05, 0.05, 0.3])


ALIKE = {"output_weight": (1.0, 1.0, 1.0, 2.0), "step_weight": (0.1, 0.1, 0.1), "damping_s": 0.0}


def first_move(controller, reference, offset, k=0):
    state = reference.at(k * PERIOD_S).state + offset
    step = controller.step(seen_truth(state, k * PERIOD_S, VEHICLE), k)
    assert step.diagnostics.fallback == ""
    return step.command.as_array()


@pytest.mark.parametrize("name", NAMES)
def test_first_move_tends_to_the_linear_one_for_small_errors(name):
    """The linear model neglects terms of second order in the error."""

    def apart(scale):
        moves = [
            first_move(
                make_controller(n, VEHICLE, LINE, PERIOD_S, options=ALIKE), LINE, scale * DIRECTION
            )
            for n in (name, "ttempc-nominal")
        ]
        return np.abs(moves[0] - moves[1]).max()

    assert apart(1e-2) < 1e-3
    assert apart(1e-3) < apart(1e-2) / 10.0
    assert apart(0.0) < 1e-9


class Checking(GaussNewton):
    """A solver that checks every plan for the optimality conditions of the nonlinear problem."""

    checked = 0

    def minimise(self, task, steps):
        plan = super().minimise(task, steps)
        errors, jacobian = np.empty_like(self._errors), np.empty_like(self._jacobian)

        def cost(given):
            self._model.evaluate(task, given, errors, jacobian)
            return np.array([np.sum(self._weight * errors**2) + self._step_weight @ given**2])

        (slope,) = central_differences(cost, plan.steps)
        held = np.tile(task.previous, len(steps) // len(task.previous))
        linear = QP(
            hessian=np.zeros((len(steps), len(steps))),
            gradient=slope,
            matrix=self._sums,
            row_lower=task.bounds.lower - held,
            row_upper=task.bounds.upper - held,
            lower=task.bounds.step_lower,
            upper=task.bounds.step_upper,
        )
        primal, stationarity = residuals(linear, plan.steps)
        assert primal < 1e-9
        assert stationarity < 1e-5
        Checking.checked += 1
        return plan


def test_converged_plans_satisfy_the_optimality_conditions(monkeypatch):
    """The slope of the cost by differences, and the bounds that are active."""
    monkeypatch.setattr(nmpc, "_TOLERANCE", 1e-9)
    monkeypatch.setattr(nmpc, "GaussNewton", Checking)
    controller = nmpc_controller(VEHICLE, EIGHT, PERIOD_S, NmpcOptions(damping_s=0.0))
    generator = np.random.default_rng(3)
    for k in range(60, 68):  # from the straight into the curve
        first_move(controller, EIGHT, NOISE * generator.standard_normal(7), k)
    assert Checking.checked == 8


@pytest.mark.parametrize("name", NAMES)
def test_both_points_stay_on_the_path(name):
    run = drive(make_controller(name, VEHICLE, EIGHT, PERIOD_S), EIGHT, ticks=250)
    assert max(run.tractor_m.max(), run.trailer_m.max()) < 0.02
    assert not any(step.diagnostics.fallback for step in run.steps)


@pytest.mark.parametrize("name", NAMES)
def test_recovers_from_a_metre_and_twenty_degrees_within_fifteen_metres(name):
    controller = make_controller(name, VEHICLE, LINE, PERIOD_S)
    turned = np.array([0.0, 1.0, math.radians(20.0), math.radians(20.0), 0.0, 0.0, 0.0])
    run = drive(controller, LINE, ticks=100, offset=turned)
    assert max(run.tractor_m[75:].max(), run.trailer_m[75:].max()) < 0.10


def test_reports_a_plan_that_has_not_converged():
    hasty = nmpc_controller(VEHICLE, LINE, PERIOD_S, NmpcOptions(iterations=2))
    step = hasty.step(seen_truth(LINE.at(0.0).state + 3.0 * DIRECTION, 0.0, VEHICLE), 0)
    assert step.diagnostics.fallback == "not converged in 2 iterations: last plan driven"
