"""The robust action: how far the vehicle is from its nominal state, and the saturated law on it."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np

from ..errors import InvalidTuning
from ..models.tracking_error import POSITIONS
from ..types import FloatArray


@dataclass(frozen=True, slots=True)
class RobustGains:
    """Gains of eq. (robustcontrollaw); the defaults are the paper's, hydrostat as a fraction.

    Raises:
        InvalidTuning: a gain is not finite or not above 0.
    """

    saturation: tuple[float, float, float] = (0.2, 0.1, 0.10)  # k_s [rad], [rad], fraction
    proportional: tuple[float, float, float] = (2.0, 1.0, 10.0)  # k_p [1/m]
    derivative: tuple[float, float, float] = (4.0, 2.0, 20.0)  # k_d [s/m]

    def __post_init__(self) -> None:
        for item in fields(self):
            values = getattr(self, item.name)
            if not all(math.isfinite(v) and v > 0.0 for v in values):
                raise InvalidTuning(f"{item.name}: got {values}, must be finite and above 0")


class Nominal:
    """The nominal tracking error zbar_e, which the paper uses and does not define.

    `one-step`: what the linear model predicted from the last error and feedback,

        zbar(k) = A_{k-1} z_e(k-1) + B_{k-1} u_b(k-1).

    `tube`: the nominal system of Mayne, Seron and Rakovic (2005), which starts at z_e and lives on
    its own; the MPC then acts on it, and keeping the vehicle near it is left to the robust law,

        zbar(k) = A_{k-1} zbar(k-1) + B_{k-1} u_b(k-1).

    Both start, and start again after a missed tick, at zbar = z_e.
    """

    def __init__(self, a: FloatArray, b: FloatArray, reading: Literal["one-step", "tube"]) -> None:
        self._a = a  # (N, n, n) held over one period
        self._b = b  # (N, n, m)
        self._tube = reading == "tube"
        self._state: FloatArray | None = None
        self._tick = -1

    def at(self, k: int, error: FloatArray) -> FloatArray:
        """Return zbar_e at tick `k`, where the measured tracking error is `error` (n,)."""
        return error if self._state is None or k != self._tick else self._state

    def mpc_state(self, nominal: FloatArray, error: FloatArray) -> FloatArray:
        """Return the state on which the MPC acts, (n,)."""
        return nominal if self._tube else error

    def advance(self, k: int, state: FloatArray, feedback: FloatArray) -> None:
        """Predict tick k + 1 from the MPC's `state` (n,) and the `feedback` u_b (m,)."""
        self._state = self._a[k] @ state + self._b[k] @ feedback
        self._tick = k + 1


class RobustLaw:
    """u_m = k_s tanh(k_p z_m + k_d z_m'), eq. (robustcontrollaw).

    z_m = sign * (zbar_e - z_e) of the four positions, within +-1 m; its derivative is a backward
    difference over one period, 0 at the start and after a missed tick.
    """

    def __init__(self, gains: RobustGains, sign: int, period_s: float) -> None:
        self._gains = tuple(
            zip(gains.saturation, gains.proportional, gains.derivative, strict=True)
        )
        self._sign = sign
        self._period = period_s
        self._last: tuple[int, list[float]] | None = None

    def step(self, k: int, nominal: FloatArray, error: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return u_m (3,) as (delta^t, lambda, HP) and z_m (4,) in the order x_t, y_t, x_i, y_i."""
        z_m = [
            max(-1.0, min(1.0, self._sign * (nominal[row] - error[row]))) for row in POSITIONS
        ]  # eq. (z2)
        before = self._last[1] if self._last and self._last[0] == k - 1 else z_m
        self._last = (k, z_m)
        x_t, y_t, _, y_i = (
            (now, (now - then) / self._period) for now, then in zip(z_m, before, strict=True)
        )
        action = [
            k_s * math.tanh(k_p * value + k_d * rate)
            for (k_s, k_p, k_d), (value, rate) in zip(self._gains, (y_t, y_i, x_t), strict=True)
        ]
        return np.array(action), np.array(z_m)
