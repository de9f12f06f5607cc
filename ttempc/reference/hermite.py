"""Piecewise cubic polynomial through values and slopes at knots.

`CubicHermiteSpline` of scipy is the same, and loads for longer than all of this package: every run
has a path along which a trailer is towed.
"""

from dataclasses import dataclass

import numpy as np

from ..types import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class CubicHermite:
    """Function with given values and slopes at its knots, cubic between them.

    Beyond the first and the last knot the cubics at the ends go on.
    """

    knots: FloatArray  # increasing (n,), n >= 2
    values: FloatArray  # at the knots (n,)
    slopes: FloatArray  # at the knots (n,), in units of value over those of knot

    def at(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the values and the slopes at any places (...)."""
        last = len(self.knots) - 2
        piece = np.clip(np.searchsorted(self.knots, places, side="right") - 1, 0, last)
        width = self.knots[piece + 1] - self.knots[piece]
        s = places - self.knots[piece]
        slope = self.slopes[piece]

        # f(s) = f_0 + f_0' s + b s^2 + a s^3 with f(h) = f_1 and f'(h) = f_1'
        mean_slope = (self.values[piece + 1] - self.values[piece]) / width
        excess = (slope + self.slopes[piece + 1] - 2.0 * mean_slope) / width
        b = (mean_slope - slope) / width - excess
        a = excess / width
        value = self.values[piece] + slope * s + b * (s * s) + a * (s * s * s)
        return value, slope + 2.0 * b * s + 3.0 * a * (s * s)
