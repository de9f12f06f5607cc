"""Control law of the articulated MPC: error, robust action, plan, backup plan.

The kernels of a tick are `compute_error`, `solve_in_closed_form` of `ttempc.mpc.condensing` and
`write_actions`. All errors here are in the frame of the reference, see `REFERENCE_ERROR`; the body
error of the supervisor is another quantity.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ..jit import cached_njit, record
from ..layout import TICK, ControlColumn, new_tick
from ..models.augmented_state import MAPPED
from ..mpc.articulated_error import Output, PredictedPath, write_reference_error
from ..mpc.condensing import StageBounds, Stages, Work, solve_in_closed_form
from ..mpc.lmpc import CondensedHorizon, LinearMpc
from ..mpc.qp import BOUND_ACTIVE, CLOSED_FORM, CLOSED_FORM_REPORT
from ..types import Diagnostics, FloatArray, SolverReport, State, TubeReport
from .backup_plan import can_follow_plan, follow_plan, keep_within_bounds, remember_plan
from .law_records import (
    ERRORS,
    HELD,
    INPUTS,
    LAW,
    MEMORY,
    MODELLING_ERROR,
    NOMINAL,
    OUTPUTS,
    STATES,
    TUBE_REPORT,
    WORDS,
    Law,
    new_memory,
)
from .reserve import SteeringReserve
from .robust_action import advance, write_robust_action
from .tracking_controller import FeedbackLaw, View, known_share, total_ahead, write_report


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def compute_error(
    k: int,
    estimate: FloatArray,
    sent: FloatArray,
    law: Law,
    stages: Stages,
    work: Work,
    memory: FloatArray,
    tick: FloatArray,
) -> None:
    """Write the error on which the MPC acts and its previous input into `work`.

    `k` is the row of the tables, the tick of the reference less `MEMORY.table_offset`.

    The robust action, where there is one, goes into `MEMORY.action`, and what it finds into the
    record `tick`. `estimate` is a finite record `ESTIMATE`, `sent` the command of the previous
    period (3,).
    """
    s = record(memory, MEMORY)
    t = record(tick, TICK)
    constants = record(law.constants, LAW)
    reference_tick = k + int(s.table_offset)
    before = max(reference_tick - 1, 0)

    write_reference_error(
        law.reference[reference_tick],
        estimate,
        constants.wheelbase,
        constants.time_constant,
        work.state,
    )
    for i in range(STATES, ERRORS):
        work.state[i] *= constants.disturbances
    for i in range(INPUTS):
        work.previous[i] = law.feedforward[before, i] - sent[i]
        s.previous[i] = work.previous[i]  # u_e of the last period: predicts the nominal state
        s.action[i] = 0.0

    s.fallback = 0.0
    for i in range(OUTPUTS):
        t.tracking[MODELLING_ERROR + i] = math.nan
    for i in range(t.tube.size):
        t.tube[i] = math.nan
    if constants.kind != NOMINAL:
        write_robust_action(k, law, stages, memory, work, tick)
    for i in range(INPUTS):
        s.previous[i] = work.previous[i]  # the robust action may have replaced it
    if constants.largest_along_m > 0.0:
        cut_error(k, law, stages, memory, work)


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def cut_error(k: int, law: Law, stages: Stages, memory: FloatArray, work: Work) -> None:
    """Take off the error what the MPC does not see of it, in reverse far from the line.

    Along the path it is what the tractor's error exceeds `LAW.largest_along_m` by, across it what
    the trailer's error exceeds `LAW.largest_across_m` by.
    """
    s = record(memory, MEMORY)
    constants = record(law.constants, LAW)
    error = work.state
    across = 0.0
    for i in range(stages.outputs.shape[2]):
        across += stages.outputs[k, Output.TRAILER_ACROSS, i] * error[i]
    along = error[State.X]
    largest = constants.largest_along_m
    s.cut_along = along - min(max(along, -largest), largest)
    largest = constants.largest_across_m
    s.cut_across = across - min(max(across, -largest), largest)
    error[State.X] -= s.cut_along
    error[State.Y] -= s.cut_across


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def restore_error(memory: FloatArray, work: Work) -> None:
    """Put back what `cut_error` has taken off, into the error and the states of the plan."""
    s = record(memory, MEMORY)
    work.state[State.X] += s.cut_along
    work.state[State.Y] += s.cut_across
    for j in range(work.free.shape[0]):
        work.free[j, State.X] += s.cut_along
        work.free[j, State.Y] += s.cut_across


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def write_actions(
    k: int, outcome: int, law: Law, stages: Stages, work: Work, memory: FloatArray, tick: FloatArray
) -> None:
    """Write the actions of tick `k` for the plan in `Work.steps` into the record `tick`.

    With a tube, feedback and robust action have a sum from which all later plans exist; the robust
    action saturates there. Without a solution of the QP the last plan is kept, see
    `ttempc.laws.backup_plan`, or without such a plan the last feedback.

    The `outcome` is that of `solve_in_closed_form`; where it is another one than `CLOSED_FORM`, the
    record has the report of the solver.
    """
    s = record(memory, MEMORY)
    t = record(tick, TICK)
    bounds = stages.bounds
    reference_tick = k + int(s.table_offset)
    has_tube = law.reserve.shape[0] > 0
    if outcome == CLOSED_FORM:
        write_closed_form(tick)
    accepted = t.solver.accepted == 1.0
    restore_error(memory, work)

    # u_b = last input + first step; `LinearMpc.complete` has set the steps to 0 where there is no
    # solution
    for i in range(INPUTS):
        planned = work.previous[i] + work.steps[i]
        s.feedback[i] = min(max(planned, bounds.lower[k, i]), bounds.upper[k, i])
    if not accepted:
        s.fallback = HELD
        if has_tube and can_follow_plan(k, law, memory):
            follow_plan(k, law, stages, work, memory)

    for i in range(INPUTS):
        s.total[i] = s.feedback[i] - s.action[i]
    if has_tube:
        keep_within_bounds(k, stages, memory)
    if accepted:
        remember_plan(k, work, memory)
    for i in range(INPUTS):
        t.control[i, ControlColumn.FEEDFORWARD] = law.feedforward[reference_tick, i]
        t.control[i, ControlColumn.FEEDBACK] = -s.feedback[i]
        t.control[i, ControlColumn.ROBUST] = s.action[i]

    for i in range(ERRORS):
        s.error[i] = work.state[i]
    for i in range(STATES):
        s.foreseen[i] = work.preview[0, i]
    s.last_tick = k
    t.law = s.fallback
    advance(k, stages, s.error, s.feedback, s.next_nominal)
    for i in range(STATES):
        s.next_nominal[i] += s.foreseen[i]


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def write_closed_form(tick: FloatArray) -> None:
    """Write the report of a QP without an active bound into the record `tick`."""
    solver = record(tick, TICK).solver
    solver.accepted = 1.0
    solver.iterations = 0.0
    solver.primal_residual = 0.0
    solver.dual_residual = 0.0
    solver.status = 0.0


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def try_in_closed_form(
    k: int,
    estimate: FloatArray,
    sent: FloatArray,
    law: Law,
    stages: Stages,
    work: Work,
    memory: FloatArray,
    tick: FloatArray,
) -> int:
    """Run a whole tick where no solver is needed; return the outcome of `solve_in_closed_form`.

    Three calls would hand over each array of `law`, `stages` and `work` three times.
    """
    compute_error(k, estimate, sent, law, stages, work, memory, tick)
    outcome = solve_in_closed_form(k, stages, work)
    if outcome == CLOSED_FORM:
        write_actions(k, outcome, law, stages, work, memory, tick)
    return outcome


_EXCESS: Final = 1e-3  # [m], [rad] violation of the corridor from which it counts as left; assumed


class ArticulatedLaw(FeedbackLaw):
    """Linear MPC on the articulated error model with what a `Law` adds, by compiled code.

    Of a reference that repeats every `lap` ticks the tables of law and horizon have the first laps:
    all later ones are driven with those of the second, at the nearest tick.
    """

    def __init__(
        self,
        law: Law,
        horizon: CondensedHorizon,
        path: PredictedPath,
        lap: float = math.inf,
        relaxed: StageBounds | None = None,  # without a reserve of the trailer's steering
    ) -> None:
        self.law = law
        self.path = path
        self.mpc = LinearMpc(horizon)
        self._lap = lap
        self._table_offset = 0  # ticks of the reference by which it is beyond the tables
        self._until = 2.0 * lap  # first tick that needs another offset
        self._memory = new_memory()
        self.report: SolverReport | None = None  # of this tick's QP; None: answered in closed form
        self._last: tuple[FloatArray, ...] = ()  # estimate and command, of a step
        # Bounds of this law's own: those of the horizon are shared with its copies
        self._bounds = horizon.stages.bounds
        self._reserve: SteeringReserve | None = None
        if relaxed is not None:
            self._reserve = SteeringReserve(self._bounds, relaxed)
            self._bounds = StageBounds(*(values.copy() for values in self._bounds))

    @property
    def _stages(self) -> Stages:
        return self.mpc.horizon.stages._replace(bounds=self._bounds)

    def resume(self, previous: object) -> None:
        """Keep autocorrelation, nominal input and line acquisition, see `Controller.resume`.

        The nominal state, an error to another reference, starts anew.
        """
        if isinstance(previous, ArticulatedLaw):
            mine = self._memory.view(MEMORY)[0]
            other = previous._memory.view(MEMORY)[0]
            for name in ("last_signal", "product", "power", "feedback"):
                mine[name] = other[name]
            self.mpc.work.acquiring[:] = previous.mpc.work.acquiring

    def act(self, k: int, row: FloatArray, view: View, sent: FloatArray, tick: FloatArray) -> None:
        self._last = (row, sent)
        self.report = None
        if not self._table_offset <= k < self._until:
            self._move_tables(k)
        row_of_tables = k - self._table_offset
        outcome = self._try_in_closed_form(row_of_tables, self.mpc.work, self._memory, tick)
        if outcome != CLOSED_FORM:
            self._complete(row_of_tables, outcome, tick)

    def _complete(self, row_of_tables: int, outcome: int, tick: FloatArray) -> None:
        """Let the solver answer the QP of row `at` of the tables, and write the actions."""
        self.report, slacks = self.mpc.complete(row_of_tables, outcome)
        write_report(self.report, tick)
        leaves_corridor = slacks is not None and bool((slacks > _EXCESS).any())
        tick.view(TICK)[0]["leaves_corridor"] = leaves_corridor
        stages = self._stages
        write_actions(row_of_tables, outcome, self.law, stages, self.mpc.work, self._memory, tick)

    def _move_tables(self, k: int) -> None:
        """Move to the rows of the tables that stand for the lap of tick `k`."""
        memory = self._memory.view(MEMORY)[0]
        self._table_offset = round(max(0.0, k // self._lap - 1.0) * self._lap)
        self._until = self._table_offset + 2.0 * self._lap
        for name in ("last_tick", "plan_tick", "followed_tick"):
            memory[name] += memory["table_offset"] - self._table_offset
        memory["table_offset"] = self._table_offset
        self.mpc.work.tick[0] = -1.0

    def prepare(self, k: int) -> None:
        """Run tick `k` for the data of the last step and drop the result, to fill the caches."""
        if self._last:
            self.mpc.preparing.acquiring[:] = self.mpc.work.acquiring
            row_of_tables = k - self._table_offset
            self._try_in_closed_form(
                row_of_tables, self.mpc.preparing, self._memory.copy(), new_tick()
            )

    def warm_up(self) -> None:
        """Solve the problem of the last step by the solver, which takes milliseconds at first."""
        self.mpc.complete(int(self.mpc.work.tick[0]), BOUND_ACTIVE)

    def _try_in_closed_form(
        self, row_of_tables: int, work: Work, memory: FloatArray, tick: FloatArray
    ) -> int:
        stages = self._stages
        estimate, sent = self._last
        if self.expected:  # -E (s(k + j) - s(k)), see `error_dynamics`
            reference_tick = row_of_tables + self._table_offset
            count = len(work.preview)
            ahead = total_ahead(self.expected, reference_tick, count)[..., None]
            rows = slice(row_of_tables, row_of_tables + count)
            by_slips = stages.a[rows, :, STATES : STATES + MAPPED]
            work.preview[:] = (by_slips @ ahead)[..., 0]
            if self._reserve is not None:
                known = known_share(self.expected, reference_tick)
                self._reserve.write(row_of_tables, known, self._bounds)
        return try_in_closed_form(
            row_of_tables, estimate, sent, self.law, stages, work, memory, tick
        )

    def predicted_path(self, k: int) -> FloatArray:
        outputs = self.mpc.horizon.stages.outputs[k - self._table_offset + 1 :]
        return self.path.under(k, self.mpc.work, outputs)

    def diagnostics(self, k: int, tick: FloatArray) -> Diagnostics:
        """Return the view of the record of the last tick, `k`."""
        t = tick.view(TICK)[0]
        report = self.report or CLOSED_FORM_REPORT
        modelling_error = t["tracking"][MODELLING_ERROR:]
        return Diagnostics(
            feedback=t["control"][:, ControlColumn.FEEDBACK].copy(),
            robust=t["control"][:, ControlColumn.ROBUST].copy(),
            modelling_error=None if np.isnan(modelling_error[0]) else modelling_error.copy(),
            predicted_path=self.predicted_path(k),
            solver=report,
            fallback=WORDS[int(t["law"])].format(report.status),
            tube=_tube_view(t["tube"]),
            leaves_corridor=bool(t["leaves_corridor"]),
        )


def _tube_view(row: FloatArray) -> TubeReport | None:
    """Return the view of a `TUBE_REPORT`, None where there is none."""
    report = row.view(TUBE_REPORT)[0]
    if np.isnan(report["inside"]):
        return None
    return TubeReport(
        inside=bool(report["inside"]),
        margin=float(report["margin"]),
        nominal=report["nominal"].copy(),
        half_width=report["half_width"].copy(),
    )
