"""Saturated robust law of the paper on the modelling error."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from ..models.tracking_error import POSITIONS
from ..types import FloatArray, Input
from ..validation import check_vector


@dataclass(frozen=True)
class RobustGains:
    """Gains of eq. (robustcontrollaw), in the order of `Input`.

    The defaults are the paper's, with the hydrostat as a fraction. The front steering acts on y of
    the tractor, the trailer steering on y of the trailer, the hydrostat on x of the tractor.

    Raises:
        InvalidTuning: a gain is not finite or not above 0.
    """

    saturation: tuple[float, float, float] = (0.2, 0.1, 0.10)  # k_s [rad], [rad], fraction
    proportional: tuple[float, float, float] = (2.0, 1.0, 10.0)  # k_p [1/m]
    derivative: tuple[float, float, float] = (4.0, 2.0, 20.0)  # k_d [s/m]

    def __post_init__(self) -> None:
        for item in fields(RobustGains):
            check_vector(item.name, getattr(self, item.name), len(Input))


class RobustLaw:
    """u_m = k_s tanh(k_p z_m + k_d z_m'), eq. (robustcontrollaw).

    z_m = sign * (zbar_e - z_e) of the four positions, within +-1 m. Its derivative is a backward
    difference over one period, 0 at the start and after a missed tick.
    """

    def __init__(self, gains: RobustGains, sign: int, period_s: float) -> None:
        self._gains = gains
        self._rows = tuple(zip(gains.saturation, gains.proportional, gains.derivative, strict=True))
        self._sign = sign
        self._period_s = period_s
        self._last: tuple[int, list[float]] | None = None  # tick and z_m

    def fresh(self) -> RobustLaw:
        """Return the law before its first tick."""
        return RobustLaw(self._gains, self._sign, self._period_s)

    def step(self, k: int, nominal: FloatArray, error: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the action and the modelling error of tick `k`.

        Args:
            k: the tick.
            nominal: zbar_e (7,), see `NominalState`.
            error: z_e (7,), see `Error`.

        Returns:
            u_m (3,) as (delta^t, lambda, HP), and z_m (4,) [m] in the order x_t, y_t, x_i, y_i.
        """
        z_m = [
            max(-1.0, min(1.0, self._sign * (nominal[row] - error[row]))) for row in POSITIONS
        ]  # eq. (z2)
        before = self._last[1] if self._last and self._last[0] == k - 1 else z_m
        self._last = (k, z_m)
        x_t, y_t, _, y_i = (
            (now, (now - then) / self._period_s) for now, then in zip(z_m, before, strict=True)
        )
        action = [
            k_s * math.tanh(k_p * value + k_d * rate)
            for (k_s, k_p, k_d), (value, rate) in zip(self._rows, (y_t, y_i, x_t), strict=True)
        ]
        return np.array(action), np.array(z_m)
