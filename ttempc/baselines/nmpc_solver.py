"""Gauss-Newton method over a horizon, with a small QP in each iteration."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ..mpc.qp import QP, HorizonTuning
from ..mpc.solver import PersistentSolver
from ..reference.reference import Reference
from ..types import FloatArray, SolverReport
from .nmpc_model import ArticulatedModel
from .nmpc_problem import HorizonModel, Subsystem, Task, condense

# A plan is converged where the last iteration changed no input of it by more than this, in rad or
# hydrostat position. Changes shrink tenfold or more near the solution: the rest is below a tenth.
_TOLERANCE = 1e-4
ITERATIONS = 20  # at most; 2 to 3 are usual
_HALVINGS = 6
_SUFFICIENT = 0.25  # least actual descent over the QP's, below which a change is halved (Armijo)


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
        """Get ready for the next call, which gives the same plan."""
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
        model: by default the articulated one of the reference's vehicle.

    Raises:
        MissingPackage: the package of the tuning's solver is not installed.
    """

    def __init__(
        self,
        reference: Reference,
        subsystem: Subsystem,
        tuning: HorizonTuning,
        period_s: float,
        iterations: int = ITERATIONS,
        model: HorizonModel | None = None,
    ) -> None:
        self._model = model or ArticulatedModel(reference.vehicle, subsystem, period_s)
        self._qp = PersistentSolver(tuning.solver)
        # `prepare` has a solver of its own: a solve changes the last digits of later results.
        self._preparing_qp = self._qp.fresh()
        self._iterations = iterations
        self._last: tuple[Task, FloatArray] | None = None
        own, moves = list(subsystem.inputs), tuning.moves
        self._weight = np.array([tuning.output_weight[i] for i in subsystem.outputs])  # (p,)
        self._step_weight = np.tile([tuning.step_weight[i] for i in own], moves)  # (m Nc,)
        sums = np.kron(np.tril(np.ones((moves, moves))), np.eye(len(own)))
        self._sums: FloatArray = sums.astype(np.float64)
        shape = tuning.horizon, len(self._weight)
        self._errors, self._jacobian = np.empty(shape), np.empty((*shape, len(sums)))

    def prepare(self) -> None:
        """Minimise the last task again and drop the result, which fills the caches."""
        if self._last:
            self._minimise(self._preparing_qp, *self._last)

    def fresh(self) -> GaussNewton:
        """Return the solver as it was before its first call; it shares model and buffers."""
        solver = copy.copy(self)
        solver._qp, solver._preparing_qp = self._qp.fresh(), self._qp.fresh()
        solver._last = None
        return solver

    def minimise(self, task: Task, steps: FloatArray) -> Plan:
        """Return the plan for `task`; `steps` (m Nc,) is the initial guess."""
        self._last = task, steps
        return self._minimise(self._qp, task, steps)

    def _minimise(self, solver: PersistentSolver, task: Task, steps: FloatArray) -> Plan:
        cost, qp = self._linearise(task, steps)
        time_s, iteration = 0.0, 0
        while True:
            iteration += 1
            solution = solver.solve(qp)
            time_s += solution.report.solve_time_s
            report = replace(solution.report, iterations=iteration, solve_time_s=time_s)
            if solution.x is None:
                # An estimate far off may overflow along the horizon.
                fallback = f"QP {report.status}: previous feedback held"
                return Plan(None, self._errors.copy(), report, fallback)
            change = solution.x - steps
            converged = bool(np.abs(change).max() <= _TOLERANCE)
            if converged or iteration == self._iterations:
                break
            descent = qp.objective(steps) - qp.objective(solution.x)
            trial, qp = self._linearise(task, steps + change)
            # The first change is not halved: it ends within the bounds wherever the guess lay.
            for _ in range(_HALVINGS if iteration > 1 else 0):
                if cost - trial >= _SUFFICIENT * descent:
                    break
                change, descent = 0.5 * change, 0.5 * descent
                trial, qp = self._linearise(task, steps + change)
            steps, cost = steps + change, trial
        errors = self._errors + self._jacobian @ change  # the last change to first order
        missed = not converged and self._iterations > 1
        fallback = f"not converged in {self._iterations} iterations: last plan driven"
        return Plan(solution.x, errors, report, fallback if missed else "")

    def _linearise(self, task: Task, steps: FloatArray) -> tuple[float, QP]:
        """Return the cost under `steps` (m Nc,), and the QP that is linearised there."""
        self._model.evaluate(task, steps, self._errors, self._jacobian)
        gradient, hessian = np.empty_like(steps), np.empty_like(self._sums)
        cost = condense(
            self._errors,
            self._jacobian,
            self._weight,
            self._step_weight,
            steps,
            hessian,
            gradient,
        )
        bounds, repeats = task.bounds, len(steps) // len(task.previous)
        shift = np.concatenate([task.previous] * repeats)
        qp = QP(
            hessian=hessian,
            gradient=gradient,
            matrix=self._sums,
            lower=bounds.lower - shift,
            upper=bounds.upper - shift,
            step_lower=bounds.step_lower,
            step_upper=bounds.step_upper,
        )
        return cost, qp
