"""Soil layers: patches, gradients, maps and random fields of cone index."""

from __future__ import annotations

import math
from dataclasses import dataclass as stdlib_dataclass
from typing import Annotated, ClassVar, Final

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.types import FloatArray

from ..configuration.config_io import STRICT, BearingDeg, LengthM, PlaceM, StrengthKpa
from ..errors import InvalidField
from .grid import Grid

_PERIOD_LENGTHS: Final = 4.0  # correlation left between opposite edges of a random field: e^-4
_FAST: Final = 64  # Fourier transforms are fast for multiples of this size


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Patch:
    """A round patch of soil of another strength."""

    x_m: PlaceM
    """Centre, map frame."""
    y_m: PlaceM
    """Centre, map frame."""
    radius_m: LengthM
    """Radius."""
    cone_index_kpa: StrengthKpa
    """Cone index inside the patch."""

    @property
    def finest(self) -> float:
        """Diameter [m]."""
        return 2.0 * self.radius_m

    def over(self, below: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the cone index [kPa] at (x, y) [m] over that of the layers below [kPa]."""
        dx, dy = x - self.x_m, y - self.y_m
        covered = (dx / self.radius_m) ** 2 + (dy / self.radius_m) ** 2 <= 1.0
        return np.where(covered, self.cone_index_kpa, below)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Gradient:
    """Strength that changes linearly over a distance; it replaces the layers below.

    The first value holds up to (x, y) along the direction, the second one behind the distance.
    """

    from_kpa: StrengthKpa
    """Cone index before the gradient."""
    to_kpa: StrengthKpa
    """Cone index behind the gradient."""
    distance_m: LengthM
    """Length of the gradient; a very small one makes an edge between two soils."""
    x_m: PlaceM = 0.0
    """Start of the gradient, map frame."""
    y_m: PlaceM = 0.0
    """Start of the gradient, map frame."""
    towards_deg: BearingDeg = 0.0
    """Direction of the gradient, counter-clockwise from east."""

    @property
    def finest(self) -> float:
        """Infinite: a gradient has no width."""
        return math.inf

    def over(self, below: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the cone index [kPa] at (x, y) [m]."""
        direction = math.radians(self.towards_deg)
        along = math.cos(direction) * (x - self.x_m) + math.sin(direction) * (y - self.y_m)
        share = np.clip(along / self.distance_m, 0.0, 1.0)
        return (1.0 - share) * self.from_kpa + share * self.to_kpa


@stdlib_dataclass(frozen=True, slots=True, eq=False)
class StrengthMap(Grid):
    """Measured cone index [kPa] on a grid, bilinear in between; it replaces the layers below.

    Raises:
        InvalidField: the grid is not usable, or a cone index is not above 0.
    """

    what: ClassVar[str] = "soil map"

    def __post_init__(self) -> None:
        Grid.__post_init__(self)
        self._refuse_where(self.values <= 0.0, self.values, "every cone index must be above 0 kPa")

    @property
    def finest(self) -> float:
        """Infinite: a coarser grid samples fewer of the points of the map."""
        return math.inf

    def over(self, below: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the cone index [kPa] at (x, y) [m] over that of the layers below [kPa]."""
        inside = self.inside(x, y, -1e-9 * self.spacing_m)  # its last row despite rounding
        return np.where(inside, self.at(x, y), below)


@stdlib_dataclass(frozen=True, slots=True, eq=False)
class RandomField(Grid):
    """Factors of mean 1 that multiply the strength of the layers below, bilinear in between."""

    what: ClassVar[str] = "random soil"

    @property
    def finest(self) -> float:
        """Infinite: the field has the grid of the terrain."""
        return math.inf

    def over(self, below: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the cone index [kPa] at (x, y) [m] over that of the layers below [kPa]."""
        return below * self.at(x, y)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class RandomStrength:
    """Distribution of a log-normal random field that multiplies the strength of the soil.

    The logarithm is a stationary Gaussian field of correlation exp(-r / correlation_m), the
    exponential variogram of soil science, and of variance ln(1 + cv^2) and mean -variance/2, so
    that the factors have mean 1 and the given coefficient of variation.
    """

    coefficient_of_variation: Annotated[float, Field(ge=0, le=2)] = 0.3
    """Standard deviation over mean; assumed."""
    correlation_m: LengthM = 5.0
    """Correlation length; assumed."""

    def draw(self, generator: np.random.Generator, grid: Grid) -> RandomField:
        """Return a field on the points of a grid.

        It is drawn on a larger torus whose covariance a Fourier transform makes diagonal
        (circulant embedding: Dietrich and Newsam, SIAM J. Sci. Comput. 18 (1997) 1088).

        Raises:
            InvalidField: the correlation length is shorter than the spacing of the grid or longer
                than the grid.
        """
        spacing, longest = grid.spacing_m, max(grid.size_m)
        if not spacing <= self.correlation_m <= longest:
            raise InvalidField(
                f"random soil: got correlation length {self.correlation_m} m, must be at least the "
                f"grid's spacing, {spacing:g} m, and at most the field's length, {longest:g} m"
            )
        ny, nx = grid.values.shape
        spare = math.ceil(_PERIOD_LENGTHS * self.correlation_m / spacing)
        rows, columns = (_FAST * math.ceil((n + min(n, spare)) / _FAST) for n in (ny, nx))
        lag_y, lag_x = (
            spacing * np.minimum(np.arange(n), n - np.arange(n)) for n in (rows, columns)
        )
        distance = np.hypot(lag_x, lag_y[:, None])  # (rows, columns)
        correlation = np.exp(-distance / self.correlation_m)
        # On a torus of less than twice the field, the power may be negative: clip it.
        power = np.maximum(np.fft.rfft2(correlation).real, 0.0)
        noise = np.fft.rfft2(generator.standard_normal((rows, columns)))
        normal = np.fft.irfft2(noise * np.sqrt(power), s=(rows, columns))[:ny, :nx]
        variance = math.log1p(self.coefficient_of_variation**2)
        factors = np.exp(math.sqrt(variance) * normal - 0.5 * variance)
        return RandomField(factors, spacing, grid.origin)
