"""Articulated law on flat arrays: both ways of its QP, copies of it, its record of a tick."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.closed_loop import PERIOD_S, Supervised, drive
from tests.ttempc.exact_qp import residuals
from tests.ttempc.tubes import DESIGN, REFERENCE, VEHICLE
from ttempc.guidance.controllers import make_controller
from ttempc.layout import TICK
from ttempc.mpc.lmpc import LinearMpc
from ttempc.reference.corridor import Corridor

NOISE = np.array([0.01, 0.01, 0.005, 0.005, 0.003, 0.003, 0.01])


class Watched:
    """`ttempc` with another solution of every QP, by the solver alone."""

    def __init__(self, reference):
        self.controller = make_controller("ttempc", VEHICLE, reference, PERIOD_S)
        self.law = self.controller.feedback
        self.solver = LinearMpc(self.law.mpc.horizon, most=-1)
        self.sets = []

    def step(self, estimate, k):
        step, mpc = self.controller.step(estimate, k), self.law.mpc
        report, work = step.diagnostics.solver, mpc.work
        answered = report.solve_time_s == 0.0
        self.sets.append(report.iterations if answered else -1)
        if answered and report.iterations:
            self.solver.step(k, work.given[:-3], work.given[-3:])
            np.testing.assert_allclose(self.solver.work.steps, work.steps, atol=1e-6)
            qp = mpc.horizon.problem(k, work)
            assert max(residuals(qp, work.steps)) < 1e-8
        np.testing.assert_allclose(step.diagnostics.predicted_path, self.path(k), atol=1e-9)
        return step

    def path(self, k):
        """Stage by stage, z_j of the present plan, whose outputs are the errors of both points."""
        horizon, work = self.law.mpc.horizon, self.law.mpc.work
        now, errors = work.given.copy(), []
        for j in range(horizon.horizon):
            if 3 * j < work.steps.size:
                now[-3:] += work.steps[3 * j : 3 * j + 3]
            now[:7] = horizon.stages.model[k + j] @ now
            errors.append(horizon.stages.outputs[k + j + 1] @ now[:7])
        return self.law.path.less(k, np.array(errors))


@pytest.mark.parametrize("corridor", [None, Corridor(0.3)])
@pytest.mark.parametrize(("noise", "least"), [(1.0, 0.95), (4.0, 0.4)])
def test_active_sets_and_the_solver_agree_on_the_problems_of_a_drive(noise, least, corridor):
    watched = Watched(replace(REFERENCE, corridor=corridor))
    drive(watched, REFERENCE, noise=noise * NOISE, ticks=200)
    sets = np.array(watched.sets)
    assert (sets > 0).sum() > 10
    assert (sets >= 0).mean() > least


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
