"""Articulated law on flat arrays: who answers its QP, copies of it, its record of a tick."""

from __future__ import annotations

import copy
import pickle
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.closed_loop import PERIOD_S, Supervised, drive
from tests.ttempc.tubes import DESIGN, REFERENCE, VEHICLE
from ttempc.guidance.controllers import make_controller
from ttempc.layout import TICK
from ttempc.mpc.qp import CheckedSolver
from ttempc.reference.corridor import Corridor

NOISE = np.array([0.01, 0.01, 0.005, 0.005, 0.003, 0.003, 0.01])


class Watched:
    """`ttempc` with a check of every QP: who answered it, and its minimiser by DAQP."""

    def __init__(self, reference):
        self.controller = make_controller("ttempc", VEHICLE, reference, PERIOD_S, DESIGN)
        self.law = self.controller.feedback
        self.other = CheckedSolver("daqp")
        self.statuses = []

    def step(self, estimate, k):
        step = self.controller.step(estimate, k)
        horizon = self.law.mpc.horizon
        work = self.law.mpc.work
        report = step.diagnostics.solver
        self.statuses.append(report.status)

        problem = horizon.problem(work)
        free = np.linalg.solve(problem.hessian, -problem.gradient)
        needs_solver = problem.violation(free) > 0.0 or self.soft_violation(k, free) > 1e-9
        assert (report.status == "closed form") == (not needs_solver)

        assert report.accepted
        assert problem.violation(work.steps) < 1e-12
        if report.status == "solved with soft bounds":
            problem = horizon.softened_problem(k, work)
        else:
            assert self.soft_violation(k, work.steps) < 1e-8
        minimiser = self.other.solve(problem).x[: work.steps.size]
        np.testing.assert_allclose(work.steps, minimiser, atol=1e-6)
        np.testing.assert_allclose(step.diagnostics.predicted_path, self.path(k), atol=1e-9)
        return step

    def soft_violations(self, k, steps):
        """Return the largest violation of each soft output along the horizon, (s,)."""
        soft = self.law.mpc.horizon.softened_problem(k, self.law.mpc.work).soft
        values = soft.matrix @ steps
        excess = np.maximum(values - soft.upper, soft.lower - values)
        return excess.reshape(-1, len(soft.penalty)).max(axis=0)

    def soft_violation(self, k, steps):
        return self.soft_violations(k, steps).max()

    def path(self, k):
        """Stage by stage, z_j of the present plan, whose outputs are the errors of both points."""
        horizon, work = self.law.mpc.horizon, self.law.mpc.work
        stages = horizon.stages
        state, inputs, errors = work.state.copy(), work.previous.copy(), []
        for j in range(horizon.horizon):
            if 3 * j < work.steps.size:
                inputs += work.steps[3 * j : 3 * j + 3]
            state[:7] = stages.a[k + j] @ state + stages.b[k + j] @ inputs
            errors.append(stages.outputs[k + j + 1] @ state[:7])
        return self.law.path.less(k, np.array(errors))


@pytest.mark.parametrize(
    ("half_width_m", "noise", "status"),
    [(None, 1.0, "solved"), (None, 4.0, "solved"), (0.004, 1.0, "solved with soft bounds")],
)
def test_the_solver_answers_the_problems_with_an_active_bound_and_no_other(
    half_width_m, noise, status
):
    corridor = None if half_width_m is None else Corridor(half_width_m)
    watched = Watched(replace(REFERENCE, corridor=corridor))
    drive(watched, REFERENCE, noise=noise * NOISE, ticks=200)
    statuses = Counter(watched.statuses)
    assert statuses["closed form"] > 10
    assert statuses[status] > 10


@pytest.mark.parametrize("name", ["ttempc", "ttempc-nominal", "ttempc-tube"])
def test_copies_of_a_supervised_law_go_on_alike(name):
    original = Supervised(
        make_controller(name, VEHICLE, REFERENCE, PERIOD_S, DESIGN), REFERENCE, PERIOD_S
    )

    class Copied:
        supervisors = (original,)

        def step(self, estimate, k):
            if k == 40:
                others = copy.deepcopy(original), pickle.loads(pickle.dumps(original))
                self.supervisors = (original, *others)
            if k % 7 == 0:
                self.supervisors[-1].prepare(k)  # which changes no result
            steps = [each.step(estimate, k, k * PERIOD_S) for each in self.supervisors]
            records = [each.tick.tobytes() for each in self.supervisors]
            assert len(set(records)) == 1
            return steps[0]

    drive(Copied(), REFERENCE, noise=2.0 * NOISE, ticks=80)


def test_a_law_goes_on_from_a_copy_of_another_and_the_record_has_the_command():
    law, other = (make_controller("ttempc", VEHICLE, REFERENCE, PERIOD_S, DESIGN) for _ in range(2))
    supervisors = [Supervised(each, REFERENCE, PERIOD_S) for each in (law, other)]

    class Restored:
        def step(self, estimate, k):
            other.feedback = copy.deepcopy(law.feedback)
            steps = [each.step(estimate, k, k * PERIOD_S) for each in supervisors]
            assert steps[0].command == steps[1].command
            control = supervisors[0].tick.view(TICK)[0]["control"]
            np.testing.assert_array_equal(control[:, 4], steps[0].command.as_array())
            np.testing.assert_allclose(control[:, 3], control[:, :3].sum(axis=1), rtol=1e-15)
            assert np.all((control[:, 5] <= control[:, 4]) & (control[:, 4] <= control[:, 6]))
            return steps[0]

    drive(Restored(), REFERENCE, noise=3.0 * NOISE, ticks=60)
