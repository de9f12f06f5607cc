"""Gauss-Newton method over a horizon, with a small QP in each iteration."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ..mpc.qp import QP, HorizonTuning, StageBounds
from ..mpc.solver import PersistentSolver
from ..reference.reference import Reference
from ..types import FloatArray, SolverReport
from .nmpc_model import ArticulatedExpressions, Expressions, HorizonModel, Subsystem

# A plan is converged where the last iteration changed no input of it by more than this, in rad or
# hydrostat position. Changes shrink tenfold or more near the solution: the rest is below a tenth.
_TOLERANCE = 1e-4
ITERATIONS = 20  # at most; 2 to 3 are usual
_HALVINGS = 6
_SUFFICIENT = 0.25  # least actual descent over the QP's, below which a change is halved (Armijo)


@dataclass(frozen=True, slots=True)
class Task:
    """Data of the problem of one tick."""

    state: FloatArray  # (7,) the estimate
    disturbance: FloatArray  # (Np, 5) predicted as by the linear MPC
    poses: FloatArray  # (Np, 6 or 7) targets at the ends of the periods, for `HorizonModel`
    feedforward: FloatArray  # (Np, 3) u_r
    inputs_e: FloatArray  # (Np, 3) u_e; only the subsystem's own columns are decided
    previous: FloatArray  # (m,) own u_e(k-1)
    bounds: StageBounds  # (m Nc,) each, own


@dataclass(frozen=True, slots=True)
class Plan:
    """Solution of one tick."""

    steps: FloatArray | None  # (m Nc,) Delta u_e; None where a QP has no accepted solution
    errors: FloatArray  # (Np, p) position errors under the steps [m]
    report: SolverReport
    fallback: str = ""  # why the steps are not the minimiser; empty where they are


class HorizonSolver(Protocol):
    """Minimises the cost of a horizon."""

    def minimise(self, task: Task, steps: FloatArray) -> Plan:
        """Return the plan for `task`; `steps` (m Nc,) is the initial guess."""
        ...

    def prepare(self) -> None:
        """Get ready for the next call, which gives the same plan but for its last digits."""
        ...

    def fresh(self) -> HorizonSolver:
        """Return the solver as it was before its first call."""
        ...


class GaussNewton:
    """Minimiser of the linear MPC's cost within its bounds, under the nonlinear model.

    The unknowns are the steps of u_e = u_r - u of one subsystem, as in
    `ttempc.mpc.qp.CondensedHorizon`:

        min sum_j y_j' Q y_j + sum Delta u' R Delta u,    y_j = y_j(z_k, u_{k-1}, Delta U),

    where y_j are the position errors of the nonlinear model (single shooting: a plan is feasible
    where its steps are within linear bounds). Every iteration linearises y_j at the present plan,
    accumulates its derivatives from stage to stage and solves the resulting QP. Converged plans
    are stationary points of the nonlinear problem. With one iteration it is a real-time iteration
    (Diehl, Bock and Schloeder 2005, SIAM J. Control Optim. 43), which need not converge in a tick.

    Args:
        reference: of the vehicle whose model counts.
        subsystem: inputs that are decided and outputs that are minimised.
        tuning: horizon, weights and bounds.
        period_s: control period [s].
        iterations: at most, in one call.
        expressions: the model, by default the articulated one of the reference's vehicle.

    Raises:
        MissingPackage: CasADi is not installed.
    """

    def __init__(
        self,
        reference: Reference,
        subsystem: Subsystem,
        tuning: HorizonTuning,
        period_s: float,
        iterations: int = ITERATIONS,
        expressions: Expressions | None = None,
    ) -> None:
        expressions = expressions or ArticulatedExpressions(reference.vehicle)
        self._model = HorizonModel(expressions, subsystem, tuning.horizon, period_s)
        self._qp = PersistentSolver()
        self._iterations = iterations
        self._last: tuple[Task, FloatArray] | None = None
        self._own = list(subsystem.inputs)
        horizon, moves, m = tuning.horizon, tuning.moves, len(self._own)
        n, p = len(subsystem.states), len(subsystem.outputs)
        free = np.arange(horizon)[:, None] >= np.arange(moves)  # step i acts on stage j >= i
        pick = np.kron(free, np.eye(m))  # (Np m, m Nc)
        self._pick = pick.reshape(horizon, m, m * moves)
        self._weight = np.array([tuning.output_weight[i] for i in subsystem.outputs])  # (p,)
        self._weights = np.tile(self._weight, horizon)[:, None]  # (Np p, 1)
        step_weight = np.array([tuning.step_weight[i] for i in self._own])
        self._step_weight = np.tile(step_weight, moves)  # (m Nc,)
        sums = np.kron(np.tril(np.ones((moves, moves))), np.eye(m))
        self._sums: FloatArray = sums.astype(np.float64)
        self._by_steps = np.zeros((horizon + 1, n, m * moves))  # d state / d steps
        self._jacobian = np.zeros((horizon, p, m * moves))

    def minimise(self, task: Task, steps: FloatArray) -> Plan:
        """Return the plan for `task`; `steps` (m Nc,) is the initial guess."""
        # An estimate far off may overflow along the horizon; the QP's solver then reports it.
        with np.errstate(over="ignore", invalid="ignore"):
            return self._minimise(task, steps)

    def prepare(self) -> None:
        """Minimise the last task again and drop the result, which fills the caches.

        Later results change by the last digits of PIQP's iterates.
        """
        if self._last:
            self.minimise(*self._last)

    def fresh(self) -> GaussNewton:
        """Return the solver as it was before its first call; it shares model and buffers."""
        solver = copy.copy(self)
        solver._qp = PersistentSolver()
        solver._last = None
        return solver

    def _minimise(self, task: Task, steps: FloatArray) -> Plan:
        self._last = task, steps
        self._model.start(task.state, task.disturbance, task.poses)
        cost = self._evaluate(task, steps)
        time_s, iteration = 0.0, 0
        while True:
            iteration += 1
            qp = self._linearised(task, steps)
            solution = self._qp.solve(qp)
            time_s += solution.report.solve_time_s
            report = replace(solution.report, iterations=iteration, solve_time_s=time_s)
            if solution.x is None:
                fallback = f"QP {report.status}: previous feedback held"
                return Plan(None, self._model.errors.copy(), report, fallback)
            change = solution.x - steps
            converged = bool(np.abs(change).max() <= _TOLERANCE)
            if converged or iteration == self._iterations:
                break
            descent = qp.objective(steps) - qp.objective(solution.x)
            trial = self._evaluate(task, steps + change)
            # The first change is not halved: it ends within the bounds wherever the guess lay.
            for _ in range(_HALVINGS if iteration > 1 else 0):
                if cost - trial >= _SUFFICIENT * descent:
                    break
                change, descent = 0.5 * change, 0.5 * descent
                trial = self._evaluate(task, steps + change)
            steps, cost = steps + change, trial
        errors = self._model.errors + self._jacobian @ change  # the last change to first order
        missed = not converged and self._iterations > 1
        fallback = f"not converged in {self._iterations} iterations: last plan driven"
        return Plan(solution.x, errors, report, fallback if missed else "")

    def _evaluate(self, task: Task, steps: FloatArray) -> float:
        """Run the model under `steps` (m Nc,) and return the cost."""
        inputs_e = task.inputs_e.copy()
        inputs_e[:, self._own] = task.previous + self._pick @ steps
        self._model.evaluate(task.feedforward - inputs_e)
        tracking = np.sum(self._weight * np.square(self._model.errors))
        return float(tracking + self._step_weight @ np.square(steps))

    def _linearised(self, task: Task, steps: FloatArray) -> QP:
        """Return the QP in the steps, linearised at the `steps` (m Nc,) last evaluated."""
        model, by_steps = self._model, self._by_steps
        by_input = model.by_input @ self._pick  # (Np, n, m Nc)
        for j, by_state in enumerate(model.by_state):
            np.dot(by_state, by_steps[j], out=by_steps[j + 1])
            by_steps[j + 1] -= by_input[j]  # u = u_r - u_e
        np.matmul(model.error_by_state, by_steps[1:], out=self._jacobian)
        jacobian = self._jacobian.reshape(-1, len(steps))  # (Np p, m Nc)
        weighted = 2.0 * self._weights * jacobian
        hessian = jacobian.T @ weighted
        hessian[np.diag_indices(len(steps))] += 2.0 * self._step_weight
        errors = model.errors.reshape(-1)
        bounds, shift = task.bounds, np.tile(task.previous, len(steps) // len(task.previous))
        return QP(
            hessian=hessian,
            gradient=weighted.T @ (errors - jacobian @ steps),
            matrix=self._sums,
            lower=bounds.lower - shift,
            upper=bounds.upper - shift,
            step_lower=bounds.step_lower,
            step_upper=bounds.step_upper,
        )
