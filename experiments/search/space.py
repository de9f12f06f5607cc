"""Space of a search: bounded parameters of a scenario, their severity and their distributions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from scipy.stats import norm, truncnorm

from ttempc.types import FloatArray

from ..sweep.study import Scalar

BOUND_SD: Final = 3.0
"""Standard deviations from the nominal value to the farther bound; assumed."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A bounded parameter of a scenario.

    Its position is a number from 0 (`low`) to 1 (`high`), on a logarithmic scale if so spaced.
    """

    keys: tuple[str, ...]  # of the scenario, which have the same value
    low: float
    high: float
    nominal: float | None  # None: free, as a place or a direction, which is no severity
    spacing: Literal["linear", "log"] = "linear"
    step: float = 0.0  # values are whole multiples of it; 0: any value
    names: tuple[str, ...] = ()  # values of which `low` to `high` are the indices

    def position(self, value: float) -> float:
        """Return the position of a value."""
        if self.spacing == "log":
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    @property
    def nominal_position(self) -> float:
        """Return the position of the nominal value, of a free parameter the middle."""
        return 0.5 if self.nominal is None else self.position(self.nominal)

    def value(self, position: float) -> float:
        """Return the value at a position; of a named parameter the index of its name."""
        if self.spacing == "log":
            value = self.low * (self.high / self.low) ** position
        else:
            value = self.low + position * (self.high - self.low)
        step = 1.0 if self.names else self.step
        # Six digits, so that a scenario file shows 812.25, not 812.2495170431.
        value = round(round(value / step) * step, 12) if step else float(f"{value:.6g}")
        return min(max(value, self.low), self.high)

    def severity(self, position: float) -> float:
        """Return the distance from the nominal value over that of the farther bound, 0 to 1."""
        nominal = self.nominal_position
        distance = abs(self.position(self.value(position)) - nominal)
        return distance / max(nominal, 1.0 - nominal)

    def quantile(self, probability: FloatArray) -> FloatArray:
        """Return the positions at these probabilities of the parameter's distribution.

        A free parameter is uniform between its bounds. Any other is normal about its nominal value,
        with the farther bound at `BOUND_SD` standard deviations, and truncated at both bounds.
        """
        if self.nominal is None:
            return probability
        mean = self.nominal_position
        sd = max(mean, 1.0 - mean) / BOUND_SD
        return truncnorm.ppf(probability, -mean / sd, (1.0 - mean) / sd, loc=mean, scale=sd)


@dataclass(frozen=True)
class Space:
    """All parameters of a search; a point has a position for each, (n,)."""

    parameters: tuple[Parameter, ...]

    @property
    def nominal(self) -> FloatArray:
        """Return the nominal point, (n,)."""
        return np.array([parameter.nominal_position for parameter in self.parameters])

    @property
    def counted(self) -> FloatArray:
        """Return 1 for a parameter that counts as severity, 0 for a free one, (n,)."""
        return np.array([float(p.nominal is not None) for p in self.parameters])

    def severity(self, point: FloatArray) -> float:
        """Return the root mean square of the severities: 0 nominal, 1 every value at its bound."""
        pairs = zip(self.parameters, point.tolist(), strict=True)
        squares = [p.severity(x) ** 2 for p, x in pairs if p.nominal is not None]
        return math.sqrt(sum(squares) / len(squares))

    def changes(self, point: FloatArray) -> dict[str, Scalar]:
        """Return the values of all scenario keys at a point."""
        changes: dict[str, Scalar] = {}
        for parameter, position in zip(self.parameters, point.tolist(), strict=True):
            value = parameter.value(position)
            name = parameter.names[int(value)] if parameter.names else value
            changes |= dict.fromkeys(parameter.keys, name)
        return changes

    def from_normal(self, samples: Sequence[FloatArray] | FloatArray) -> FloatArray:
        """Return the points of independent standard normal samples, both (m, n)."""
        probability = norm.cdf(np.asarray(samples))
        columns = zip(self.parameters, probability.T, strict=True)
        return np.column_stack([parameter.quantile(column) for parameter, column in columns])
