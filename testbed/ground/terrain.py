"""Terrain: a grid of heights with ISO 8608 roughness, features and a slope."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from ttempc.types import FloatArray

from ..errors import InvalidField
from .features import Feature
from .grid import Grid, check_points

# Geometric means G_d(n0) of the classes [m^3] at n0 = 0.1 cycle/m; ISO 8608:2016, table C.1.
# (The class limits are half and double these; some public code returns the upper limit.)
ISO_8608: Final = {letter: 16e-6 * 4**i for i, letter in enumerate("ABCDEF")}
REFERENCE_FREQUENCY: Final = 0.1  # n0 [cycle/m]; ISO 8608
LOWEST_FREQUENCY: Final = 0.05  # [cycle/m]; longer waves are slopes, not roughness

DEFAULT_SHORTEST_WAVE_M: Final = 0.5  # shorter ones shake a machine, but hardly move its course
LEAST_SHORTEST_WAVE_M: Final = 0.2  # the contact area averages shorter waves

DEFAULT_SIZE_M: Final = (80.0, 50.0)  # figure eight of 50 x 20 m and 15 m around it
DEFAULT_SPACING_M: Final = 0.1  # five points on the shortest wave
_BLOCK_ROWS: Final = 256  # of a spectrum
LEAST_FLANK_CELLS: Final = 2  # a rise over less is a wall between two points of the grid


@dataclass(frozen=True, slots=True, eq=False)
class Terrain(Grid):
    """Heights [m] on a square grid over the map frame, bilinear in between."""

    what: ClassVar[str] = "terrain"

    @property
    def heights(self) -> FloatArray:
        """Heights [m] at the grid's points, (ny, nx), row = y, column = x."""
        return self.values

    def height(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the height [m] at (x, y) [m]; beyond the field, that of its nearest edge."""
        return self.at(x, y)

    def shaped(self, features: Iterable[Feature]) -> Terrain:
        """Return this terrain with the heights of features added to it.

        Raises:
            InvalidField: a feature lies outside the field, or is too fine for its grid.
        """
        features = tuple(features)
        if not features:
            return self
        x, y = self.points()
        heights = self.heights.copy()
        for feature in features:
            if feature.place and not self.contains(*feature.place):
                raise InvalidField(
                    f"{feature.kind}: got a place at {feature.place} m, must be on the field, "
                    f"{self.size_m[0]:g} x {self.size_m[1]:g} m "
                    f"about ({self.centre[0]:.1f}, {self.centre[1]:.1f})"
                )
            if feature.flank < LEAST_FLANK_CELLS * self.spacing_m * (1.0 - 1e-9):
                raise InvalidField(
                    f"{feature.kind}: rises over {feature.flank:g} m, must be "
                    f"{LEAST_FLANK_CELLS * self.spacing_m:g} m or more on a grid of "
                    f"{self.spacing_m:g} m"
                )
            heights += feature.height(x, y)
        return Terrain(heights, self.spacing_m, self.origin)

    def tilted(self, slope_rad: float, uphill_rad: float = 0.0) -> Terrain:
        """Return this terrain on a plane that rises by `slope_rad` towards `uphill_rad`.

        The direction is counter-clockwise from x; the plane is 0 at the middle of the field.

        Raises:
            InvalidField: the slope is not in [0, 1.2] rad.
        """
        if not 0.0 <= slope_rad <= 1.2:
            raise InvalidField(f"terrain: got slope {slope_rad} rad, must be in [0, 1.2]")
        if not math.isfinite(uphill_rad):
            raise InvalidField(f"terrain: got uphill direction {uphill_rad}, must be finite")
        if slope_rad == 0.0:
            return self
        x, y = self.points()
        x = x - self.centre[0]
        y = y - self.centre[1]
        along = math.cos(uphill_rad) * x + math.sin(uphill_rad) * y  # (ny, nx)
        return Terrain(self.heights + math.tan(slope_rad) * along, self.spacing_m, self.origin)


def flat(
    size_m: tuple[float, float] = DEFAULT_SIZE_M,
    spacing_m: float = DEFAULT_SPACING_M,
    centre: tuple[float, float] = (0.0, 0.0),
) -> Terrain:
    """Return level ground."""
    shape, origin = _grid(size_m, spacing_m, centre)
    return Terrain(np.zeros(shape), spacing_m, origin)


def rough(
    iso_class: str,
    generator: np.random.Generator,
    size_m: tuple[float, float] = DEFAULT_SIZE_M,
    spacing_m: float = DEFAULT_SPACING_M,
    centre: tuple[float, float] = (0.0, 0.0),
    shortest_wave_m: float = DEFAULT_SHORTEST_WAVE_M,
) -> Terrain:
    """Return an isotropic random field whose straight sections are of an ISO 8608 class.

    The one-sided spectrum of a section is G_d(n) = G_d(n0) (n/n0)^-2 (ISO 8608:2016, eq. (C.1))
    from 0.05 cycles/m up to the shortest wave, and 0 above. White noise is shaped by the
    two-dimensional spectrum that has these sections (see `_spectrum`).

    Args:
        iso_class: letter A to F.
        generator: of the white noise.
        size_m: extent along x and y [m].
        spacing_m: of the grid, at most half the shortest wave [m]. Straight lines between the
            points keep 0.41 of a wave of twice the spacing, 0.81 of one of four times.
        centre: of the field [m].
        shortest_wave_m: of the spectrum, from 0.2 m on.

    Raises:
        InvalidField: the class is not a letter A to F, or the size, the spacing or the shortest
            wave is out of range.
    """
    if iso_class not in ISO_8608:
        raise InvalidField(
            f"terrain: got class {iso_class!r}, must be one of {', '.join(ISO_8608)}"
        )
    longest_m = 1.0 / LOWEST_FREQUENCY
    if not LEAST_SHORTEST_WAVE_M <= shortest_wave_m < longest_m:
        raise InvalidField(
            f"terrain: got shortest wave {shortest_wave_m} m, must be at least "
            f"{LEAST_SHORTEST_WAVE_M:g}, below {longest_m:g}"
        )
    if not spacing_m <= 0.5 * shortest_wave_m:
        raise InvalidField(
            f"terrain: got spacing {spacing_m} m, must be at most {0.5 * shortest_wave_m:g}, "
            "half the shortest wave"
        )
    shape, origin = _grid(size_m, spacing_m, centre)
    noise = np.fft.rfft2(generator.standard_normal(shape))
    ny, nx = shape
    n_x = np.fft.rfftfreq(nx, spacing_m)  # (nx//2 + 1,) [cycle/m]
    n_y = np.fft.fftfreq(ny, spacing_m)  # (ny,)
    highest = 1.0 / shortest_wave_m
    resolution = max(n_x[1], n_y[1])
    # A block of rows at a time: the spectrum of a large field takes six times its memory.
    for first in range(0, ny, _BLOCK_ROWS):
        rows = slice(first, first + _BLOCK_ROWS)
        frequency = np.hypot(n_x, n_y[rows, None])  # (rows, nx//2 + 1)
        # unit white noise has the two-sided spectrum spacing^2
        power = _spectrum(frequency, ISO_8608[iso_class], highest, resolution)
        noise[rows] *= np.sqrt(power) / spacing_m
    return Terrain(np.fft.irfft2(noise, s=shape), spacing_m, origin)


def _grid(
    size_m: tuple[float, float], spacing_m: float, centre: tuple[float, float]
) -> tuple[tuple[int, int], tuple[float, float]]:
    """Return shape (ny, nx) and origin of a field; refuse impossible sizes."""
    if not (math.isfinite(spacing_m) and 0.0 < spacing_m <= 0.25):
        raise InvalidField(f"terrain: got spacing {spacing_m} m, must be above 0, at most 0.25")
    if not all(2.0 <= side <= 1000.0 for side in size_m):
        raise InvalidField(f"terrain: got size {size_m} m, each side must be in [2, 1000]")
    nx, ny = (round(side / spacing_m) + 1 for side in size_m)
    check_points(nx, ny, "terrain")
    origin = (centre[0] - 0.5 * (nx - 1) * spacing_m, centre[1] - 0.5 * (ny - 1) * spacing_m)
    return (ny, nx), origin


def _spectrum(
    frequency: FloatArray, roughness: float, highest: float, resolution: float
) -> FloatArray:
    """Return the two-sided isotropic spectrum [m^4] whose sections are G_d(n0) (n/n0)^-2.

    A section at frequency n collects all waves with that component along it,
    G(n) = 2 integral S(sqrt(n^2 + m^2)) dm. Solved for S (an Abel integral) with G cut off at
    the highest frequency K:

        S(k) = G_d(n0) n0^2 / (4 k^3) * (2/pi) (theta + cot theta),   cos theta = k / K.

    The integrable pole at k = K is capped half a grid frequency below it.
    """
    inside = (frequency >= LOWEST_FREQUENCY) & (frequency < highest)
    k = np.where(inside, frequency, 0.5 * highest)
    cosine = np.minimum(k, highest - 0.5 * resolution) / highest
    theta = np.arccos(cosine)
    shape = (2.0 / np.pi) * (theta + cosine / np.sqrt(1.0 - cosine**2))
    power = roughness * REFERENCE_FREQUENCY**2 / (4.0 * k**3) * shape
    return np.where(inside, power, 0.0)
