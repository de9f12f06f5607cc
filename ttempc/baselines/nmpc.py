"""Nonlinear MPC on the articulated model: `nmpc` and `nmpc-rti`.

Horizon, bounds and information are those of the linear MPC, the weights are tuned as its are.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..errors import check_choice, check_count
from ..laws.options import MpcOptions
from ..laws.tracking_controller import ExactCourse, FeedbackLaw, TrackingController
from ..mpc.articulated_error import PredictedPath, error_state, map_gains, remaining_bounds
from ..mpc.lmpc import HorizonTuning, Solver, move_bounds
from ..mpc.qp import QP, CheckedSolver
from ..reference.reference import GUIDED, Guided, Reference, guided
from ..types import Diagnostics, Estimate, FloatArray, Input, SolverReport, State
from ..vehicle import Vehicle
from .nmpc_model import (
    ArticulatedModel,
    Task,
    condense,
)

# A plan is converged where the last iteration changed no input of it by more than this, in rad or
# hydrostat position. Changes shrink tenfold or more near the solution: the rest is below a tenth.
_TOLERANCE = 1e-4
_M = len(Input)
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


class GaussNewton:
    """Minimiser of the linear MPC's cost within its bounds, under the nonlinear model.

    The unknowns are the steps of u_e = u_r - u, as in `ttempc.mpc.lmpc.CondensedHorizon`:

        min sum_j y_j' Q y_j + sum Delta u' R Delta u,    y_j = y_j(z_k, u_{k-1}, Delta U),

    where y_j are the position errors of the nonlinear model (single shooting: a plan is feasible
    where its steps are within linear bounds). Every iteration linearises y_j at the present plan,
    accumulates its derivatives from stage to stage and solves the resulting QP. Converged plans
    are stationary points of the nonlinear problem. With one iteration it is a real-time iteration
    (Diehl, Bock and Schloeder 2005, SIAM J. Control Optim. 43), which need not converge in a tick.

    Raises:
        MissingPackage: the package of the tuning's solver is not installed.
    """

    def __init__(
        self,
        model: ArticulatedModel,  # or one of its shape
        tuning: HorizonTuning,
        iterations: int,
        damping: float = 0.0,  # tau of y + tau y' for the cross-track errors y, in periods
    ) -> None:
        self._model, self._qp = model, CheckedSolver(tuning.solver)
        # `prepare` has a solver of its own: a solve changes the last digits of later results.
        self._preparing_qp = CheckedSolver(tuning.solver)
        self._iterations = iterations
        self._last: tuple[Task, FloatArray] | None = None
        self._damping = damping
        moves = tuning.moves
        self._weight = np.array(tuning.output_weight)  # (p,)
        self._step_weight = np.tile(tuning.step_weight, moves)  # (m Nc,)
        sums = np.kron(np.tril(np.ones((moves, moves))), np.eye(_M))
        self._sums: FloatArray = sums.astype(np.float64)
        shape = tuning.horizon, len(self._weight)
        self._errors, self._jacobian = np.empty(shape), np.empty((*shape, len(sums)))

    def prepare(self) -> None:
        """Minimise the last task again and drop the result, which fills the caches."""
        if self._last:
            self._minimise(self._preparing_qp, *self._last)

    def minimise(self, task: Task, steps: FloatArray) -> Plan:
        """Return the plan for `task`; `steps` (m Nc,) is the initial guess."""
        self._last = task, steps
        return self._minimise(self._qp, task, steps)

    def _minimise(self, solver: CheckedSolver, task: Task, steps: FloatArray) -> Plan:
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

    def _damped(self, outputs: FloatArray) -> FloatArray:
        """Return y + tau y' in the place of the cross-track errors y (Np, p, ...)."""
        if not self._damping:
            return outputs
        result, across = outputs.copy(), outputs[:, 1::2]
        rate = self._damping * np.diff(across, axis=0)
        result[:-1, 1::2] += rate
        result[-1, 1::2] += rate[-1]
        return result

    def _linearise(self, task: Task, steps: FloatArray) -> tuple[float, QP]:
        """Return the cost under `steps` (m Nc,), and the QP that is linearised there."""
        self._model.evaluate(task, steps, self._errors, self._jacobian)
        gradient, hessian = np.empty_like(steps), np.empty_like(self._sums)
        weighted = self._damped(self._errors), self._damped(self._jacobian)
        cost = condense(*weighted, self._weight, self._step_weight, steps, hessian, gradient)
        held = np.tile(task.previous, len(steps) // len(task.previous))
        return cost, QP(
            hessian=hessian,
            gradient=gradient,
            matrix=self._sums,
            row_lower=task.bounds.lower - held,
            row_upper=task.bounds.upper - held,
            lower=task.bounds.step_lower,
            upper=task.bounds.step_upper,
        )


_BODY_FIXED, _MAP_FIXED = slice(7, 12), slice(12, 16)  # disturbances in `error_state`


@dataclass(frozen=True)
class NmpcRtiOptions(MpcOptions):
    """Options of `nmpc-rti`."""

    # The best of 46 sets on the benchmark's trials, on tuning seeds
    output_weight: tuple[float, ...] = (1.0, 1.0, 1.0, 3.9)
    step_weight: tuple[float, ...] = (0.08, 0.045, 0.25)
    damping_s: float = 0.6
    solver: Solver = "daqp"  # of the QP: the faster one, or "piqp"
    guided: Guided = "tool"  # the point behind that keeps to its line; without a tool the axle

    def __post_init__(self) -> None:
        MpcOptions.__post_init__(self)
        check_choice("guided", self.guided, GUIDED)


@dataclass(frozen=True)
class NmpcOptions(NmpcRtiOptions):
    """Options of `nmpc`."""

    iterations: int = ITERATIONS  # Gauss-Newton iterations a period, at most

    def __post_init__(self) -> None:
        NmpcRtiOptions.__post_init__(self)
        check_count("iterations", self.iterations)


class NonlinearFeedback(FeedbackLaw):
    """Receding horizon of an NMPC, which starts from its plan of the previous tick, shifted.

    Where a QP has no accepted solution, the previous input is held; where the NMPC does not
    converge, its last plan is applied. `Diagnostics.fallback` reports both.
    """

    def __init__(self, course: ExactCourse, tuning: MpcOptions, iterations: int) -> None:
        self._course, self._tuning = course, tuning
        grid, vehicle, period_s = course.grid, course.vehicle, course.period_s
        self._poses = np.hstack(
            [grid.state[:, :3], grid.trailer_xy, grid.state[:, State.PSI_I, None]]
        )  # (N + 1, 6)
        ticks = len(course.feedforward)
        middle = course.reference.at((np.arange(ticks) + 0.5) * period_s)
        self._map_gains = map_gains(middle, vehicle)  # (N, 5, 4)
        remaining = remaining_bounds(course.feedforward, course.limits)
        self._bounds = move_bounds(tuning, period_s, ticks, remaining)
        model, damping = ArticulatedModel(vehicle, period_s), tuning.damping_s / period_s
        self._solver = GaussNewton(model, tuning, iterations, damping)
        self._path = PredictedPath(grid)
        self._steps = np.zeros((tuning.moves, _M))  # the last plan, Delta u_e

    def resume(self, previous: object) -> None:
        """Keep the last plan as the first guess, see `ttempc.types.Resuming`."""
        if isinstance(previous, NonlinearFeedback):
            self._steps = previous._steps

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Diagnostics:
        horizon, course, bounds = self._tuning.horizon, self._course, self._bounds.at(k)
        previous = course.feedforward[max(k - 1, 0)] - sent  # u_e(k-1)
        error = error_state(course.grid.state[k], estimate, course.vehicle)
        map_fixed = self._map_gains[k : k + horizon] @ error[_MAP_FIXED]
        task = Task(
            state=estimate.state,
            disturbance=error[_BODY_FIXED] + map_fixed,
            poses=self._poses[k + 1 : k + 1 + horizon],
            feedforward=course.feedforward[k : k + horizon],
            previous=bounds.clamp_previous(previous),
            bounds=bounds,
        )
        guess = np.vstack([self._steps[1:], np.zeros(_M)])
        plan = self._solver.minimise(task, guess.reshape(-1))
        self._steps = np.zeros_like(guess) if plan.steps is None else plan.steps.reshape(-1, _M)
        return Diagnostics(
            feedback=-bounds.clamp(task.previous + self._steps[0]),
            robust=np.zeros(_M),
            predicted_path=self._path.less(k, plan.errors),
            solver=plan.report,
            fallback=plan.fallback,
        )

    def prepare(self, k: int) -> None:
        self._solver.prepare()


def nmpc_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    options: NmpcRtiOptions = NmpcOptions(),
) -> TrackingController:
    """Compose the exact feedforward and the NMPC; `NmpcRtiOptions` ask for one iteration a period.

    Raises:
        MissingPackage: the package of the QP solver is not installed.
    """
    reference = guided(reference, options.guided)
    iterations = getattr(options, "iterations", 1)
    tuning = options.for_vehicle(vehicle, reference.speed.top_speed, period_s)

    course = ExactCourse(reference, period_s, tuning.horizon)
    return course.controller(NonlinearFeedback(course, tuning, iterations))
