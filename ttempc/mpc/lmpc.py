"""The feedback action: a linear MPC over precomputed horizons."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import FloatArray, SolverReport
from .qp import CondensedHorizon
from .solver import PersistentSolver


@dataclass(frozen=True, slots=True)
class FeedbackAction:
    """What the linear MPC wants at one tick."""

    input: FloatArray  # u_b = u_e* (m,), eq. (ue); inside its bounds
    plan: FloatArray  # (n + m + m Nc,) w of `CondensedHorizon`: known things and input steps
    report: SolverReport
    fallback: str  # why the input is not the minimiser; empty where it is


class LinearMpc:
    """Receding horizon: solve, take the first step. It remembers nothing that changes a result.

    Where the solver gives no result that counts, the previous input is held.
    """

    def __init__(self, horizon: CondensedHorizon) -> None:
        self._horizon = horizon
        self._solver = PersistentSolver()
        self._rehearsal = PersistentSolver()  # an update leaves traces in PIQP's last digits
        self._last: tuple[FloatArray, FloatArray] | None = None  # state and input of the last step

    def step(self, k: int, state: FloatArray, previous: FloatArray) -> FeedbackAction:
        """Return the action of tick `k` for the state z_k (n,) and the input u_{k-1} (m,)."""
        previous = self._horizon.first.within_reach(k, previous)
        qp = self._horizon.qp(k, state, previous)
        solution = self._solver.solve(qp)
        if solution.x is None:
            steps = np.zeros_like(qp.gradient)
            fallback = f"QP {solution.report.status}: previous feedback held"
        else:
            steps = np.minimum(np.maximum(solution.x, qp.step_lower), qp.step_upper)
            fallback = ""
        u = self._horizon.first.within(k, previous + steps[: len(previous)])
        plan = np.concatenate([state, previous, steps])
        self._last = state, previous
        return FeedbackAction(u, plan, solution.report, fallback)

    def prepare(self, k: int) -> None:
        """Solve tick `k` for what the last step was given, in another solver, and drop the result.

        The next step then finds its code in the caches.
        """
        if self._last:
            solver, self._solver = self._solver, self._rehearsal
            self.step(k, *self._last)
            self._solver = solver
