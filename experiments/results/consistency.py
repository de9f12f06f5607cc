"""Consistency of an estimator: its errors and innovations against the sizes that it claims."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ttempc.models.kinematics import wrap_angle
from ttempc.types import Estimate, FloatArray, Innovation, State

from ...testbed.recording.channels import STATE
from ...testbed.recording.record import Record
from .tracking_errors import START_UP_S

_TRUTH: Final = ("x_t_m", "y_t_m", "psi_t_rad", "psi_i_rad", "delta_t_rad", "delta_i_rad", "v_mps")
_SAME_TIME_S: Final = 1e-6


@dataclass(frozen=True, slots=True)
class StateConsistency:
    """Error (estimate less truth) of one state in its SI unit."""

    name: str
    bias: float
    rms: float
    claimed: float  # root mean square of the claimed standard deviation
    nees: float  # mean normalised estimation error squared: 1 where the claim is true


@dataclass(frozen=True, slots=True)
class SensorConsistency:
    """Innovations of one sensor; with a true model they are white with covariance 1."""

    name: str
    samples: int
    entries: int  # of all samples together
    rejected: int  # samples that the innovation gate rejected
    nis: float  # mean normalised innovation squared per entry
    autocorrelation: float  # of the whitened innovations, from one sample to the next
    log_likelihood: float  # of all samples, rejected ones included


@dataclass(frozen=True, slots=True)
class Consistency:
    """Figures of an estimator over a run without its first `START_UP_S`."""

    states: tuple[StateConsistency, ...]
    sensors: tuple[SensorConsistency, ...]
    position_nees: float  # of x and y together, by two: 1 where the claimed covariance is true
    heading_nees: float  # of both yaws together, by two
    tractor_m: float  # mean distance of the estimated points from the true ones
    trailer_m: float

    @property
    def nis(self) -> float:
        """Mean normalised innovation squared per entry of all samples; NaN without any."""
        entries = sum(sensor.entries for sensor in self.sensors)
        weighted = sum(item.entries * item.nis for item in self.sensors)
        return weighted / entries if entries else math.nan

    @property
    def log_likelihood(self) -> float:
        """Log-likelihood of all samples."""
        return sum(sensor.log_likelihood for sensor in self.sensors)


def consistency(estimates: Sequence[Estimate], record: Record) -> Consistency:
    """Return the figures of estimates against the truth of the run from which they come.

    Only estimates at times with a row of the truth count. Figures without data are NaN.
    """
    table = record[STATE]
    time_s = np.array([estimate.time_s for estimate in estimates])
    row = np.searchsorted(table.time_s, time_s - _SAME_TIME_S)
    kept = [
        k
        for k in np.flatnonzero((time_s >= START_UP_S) & (row < len(table))).tolist()
        if abs(table.time_s[row[k]] - time_s[k]) <= _SAME_TIME_S
        and np.isfinite(estimates[k].state).all()
    ]
    used = [estimates[k] for k in kept]
    row = row[kept]
    error = (
        np.reshape([item.state for item in used], (-1, len(State))) - table.columns(*_TRUTH)[row]
    )
    for angle in (State.PSI_T, State.PSI_I):
        error[:, angle] = [wrap_angle(value) for value in error[:, angle].tolist()]
    covariance = np.reshape([item.covariance for item in used], (-1, len(State), len(State)))
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    trailer = np.reshape([item.trailer_xy for item in used], (-1, 2))
    trailer = trailer - table.columns("x_i_m", "y_i_m")[row]
    return Consistency(
        states=tuple(
            StateConsistency(
                state.name.lower(),
                bias=_mean(error[:, state]),
                rms=math.sqrt(_mean(error[:, state] ** 2)),
                claimed=math.sqrt(_mean(variance[:, state])),
                nees=_mean(error[:, state] ** 2 / variance[:, state]),
            )
            for state in State
        ),
        sensors=_sensors(used),
        position_nees=_joint_nees(error, covariance, [State.X, State.Y]),
        heading_nees=_joint_nees(error, covariance, [State.PSI_T, State.PSI_I]),
        tractor_m=_mean(np.hypot(*error[:, : State.PSI_T].T)),
        trailer_m=_mean(np.hypot(*trailer.T)),
    )


def format_consistency(figures: Consistency) -> list[str]:
    """Return the figures as lines of text."""
    lines = [f"{'state':<16}{'bias':>11}{'rms error':>11}{'claimed':>11}{'NEES':>8}"]
    lines += [
        f"{item.name:<16}{item.bias:>11.5f}{item.rms:>11.5f}{item.claimed:>11.5f}{item.nees:>8.2f}"
        for item in figures.states
    ]
    heads = f"{'samples':>8}{'rejected':>9}{'NIS':>8}{'autocorr.':>11}{'log-likelihood':>16}"
    lines += ["", f"{'sensor':<18}{heads}"]
    lines += [
        f"{item.name:<18}{item.samples:>8}{item.rejected:>9}{item.nis:>8.3f}"
        f"{item.autocorrelation:>11.3f}{item.log_likelihood:>16.1f}"
        for item in figures.sensors
    ]
    return [
        *lines,
        f"{'all':<35}{figures.nis:>8.3f}{figures.log_likelihood:>27.1f}",
        "",
        f"mean distance of the estimated points from the true ones: tractor "
        f"{100.0 * figures.tractor_m:.2f} cm, trailer {100.0 * figures.trailer_m:.2f} cm",
    ]


def _joint_nees(error: FloatArray, covariance: FloatArray, states: list[State]) -> float:
    """Return the mean of e' P^-1 e over the number of states, of errors e (n, 7), P (n, 7, 7)."""
    of_states = error[:, states]
    block = covariance[:, states][:, :, states]
    weighted = np.linalg.solve(block, of_states[:, :, None])[:, :, 0]
    return _mean(np.sum(of_states * weighted, axis=1)) / len(states)


def _sensors(estimates: Sequence[Estimate]) -> tuple[SensorConsistency, ...]:
    by_sensor: dict[str, list[Innovation]] = {}
    for estimate in estimates:
        for item in estimate.innovations:
            if item.whitened and math.isfinite(item.normalised_squared):
                by_sensor.setdefault(item.sensor, []).append(item)
    return tuple(_sensor(name, items) for name, items in by_sensor.items())


def _sensor(name: str, items: Sequence[Innovation]) -> SensorConsistency:
    """Return the figures of one sensor; the log-likelihood is for Gaussian innovations."""
    whitened = np.array([item.whitened for item in items])  # (n, m)
    determinants = np.array([item.log_determinant for item in items])
    power = float(np.sum(whitened**2))
    constant = whitened.size * math.log(2.0 * math.pi)
    return SensorConsistency(
        name=name,
        samples=len(items),
        entries=whitened.size,
        rejected=sum(not item.accepted for item in items),
        nis=power / whitened.size,
        autocorrelation=float(np.sum(whitened[1:] * whitened[:-1])) / power,
        log_likelihood=-0.5 * (power + float(determinants.sum()) + constant),
    )


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if len(values) else math.nan
