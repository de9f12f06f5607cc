"""Nonlinear MPC on the articulated model: `nmpc` and its variants.

Horizon, bounds and information are those of the linear MPC, the weights are tuned as its are.
Centralised, decentralised and distributed after Kayacan, Peschel and Kayacan (2016), "Centralized,
decentralized and distributed nonlinear model predictive control of a tractor-trailer system: a
comparative study", American Control Conference, pp. 4403-4408.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..errors import check_choice, check_count
from ..laws.articulated_mpc import MpcOptions
from ..laws.tracking_controller import ExactCourse, FeedbackLaw, TrackingController
from ..mpc.articulated_error import PredictedPath, error_state, map_gains, remaining_bounds
from ..mpc.lmpc import QP, HorizonTuning, Solver, StageBounds, move_bounds
from ..mpc.qp import PersistentSolver
from ..reference.reference import GUIDED, Guided, Reference, guided
from ..types import Diagnostics, Estimate, FloatArray, Input, SolverReport, State
from ..vehicle import Vehicle
from .nmpc_model import (
    TRACTOR,
    TRAILER,
    WHOLE,
    ArticulatedModel,
    Subsystem,
    Task,
    condense,
)

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


class GaussNewton:
    """Minimiser of the linear MPC's cost within its bounds, under the nonlinear model.

    The unknowns are the steps of u_e = u_r - u of one subsystem, as in
    `ttempc.mpc.lmpc.CondensedHorizon`:

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
        subsystem: Subsystem,
        tuning: HorizonTuning,
        iterations: int,
        damping: float = 0.0,  # tau of y + tau y' for the cross-track errors y, in periods
    ) -> None:
        self._model, self._qp = model, PersistentSolver(tuning.solver)
        # `prepare` has a solver of its own: a solve changes the last digits of later results.
        self._preparing_qp = PersistentSolver(tuning.solver)
        self._iterations = iterations
        self._last: tuple[Task, FloatArray] | None = None
        self._damping = damping
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
        limits = task.bounds.limits
        limits[:, : len(steps)] -= np.tile(task.previous, len(steps) // len(task.previous))
        return cost, QP(hessian, gradient, self._sums, limits)


_M = len(Input)
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
    """Options of `nmpc`, `nmpc-decentralised` and `nmpc-distributed`."""

    iterations: int = ITERATIONS  # Gauss-Newton iterations a period, at most

    def __post_init__(self) -> None:
        NmpcRtiOptions.__post_init__(self)
        check_count("iterations", self.iterations)


class NonlinearFeedback(FeedbackLaw):
    """Receding horizons of one NMPC or of several that share the vehicle.

    Each NMPC starts from its own plan of the previous tick, shifted. The inputs of the others enter
    as they plan them (`exchange`: the plans of the previous tick, shifted), or held as they were
    last sent.

    Where a QP has no accepted solution, the previous input is held; where an NMPC does not
    converge, its last plan is applied. `Diagnostics.fallback` reports both.
    """

    def __init__(
        self,
        course: ExactCourse,
        tuning: MpcOptions,
        subsystems: Sequence[Subsystem],
        *,
        exchange: bool,
        iterations: int,
    ) -> None:
        self._course, self._tuning, self._exchange = course, tuning, exchange
        grid, vehicle, period_s = course.grid, course.vehicle, course.period_s
        self._poses = np.hstack(
            [grid.state[:, :3], grid.trailer_xy, grid.state[:, State.PSI_I, None]]
        )  # (N + 1, 6)
        ticks = len(course.feedforward)
        middle = course.reference.at((np.arange(ticks) + 0.5) * period_s)
        self._map_gains = map_gains(middle, vehicle)  # (N, 5, 4)
        remaining = remaining_bounds(course.feedforward, course.limits)
        bounds = move_bounds(tuning, period_s, ticks, remaining)
        self._parts = [
            _Part(
                np.array(subsystem.inputs),
                np.array(subsystem.outputs),
                GaussNewton(model, subsystem, tuning, iterations, tuning.damping_s / period_s),
                bounds.at(slice(None), _columns(subsystem, tuning.moves)),
            )
            for subsystem in subsystems
            for model in [ArticulatedModel(vehicle, subsystem, period_s)]
        ]
        self._path = PredictedPath(grid)
        self._steps = np.zeros((tuning.moves, _M))  # the last plan, Delta u_e

    def resume(self, previous: object) -> None:
        """Keep the last plan as the first guess, see `ttempc.types.Resuming`."""
        if isinstance(previous, NonlinearFeedback):
            self._steps = previous._steps

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Diagnostics:
        horizon, moves, course = self._tuning.horizon, self._tuning.moves, self._course
        feedforward = course.feedforward[k : k + horizon]
        ends = slice(k + 1, k + 1 + horizon)
        previous = course.feedforward[max(k - 1, 0)] - sent  # u_e(k-1)
        guess = np.vstack([self._steps[1:], np.zeros(_M)])
        if self._exchange:
            planned = previous + np.cumsum(guess, axis=0)  # (Nc, 3)
            inputs_e = planned[np.minimum(np.arange(horizon), moves - 1)]
        else:
            inputs_e = feedforward - sent  # u = u_r - u_e stays as it is
        error = error_state(course.grid.state[k], estimate, course.vehicle)
        map_fixed = self._map_gains[k : k + horizon] @ error[_MAP_FIXED]
        disturbance = error[_BODY_FIXED] + map_fixed  # (Np, 5)
        feedback, steps = previous.copy(), np.zeros_like(guess)
        errors = np.zeros((horizon, 4))
        plans = []
        for part in self._parts:
            own, bounds = part.inputs, part.bounds.at(k)
            task = Task(
                state=estimate.state,
                disturbance=disturbance,
                poses=self._poses[ends],
                feedforward=feedforward,
                inputs_e=inputs_e,
                previous=bounds.clamp_previous(previous[own]),
                bounds=bounds,
            )
            plan = part.solver.minimise(task, guess[:, own].reshape(-1))
            plans.append(plan)
            errors[:, part.outputs] = plan.errors
            if plan.steps is not None:
                steps[:, own] = plan.steps.reshape(moves, -1)
            feedback[own] = bounds.clamp(task.previous + steps[0, own])
        self._steps = steps
        return Diagnostics(
            feedback=-feedback,
            robust=np.zeros(_M),
            predicted_path=self._path.less(k, errors),
            solver=_joined([plan.report for plan in plans]),
            fallback="; ".join(plan.fallback for plan in plans if plan.fallback),
        )

    def prepare(self, k: int) -> None:
        for part in self._parts:
            part.solver.prepare()


@dataclass(frozen=True, slots=True)
class _Part:
    """One NMPC of those that share the vehicle."""

    inputs: NDArray[np.intp]  # of `Subsystem`
    outputs: NDArray[np.intp]
    solver: GaussNewton
    bounds: StageBounds  # of its own inputs at every tick, (ticks, m Nc)


def _columns(subsystem: Subsystem, moves: int) -> NDArray[np.intp]:
    """Return the columns of the subsystem's own inputs in the steps of all inputs, (m Nc,)."""
    return (_M * np.arange(moves)[:, None] + np.array(subsystem.inputs)).reshape(-1)


def _joined(reports: Sequence[SolverReport]) -> SolverReport:
    if len(reports) == 1:
        return reports[0]
    worst = next((report for report in reports if not report.accepted), reports[0])
    return replace(
        worst,
        iterations=sum(report.iterations for report in reports),
        solve_time_s=sum(report.solve_time_s for report in reports),
        primal_residual=max(report.primal_residual for report in reports),
        dual_residual=max(report.dual_residual for report in reports),
    )


def nmpc_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    options: NmpcRtiOptions = NmpcOptions(),
    subsystems: Sequence[Subsystem] = (WHOLE,),
    *,
    exchange: bool = False,
) -> TrackingController:
    """Compose the exact feedforward and the NMPCs of `subsystems`.

    `NmpcRtiOptions` ask for one iteration a period.

    Raises:
        MissingPackage: the package of the QP solver is not installed.
    """
    reference = guided(reference, options.guided)
    iterations = getattr(options, "iterations", 1)
    tuning = options.for_vehicle(vehicle, reference.speed.top_speed, period_s)

    course = ExactCourse(reference, period_s, tuning.horizon)
    law = NonlinearFeedback(course, tuning, subsystems, exchange=exchange, iterations=iterations)
    return course.controller(law)


nmpc_decentralised_controller = partial(nmpc_controller, subsystems=(TRACTOR, TRAILER))
nmpc_distributed_controller = partial(nmpc_decentralised_controller, exchange=True)
