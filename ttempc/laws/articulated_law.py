"""Control law of the articulated MPC on flat arrays: error, robust action, plan, backup plan."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from ..jit import cached_njit, record
from ..layout import TICK, new_tick
from ..models.augmented_state import MAPPED
from ..mpc.articulated_error import PredictedPath, write_error
from ..mpc.condensing import Stages, Work, solve_in_closed_form
from ..mpc.lmpc import CondensedHorizon, LinearMpc
from ..mpc.qp import BOUND_ACTIVE, CLOSED_FORM, CLOSED_FORM_REPORT
from ..types import Diagnostics, FloatArray, Input, SolverReport, State, TubeReport
from ..vehicle import Vehicle
from .tracking_controller import FeedbackLaw, View, write_report

_N, _M = len(State), len(Input)
NOMINAL: Final = 0
"""The MPC alone."""
ONE_STEP: Final = 1
"""MPC, and the robust law."""
TUBE_MPC: Final = 2
"""MPC on the nominal state of a tube, and an ancillary gain."""

OUTSIDE: Final = 1
HELD: Final = 2
KEPT: Final = 3
WORDS: Final = (
    "",
    "outside its tube: nominal state restarted at the estimate",
    "QP {}: previous feedback held",
    "QP {}: last plan kept by the ancillary gain",
)
"""Why another law than the controller's own acted, by `TICK.law`; {} is the solver's status."""


LAW: Final = np.dtype(
    [
        ("kind", "f8"),  # `NOMINAL`, `ONE_STEP`, `TUBE_MPC`
        ("wheelbase", "f8"),  # [m]
        ("time_constant", "f8"),  # of the drive [s]
        ("disturbances", "f8"),  # 1 where the MPC uses the estimated ones, else 0
        ("limit", "f8", 3),  # k_s of the robust law
        ("forgetting", "f8"),  # of its autocorrelation, per period
        ("reach", "f8", 2),  # in reverse, see `articulated_mpc` [m]; 0 forwards
    ]
)
"""Constants of an articulated law; 0 what it lacks."""

POINT: Final = np.dtype(
    [
        ("gains", "f8", (3, 7)),  # of the robust law in units of its limit
        ("ancillary", "f8", (3, 7)),  # K of the backup plan
        ("half_widths", "f8", 9),  # of the report
    ]
)
"""The same at a row of its tables."""


class Law(NamedTuple):
    """Arrays of an articulated law along a reference of N ticks, with tables of T rows."""

    constants: FloatArray  # record `LAW`
    course: FloatArray  # state (7,) and inputs u_r (3,) of the reference, (N, 10)
    points: FloatArray  # records `POINT`, (T, 51)
    faces: FloatArray  # of the tube (T, f, 7), or of the set of disturbances (1, f, 7); (0, 0, 7)
    reserve: FloatArray  # of the inputs, for the ancillary gain at stage j, (Np, T, 3); (0, 0, 3)


MEMORY: Final = np.dtype(
    [
        ("correlation", "f8", (3, 3)),  # see `robust_part`
        ("shift", "f8", 2),  # of the error, by what it exceeds `LAW.reach`
        ("last", "f8"),  # tick of the last step, -2 before the first
        ("state", "f8", 16),  # of the error, on which the MPC acted
        ("feedback", "f8", 3),  # u_b
        ("previous", "f8", 3),  # u_e before it
        ("action", "f8", 3),  # u_m of this tick
        ("nominal", "f8", 7),  # zbar of this tick
        ("deviation", "f8", 7),  # of the estimate from it
        ("coming", "f8", 7),  # zbar of the coming tick
        ("fallback", "f8"),  # index of `WORDS`
        ("made", "f8"),  # tick of the backup plan, -1: none
        ("planned", "f8"),  # last tick at which it was followed
        ("plan_state", "f8", 16),  # its error and inputs there
        ("plan_input", "f8", 3),
        ("beyond", "f8"),  # ticks that the reference is beyond the tables, see `ArticulatedLaw`
    ]
)
"""Memory of an articulated law from tick to tick; ticks are rows of the tables."""

_TINY: Final = 1e-30  # keeps the autocorrelation of a signal of zeros finite


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def advance(k: int, stages: Stages, state: FloatArray, inputs: FloatArray, to: FloatArray) -> None:
    """Write the error (7,) that follows on `state` (16,) and `inputs` (3,) of tick `k`."""
    for i in range(_N):
        total = 0.0
        for c in range(16):
            total += stages.a[k, i, c] * state[c]
        for c in range(_M):
            total += stages.b[k, i, c] * inputs[c]
        to[i] = total


@cached_njit(error_model="numpy", boundscheck=False, nogil=True, inline="always")
def robust_part(
    k: int, law: Law, stages: Stages, memory: FloatArray, work: Work, tick: FloatArray
) -> None:
    """Write nominal state, deviation, action and modelling error of tick `k`.

    `Work.state` has the error (16,), `Work.previous` u_e(k-1) (3,); they leave with those on which
    the MPC acts. Each action but an ancillary one is multiplied by its lag-one autocorrelation
    within [0, 1]: `MEMORY.correlation` holds the previous one and the averages of product and
    power, of which older ones weigh less by the factor `LAW.forgetting` with each tick.
    """
    constants, gains = record(law.constants, LAW), record(law.points[k], POINT).gains
    given = work.state
    s, t = record(memory, MEMORY), record(tick, TICK)
    nominal, deviation, action, feedback = s.nominal, s.deviation, s.action, s.feedback
    kind, seen, modelling, outputs = constants.kind, s.correlation, t.tracking, stages.outputs
    started = s.last == k - 1
    if started and kind == ONE_STEP:
        advance(k - 1, stages, s.state, s.previous, nominal)
    coming = s.coming
    for i in range(_N):
        if not started:
            nominal[i] = given[i]
        elif kind != ONE_STEP:
            nominal[i] = coming[i]
        deviation[i] = given[i] - nominal[i]
    for i in range(_M):
        total = 0.0
        for j in range(_N):
            total += gains[i, j] * deviation[j]
        action[i] = total
        if kind == TUBE_MPC:
            work.previous[i] = feedback[i]
    gauge = 0.0
    if law.faces.shape[0]:
        gauge = report_tube(k, law, outputs, nominal, deviation, t.tube)
    if kind == TUBE_MPC and gauge > 1.0:
        s.fallback = OUTSIDE
    elif kind == TUBE_MPC:  # the disturbances act on both states, with their present estimates
        for i in range(_N):
            given[i] = nominal[i]
    for i in range(_M):
        now = action[i]
        if kind == TUBE_MPC:
            action[i] = 0.0 if s.fallback != 0.0 else -now
            continue
        last = seen[0, i]
        power = 0.5 * (now * now + last * last)
        seen[0, i] = now
        seen[1, i] = constants.forgetting * seen[1, i] + now * last
        seen[2, i] = constants.forgetting * seen[2, i] + power
        share = min(max(seen[1, i] / max(seen[2, i], _TINY), 0.0), 1.0)
        action[i] = constants.limit[i] * math.tanh(now * share)
    if kind != TUBE_MPC:
        for p in range(4):
            total = 0.0
            for j in range(_N):
                total += outputs[k, p, j] * deviation[j]
            modelling[7 + p] = total


@cached_njit(error_model="numpy", boundscheck=False, nogil=True, inline="always")
def report_tube(
    k: int,
    law: Law,
    outputs: FloatArray,
    nominal: FloatArray,
    deviation: FloatArray,
    report: FloatArray,
) -> float:
    """Write a `TubeReport` (20,) at tick `k`; return the gauge of the deviation in its set."""
    point, at, gauge = record(law.points[k], POINT), min(k, law.faces.shape[0] - 1), 0.0
    for f in range(law.faces.shape[1]):
        value = 0.0
        for j in range(_N):
            value += law.faces[at, f, j] * deviation[j]
        gauge = max(gauge, abs(value))
    report[0], report[1] = 1.0 if gauge <= 1.0 else 0.0, 1.0 - gauge
    for i in range(9):  # entries of the error, then x and y of the trailer point
        value = nominal[i] if i < _N else 0.0
        for j in range(_N if i >= _N else 0):
            value += outputs[k, i - 5, j] * nominal[j]
        report[2 + i], report[11 + i] = value, point.half_widths[i]
    return gauge


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def propose(
    k: int,
    estimate: FloatArray,
    sent: FloatArray,
    law: Law,
    stages: Stages,
    work: Work,
    memory: FloatArray,
    tick: FloatArray,
) -> None:
    """Write the error on which the MPC acts at tick `k` and its previous input into `work`.

    The robust action, where there is one, goes into `MEMORY.action`, and what it finds into the
    record `tick`. `solve_in_closed_form` and `conclude` come next. `estimate` is a finite record
    `ESTIMATE`, `sent` the command of the previous period (3,).
    """
    s, t, constants = record(memory, MEMORY), record(tick, TICK), record(law.constants, LAW)
    given = work.state
    modelling, tube, action, previous = t.tracking, t.tube, s.action, s.previous
    at, wheelbase, tau = k + int(s.beyond), constants.wheelbase, constants.time_constant
    write_error(law.course[at], estimate, wheelbase, tau, given)
    for i in range(_N, 16):
        given[i] *= constants.disturbances
    for i in range(4):
        modelling[7 + i] = math.nan
    for i in range(20):
        tube[i] = math.nan
    for i in range(_M):
        work.previous[i] = previous[i] = law.course[max(at - 1, 0), _N + i] - sent[i]
        action[i] = 0.0
    s.fallback = 0.0
    if constants.kind != NOMINAL:
        robust_part(k, law, stages, memory, work, tick)
    for i in range(_M):
        previous[i] = work.previous[i]
    reach, shift, across = constants.reach, s.shift, 0.0
    if reach[0] > 0.0:
        for i in range(stages.outputs.shape[2]):
            across += stages.outputs[k, 3, i] * given[i]
        shift[0] = given[0] - min(max(given[0], -reach[0]), reach[0])
        shift[1] = across - min(max(across, -reach[1]), reach[1])
        given[0] -= shift[0]
        given[1] -= shift[1]


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def conclude(
    k: int, outcome: int, law: Law, stages: Stages, work: Work, memory: FloatArray, tick: FloatArray
) -> None:
    """Write the actions of tick `k` for the plan in `Work.steps` into the record `tick`.

    With a backup plan, feedback and robust action have a sum from which all later plans exist; the
    robust action saturates there. Without a solution of the QP, the last plan is kept, and its
    ancillary gain is the robust action:

        u_e = ubar_j + K m,    m = zhat - zbar_j.

    zbar_j follows the model from the estimate at which the plan was made, with the disturbances of
    now. ubar_j are the planned inputs; after a first input that the robust action has moved away
    they approach the plan at the rate that the tightening leaves, and K m saturates at its reserve.

    The `outcome` is that of `solve_in_closed_form`; where it is another one than `CLOSED_FORM`, the
    record has the report of the solver.
    """
    s, t, point = record(memory, MEMORY), record(tick, TICK), record(law.points[k], POINT)
    solver, action, feedback, ancillary = t.solver, s.action, s.feedback, point.ancillary
    plan_state, plan_input, state, control = s.plan_state, s.plan_input, s.state, t.control
    coming, previous, feedforward = s.coming, s.previous, law.course[k + int(s.beyond), _N:]
    given, steps, bounds = work.state, work.steps, stages.bounds
    if outcome == CLOSED_FORM:
        solver.accepted = 1.0
        solver.iterations = 0.0
        solver.primal_residual = 0.0
        solver.dual_residual = 0.0
        solver.status = 0.0
    for i in range(2):  # back to the true error
        given[i] += s.shift[i]
        for j in range(work.free.shape[0]):
            work.free[j, i] += s.shift[i]
    size, accepted, backed = steps.size, solver.accepted == 1.0, law.reserve.shape[0] > 0
    made = int(s.made)
    stage = k - made
    for i in range(_M):
        feedback[i] = work.previous[i] + steps[i]
        feedback[i] = min(max(feedback[i], bounds.lower[k, i]), bounds.upper[k, i])
    if not accepted:
        s.fallback = HELD
    if backed and not accepted and s.planned == k - 1 and stage < law.reserve.shape[0]:
        s.fallback, s.planned = KEPT, k
        advance(k - 1, stages, plan_state, plan_input, coming)
        first = _M * min(stage, size // _M - 1)
        for i in range(_M):
            planned, total, share = work.backup_previous[i], 0.0, law.reserve[stage, k, i]
            for j in range(i, first + i + 1, _M):
                planned += work.backup_steps[j]
            low = plan_input[i] + bounds.step_lower[made, first + i]
            high = plan_input[i] + bounds.step_upper[made, first + i]
            plan_input[i] = feedback[i] = min(max(planned, low), high)
            for j in range(_N):
                total += ancillary[i, j] * (given[j] - coming[j])
            action[i] = -min(max(total, -share), share)
        for i in range(16):
            plan_state[i] = coming[i] if i < _N else given[i]
    for i in range(_M):
        total = feedback[i] - action[i]
        if backed:
            low = max(bounds.lower[k, i], previous[i] + bounds.step_lower[k, i])
            high = min(bounds.upper[k, i], previous[i] + bounds.step_upper[k, i])
            total = max(min(total, high), low)
            action[i] = feedback[i] - total
        if accepted:
            plan_input[i] = total
            work.backup_previous[i] = work.previous[i]
        control[i, 0], control[i, 1], control[i, 2] = feedforward[i], -feedback[i], action[i]
    if accepted:
        s.made = s.planned = k
        for i in range(size):
            work.backup_steps[i] = steps[i]
    for i in range(16):
        state[i] = given[i]
        if accepted:
            plan_state[i] = given[i]
    s.last, t.law = k, s.fallback
    advance(k, stages, state, feedback, coming)


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def _drive(
    k: int,
    row: FloatArray,
    sent: FloatArray,
    law: Law,
    stages: Stages,
    work: Work,
    memory: FloatArray,
    tick: FloatArray,
) -> int:
    """Propose, solve, and conclude where no solver is needed, in one call; return the outcome.

    Three calls would hand over each array of `law`, `stages` and `work` three times.
    """
    propose(k, row, sent, law, stages, work, memory, tick)
    outcome = solve_in_closed_form(k, stages, work)
    if outcome == CLOSED_FORM:
        conclude(k, outcome, law, stages, work, memory, tick)
    return outcome


_EXCESS: Final = 1e-3  # [m], [rad] violation of the corridor from which it counts as left; assumed


class ArticulatedLaw(FeedbackLaw):
    """Linear MPC on the articulated error model with what a `Law` adds, by compiled code.

    Of a reference that repeats every `lap` ticks the tables of law and horizon have the first laps:
    all later ones are driven with those of the second, at the nearest tick.
    """

    def __init__(
        self, law: Law, horizon: CondensedHorizon, path: PredictedPath, lap: float = math.inf
    ) -> None:
        self.law, self.path, self.mpc = law, path, LinearMpc(horizon)
        self._lap, self._beyond, self._until = lap, 0, 2.0 * lap
        self._memory = np.zeros(MEMORY.itemsize // 8)
        memory = self._memory.view(MEMORY)[0]
        memory["last"] = memory["made"] = memory["planned"] = -2.0
        self.report: SolverReport | None = None  # of the last QP that a solver answered
        self._last: tuple[FloatArray, ...] = ()  # estimate and command, of a step

    def resume(self, previous: object) -> None:
        """Keep autocorrelation, nominal input and entry, see `ttempc.types.Controller.resume`.

        The nominal state, an error to another reference, starts anew.
        """
        if isinstance(previous, ArticulatedLaw):
            mine, other = self._memory.view(MEMORY)[0], previous._memory.view(MEMORY)[0]
            mine["correlation"], mine["feedback"] = other["correlation"], other["feedback"]
            self.mpc.work.acquiring[:] = previous.mpc.work.acquiring
            self.field = previous.field

    def act(self, k: int, row: FloatArray, view: View, sent: FloatArray, tick: FloatArray) -> None:
        self._last, self.report = (row, sent), None
        if not self._beyond <= k < self._until:
            self._turn(k)
        self._drive(k - self._beyond, self.mpc.work, self._memory, tick)

    def _turn(self, k: int) -> None:
        """Move to the rows of the tables that stand for the lap of tick `k`."""
        memory = self._memory.view(MEMORY)[0]
        self._beyond = round(max(0.0, k // self._lap - 1.0) * self._lap)
        self._until = self._beyond + 2.0 * self._lap
        for name in ("last", "made", "planned"):
            memory[name] += memory["beyond"] - self._beyond
        memory["beyond"], self.mpc.work.tick[0] = self._beyond, -1.0

    def prepare(self, k: int) -> None:
        """Run tick `k` for the data of the last step and drop the result, to fill the caches."""
        if self._last:
            self.mpc.preparing.acquiring[:] = self.mpc.work.acquiring
            self._drive(k - self._beyond, self.mpc.preparing, self._memory.copy(), new_tick())

    def warm_up(self) -> None:
        """Solve the problem of the last step by the solver, which takes milliseconds at first."""
        self.mpc.complete(int(self.mpc.work.tick[0]), BOUND_ACTIVE)

    def _drive(self, k: int, work: Work, memory: FloatArray, tick: FloatArray) -> None:
        law, stages, (row, sent) = self.law, self.mpc.horizon.stages, self._last
        if self.field is not None:  # -E (s(k + j) - s(k)), see `error_dynamics`
            ahead = self.field.ahead(k + self._beyond, len(work.preview))[..., None]
            by_slips = stages.a[k : k + len(ahead), :, _N : _N + MAPPED]
            work.preview[:] = (by_slips @ ahead)[..., 0]
        outcome = _drive(k, row, sent, law, stages, work, memory, tick)
        if outcome != CLOSED_FORM and work is self.mpc.work:
            self.report, excess = self.mpc.complete(k, outcome)
            write_report(self.report, tick)
            leaves_corridor = excess is not None and bool((excess > _EXCESS).any())
            tick.view(TICK)[0]["leaves_corridor"] = leaves_corridor
            conclude(k, outcome, law, stages, work, memory, tick)

    def predicted_path(self, k: int) -> FloatArray:
        outputs = self.mpc.horizon.stages.outputs[k - self._beyond + 1 :]
        return self.path.under(k, self.mpc.work, outputs)

    def diagnostics(self, k: int, tick: FloatArray) -> Diagnostics:
        """Return the view of the record of the last tick, `k`."""
        t = tick.view(TICK)[0]
        report = self.report or CLOSED_FORM_REPORT
        modelling, tube = t["tracking"][7:], t["tube"]
        return Diagnostics(
            feedback=t["control"][:, 1].copy(),
            robust=t["control"][:, 2].copy(),
            modelling_error=None if np.isnan(modelling[0]) else modelling.copy(),
            predicted_path=self.predicted_path(k),
            solver=report,
            fallback=WORDS[int(t["law"])].format(report.status),
            tube=None
            if np.isnan(tube[0])
            else TubeReport(bool(tube[0]), float(tube[1]), tube[2:11].copy(), tube[11:].copy()),
            leaves_corridor=bool(t["leaves_corridor"]),
        )


def law_of(
    kind: int,
    reference: FloatArray,
    feedforward: FloatArray,
    vehicle: Vehicle,
    rows: int,
    **fields: FloatArray | float,
) -> Law:
    """Return the law of a kind along `reference` (N + 1, 7) and `feedforward` (N, 3).

    The tables have `rows` rows; `fields` are those of `Law`, `LAW` and `POINT` that it has.
    """
    faces = np.asarray(fields.pop("faces", np.zeros((0, 0, _N))))
    reserve = np.asarray(fields.pop("reserve", np.zeros((0, 0, _M))))
    constants = np.zeros(LAW.itemsize // 8)
    points = np.zeros((rows, POINT.itemsize // 8))
    course = np.concatenate([reference[: len(feedforward)], feedforward], axis=1)
    fields |= {"kind": kind, "wheelbase": vehicle.wheelbase}
    fields["time_constant"] = vehicle.speed_time_constant
    for name, values in fields.items():
        of_law = name in (LAW.names or ())
        target = constants.view(LAW)[0] if of_law else points.view(POINT)[:, 0]
        target[name] = values
    return Law(constants, course, points, faces, reserve)
