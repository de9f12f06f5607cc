"""Steering linkage: knuckle angles of the front wheels by Ackermann."""

from __future__ import annotations

from typing import Final

import numpy as np

from ttempc.types import FloatArray

_SAMPLES: Final = 201


def knuckle_angle(delta: FloatArray, wheelbase: float, kingpin_y: float) -> FloatArray:
    """Return the angle [rad] of the knuckle at `kingpin_y` [m], left positive (Ackermann).

    tan(knuckle) = L tan(delta) / (L - y tan(delta))
    """
    tangent = np.tan(delta)
    return np.arctan2(wheelbase * tangent, wheelbase - kingpin_y * tangent)


def linkage_polynomial(limit: float, wheelbase: float, kingpin_y: float) -> FloatArray:
    """Return the quartic in delta nearest to `knuckle_angle` over +-limit [rad], (5,).

    Order 0 first. MuJoCo couples joints by a quartic. The least-squares fit has no constant: at
    delta = 0 both wheels are straight.
    """
    delta = np.linspace(-limit, limit, _SAMPLES)
    powers = delta[:, None] ** np.arange(1, 5)  # (samples, 4)
    angle = knuckle_angle(delta, wheelbase, kingpin_y)
    return np.concatenate([[0.0], np.linalg.lstsq(powers, angle, rcond=None)[0]])
