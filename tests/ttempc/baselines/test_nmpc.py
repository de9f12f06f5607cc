"""NMPCs: solutions, limit of small errors, decompositions, fallbacks."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.ttempc.closed_loop import PERIOD_S, drive, seen_truth
from tests.ttempc.exact_qp import residuals
from tests.ttempc.numeric import central_differences
from ttempc.baselines import nmpc
from ttempc.baselines.gauss_newton import GaussNewton, evaluate
from ttempc.baselines.nmpc import CENTRAL, DECENTRALISED, DISTRIBUTED, NmpcOptions, nmpc_controller
from ttempc.guidance.controllers import make_controller
from ttempc.mpc.qp import QP
from ttempc.reference.path import figure_eight, straight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
EIGHT = Reference(figure_eight(laps=1), VEHICLE, ConstantSpeed(1.0))
LINE = Reference(straight(60.0), VEHICLE, ConstantSpeed(1.0))
NAMES = ("nmpc", "nmpc-rti", "nmpc-decentralised", "nmpc-distributed")
CENTRAL_NAMES = NAMES[:2]
NOISE = np.array([0.01, 0.01, 0.006, 0.006, 0.002, 0.002, 0.02])
DIRECTION = np.array([0.5, 1.0, 0.2, -0.1, 0.05, 0.05, 0.3])


ALIKE = {"output_weight": (1.0, 1.0, 1.0, 2.0), "step_weight": (0.1, 0.1, 0.1), "damping_s": 0.0}


def first_move(controller, reference, offset, k=0):
    state = reference.at(k * PERIOD_S).state + offset
    step = controller.step(seen_truth(state, k * PERIOD_S, VEHICLE), k)
    assert step.diagnostics.fallback == ""
    return step.command.as_array()


@pytest.mark.parametrize("name", CENTRAL_NAMES)
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

    def __init__(self, *arguments, **keywords):
        super().__init__(*arguments, **keywords, tolerance=1e-9)

    def minimise(self, task):
        before = task.motion.copy()
        plan = super().minimise(task)
        after = task.motion.copy()
        for problem in self.problems:
            # a trailer that is first has taken the motion that was given
            task.motion[:] = after if self.first.model.block.tractor else before
            self.check(task, problem, plan)
        return plan

    def check(self, task, problem, plan):
        own, solution = problem.model.block.inputs, problem.vectors[2].copy()
        size, outputs = len(solution), problem.weight.shape[1]
        weight = problem.weight[task.k + 1 : task.k + 1 + len(task.poses)]
        errors = np.empty((len(task.poses), outputs))
        jacobian = np.empty((len(task.poses), outputs, size))

        def cost(given):
            problem.vectors[1] = given
            evaluate(task, problem, errors, jacobian)
            return np.array([np.sum(weight * errors**2) + problem.step_weight @ given**2])

        (slope,) = central_differences(cost, solution)
        moves = size // len(own)
        lower, upper, step_lower, step_upper = problem.limits
        linear = QP(
            hessian=np.zeros((size, size)),
            gradient=slope,
            matrix=np.kron(np.tril(np.ones((moves, moves))), np.eye(len(own))),
            row_lower=lower,
            row_upper=upper,
            lower=step_lower,
            upper=step_upper,
        )
        primal, stationarity = residuals(linear, solution)
        assert primal < 1e-9
        assert stationarity < 1e-5
        np.testing.assert_allclose(plan.steps[:, own].ravel(), solution)
        Checking.checked += 1


@pytest.mark.parametrize("decomposition", [CENTRAL, DECENTRALISED, DISTRIBUTED])
def test_converged_plans_satisfy_the_optimality_conditions(decomposition, monkeypatch):
    """The slope of the cost by differences, and the bounds that are active, of each block."""
    monkeypatch.setattr(nmpc, "GaussNewton", Checking)
    monkeypatch.setattr(Checking, "checked", 0)
    options = NmpcOptions(damping_s=0.0)
    controller = nmpc_controller(VEHICLE, EIGHT, PERIOD_S, options, decomposition)
    generator = np.random.default_rng(3)
    for k in range(60, 68):  # from the straight into the curve
        first_move(controller, EIGHT, NOISE * generator.standard_normal(7), k)
    assert Checking.checked == 8 * len(decomposition)


# With next to no weight on the trailer its tractor does not take it into account, whose own
# problem has slow steps.
LIGHT = ALIKE | {"output_weight": (1.0, 1.0, 1e-6, 2e-6), "step_weight": (0.1, 1e-5, 0.1)}


def light_move(name):
    controller = make_controller(name, VEHICLE, EIGHT, PERIOD_S, options=LIGHT)
    return first_move(controller, EIGHT, 0.02 * DIRECTION, 65)


@pytest.mark.parametrize("name", ["nmpc-decentralised", "nmpc-distributed"])
def test_a_tractor_without_care_for_its_trailer_steers_as_in_the_whole_problem(name):
    np.testing.assert_allclose(light_move(name)[[0, 2]], light_move("nmpc")[[0, 2]], atol=1e-5)


def test_a_trailer_that_knows_its_tractors_motion_steers_as_in_the_whole_problem():
    whole, known, kept = (
        light_move(name)[1] for name in ("nmpc", "nmpc-distributed", "nmpc-decentralised")
    )
    assert known == pytest.approx(whole, abs=5e-5)  # its Runge-Kutta steps are longer
    assert abs(whole) < 0.1  # within the bounds
    assert abs(kept - whole) > 1e-4  # it takes its tractor to keep its distance


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
