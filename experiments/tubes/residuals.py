"""What the error model leaves unexplained: one-step residuals of a recorded run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from proving_ground.testbed.recording.channels import CONTROL, ESTIMATE, STATE
from proving_ground.testbed.recording.record import Record
from ttempc.mpc.articulated_error import error_dynamics, error_state
from ttempc.reference.feedforward import exact_feedforward
from ttempc.reference.reference import Reference
from ttempc.types import Estimate, FloatArray, State

from ..errors import InvalidFit
from ..results.tracking import START_UP_S

_N = len(State)
_STATE = ("x_t_m", "y_t_m", "psi_t_rad", "psi_i_rad", "delta_t_rad", "delta_i_rad", "v_mps")
# In the order of `Disturbance` and `MapDisturbance`.
_DISTURBANCE = ("slip_t_rad", "slip_i_rad", "steering_rad", "drive_mps2", "wheel_slip")
_MAP_DISTURBANCE = ("side_x_rad", "side_y_rad", "climb_x", "climb_y")
_COMMAND = ("delta_t_rad_command", "delta_i_rad_command", "hp_command")
_SAME_TIME_S = 1e-6


@dataclass(frozen=True)
class Errors:
    """Errors z_e of one run at successive control ticks after start-up, seen and true.

    As `ttempc.mpc.articulated_error.error_state` has them.
    """

    tick: FloatArray  # (n,) whole numbers
    state: FloatArray  # (n, 16) of the estimate, with its disturbances
    true: FloatArray  # (n, 7)
    command: FloatArray  # (n, 3) as sent

    @property
    def seen(self) -> FloatArray:
        """Return the error of the estimate, (n, 7)."""
        return self.state[:, :_N]

    @property
    def estimation(self) -> FloatArray:
        """Return what the true error is less the seen one, (n, 7)."""
        return self.true - self.seen


@dataclass(frozen=True)
class Residuals:
    """What a step added to the error beside the model: w = z_e(k+1) - A z_e(k) - B u_e(k) + E s(k).

    The estimated disturbances, map disturbance included, are part of the model. `true` takes the
    true error at both ends of the step; `seen` that of the estimate, on which a controller acts.
    The two differ by what the estimator learns in that step, which a controller meets as a
    disturbance like any other.
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
    sample = reference.at(at)
    seen = record[ESTIMATE].columns(*_STATE, *_DISTURBANCE, *_MAP_DISTURBANCE)[first:last]
    rows = np.searchsorted(record[STATE].time_s, at)
    true = record[STATE].columns(*_STATE)[rows]
    rows = np.searchsorted(record[CONTROL].time_s, at)
    states = [_error(sample.state[k], row[:_N], row, reference) for k, row in enumerate(seen)]
    truths = [_error(sample.state[k], true[k], row, reference) for k, row in enumerate(seen)]
    return Errors(
        ticks[first:last],
        np.array(states),
        np.array(truths)[:, :_N],
        record[CONTROL].columns(*_COMMAND)[rows],
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
        state = np.concatenate([error, run.state[:, _N:]], axis=1)[:-1]
        return error[1:] - np.einsum("kij,kj->ki", a[tick, :_N], state) - driven

    return Residuals(seen=of(run.seen), true=of(run.true))


def _error(
    wanted: FloatArray, state: FloatArray, row: FloatArray, reference: Reference
) -> FloatArray:
    """Return (z_e, s, m) of a `state` (7,) with the disturbances in a `row` of the estimate."""
    last = _N + len(_DISTURBANCE)
    return error_state(
        wanted,
        Estimate(
            time_s=0.0,
            state=state,
            covariance=np.zeros((_N, _N)),
            trailer_xy=np.zeros(2),
            hitch_angle=0.0,
            disturbance=row[_N:last],
            map_disturbance=row[last:],
        ),
        reference.vehicle,
    )
