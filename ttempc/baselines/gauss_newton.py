"""Gauss-Newton iterations for the problems of the nonlinear MPCs, compiled."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from ..jit import FAST, cached_njit, record
from ..mpc.condensing import StageBounds
from ..mpc.lmpc import HorizonTuning
from ..mpc.qp import (
    CLOSED_FORM_REPORT,
    QP,
    CheckedSolver,
    factorise,
    is_within,
    minimise_unconstrained,
)
from ..types import FloatArray, Input, SolverReport
from .nmpc_model import PRINTED, Model, Task, articulated_horizon, condense
from .printed_model import printed_horizon

# A plan is converged where the last iteration changed no input of it by more than this, in rad or
# hydrostat position. Changes shrink tenfold or more near the solution: the rest is below a tenth.
TOLERANCE: Final = 1e-4
_HALVINGS: Final = 6
_SUFFICIENT: Final = 0.25  # least actual descent over the QP's, below which a change is halved
_M: Final = len(Input)

DONE: Final = -1
"""All blocks have a plan."""

PROGRESS: Final = np.dtype(
    [
        ("iteration", "f8"),  # QPs solved in this tick
        ("halvings", "f8"),  # of the last change
        ("cost", "f8"),  # at the last accepted steps
        ("descent", "f8"),  # of the QP there, as far as the change is not halved
        ("converged", "f8"),  # 1 where the plan is converged
    ]
)
"""Progress of the iterations of a block."""


class Problem(NamedTuple):
    """Settings of a block's problem and the arrays in which it is solved: q = m Nc steps."""

    model: Model
    weight: FloatArray  # of the outputs at every tick (ticks, p); the last row holds for later ones
    step_weight: FloatArray  # (q,)
    damping: float  # tau of y + tau y' for the cross-track errors y, in periods
    most: int  # iterations
    tolerance: float  # see `TOLERANCE`
    bounds: FloatArray  # lower and upper ones on inputs, then on their steps, (ticks, 4, q)
    progress: FloatArray  # record `PROGRESS`
    limits: FloatArray  # the same for the steps: inputs less the previous ones, (4, q)
    vectors: FloatArray  # accepted steps, steps at present, solution and gradient of the QP, (4, q)
    hessian: FloatArray  # of the QP (q, q)


_ACCEPTED: Final = 0  # rows of `Problem.vectors`
_STEPS: Final = 1
_SOLUTION: Final = 2
_GRADIENT: Final = 3
_LOWER: Final = 0  # rows of `Problem.bounds` and `Problem.limits`
_UPPER: Final = 1
_STEP_LOWER: Final = 2
_STEP_UPPER: Final = 3


class Plan(NamedTuple):
    """Solution of one tick."""

    inputs: FloatArray  # (3,) first u_e, within its bounds
    steps: FloatArray  # (Nc, 3) Delta u_e; 0 where a QP has no accepted solution
    errors: FloatArray  # (Np, p) position errors under the steps [m]


@cached_njit(error_model="numpy", boundscheck=False)
def solve_blocks(
    first: Problem, second: Problem | None, task: Task, block: int, solved: bool, plan: Plan
) -> int:
    """Minimise the problems of both blocks, each as `iterate`, and write their parts of the plan.

    Returns the block whose QP needs the solver, `DONE` where none does. The call goes on at that
    `block`, with `solved` once its solution is in place, or at the next one.
    """
    if block == 0:
        if not solved:
            begin(task, first)
        if not iterate(task, first, solved, plan):
            return 0
    if second is not None:
        resumed = solved and block == 1
        if not resumed:
            begin(task, second)
        if not iterate(task, second, resumed, plan):
            return 1
    return DONE


@cached_njit(error_model="numpy", boundscheck=False)
def begin(task: Task, problem: Problem) -> None:
    """Write limits and initial guess of a block, the last plan shifted.

    Previous inputs from which no step leads into the bounds are moved to the nearest ones: the QP
    is infeasible there.
    """
    own = problem.model.block.inputs
    bounds = problem.bounds[task.k]
    limits = problem.limits
    steps = problem.vectors[_STEPS]
    previous = task.previous
    m = own.size
    for o in range(m):
        low = bounds[_LOWER, o] - bounds[_STEP_UPPER, o]
        high = bounds[_UPPER, o] - bounds[_STEP_LOWER, o]
        previous[own[o]] = min(max(previous[own[o]], low), high)
    for c in range(steps.size):
        which = own[c % m]
        limits[_LOWER, c] = bounds[_LOWER, c] - previous[which]
        limits[_UPPER, c] = bounds[_UPPER, c] - previous[which]
        limits[_STEP_LOWER, c] = bounds[_STEP_LOWER, c]
        limits[_STEP_UPPER, c] = bounds[_STEP_UPPER, c]
        later = c // m + 1
        steps[c] = task.last_plan[later, which] if later < len(task.last_plan) else 0.0
    for i in range(problem.progress.size):
        problem.progress[i] = 0.0


@cached_njit(error_model="numpy", boundscheck=False)
def iterate(task: Task, problem: Problem, solved: bool, plan: Plan) -> bool:
    """Linearise and solve until the plan of a block is converged; whether it has an end.

    Else a bound is active in the QP: the call goes on with `solved` once its solution is in place.
    The plan is the last solution; `PROGRESS.converged` says whether it is converged.
    """
    p = record(problem.progress, PROGRESS)
    steps = problem.vectors[_STEPS]
    solution = problem.vectors[_SOLUTION]
    accepted = problem.vectors[_ACCEPTED]
    gradient = problem.vectors[_GRADIENT]
    size = steps.size
    errors = np.empty((len(task.poses), problem.weight.shape[1]))
    jacobian = np.empty((len(task.poses), problem.weight.shape[1], size))
    weight = np.empty((len(task.poses), problem.weight.shape[1]))
    for j in range(len(weight)):
        weight[j] = problem.weight[min(task.k + 1 + j, len(problem.weight) - 1)]
    if solved:
        evaluate(task, problem, errors, jacobian)
    while True:
        if not solved:
            evaluate(task, problem, errors, jacobian)
            cost = condense(
                errors,
                jacobian,
                weight,
                problem.step_weight,
                problem.damping,
                steps,
                problem.hessian,
                gradient,
            )
            # The first change is not halved: it ends within the bounds wherever the guess lay.
            short = p.cost - cost < _SUFFICIENT * p.descent  # Armijo
            if p.iteration > 1.0 and short and p.halvings < _HALVINGS:
                for i in range(size):
                    steps[i] = accepted[i] + 0.5 * (steps[i] - accepted[i])
                p.descent *= 0.5
                p.halvings += 1.0
                continue
            p.cost = cost
            p.halvings = 0.0
            if not solve_without_bounds(problem):
                return False
        solved = False
        p.iteration += 1.0
        largest = 0.0
        for i in range(size):
            largest = max(largest, abs(solution[i] - steps[i]))
        p.converged = 1.0 if largest <= problem.tolerance else 0.0
        if p.converged == 1.0 or p.iteration >= problem.most:
            write_plan(task, problem, errors, jacobian, plan)
            return True
        p.descent = objective(problem, steps) - objective(problem, solution)
        for i in range(size):
            accepted[i] = steps[i]
            steps[i] = solution[i]


@cached_njit(error_model="numpy", boundscheck=False)
def evaluate(task: Task, problem: Problem, errors: FloatArray, jacobian: FloatArray) -> None:
    """Write errors (Np, p) and derivatives (Np, p, q) of a block at its present steps."""
    steps = problem.vectors[_STEPS]
    if problem.model.kind == PRINTED:
        printed_horizon(problem.model, task, steps, errors, jacobian)
    else:
        articulated_horizon(problem.model, task, steps, errors, jacobian)


@cached_njit(error_model="numpy", boundscheck=False)
def solve_without_bounds(problem: Problem) -> bool:
    """Write the unconstrained minimiser of the QP; whether it is within all bounds."""
    size = problem.hessian.shape[0]
    m = problem.model.block.inputs.size
    solution = problem.vectors[_SOLUTION]
    limits = problem.limits
    factor = np.empty((size, size))
    if not factorise(problem.hessian, factor):
        return False
    if not minimise_unconstrained(factor, problem.vectors[_GRADIENT], solution):
        return False
    if not is_within(limits[_STEP_LOWER], limits[_STEP_UPPER], solution):
        return False
    inputs = solution.copy()  # less the previous ones
    for c in range(m, size):
        inputs[c] += inputs[c - m]
    return is_within(limits[_LOWER], limits[_UPPER], inputs)


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST)
def objective(problem: Problem, x: FloatArray) -> float:
    """Return the cost of the QP at `x` (q,)."""
    gradient = problem.vectors[_GRADIENT]
    total = 0.0
    for i in range(x.size):
        total += gradient[i] * x[i]
        for j in range(x.size):
            total += 0.5 * x[i] * problem.hessian[i, j] * x[j]
    return total


@cached_njit(error_model="numpy", boundscheck=False)
def write_plan(
    task: Task, problem: Problem, errors: FloatArray, jacobian: FloatArray, plan: Plan
) -> None:
    """Write a block's part of the plan: the last solution, and its errors to first order."""
    own = problem.model.block.inputs
    placed = problem.model.block.outputs
    bounds = problem.bounds[task.k]
    steps = problem.vectors[_STEPS]
    solution = problem.vectors[_SOLUTION]
    for o in range(own.size):
        wanted = task.previous[own[o]] + solution[o]
        plan.inputs[own[o]] = min(max(wanted, bounds[_LOWER, o]), bounds[_UPPER, o])
    for c in range(solution.size):
        plan.steps[c // own.size, own[c % own.size]] = solution[c]
    for j in range(len(errors)):
        for output in range(placed.size):
            total = errors[j, output]
            for c in range(solution.size):
                total += jacobian[j, output, c] * (solution[c] - steps[c])
            plan.errors[j, placed[output]] = total


class GaussNewton:
    """Minimiser of the linear MPC's cost within its bounds, under a nonlinear model.

    The unknowns are the steps of u_e = u_r - u of the inputs of a block, as in
    `ttempc.mpc.lmpc.CondensedHorizon`:

        min sum_j y_j' Q y_j + sum Delta u' R Delta u,    y_j = y_j(z_k, u_{k-1}, Delta U),

    where y_j are the position errors of the nonlinear model (single shooting: a plan is feasible
    where its steps are within linear bounds). Every iteration linearises y_j at the present plan,
    accumulates its derivatives from stage to stage and solves the resulting QP: its unconstrained
    minimiser where that is within all bounds, else by the solver. Converged plans are stationary
    points of the nonlinear problem. With one iteration it is a real-time iteration
    (Diehl, Bock and Schloeder 2005, SIAM J. Control Optim. 43), which need not converge in a tick.

    Args:
        models: of one block or two, which together decide all inputs, in the order in which they
            are solved. A trailer after its tractor knows how that will move.
        bounds: on all inputs at every tick, (ticks, 3 Nc) each.
        tuning: horizon, weights and solver.
        iterations: of each block in a tick, at most.
        damping: tau of y + tau y' for the cross-track errors y, in periods.
        tolerance: largest change of a converged plan.
        weight_factors: of the weights of all outputs at every tick (ticks, p); without them 1.

    Raises:
        MissingPackage: the package of the tuning's solver is not installed.
    """

    def __init__(
        self,
        models: tuple[Model, ...],
        bounds: StageBounds,
        tuning: HorizonTuning,
        iterations: int,
        damping: float = 0.0,
        tolerance: float = TOLERANCE,
        weight_factors: FloatArray | None = None,
    ) -> None:
        self.report = CLOSED_FORM_REPORT  # of the last tick
        self.fallback = ""  # why its steps are not the minimiser; empty where they are
        factors = np.ones((1, len(tuning.output_weight)))
        if weight_factors is not None:
            factors = weight_factors
        problems = [
            new_problem(model, bounds, tuning, iterations, damping, factors)._replace(
                tolerance=tolerance
            )
            for model in models
        ]
        self.first = problems[0]
        self.second = problems[1] if len(problems) > 1 else None
        self.problems = problems
        # A solver is updated where the rows are the same array.
        self._sums = [_sums(problem) for problem in problems]
        self._solvers = [CheckedSolver(tuning.solver) for _ in models]
        outputs = sum(len(model.block.outputs) for model in models)
        self._shapes = (_M,), (tuning.moves, _M), (tuning.horizon, outputs)
        self._last: Task | None = None

    def new_plan(self) -> Plan:
        """Return a plan of zeros."""
        return Plan(*(np.zeros(shape) for shape in self._shapes))

    def prepare(self) -> None:
        """Solve the last task again and drop the result, which fills the caches."""
        if self._last is not None:
            task = self._last
            task = task._replace(motion=task.motion.copy(), previous=task.previous.copy())
            solve_blocks(self.first, self.second, task, 0, False, self.new_plan())

    def minimise(self, task: Task) -> Plan:
        """Return the plan for `task`.

        Where a QP has no accepted solution, the block's previous inputs are held.
        """
        self._last = task
        plan = self.new_plan()
        blocks = self.first, self.second
        reports: list[SolverReport] = []
        fallbacks: list[str] = []
        block = solve_blocks(*blocks, task, 0, False, plan)
        while block != DONE:
            problem = self.problems[block]
            solution = self._solvers[block].solve(_qp(problem, self._sums[block]))
            reports.append(solution.report)
            if solution.x is None:
                # An estimate far off may overflow along the horizon.
                fallbacks.append(f"QP {solution.report.status}: previous feedback held")
                own = problem.model.block.inputs
                plan.inputs[own] = task.previous[own]
                if block == len(self.problems) - 1:
                    break
                block = solve_blocks(*blocks, task, block + 1, False, plan)
                continue
            problem.vectors[_SOLUTION] = solution.x
            block = solve_blocks(*blocks, task, block, True, plan)
        iterations = 0
        for problem in self.problems:
            iteration, _, _, _, converged = problem.progress.tolist()
            iterations += int(iteration)
            if problem.most == iteration > 1 and not converged:
                fallbacks.append(f"not converged in {problem.most} iterations: last plan driven")
        self.fallback = "; ".join(fallbacks)
        self.report = _joined(reports, iterations)
        return plan


def _sums(problem: Problem) -> FloatArray:
    """Return the matrix from the steps of a block to its inputs, (q, q)."""
    m = len(problem.model.block.inputs)
    moves = len(problem.hessian) // m
    return np.kron(np.tril(np.ones((moves, moves))), np.eye(m)).astype(np.float64)


def _qp(problem: Problem, sums: FloatArray) -> QP:
    """Return the QP at the present steps of a block."""
    return QP(
        hessian=problem.hessian,
        gradient=problem.vectors[_GRADIENT],
        matrix=sums,
        row_lower=problem.limits[_LOWER],
        row_upper=problem.limits[_UPPER],
        lower=problem.limits[_STEP_LOWER],
        upper=problem.limits[_STEP_UPPER],
    )


def new_problem(
    model: Model,
    bounds: StageBounds,
    tuning: HorizonTuning,
    iterations: int,
    damping: float,
    weight_factors: FloatArray,
) -> Problem:
    """Return settings and arrays for the block of a model; arguments as of `GaussNewton`."""
    inputs = model.block.inputs
    moves = tuning.moves
    size = moves * len(inputs)
    columns = (_M * np.arange(moves)[:, None] + inputs).ravel()
    return Problem(
        model=model,
        weight=(weight_factors * np.array(tuning.output_weight))[:, model.block.outputs],
        step_weight=np.tile(np.array(tuning.step_weight)[inputs], moves),
        damping=damping,
        most=iterations,
        tolerance=TOLERANCE,
        bounds=np.stack([values[:, columns] for values in bounds], axis=1),
        progress=np.zeros(PROGRESS.itemsize // 8),
        limits=np.zeros((4, size)),
        vectors=np.zeros((4, size)),
        hessian=np.zeros((size, size)),
    )


def _joined(reports: list[SolverReport], iterations: int) -> SolverReport:
    """Return the report of a tick, with the status of the first QP that failed."""
    if not reports:
        return SolverReport(CLOSED_FORM_REPORT.status, True, iterations, 0.0, 0.0, 0.0)
    worst = next((report for report in reports if not report.accepted), reports[0])
    return SolverReport(
        worst.status,
        worst.accepted,
        iterations,
        solve_time_s=sum([report.solve_time_s for report in reports]),
        primal_residual=max([report.primal_residual for report in reports]),
        dual_residual=max([report.dual_residual for report in reports]),
    )
