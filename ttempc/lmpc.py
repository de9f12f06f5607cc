"""The feedback action: a linear MPC over precomputed horizons."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ttempc.qp import CondensedHorizon
from ttempc.solver import PersistentSolver
from ttempc.types import FloatArray, SolverReport


@dataclass(frozen=True, slots=True)
class FeedbackAction:
    """What the linear MPC wants at one tick."""

    input: FloatArray  # u_b = u_e* (m,), eq. (ue); inside its bounds
    plan: FloatArray  # (n + m + m Nc,) w of `CondensedHorizon`: known things and input steps
    report: SolverReport
    fallback: str  # why the input is not the minimiser; empty where it is


class LinearMpc:
    """Receding horizon: solve, apply the first step, remember the input.

    Where the solver gives no result that counts, the previous input is held.
    """

    def __init__(self, horizon: CondensedHorizon) -> None:
        self._horizon = horizon
        self._solver = PersistentSolver()
        self._previous = np.zeros_like(horizon.input_bound)  # u_e(k-1)

    def step(self, k: int, state: FloatArray) -> FeedbackAction:
        """Return the action of tick `k` for the tracking error `state` (n,)."""
        bound = self._horizon.input_bound
        # An input outside its own set would make the QP infeasible.
        previous = np.minimum(np.maximum(self._previous, -bound), bound)
        qp = self._horizon.qp(k, state, previous)
        solution = self._solver.solve(qp)
        if solution.x is None:
            steps = np.zeros_like(qp.gradient)
            fallback = f"QP {solution.report.status}: previous feedback held"
        else:
            steps = np.minimum(np.maximum(solution.x, -qp.step_bound), qp.step_bound)
            fallback = ""
        u = previous + steps[: len(bound)]
        self._previous = np.minimum(np.maximum(u, -bound), bound)
        plan = np.concatenate([state, previous, steps])
        return FeedbackAction(self._previous, plan, solution.report, fallback)
