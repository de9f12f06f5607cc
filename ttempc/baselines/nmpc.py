"""Nonlinear MPC on the articulated model, of the whole vehicle or of a problem for each body.

Horizon, bounds and information are those of the linear MPC, the weights are tuned as its are.
Centralised, decentralised and distributed after Kayacan, Peschel and Kayacan (2016), "Centralized,
decentralized and distributed nonlinear model predictive control of a tractor-trailer system: a
comparative study", American Control Conference, pp. 4403-4408.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from ..errors import check_choice, check_count
from ..laws.near_stop import weight_factors
from ..laws.options import MpcOptions
from ..laws.tracking_controller import (
    ExactCourse,
    FeedbackLaw,
    TrackingController,
    View,
    total_ahead,
    write_report,
)
from ..layout import ESTIMATE, TICK
from ..models.augmented_state import MAPPED
from ..mpc.articulated_error import (
    PredictedPath,
    map_gains,
    remaining_bounds,
    write_reference_error,
)
from ..mpc.lmpc import Solver, move_bounds
from ..reference.reference import GUIDED, Guided, Reference, guided
from ..types import (
    Diagnostics,
    Disturbance,
    FloatArray,
    Input,
    MapDisturbance,
    SolverReport,
    State,
)
from ..vehicle import Vehicle
from .gauss_newton import GaussNewton
from .nmpc_model import (
    TRACTOR,
    TRAILER,
    WHOLE,
    Block,
    Model,
    Task,
    articulated_model,
    kept_motion,
    new_motion,
    stage_times,
)

_M: Final = len(Input)
ITERATIONS: Final = 20  # at most; 2 to 3 are usual


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


Decomposition = tuple[Block, ...]
"""Blocks of the problem of a tick in the order in which they are solved."""

CENTRAL: Final[Decomposition] = (WHOLE,)
DECENTRALISED: Final[Decomposition] = (TRAILER, TRACTOR)
"""Nothing is exchanged: the trailer takes its tractor to keep its distance from its reference."""
DISTRIBUTED: Final[Decomposition] = (TRACTOR, TRAILER)
"""The tractor sends its predicted motion to the trailer."""

_BODY_FIXED: Final = slice(len(State), len(State) + len(Disturbance))  # in `error_state`
_MAP_FIXED: Final = slice(len(State) + len(Disturbance), None)
_FIRST_STATE: Final = (ESTIMATE.fields or {})["state"][1] // 8
_STATE: Final = slice(_FIRST_STATE, _FIRST_STATE + len(State))  # in a record `ESTIMATE`
_ERRORS: Final = len(State) + len(Disturbance) + len(MapDisturbance)


class NonlinearFeedback(FeedbackLaw):
    """Receding horizon of an NMPC, which starts from its plan of the previous tick, shifted.

    Where a QP has no accepted solution, the previous input is held; where the NMPC does not
    converge, its last plan is applied. `Diagnostics.fallback` reports both.
    """

    def __init__(
        self,
        course: ExactCourse,
        tuning: MpcOptions,
        iterations: int,
        decomposition: Decomposition = CENTRAL,
    ) -> None:
        self._course = course
        self._tuning = tuning
        vehicle = course.vehicle
        period_s = course.period_s
        damping = tuning.damping_s / period_s
        models = tuple(articulated_model(vehicle, period_s, block) for block in decomposition)
        remaining = remaining_bounds(course.feedforward, course.limits)
        bounds = move_bounds(tuning, period_s, len(course.feedforward), remaining)
        factors = weight_factors(course.reference, len(course.grid.state), period_s)
        self._solver = GaussNewton(
            models, bounds, tuning, iterations, damping, weight_factors=factors
        )
        self._motion = new_motion(models[0], tuning.horizon)
        grid = course.grid
        self._poses = np.hstack(
            [grid.state[:, :3], grid.trailer_xy, grid.state[:, State.PSI_I, None]]
        )  # (N + 1, 6)
        ticks = len(course.feedforward)
        middle = course.reference.at((np.arange(ticks) + 0.5) * course.period_s)
        self._map_gains = map_gains(middle, course.vehicle)  # (N, 5, 4)
        self._kept: FloatArray | None = None
        if not models[0].block.tractor:
            self._kept = _motion_of_reference(course, models[0])
        self._constants = vehicle.wheelbase, vehicle.speed_time_constant
        self._path = PredictedPath(grid)
        self._plan = self._solver.new_plan()  # of the last tick
        self.report: SolverReport | None = None  # of the last tick

    def resume(self, previous: object) -> None:
        """Keep the last plan as the first guess, see `ttempc.types.Controller.resume`."""
        if isinstance(previous, NonlinearFeedback):
            self._plan = previous._plan

    def act(self, k: int, row: FloatArray, view: View, sent: FloatArray, tick: FloatArray) -> None:
        """Write the actions of tick `k` into the record `TICK`, see `FeedbackLaw.act`."""
        horizon = self._tuning.horizon
        course = self._course
        error = np.empty(_ERRORS)
        write_reference_error(course.grid.state[k], row, *self._constants, error)
        disturbance = error[_BODY_FIXED] + self._map_gains[k : k + horizon] @ error[_MAP_FIXED]
        if self.expected:
            disturbance[:, :MAPPED] += total_ahead(self.expected, k, len(disturbance))
        task = Task(
            k=k,
            state=row[_STATE],
            disturbance=disturbance,
            poses=self._poses[k + 1 : k + 1 + horizon],
            feedforward=course.feedforward[k : k + horizon],
            previous=course.feedforward[max(k - 1, 0)] - sent,
            last_plan=self._plan.steps,
            motion=self._motion,
        )
        if self._kept is not None:
            ahead = self._kept[k : k + horizon]
            kept_motion(ahead, self._poses[k], task.state, self._motion)
        plan = self._solver.minimise(task)
        self._plan = plan
        self.report = self._solver.report
        of = tick.view(TICK)[0]
        control = of["control"]
        control[:, 1] = -plan.inputs
        control[:, 2] = 0.0
        write_report(self.report, tick)
        of["law"] = 1.0 if self._solver.fallback else 0.0

    def predicted_path(self, k: int) -> FloatArray:
        """Return the path of tick `k` under the plans, (Np, 4) [m], map frame."""
        return self._path.less(k, self._plan.errors)

    def diagnostics(self, k: int, tick: FloatArray) -> Diagnostics:
        """Return the view of the record of the last tick, `k`."""
        control = tick.view(TICK)[0]["control"]
        return Diagnostics(
            feedback=control[:, 1].copy(),
            robust=control[:, 2].copy(),
            predicted_path=self.predicted_path(k),
            solver=self.report,
            fallback=self._solver.fallback,
        )

    def prepare(self, k: int) -> None:
        """Solve the last task again, see `GaussNewton.prepare`."""
        self._solver.prepare()


def _motion_of_reference(course: ExactCourse, model: Model) -> FloatArray:
    """Return the motion of the reference tractor in all periods, (N, s, 3), see `new_motion`."""
    periods = len(course.feedforward)
    times = course.period_s * np.arange(periods)[:, None] + stage_times(model)
    sample = course.reference.at(times.ravel())
    rows = np.column_stack(
        [sample.state[:, State.PSI_T], sample.state[:, State.V], sample.yaw_rate_t]
    )
    motion = rows.reshape(periods, -1, rows.shape[1])
    ends = course.grid.state[1 : periods + 1]
    motion[:, -1] = ends[:, [State.X, State.Y, State.PSI_T]]
    return motion


def nmpc_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    options: NmpcRtiOptions = NmpcOptions(),
    decomposition: Decomposition = CENTRAL,
) -> TrackingController:
    """Compose the exact feedforward and the NMPC; `NmpcRtiOptions` ask for one iteration a period.

    Raises:
        MissingPackage: the package of the QP solver is not installed.
    """
    reference = guided(reference, options.guided)
    iterations = getattr(options, "iterations", 1)
    tuning = options.for_vehicle(vehicle, reference.speed.top_speed, period_s)

    course = ExactCourse(reference, period_s, tuning.horizon)
    return course.controller(NonlinearFeedback(course, tuning, iterations, decomposition))


nmpc_decentralised_controller = partial(nmpc_controller, decomposition=DECENTRALISED)
nmpc_distributed_controller = partial(nmpc_controller, decomposition=DISTRIBUTED)
