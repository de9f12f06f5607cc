"""Linear MPC with a receding horizon over precomputed matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import FloatArray, SolverReport
from .qp import CondensedHorizon
from .solver import PersistentSolver


@dataclass(frozen=True, slots=True)
class FeedbackAction:
    """Result of the linear MPC at one tick."""

    input: FloatArray  # u_b = u_e* (m,), eq. (ue); inside its bounds
    plan: FloatArray  # (n + m + m Nc,) w of `CondensedHorizon`: state, previous input, input steps
    report: SolverReport
    fallback: str  # why the input is not the minimiser; empty where it is
    excess: FloatArray | None = None  # (r,) violation of the soft bounds; None where there is none


class LinearMpc:
    """Receding horizon: solve the QP of a tick and apply its first step.

    Where the QP has no accepted solution, the previous input is held. A result depends on earlier
    ones in the last digits of the solver's iterates only.
    """

    def __init__(self, horizon: CondensedHorizon) -> None:
        self._horizon = horizon
        self._solver = PersistentSolver(horizon.solver)
        # `prepare` has a solver of its own: a solve changes the last digits of later results.
        self._preparing_solver = PersistentSolver(horizon.solver)
        self._last: tuple[FloatArray, FloatArray] | None = None  # state and input of the last step

    def fresh(self) -> LinearMpc:
        """Return the MPC before its first tick; it shares the horizon."""
        return LinearMpc(self._horizon)

    def step(self, k: int, state: FloatArray, previous: FloatArray) -> FeedbackAction:
        """Return the action of tick `k` for the state z_k (n,) and the input u_{k-1} (m,)."""
        self._last = state, previous
        return self._solve(self._solver, k, state, previous)

    def prepare(self, k: int) -> None:
        """Solve tick `k` for the data of the last step and drop the result, to fill the caches.

        Its Hessian, which depends on the tick alone, is factorised for the step to come.
        """
        if self._last:
            self._solve(self._preparing_solver, k, *self._last)
            self._solver.hold(self._horizon.hessian(k))

    def _solve(
        self, solver: PersistentSolver, k: int, state: FloatArray, previous: FloatArray
    ) -> FeedbackAction:
        previous = self._horizon.first.clamp_previous(k, previous)
        qp = self._horizon.qp(k, state, previous)
        n = len(qp.gradient)
        solution = solver.solve(qp)
        excess = None
        if solution.x is None:
            steps = np.zeros_like(qp.gradient)
            fallback = f"QP {solution.report.status}: previous feedback held"
        else:
            steps = np.minimum(np.maximum(solution.x[:n], qp.step_lower), qp.step_upper)
            excess = solution.x[n:] if len(solution.x) > n else None
            fallback = ""
        u = self._horizon.first.clamp(k, previous + steps[: len(previous)])
        plan = np.concatenate([state, previous, steps])
        return FeedbackAction(u, plan, solution.report, fallback, excess)
