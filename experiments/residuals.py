"""What the error model leaves unexplained: one-step residuals of a recorded run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from experiments.errors import InvalidFit
from experiments.tracking import START_UP_S
from testbed.channels import CONTROL, ESTIMATE, STATE
from testbed.record import Record, Table
from ttempc.articulated import error_dynamics
from ttempc.feedforward import exact_feedforward
from ttempc.prediction import rotation
from ttempc.reference import Reference
from ttempc.types import Disturbance, FloatArray, State

_N = len(State)
_STATE = ("x_t_m", "y_t_m", "psi_t_rad", "psi_i_rad", "delta_t_rad", "delta_i_rad", "v_mps")
_COMMAND = ("delta_t_rad_command", "delta_i_rad_command", "hp_command")
_SAME_TIME_S = 1e-6


@dataclass(frozen=True)
class Errors:
    """Errors z_e of one run at successive control ticks after start-up, seen and true.

    In the frame of the reference and in the order of `State`, as in `ttempc.articulated`.
    """

    tick: FloatArray  # (n,) whole numbers
    seen: FloatArray  # (n, 7) of the estimate
    true: FloatArray  # (n, 7)
    disturbance: FloatArray  # (n, d) as estimated
    command: FloatArray  # (n, 3) as sent

    @property
    def estimation(self) -> FloatArray:
        """Return what the true error is less the seen one, (n, 7)."""
        return self.true - self.seen


@dataclass(frozen=True)
class Residuals:
    """What a step added to the error beside the model: w = z_e(k+1) - A z_e(k) - B u_e(k) + E s(k).

    The estimated disturbance s is part of the model. `true` takes the true error at both ends of
    the step; `seen` that of the estimate, on which a controller acts. The two differ by what the
    estimator learns in that step, which a controller meets as a disturbance like any other.
    """

    seen: FloatArray  # (n - 1, 7)
    true: FloatArray  # (n - 1, 7)


def errors(record: Record, reference: Reference, period_s: float) -> Errors:
    """Return the errors of a run after start-up, up to the first tick that is missing.

    Raises:
        InvalidFit: the run is too short to have two ticks.
    """
    time_s = record[ESTIMATE].time_s
    ticks = np.round(time_s / period_s)
    kept = (time_s >= START_UP_S) & (np.abs(ticks * period_s - time_s) < _SAME_TIME_S)
    for table in (record[STATE], record[CONTROL]):
        kept &= np.isin(time_s, table.time_s)
    kept &= np.isfinite(record[ESTIMATE].columns(*_STATE)).all(axis=1)
    first = int(np.argmax(kept))
    gaps = np.flatnonzero(~kept[first:])
    last = first + int(gaps[0]) if len(gaps) else len(kept)
    if not kept.any() or last - first < 2:
        raise InvalidFit(
            f"the run has {int(kept.sum())} control ticks after {START_UP_S:g} s, at least 2 in a "
            "row are needed"
        )
    at = time_s[first:last]
    disturbance = record[ESTIMATE].values[first:last][:, _disturbance_columns()]
    sample = reference.at(at)
    turn = rotation(-sample.state[:, State.PSI_T])
    return Errors(
        ticks[first:last],
        _error(sample.state, record[ESTIMATE].columns(*_STATE)[first:last], turn),
        _error(sample.state, _at(record[STATE], at, _STATE), turn),
        disturbance,
        _at(record[CONTROL], at, _COMMAND),
    )


def residuals(run: Errors, reference: Reference, period_s: float) -> Residuals:
    """Return the one-step residuals of the errors of a run along its reference."""
    tick = run.tick[:-1].astype(int)
    count = int(tick[-1]) + 1
    a, b, _ = error_dynamics(reference, period_s, count)
    feedforward = exact_feedforward(reference, count, period_s)
    u_e = feedforward[tick] - run.command[:-1]  # (n - 1, 3)
    driven = np.einsum("kij,kj->ki", b[tick, :_N], u_e)

    def of(error: FloatArray) -> FloatArray:
        state = np.concatenate([error, run.disturbance], axis=1)[:-1]
        return error[1:] - np.einsum("kij,kj->ki", a[tick, :_N], state) - driven

    return Residuals(seen=of(run.seen), true=of(run.true))


def _error(reference: FloatArray, state: FloatArray, turn: FloatArray) -> FloatArray:
    """Return T (z_r - z), (n, 7)."""
    error = reference - state
    yaw = [State.PSI_T, State.PSI_I]
    error[:, yaw] = np.remainder(error[:, yaw] + np.pi, 2.0 * np.pi) - np.pi
    error[:, :2] = np.einsum("kij,kj->ki", turn, error[:, :2])
    return error


def _at(table: Table, time_s: FloatArray, names: tuple[str, ...]) -> FloatArray:
    rows = np.searchsorted(table.time_s, time_s)
    return table.columns(*names)[rows]


def _disturbance_columns() -> slice:
    """Return where the disturbances stand in a row of the estimate: in the order of the enum."""
    first = ESTIMATE.fields.index("slip_t_rad")
    return slice(first, first + len(Disturbance))
