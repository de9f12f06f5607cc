"""Tick of the paper's controller on flat arrays: tracking error, robust law, linear MPC."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from ..jit import cached_njit, record
from ..laws.tracking_controller import FeedbackLaw, View, write_report
from ..layout import ESTIMATE, TICK, new_tick
from ..models.kinematics import POSITIONS, Error
from ..mpc.articulated_error import PredictedPath
from ..mpc.condensing import Stages, Work, solve_in_closed_form
from ..mpc.lmpc import CondensedHorizon, LinearMpc
from ..mpc.qp import BOUND_ACTIVE, CLOSED_FORM, CLOSED_FORM_REPORT
from ..reference.reference import ReferenceSample
from ..types import Diagnostics, FloatArray, Input, SolverReport, State

_N: Final = len(Error)
_M: Final = len(Input)
_P: Final = len(POSITIONS)
_PSI_T: Final = int(Error.PSI_T)
_PSI_I: Final = int(Error.PSI_I)
_MODELLING: Final = _N  # first entry of z_m in `TICK.tracking`

_REFERENCE: Final = 0
_ONE_STEP: Final = 1
_MODEL: Final = 2
NOMINALS: Final = {"reference": _REFERENCE, "one-step": _ONE_STEP, "model": _MODEL}
"""Values of `CONSTANTS.nominal` by their names."""

_HELD: Final = 1
_WORDS: Final = ("", "QP {}: previous feedback held")
"""Why the MPC's own action did not act, by `TICK.law`; {} is the solver's status."""

CONSTANTS: Final = np.dtype(
    [
        ("saturation", "f8", 3),  # k_s, in the order of `Input`
        ("proportional", "f8", 3),  # k_p [1/m]
        ("derivative", "f8", 3),  # k_d [s/m]
        ("sign", "f8"),  # of z_m = sign (zbar_e - z_e)
        ("period_s", "f8"),  # of control [s]
        ("nominal", "f8"),  # `_REFERENCE`, `_ONE_STEP`, `_MODEL`
        ("from_nominal", "f8"),  # 1 where the MPC predicts from zbar_e, 0 from z_e
        ("robust", "f8"),  # 1 where the robust law acts
        ("full_scale", "f8"),  # hydrostat position of the model at full stroke
    ]
)
"""Constants of a reading of the paper."""

MEMORY: Final = np.dtype(
    [
        ("last", "f8"),  # tick of the last step
        ("error", "f8", 7),  # z_e of this tick
        ("nominal", "f8", 7),  # zbar_e of this tick
        ("coming", "f8", 7),  # zbar_e of the coming tick
        ("modelling", "f8", 4),  # z_m of this tick: x_t, y_t, x_i, y_i [m]
        ("action", "f8", 3),  # u_m of this tick
        ("feedback", "f8", 3),  # u_b, the u_e(k - 1) of the coming tick
    ]
)
"""Memory of the law from tick to tick."""


class PaperTables(NamedTuple):
    """Arrays of the law along a reference."""

    constants: FloatArray  # record `CONSTANTS`
    poses: FloatArray  # of the reference: minimal state (7,), x and y of the trailer point, (N, 9)


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def robust_action(
    constants: FloatArray, modelling: FloatArray, before: FloatArray, action: FloatArray
) -> None:
    """Write u_m = k_s tanh(k_p z_m + k_d z_m') of eq. (robustcontrollaw) into `action` (3,).

    `modelling` is z_m (4,) in the order x_t, y_t, x_i, y_i, `before` that of the last tick: the
    derivative is a backward difference over one period.
    """
    of = record(constants, CONSTANTS)
    saturation = of.saturation
    proportional = of.proportional
    derivative = of.derivative
    for i in range(_M):
        # the front steering acts on y_t, the trailer's on y_i, the hydrostat on x_t
        row = 1
        if i == Input.DELTA_I:
            row = 3
        elif i == Input.HP:
            row = 0
        rate = (modelling[row] - before[row]) / of.period_s
        argument = proportional[i] * modelling[row] + derivative[i] * rate
        action[i] = saturation[i] * math.tanh(argument)


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def body_error(
    target_x: float,
    target_y: float,
    target_yaw: float,
    x: float,
    y: float,
    yaw: float,
    psi: int,
    error: FloatArray,
) -> None:
    """Write the error of one body in its own frame into `error`, its yaw into the entry `psi`.

    Rows of z_e = T (z_r - z), eq. (errorstate): x, y [m], psi in [-pi, pi].
    """
    along = target_x - x
    across = target_y - y
    cos = math.cos(yaw)
    sin = math.sin(yaw)
    error[psi - 2] = cos * along + sin * across
    error[psi - 1] = cos * across - sin * along
    turn = target_yaw - yaw
    error[psi] = turn - math.tau * math.floor(turn / math.tau + 0.5)


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def propose(
    k: int, estimate: FloatArray, tables: PaperTables, memory: FloatArray, work: Work
) -> None:
    """Write what the MPC of tick `k` starts from, and the robust action into the memory.

    `estimate` is a finite record `ESTIMATE`.
    """
    e = record(estimate, ESTIMATE)
    s = record(memory, MEMORY)
    of = record(tables.constants, CONSTANTS)
    state = e.state
    point = e.trailer_xy
    pose = tables.poses[k]
    error = s.error
    nominal = s.nominal
    coming = s.coming
    modelling = s.modelling
    feedback = s.feedback

    body_error(
        pose[State.X],
        pose[State.Y],
        pose[State.PSI_T],
        state[State.X],
        state[State.Y],
        state[State.PSI_T],
        _PSI_T,
        error,
    )
    body_error(
        pose[_N],
        pose[_N + 1],
        pose[State.PSI_I],
        point[0],
        point[1],
        state[State.PSI_I],
        _PSI_I,
        error,
    )
    error[Error.V] = pose[State.V] - state[State.V]

    # The nominal state starts at z_e, and again there after a missed tick.
    follows = s.last == k - 1
    for i in range(_N):
        nominal[i] = coming[i] if follows else error[i]
        if of.nominal == _REFERENCE:
            nominal[i] = 0.0
        work.state[i] = nominal[i] if of.from_nominal != 0.0 else error[i]
    for i in range(_M):
        work.previous[i] = feedback[i]

    before = np.empty(_P)
    for p in range(_P):
        before[p] = modelling[p]
        row = p if p < 2 else p + 1  # `POSITIONS` in z_e
        deviation = of.sign * (nominal[row] - error[row])
        modelling[p] = min(max(deviation, -1.0), 1.0)  # eq. (z2)
        if not follows:
            before[p] = modelling[p]
    action = s.action
    robust_action(tables.constants, modelling, before, action)
    for i in range(_M):
        action[i] *= of.robust


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def conclude(
    k: int,
    outcome: int,
    tables: PaperTables,
    stages: Stages,
    work: Work,
    memory: FloatArray,
    tick: FloatArray,
) -> None:
    """Write the actions of tick `k` into the record `TICK`, and zbar_e(k + 1) into the memory.

    The `outcome` is that of `solve_in_closed_form`; where it is another than `CLOSED_FORM` the
    record already has the report of a solver.
    """
    s = record(memory, MEMORY)
    t = record(tick, TICK)
    of = record(tables.constants, CONSTANTS)
    solver = t.solver
    control = t.control
    tracking = t.tracking
    feedback = s.feedback
    action = s.action
    modelling = s.modelling
    lower = stages.bounds.lower
    upper = stages.bounds.upper
    if outcome == CLOSED_FORM:
        solver.accepted = 1.0
        solver.iterations = 0.0
        solver.primal_residual = 0.0
        solver.dual_residual = 0.0
        solver.status = 0.0
    t.law = 0.0 if solver.accepted == 1.0 else _HELD

    # u = u_f - u_b + u_m, with the hydrostat back from the unit of the model
    for i in range(_M):
        wanted = work.previous[i] + work.steps[i]
        feedback[i] = min(max(wanted, lower[k, i]), upper[k, i])
        unit = 1.0 / of.full_scale if i == Input.HP else 1.0
        control[i, 1] = -feedback[i] * unit
        control[i, 2] = action[i] * unit
    for p in range(_P):
        tracking[_MODELLING + p] = modelling[p] if of.robust != 0.0 else math.nan

    start = s.nominal if of.nominal == _MODEL else s.error
    coming = s.coming
    for i in range(_N):
        total = 0.0
        for j in range(_N):
            total += stages.a[k, i, j] * start[j]
        for j in range(_M):
            total += stages.b[k, i, j] * feedback[j]
        coming[i] = total
    s.last = k


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def _drive(
    k: int,
    estimate: FloatArray,
    tables: PaperTables,
    stages: Stages,
    work: Work,
    memory: FloatArray,
    tick: FloatArray,
) -> int:
    """Propose, solve, and conclude where no solver is needed; return the outcome."""
    propose(k, estimate, tables, memory, work)
    outcome = solve_in_closed_form(k, stages, work)
    if outcome == CLOSED_FORM:
        conclude(k, outcome, tables, stages, work, memory, tick)
    return outcome


class PaperLaw(FeedbackLaw):
    """Linear MPC on the printed error model, and the tanh law on the modelling error.

    The paper uses a nominal tracking error zbar_e and does not define it (erratum 8). Readings:

    - `reference`: zbar = 0, the reference itself. The robust law is a saturated PD action on the
      tracking error.
    - `one-step`: the linear model's prediction from the previous error and feedback,
      zbar(k) = A_{k-1} z_e(k-1) + B_{k-1} u_b(k-1).
    - `model`: the linear model under the MPC's feedback alone,
      zbar(k) = A_{k-1} zbar(k-1) + B_{k-1} u_b(k-1).

    The last two start at zbar = z_e, and again there after a missed tick.
    """

    def __init__(
        self, grid: ReferenceSample, horizon: CondensedHorizon, tables: PaperTables
    ) -> None:
        self._tables = tables
        self._mpc = LinearMpc(horizon)
        self._memory = np.zeros(MEMORY.itemsize // 8)
        self._memory.view(MEMORY)[0]["last"] = -2.0
        self._path = PredictedPath(grid)
        self._positions = np.ascontiguousarray(horizon.stages.outputs[:, POSITIONS])
        self._estimate: FloatArray | None = None  # of the last step
        self.report: SolverReport | None = None  # of the last QP that a solver answered

    def resume(self, previous: object) -> None:
        """Keep the input of the last tick, see `ttempc.types.Controller.resume`.

        Where zbar is the reference the modelling error goes on too, whose derivative the robust law
        takes; a nominal error of the other readings is one to another reference, and starts anew.
        """
        if not isinstance(previous, PaperLaw):
            return
        mine = self._memory.view(MEMORY)[0]
        earlier = previous._memory.view(MEMORY)[0]
        mine["feedback"] = earlier["feedback"]
        if self._tables.constants.view(CONSTANTS)[0]["nominal"] == _REFERENCE:
            mine["modelling"] = earlier["modelling"]
            mine["last"] = earlier["last"]

    def act(self, k: int, row: FloatArray, view: View, sent: FloatArray, tick: FloatArray) -> None:
        """Write the actions of tick `k` into the record `TICK`, see `FeedbackLaw.act`."""
        self._estimate = row
        self.report = None
        mpc = self._mpc
        stages = mpc.horizon.stages
        outcome = _drive(k, row, self._tables, stages, mpc.work, self._memory, tick)
        if outcome != CLOSED_FORM:
            self.report, _ = mpc.complete(k, outcome)
            write_report(self.report, tick)
            conclude(k, outcome, self._tables, stages, mpc.work, self._memory, tick)

    def prepare(self, k: int) -> None:
        """Run tick `k` for the last estimate and drop the result, to fill the caches."""
        if self._estimate is None:
            return
        mpc = self._mpc
        memory = self._memory.copy()
        stages = mpc.horizon.stages
        _drive(k, self._estimate, self._tables, stages, mpc.preparing, memory, new_tick())

    def warm_up(self) -> None:
        """Solve the problem of the last step by the solver, which takes milliseconds at first."""
        self._mpc.complete(int(self._mpc.work.tick[0]), BOUND_ACTIVE)

    def predicted_path(self, k: int) -> FloatArray:
        """Return the path of tick `k` under the MPC's plan, (Np, 4) [m], map frame."""
        return self._path.under(k, self._mpc.work, self._positions[k + 1 :])

    def diagnostics(self, k: int, tick: FloatArray) -> Diagnostics:
        """Return the view of the record of the last tick, `k`."""
        t = tick.view(TICK)[0]
        report = self.report or CLOSED_FORM_REPORT
        modelling = t["tracking"][_MODELLING:]
        return Diagnostics(
            feedback=t["control"][:, 1].copy(),
            robust=t["control"][:, 2].copy(),
            modelling_error=None if np.isnan(modelling[0]) else modelling.copy(),
            predicted_path=self.predicted_path(k),
            solver=report,
            fallback=_WORDS[int(t["law"])].format(report.status),
        )
