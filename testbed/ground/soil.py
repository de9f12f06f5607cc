"""Soil strength: cone index as a function of position, and the layers that change it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass as stdlib_dataclass
from dataclasses import field
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, ClassVar, Final, Protocol

import numpy as np
import scipy
from numpy.typing import ArrayLike
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.types import FloatArray

from ..configuration.config_io import STRICT, BearingDeg, LengthM, PlaceM, StrengthKpa
from ..errors import InvalidField
from .grid import Grid
from .terrain import Terrain

if TYPE_CHECKING:
    from scipy.spatial import KDTree

_PERIOD_LENGTHS: Final = 4.0  # correlation left between opposite edges of a random field: e^-4
_FAST: Final = 64  # Fourier transforms are fast for multiples of this size
_STEP_OF_WIDTH: Final = 0.2  # of the points along a track: its edge is short by 1 % of its width

# Soils by name, cone index [kPa], all assumed: one loam, stronger as it dries, over the range of
# the traction equation. On "moist" the empty tractor slips little, on "wet" it slips and slides.
# Brixius' equation fits down to 225 kPa (Thangavadivelu 1994), so no weaker soil has a name. "hard"
# stands for asphalt or a dry farm road, which no cone penetrates: a finite strength above which the
# law changes little. There the motion resistance is 5 % of the load and the empty vehicle drives
# with 1.9 % slip.
NAMED_SOILS: Final[Mapping[str, float]] = MappingProxyType(
    {"hard": 2000.0, "dry": 1000.0, "moist": 600.0, "wet": 300.0}
)


class Layer(Protocol):
    """A layer that changes the strength of the layers below it."""

    @property
    def finest(self) -> float:
        """Smallest width [m] of its details; a grid must be finer."""
        ...

    def over(self, below: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the cone index [kPa] at (x, y) [m] where it was `below` [kPa]; all one shape."""
        ...


@stdlib_dataclass(frozen=True, slots=True)
class SoilMap:
    """A background of one strength and layers over it, in their order from below.

    Raises:
        InvalidField: the background is not finite and above 0.
    """

    background: float  # cone index [kPa]
    layers: tuple[Layer, ...] = field(default=())
    ruts: bool = False  # whether wheels press the ground

    def __post_init__(self) -> None:
        if not (math.isfinite(self.background) and self.background > 0.0):
            raise InvalidField(
                f"soil: got cone index {self.background} kPa, must be finite and above 0"
            )

    @classmethod
    def named(cls, name: str, layers: tuple[Layer, ...] = ()) -> SoilMap:
        """Return the soil of that name, with layers over it.

        Raises:
            InvalidField: no soil has that name.
        """
        if name not in NAMED_SOILS:
            raise InvalidField(f"soil: got {name!r}, must be one of {', '.join(NAMED_SOILS)}")
        return cls(NAMED_SOILS[name], layers)

    def cone_index(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the cone index [kPa] at (x, y) [m]."""
        east, north = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        strength = np.full(east.shape, self.background)
        for layer in self.layers:
            strength = layer.over(strength, east, north)
        return strength

    def rasterised(self, terrain: Terrain) -> FloatArray:
        """Return the cone index [kPa] at every point of the terrain's grid, (ny, nx).

        Raises:
            InvalidField: a layer has details narrower than the spacing of the grid.
        """
        for layer in self.layers:
            if layer.finest < terrain.spacing_m * (1.0 - 1e-9):
                raise InvalidField(
                    f"soil: got {type(layer).__name__.lower()} {layer.finest:g} m wide, must be "
                    f"as wide as the grid's spacing, {terrain.spacing_m:g} m"
                )
        return self.cone_index(*terrain.points())


# --- layers ---------------------------------------------------------------------------------------


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
        dx = x - self.x_m
        dy = y - self.y_m
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
        spacing = grid.spacing_m
        longest = max(grid.size_m)
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


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Tracks:
    """Two tracks of changed soil beside a line; the default ones are those of the tractor."""

    # Descriptions instead of docstrings, because subclasses do not inherit those.
    track_m: Annotated[
        float, Field(ge=1e-3, le=100, description="Distance between the middles of both tracks.")
    ] = 0.95
    width_m: Annotated[float, Field(ge=1e-3, le=100, description="Width of each track.")] = 0.3
    strength_factor: Annotated[
        float,
        Field(ge=0.05, le=20, description="Cone index in a track over that beside it; assumed."),
    ] = 1.5

    def __post_init__(self) -> None:
        if self.width_m > self.track_m:
            raise ValueError(
                f"got tracks {self.width_m} m wide and {self.track_m} m apart, "
                "the width must be at most the distance"
            )


@stdlib_dataclass(frozen=True, slots=True, eq=False)
class Tramlines:
    """Soil layer of two tracks beside every line; where tracks cross, they count once.

    Raises:
        InvalidField: there is no line, or a line has less than two points, no length or a point
            that is not finite.
    """

    lines: tuple[FloatArray, ...]  # each (n, 2) [m], the middle between both tracks
    tracks: Tracks

    _points: KDTree = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not self.lines:
            raise InvalidField("tramlines: got no line, must be one or more")
        lines = tuple(np.asarray(line, dtype=float) for line in self.lines)
        for line in lines:
            if line.ndim != 2 or line.shape[1:] != (2,) or len(line) < 2:
                raise InvalidField(f"tramlines: got a {line.shape} line, must be (2 or more, 2)")
            if not np.isfinite(line).all():
                raise InvalidField("tramlines: got a point that is not finite")
            if not np.any(line != line[0]):
                raise InvalidField(f"tramlines: got a line without length at {tuple(line[0])} m")
        object.__setattr__(self, "lines", lines)
        points = np.concatenate(list(self._track_points()))
        object.__setattr__(self, "_points", scipy.spatial.KDTree(points))

    @property
    def finest(self) -> float:
        """The width of a track [m]."""
        return self.tracks.width_m

    def over(self, below: FloatArray, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the cone index [kPa] at (x, y) [m] over that of the layers below [kPa]."""
        places = np.stack(np.broadcast_arrays(x, y), axis=-1)  # (..., 2)
        reach = 0.5 * self.tracks.width_m
        distance, _ = self._points.query(places, distance_upper_bound=reach * (1.0 + 1e-12))
        return np.where(np.isfinite(distance), self.tracks.strength_factor * below, below)

    def _track_points(self) -> Iterable[FloatArray]:
        """Yield the points along each track, (n, 2) [m]."""
        for line in self.lines:
            steps = np.diff(line, axis=0)
            steps = steps[np.any(steps != 0.0, axis=1)]  # (pieces, 2)
            lengths = np.linalg.norm(steps, axis=1)
            ends = np.concatenate([[0.0], np.cumsum(lengths)])  # (pieces + 1,)
            count = math.ceil(ends[-1] / (_STEP_OF_WIDTH * self.tracks.width_m)) + 1
            places = np.linspace(0.0, ends[-1], count)
            piece = np.clip(np.searchsorted(ends, places, "right") - 1, 0, len(steps) - 1)
            ahead = (steps / lengths[:, None])[piece]  # (count, 2)
            driven = line[0] + np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])[piece]
            driven += (places - ends[piece])[:, None] * ahead
            left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
            for side in (0.5, -0.5):
                yield driven + side * self.tracks.track_m * left
