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
    """Receding horizon: solve, take the first step. Its only memory is the solver's.

    Where the solver gives no result that counts, the previous input is held.
    """

    def __init__(self, horizon: CondensedHorizon) -> None:
        self._horizon = horizon
        self._solver = PersistentSolver()

    def step(self, k: int, state: FloatArray, previous: FloatArray) -> FeedbackAction:
        """Return the action of tick `k` for the state z_k (n,) and the input u_{k-1} (m,)."""
        bounds = self._horizon.first_bounds(k, len(previous))
        # An input from which no allowed step leads back into the set would leave no solution.
        previous = np.minimum(
            np.maximum(previous, bounds.lower - bounds.step_upper),
            bounds.upper - bounds.step_lower,
        )
        qp = self._horizon.qp(k, state, previous)
        solution = self._solver.solve(qp)
        if solution.x is None:
            steps = np.zeros_like(qp.gradient)
            fallback = f"QP {solution.report.status}: previous feedback held"
        else:
            steps = np.minimum(np.maximum(solution.x, qp.step_lower), qp.step_upper)
            fallback = ""
        u = previous + steps[: len(previous)]
        u = np.minimum(np.maximum(u, bounds.lower), bounds.upper)
        plan = np.concatenate([state, previous, steps])
        return FeedbackAction(u, plan, solution.report, fallback)
