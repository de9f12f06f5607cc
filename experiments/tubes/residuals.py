"""One-step residuals of the error model in a recorded run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ttempc.mpc.articulated_error import error_dynamics, error_state
from ttempc.reference.reference import Reference, exact_feedforward
from ttempc.types import Estimate, FloatArray, State

from ...testbed.recording.channels import CONTROL, ESTIMATE, STATE
from ...testbed.recording.record import Record
from ..errors import InvalidFit
from ..results.tracking_errors import START_UP_S

_N = len(State)
_STATE = ("x_t_m", "y_t_m", "psi_t_rad", "psi_i_rad", "delta_t_rad", "delta_i_rad", "v_mps")
# In the order of `Disturbance` and `MapDisturbance`.
_DISTURBANCE = ("slip_t_rad", "slip_i_rad", "steering_rad", "drive_mps2", "wheel_slip")
_MAP_DISTURBANCE = ("side_x_rad", "side_y_rad", "climb_x", "climb_y")
_COMMAND = ("delta_t_rad_command", "delta_i_rad_command", "hp_command")
_SAME_TIME_S = 1e-6


@dataclass(frozen=True)
class RunErrors:
    """Estimated and true errors of one run at consecutive control ticks after start-up.

    The error is that of `ttempc.mpc.articulated_error.error_state`.
    """

    tick: FloatArray  # (n,) whole numbers
    state: FloatArray  # (n, 16) error of the estimate, with the estimated disturbances
    true: FloatArray  # (n, 7)
    command: FloatArray  # (n, 3) as sent

    @property
    def estimated(self) -> FloatArray:
        """Error z_e of the estimate, (n, 7)."""
        return self.state[:, :_N]

    @property
    def estimation(self) -> FloatArray:
        """True error minus estimated error, (n, 7)."""
        return self.true - self.estimated


@dataclass(frozen=True)
class Residuals:
    """One-step residuals w = z_e(k+1) - A z_e(k) - B u_e(k) + E s(k).

    The estimated disturbances s, map disturbance included, are part of the model. `true` takes the
    true error at both ends of the step, `estimated` the error of the estimate, on which a
    controller acts. They differ by the correction of the estimate in that step, which is one more
    disturbance to the controller.
    """

    estimated: FloatArray  # (n - 1, 7)
    true: FloatArray  # (n - 1, 7)


def run_errors(record: Record, reference: Reference, period_s: float) -> RunErrors:
    """Return the errors of a run from the end of start-up to the first missing tick.

    Raises:
        InvalidFit: there are fewer than two consecutive ticks.
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
    estimates = record[ESTIMATE].columns(*_STATE, *_DISTURBANCE, *_MAP_DISTURBANCE)[first:last]
    true = record[STATE].columns(*_STATE)[np.searchsorted(record[STATE].time_s, at)]
    command = record[CONTROL].columns(*_COMMAND)[np.searchsorted(record[CONTROL].time_s, at)]
    states = [_error(sample.state[k], row[:_N], row, reference) for k, row in enumerate(estimates)]
    truths = [_error(sample.state[k], true[k], row, reference) for k, row in enumerate(estimates)]
    return RunErrors(
        tick=ticks[first:last],
        state=np.array(states),
        true=np.array(truths)[:, :_N],
        command=command,
    )


def residuals(run: RunErrors, reference: Reference, period_s: float) -> Residuals:
    """Return the one-step residuals of a run along its reference."""
    tick = run.tick[:-1].astype(int)
    count = int(tick[-1]) + 1
    a, b, _ = error_dynamics(reference, period_s, count)
    feedforward = exact_feedforward(reference, count, period_s)
    u_e = feedforward[tick] - run.command[:-1]  # (n - 1, 3)
    driven = np.einsum("kij,kj->ki", b[tick, :_N], u_e)

    def residual(error: FloatArray) -> FloatArray:
        state = np.concatenate([error, run.state[:, _N:]], axis=1)[:-1]
        return error[1:] - np.einsum("kij,kj->ki", a[tick, :_N], state) - driven

    return Residuals(estimated=residual(run.estimated), true=residual(run.true))


def _error(
    reference_state: FloatArray, state: FloatArray, estimate: FloatArray, reference: Reference
) -> FloatArray:
    """Return the augmented error (z_e, s, m), (16,).

    Args:
        reference_state: (7,).
        state: estimated or true state, (7,).
        estimate: row of the estimate whose disturbances are taken, (16,).
        reference: along which the run was driven.
    """
    end = _N + len(_DISTURBANCE)
    return error_state(
        reference_state,
        Estimate(
            time_s=0.0,
            state=state,
            covariance=np.zeros((_N, _N)),
            trailer_xy=np.zeros(2),
            hitch_angle=0.0,
            disturbance=estimate[_N:end],
            map_disturbance=estimate[end:],
        ),
        reference.vehicle,
    )
