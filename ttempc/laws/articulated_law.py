"""Control law of the articulated MPC on flat arrays: error, robust action, plan, backup plan."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from ..jit import cached_njit, record
from ..layout import ESTIMATE, TICK, new_tick
from ..mpc.articulated_error import PredictedPath
from ..mpc.lmpc import CondensedHorizon, LinearMpc, Stages, Work, plan
from ..types import Diagnostics, Estimate, FloatArray, Input, SolverReport, State, TubeReport
from ..vehicle import Vehicle
from .tracking_controller import FeedbackLaw

_N, _M = len(State), len(Input)
NOMINAL: Final = 0
"""The MPC alone."""
ONE_STEP: Final = 1
"""MPC, and the robust law in the one-step reading."""
TUBE_READING: Final = 2
"""MPC, and the robust law in the tube reading."""
TUBE_MPC: Final = 3
"""MPC on the nominal state of a tube, and an ancillary gain."""

EXHAUSTED: Final = 1
OUTSIDE: Final = 2
HELD: Final = 3
KEPT: Final = 4
WORDS: Final = (
    "",
    "robust action exhausted: nominal state starts anew",
    "outside its tube: nominal state restarted at the estimate",
    "QP {}: previous feedback held",
    "QP {}: last plan kept by the ancillary gain",
)
"""Why another law than the controller's own acted, by `TICK.law`; {} is the solver's status."""


class Law(NamedTuple):
    """Constants of an articulated law along a reference of T ticks; (0, ...) what it lacks."""

    kind: int  # `NOMINAL`, `ONE_STEP`, `TUBE_READING`, `TUBE_MPC`
    reference: FloatArray  # state (T + 1, 7)
    feedforward: FloatArray  # u_r (T, 3)
    wheelbase: float  # [m]
    time_constant: float  # of the drive [s]
    disturbances: float  # 1 where the MPC uses the estimated ones, else 0
    gains: FloatArray  # (T, 3, 7), of the robust law in units of its limit
    limit: FloatArray  # k_s (3,) of the robust law
    forgetting: float  # of its autocorrelation, per period
    ancillary: FloatArray  # K (T, 3, 7) of the backup plan
    reserve: FloatArray  # of the inputs that it leaves K at stage j, (Np, T, 3)
    faces: FloatArray  # of the set of disturbances (f, 7), or of the tube (T * 12, 7)
    rows: FloatArray  # from an error to the entries of a report (T, 9, 7)
    half_widths: FloatArray  # of the report (T, 9)


MEMORY: Final = np.dtype(
    [
        ("correlation", "f8", (3, 3)),  # see `robust_part`
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
    ]
)
"""Memory of an articulated law from tick to tick."""

_TINY: Final = 1e-30  # keeps the autocorrelation of a signal of zeros finite
# Largest argument of tanh in the tube reading. Beyond it the law cannot bring the vehicle back.
_EXHAUSTED: Final = 3.0
_TURN: Final = math.tau


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def robust_part(
    k: int, law: Law, stages: Stages, memory: FloatArray, given: FloatArray, tick: FloatArray
) -> None:
    """Write nominal state, deviation, action and modelling error of tick `k`.

    `given` has the error (16,) and u_e(k-1) (3,); it leaves with those on which the MPC acts. In
    the one-step reading each action is multiplied by its lag-one autocorrelation within [0, 1]:
    `MEMORY.correlation` holds the previous one and the averages of product and power, of which
    older ones weigh less by the factor `Law.forgetting` with each tick.
    """
    s, t = record(memory, MEMORY), record(tick, TICK)
    started = s.last == k - 1
    if law.kind == TUBE_READING and s.last >= 0.0:
        for i in range(_M):
            given[16 + i] = s.feedback[i]
    for i in range(_N):
        s.nominal[i] = given[i]
        if law.kind == TUBE_MPC and s.last == k - 1:
            s.nominal[i] = s.coming[i]
        elif law.kind != TUBE_MPC and started:
            total = 0.0
            for c in range(16):
                total += stages.model[k - 1, i, c] * s.state[c]
            for c in range(_M):
                total += stages.model[k - 1, i, 16 + c] * given[16 + c]
            s.nominal[i] = total
        s.deviation[i] = given[i] - s.nominal[i]
    largest = gauge = 0.0
    for i in range(_M):
        s.action[i] = 0.0
        for j in range(_N):
            s.action[i] += law.gains[k, i, j] * s.deviation[j]
        largest = max(largest, abs(s.action[i]))
    if law.faces.shape[0]:
        faces, first = law.faces.shape[0], 0
        if law.kind == TUBE_MPC:
            faces //= law.half_widths.shape[0]
            first = faces * k
        gauge = report_tube(k, law, first, first + faces, s.nominal, s.deviation, t.tube)
    if law.kind == TUBE_MPC:
        for i in range(_M):
            s.action[i] = -s.action[i] if gauge <= 1.0 else 0.0
            given[16 + i] = s.feedback[i]
        if gauge <= 1.0:
            for i in range(_N):
                given[i] = s.nominal[i]
        else:
            s.fallback = OUTSIDE
        return
    if law.kind == ONE_STEP:
        for i in range(_M):
            last, now, seen = s.correlation[0, i], s.action[i], s.correlation
            seen[1, i] = law.forgetting * seen[1, i] + now * last
            power = 0.5 * (now * now + last * last)
            seen[2, i] = law.forgetting * seen[2, i] + power
            seen[0, i] = now
            s.action[i] *= min(max(seen[1, i] / max(seen[2, i], _TINY), 0.0), 1.0)
    elif largest > _EXHAUSTED:
        s.fallback = EXHAUSTED
        for i in range(_N):
            s.deviation[i] = 0.0
        for i in range(_M):
            s.action[i] = 0.0
    else:  # the disturbances act on both states, with their present estimates
        for i in range(_N):
            given[i] = s.nominal[i]
    for i in range(_M):
        s.action[i] = law.limit[i] * math.tanh(s.action[i])
    for p in range(4):
        t.tracking[7 + p] = 0.0
        for j in range(_N):
            t.tracking[7 + p] += stages.outputs[k, p, j] * s.deviation[j]


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def report_tube(
    k: int,
    law: Law,
    first: int,
    end: int,
    nominal: FloatArray,
    deviation: FloatArray,
    report: FloatArray,
) -> float:
    """Write a `TubeReport` (20,) at tick `k`; return the gauge of the deviation in its set."""
    gauge = 0.0
    for f in range(first, end):
        value = 0.0
        for j in range(_N):
            value += law.faces[f, j] * deviation[j]
        gauge = max(gauge, abs(value))
    report[0], report[1] = 1.0 if gauge <= 1.0 else 0.0, 1.0 - gauge
    for i in range(9):
        report[2 + i], report[11 + i] = 0.0, law.half_widths[k, i]
        for j in range(_N):
            report[2 + i] += law.rows[k, i, j] * nominal[j]
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
    kept: FloatArray,
    tick: FloatArray,
    most: int,
) -> int:
    """Write the actions of tick `k` into the record `tick`; return the outcome of `plan`.

    Below 0 the QP is not solved: the caller writes its answer into `Work.steps`, the solver's
    report into `tick`, and calls `conclude`.

    Args:
        estimate: record `ESTIMATE`, finite.
        sent: command of the previous period (3,).
        memory: record `MEMORY`.
        kept: the plan of the backup: previous input and steps (m + m Nc,).
        most: see `minimise`.
    """
    e, s, t, given = (
        record(estimate, ESTIMATE),
        record(memory, MEMORY),
        record(tick, TICK),
        work.given,
    )
    r, x, on_map = law.reference[k], e.state, e.map_disturbance
    dx, dy, cos, sin = r[0] - x[0], r[1] - x[1], math.cos(r[2]), math.sin(r[2])
    given[0], given[1] = cos * dx + sin * dy, cos * dy - sin * dx
    for i in range(2, _N):
        given[i] = r[i] - x[i]
    for i in range(2, 4):
        given[i] -= _TURN * math.floor(given[i] / _TURN + 0.5)
    # body-fixed and map-fixed part of the disturbance, see `map_disturbance_gain`
    cos, sin, v = math.cos(x[2]), math.sin(x[2]), x[6]
    gear, yaw_rate = math.copysign(1.0, v), v * math.tan(x[4] + e.disturbance[2]) / law.wheelbase
    by_x = -v * (cos / law.time_constant - yaw_rate * sin)
    by_y = -v * (sin / law.time_constant + yaw_rate * cos)
    of_map = (
        gear * (on_map[1] * cos - on_map[0] * sin),
        gear * (on_map[1] * math.cos(x[3]) - on_map[0] * math.sin(x[3])),
        0.0,
        gear * (by_x * on_map[2] + by_y * on_map[3]),
        gear * (cos * on_map[2] + sin * on_map[3]),
    )
    for i in range(5):
        given[7 + i] = law.disturbances * (e.disturbance[i] - of_map[i])
    for i in range(4):
        given[12 + i] = law.disturbances * on_map[i]
        t.tracking[7 + i] = math.nan
    for i in range(20):
        t.tube[i] = math.nan
    for i in range(_M):
        given[16 + i] = law.feedforward[max(k - 1, 0), i] - sent[i]
        s.action[i] = 0.0
    s.fallback = 0.0
    if law.kind != NOMINAL:
        robust_part(k, law, stages, memory, given, tick)
    for i in range(_M):
        s.previous[i] = given[16 + i]
    outcome = plan(k, stages, work, most)
    if outcome >= 0:
        t.solver[0], t.solver[1], t.solver[2], t.solver[3] = 1.0, outcome, 0.0, 0.0
        conclude(k, law, stages, work, memory, kept, tick)
    return outcome


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def conclude(
    k: int,
    law: Law,
    stages: Stages,
    work: Work,
    memory: FloatArray,
    kept: FloatArray,
    tick: FloatArray,
) -> None:
    """Write the actions of tick `k` for the plan in `Work.steps`; the rest is as of `propose`.

    With a backup plan, feedback and robust action have a sum from which all later plans exist; the
    robust action saturates there. Without a solution of the QP, the last plan is kept, and its
    ancillary gain is the robust action:

        u_e = ubar_j + K m,    m = zhat - zbar_j.

    zbar_j starts at the estimate at which the plan was made. It follows the model under ubar_j and
    the disturbances that the estimator gives at each tick. ubar_j are the planned inputs; after a
    first input that the robust action has moved away from them, they approach the plan at the rate
    that the tightening leaves. K m saturates at the share of the inputs that the tightening has
    reserved for it. A plan can be kept at every tick up to the last stage of its horizon.
    """
    s, t, given, steps = record(memory, MEMORY), record(tick, TICK), work.given, work.steps
    size, accepted, backed = steps.size, t.solver[0] == 1.0, law.reserve.shape[0] > 0
    for i in range(_M):
        low, high = stages.limits[k, 0, i], stages.limits[k, 1, i]
        s.feedback[i] = min(max(given[16 + i] + steps[i], low), high)
    if not accepted:
        s.fallback = HELD
    stage, moves = k - int(s.made), size // _M
    if backed and not accepted and s.planned == k - 1 and stage < law.reserve.shape[0]:
        s.fallback, moved = KEPT, np.empty(_N)
        for i in range(_N):
            total = 0.0
            for c in range(16):
                total += stages.model[k - 1, i, c] * s.plan_state[c]
            for c in range(_M):
                total += stages.model[k - 1, i, 16 + c] * s.plan_input[c]
            moved[i] = total
        at = size + _M * min(stage, moves - 1)
        for i in range(_M):
            planned = kept[i]
            for j in range(min(stage + 1, moves)):
                planned += kept[_M + _M * j + i]
            low = s.plan_input[i] + stages.limits[int(s.made), 0, at + i]
            high = s.plan_input[i] + stages.limits[int(s.made), 1, at + i]
            s.plan_input[i] = s.feedback[i] = min(max(planned, low), high)
            total, reserve = 0.0, law.reserve[stage, k, i]
            for j in range(_N):
                total += law.ancillary[k, i, j] * (given[j] - moved[j])
            s.action[i] = -min(max(total, -reserve), reserve)
        for i in range(16):
            s.plan_state[i] = moved[i] if i < _N else given[i]
        s.planned = k
    if backed:
        for i in range(_M):
            low = max(stages.limits[k, 0, i], s.previous[i] + stages.limits[k, 0, size + i])
            high = min(stages.limits[k, 1, i], s.previous[i] + stages.limits[k, 1, size + i])
            total = max(min(s.feedback[i] - s.action[i], high), low)
            s.action[i] = s.feedback[i] - total
            if accepted:
                s.plan_input[i] = total
        if accepted:
            s.made = s.planned = k
            for i in range(16):
                s.plan_state[i] = given[i]
            for i in range(_M):
                kept[i] = given[16 + i]
            for i in range(size):
                kept[_M + i] = steps[i]
    s.last = k
    for i in range(16):
        s.state[i] = given[i]
    if law.kind == TUBE_MPC:
        for i in range(_N):
            s.coming[i] = 0.0
            for c in range(16):
                s.coming[i] += stages.model[k, i, c] * given[c]
            for c in range(_M):
                s.coming[i] += stages.model[k, i, 16 + c] * s.feedback[c]
    for i in range(_M):
        t.control[i, 0] = law.feedforward[k, i]
        t.control[i, 1] = -s.feedback[i]
        t.control[i, 2] = s.action[i]
    t.law = s.fallback


_EXCESS: Final = 1e-3  # [m], [rad] violation of the corridor from which it counts as left; assumed


class ArticulatedLaw(FeedbackLaw):
    """Linear MPC on the articulated error model with what a `Law` adds, by compiled code."""

    def __init__(self, law: Law, horizon: CondensedHorizon, path: PredictedPath) -> None:
        self.law, self.horizon, self.path = law, horizon, path
        self.mpc = LinearMpc(horizon)
        self._memory = np.zeros(MEMORY.itemsize // 8)
        memory = self._memory.view(MEMORY)[0]
        memory["last"] = memory["made"] = memory["planned"] = -2.0
        self._kept = np.zeros(_M + len(horizon.stages.matrix))
        self.report: SolverReport | None = None  # of the last QP that a solver answered
        self._last: tuple[FloatArray, FloatArray] | None = None  # estimate and command, of a step

    @property
    def state(self) -> FloatArray:
        """All that later steps depend on, a copy; `restore` takes it."""
        return np.concatenate([self._memory, self._kept, self.mpc.work.active])

    def restore(self, state: FloatArray) -> None:
        """Go on from a `state` of a law along the same reference."""
        ends = np.cumsum([len(self._memory), len(self._kept)])
        parts = self._memory, self._kept, self.mpc.work.active
        for part, values in zip(parts, np.split(state, ends), strict=True):
            part[:] = values

    def resume(self, previous: object) -> None:
        """Keep autocorrelation and nominal input, see `ttempc.types.Resuming`.

        The nominal state, an error to another reference, starts anew.
        """
        if isinstance(previous, ArticulatedLaw):
            mine, other = self._memory.view(MEMORY)[0], previous._memory.view(MEMORY)[0]
            mine["correlation"], mine["feedback"] = other["correlation"], other["feedback"]

    def act(
        self,
        k: int,
        row: FloatArray,
        view: Callable[[], Estimate],
        sent: FloatArray,
        tick: FloatArray,
    ) -> None:
        mpc, stages, work = self.mpc, self.horizon.stages, self.mpc.work
        outcome = propose(
            k, row, sent, self.law, stages, work, self._memory, self._kept, tick, mpc.most
        )
        self._last, self.report = (row, sent), None
        if outcome < 0:
            self.report, excess = mpc.answer(k, outcome)
            report, record = self.report, tick.view(TICK)[0]
            record["solver"][:4] = (
                report.accepted,
                report.iterations,
                report.primal_residual,
                report.dual_residual,
            )
            record["leaves_corridor"] = excess is not None and bool((excess > _EXCESS).any())
            conclude(k, self.law, stages, work, self._memory, self._kept, tick)

    @property
    def plan(self) -> FloatArray:
        """Error, previous input and steps of the last tick, (16 + m + m Nc,), a copy."""
        return np.concatenate([self.mpc.work.given, self.mpc.work.steps])

    def predicted_paths(self, ticks: FloatArray, plans: FloatArray) -> FloatArray:
        """Return the paths of T ticks under their plans, (T, Np, 4), see `Diagnostics`."""
        at = np.asarray(ticks, dtype=int)
        return self.path.less(at, self.horizon.outputs(at, plans))

    def predicted_path(self, k: int) -> FloatArray:
        return self.path.less(k, self.horizon.planned(k, self.mpc.work))

    def diagnostics(self, k: int, tick: FloatArray) -> Diagnostics:
        """Return the view of the record of the last tick, `k`."""
        t = tick.view(TICK)[0]
        report = self.report or SolverReport("solved", True, int(t["solver"][1]), 0.0, 0.0, 0.0)
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

    def prepare(self, k: int) -> None:
        """Run tick `k` for the data of the last step and drop the result, to fill the caches."""
        if self._last:
            propose(
                k,
                *self._last,
                self.law,
                self.horizon.stages,
                self.mpc.beside,
                self._memory.copy(),
                self._kept.copy(),
                new_tick(),
                self.mpc.most,
            )


def law_of(kind: int, reference: FloatArray, feedforward: FloatArray, vehicle: Vehicle) -> Law:
    """Return the law of a kind without gains and sets, of which `Law._replace` makes others."""
    none = np.zeros((0, _M, _N))
    return Law(
        kind=kind,
        reference=reference,
        feedforward=feedforward,
        wheelbase=vehicle.wheelbase,
        time_constant=vehicle.speed_time_constant,
        disturbances=1.0,
        gains=none,
        limit=np.zeros(_M),
        forgetting=0.0,
        ancillary=none,
        reserve=np.zeros((0, 0, _M)),
        faces=np.zeros((0, _N)),
        rows=none,
        half_widths=np.zeros((0, 9)),
    )
