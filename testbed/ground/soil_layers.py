"""Layers of soil: patches, gradients, maps and random fields of cone index."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import ClassVar, Final

import numpy as np

from ttempc.types import FloatArray

from ..errors import InvalidField
from .grid import Grid

_PERIOD_LENGTHS: Final = 4.0  # correlation left between opposite edges of a random field: e^-4
_FAST: Final = 64  # a Fourier transform is quick over multiples of it


def check_cone_index(what: str, value: float) -> None:
    """Refuse a cone index [kPa] that is not finite and above 0."""
    if not (math.isfinite(value) and value > 0.0):
        raise InvalidField(f"{what}: got cone index {value} kPa, must be finite and above 0")


@dataclass(frozen=True, slots=True)
class Patch:
    """An ellipse of other strength.

    Raises:
        InvalidField: a value is not finite, or a radius or the cone index is not above 0.
    """

    x: float  # [m] centre, map frame
    y: float  # [m]
    radius_x: float  # [m] semi-axis along the patch's own x
    radius_y: float  # [m]
    cone_index: float  # [kPa]
    angle: float = 0.0  # [rad] of the patch's own x in the map frame

    def __post_init__(self) -> None:
        check_cone_index("soil patch", self.cone_index)
        _check_finite("soil patch", self)
        for name in ("radius_x", "radius_y"):
            value = getattr(self, name)
            if value <= 0.0:
                raise InvalidField(f"soil patch: got {name} {value} m, must be above 0")

    @classmethod
    def circle(cls, x: float, y: float, radius: float, cone_index: float) -> Patch:
        """Return a round patch."""
        return cls(x, y, radius, radius, cone_index)

    @property
    def finest(self) -> float:
        """The smaller diameter [m]."""
        return 2.0 * min(self.radius_x, self.radius_y)

    def over(self, below: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the cone index [kPa] at (x, y) [m] where it was `below` [kPa]."""
        dx, dy = x - self.x, y - self.y
        along = math.cos(self.angle) * dx + math.sin(self.angle) * dy
        across = math.cos(self.angle) * dy - math.sin(self.angle) * dx
        covered = (along / self.radius_x) ** 2 + (across / self.radius_y) ** 2 <= 1.0
        return np.where(covered, self.cone_index, below)


@dataclass(frozen=True, slots=True)
class Gradient:
    """Strength that changes linearly from one value to another; it covers all that lies below.

    Up to (x, y) along its direction there is the first value, `distance` further on and beyond the
    second.

    Raises:
        InvalidField: a value is not finite, or distance or a cone index is not above 0.
    """

    x: float  # [m] where it begins, map frame
    y: float  # [m]
    direction: float  # [rad] counter-clockwise from x
    distance: float  # [m]; next to nothing makes a border between two soils
    first: float  # cone index [kPa]
    second: float  # [kPa]

    def __post_init__(self) -> None:
        for value in (self.first, self.second):
            check_cone_index("soil gradient", value)
        _check_finite("soil gradient", self)
        if self.distance <= 0.0:
            raise InvalidField(f"soil gradient: got distance {self.distance} m, must be above 0")

    @property
    def finest(self) -> float:
        """Infinite: it draws nothing narrow."""
        return math.inf

    def over(self, below: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the cone index [kPa] at (x, y) [m]."""
        along = math.cos(self.direction) * (x - self.x) + math.sin(self.direction) * (y - self.y)
        share = np.clip(along / self.distance, 0.0, 1.0)
        return (1.0 - share) * self.first + share * self.second


@dataclass(frozen=True, slots=True, eq=False)
class StrengthMap(Grid):
    """Measured cone index [kPa] on a grid, bilinear in between; beyond it what lies below holds.

    Raises:
        InvalidField: the grid is not usable, or a cone index is not above 0.
    """

    what: ClassVar[str] = "soil map"

    def __post_init__(self) -> None:
        Grid.__post_init__(self)
        self._refuse_where(self.values <= 0.0, self.values, "every cone index must be above 0 kPa")

    @property
    def finest(self) -> float:
        """Infinite: a coarser grid sees fewer of its points."""
        return math.inf

    def over(self, below: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the cone index [kPa] at (x, y) [m] where it was `below` [kPa]."""
        inside = self.inside(x, y, -1e-9 * self.spacing_m)  # its last row, whatever the rounding
        return np.where(inside, self.at(x, y), below)


@dataclass(frozen=True, slots=True, eq=False)
class RandomField(Grid):
    """Factors of mean 1 that multiply the strength of what lies below, bilinear in between."""

    what: ClassVar[str] = "random soil"

    @classmethod
    def drawn(
        cls,
        generator: np.random.Generator,
        grid: Grid,
        coefficient_of_variation: float,
        correlation_m: float,
    ) -> RandomField:
        """Return a log-normal random field on the points of a grid.

        The logarithm is a stationary Gaussian field of correlation exp(-r / correlation_m), the
        exponential variogram of soil science, and of variance ln(1 + cv^2) and mean -variance/2,
        so that the factors have mean 1 and the given coefficient of variation. It is drawn on a
        larger torus whose covariance a Fourier transform makes diagonal (circulant embedding:
        Dietrich and Newsam, SIAM J. Sci. Comput. 18 (1997) 1088).

        Raises:
            InvalidField: the coefficient of variation is not in [0, 2], or the correlation length
                is shorter than the spacing or longer than the field.
        """
        if not 0.0 <= coefficient_of_variation <= 2.0:
            raise InvalidField(
                f"random soil: got coefficient of variation {coefficient_of_variation}, "
                "must be in [0, 2]"
            )
        spacing, longest = grid.spacing_m, max(grid.size_m)
        if not spacing <= correlation_m <= longest:
            raise InvalidField(
                f"random soil: got correlation length {correlation_m} m, must be at least the "
                f"grid's spacing, {spacing:g} m, and at most the field's length, {longest:g} m"
            )
        ny, nx = grid.values.shape
        spare = math.ceil(_PERIOD_LENGTHS * correlation_m / spacing)
        rows, columns = (_FAST * math.ceil((n + min(n, spare)) / _FAST) for n in (ny, nx))
        lag_y, lag_x = (
            spacing * np.minimum(np.arange(n), n - np.arange(n)) for n in (rows, columns)
        )
        correlation = np.exp(-np.hypot(lag_x, lag_y[:, None]) / correlation_m)  # (rows, columns)
        # on a torus that is not twice the field it is not quite a covariance: clip what is below 0
        power = np.maximum(np.fft.rfft2(correlation).real, 0.0)
        noise = np.fft.rfft2(generator.standard_normal((rows, columns)))
        normal = np.fft.irfft2(noise * np.sqrt(power), s=(rows, columns))[:ny, :nx]
        variance = math.log1p(coefficient_of_variation**2)
        factors = np.exp(math.sqrt(variance) * normal - 0.5 * variance)
        return cls(factors, spacing, grid.origin)

    @property
    def finest(self) -> float:
        """Infinite: it has the points of the field."""
        return math.inf

    def over(self, below: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the cone index [kPa] at (x, y) [m] where it was `below` [kPa]."""
        return below * self.at(x, y)


def _check_finite(what: str, layer: Patch | Gradient) -> None:
    for item in fields(layer):
        value = getattr(layer, item.name)
        if not math.isfinite(value):
            raise InvalidField(f"{what}: got {item.name} {value}, must be finite")
