"""The shape of the ground: a grid of heights, rough after ISO 8608, tilted, or read from a file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from testbed.errors import InvalidField
from ttempc.types import FloatArray

# Geometric means G_d(n0) of the classes [m^3] at n0 = 0.1 cycle/m; ISO 8608:2016, table C.1.
# (The class limits are half and double these; some public code returns the upper limit.)
ISO_8608: Final = {letter: 16e-6 * 4**i for i, letter in enumerate("ABCDEF")}
REFERENCE_FREQUENCY: Final = 0.1  # n0 [cycle/m]; ISO 8608
LOWEST_FREQUENCY: Final = 0.05  # [cycle/m]; longer waves are slopes, not roughness
HIGHEST_FREQUENCY: Final = 2.0  # [cycle/m]; shorter waves drown under the tyre

DEFAULT_SIZE_M: Final = (80.0, 50.0)  # figure eight of 50 x 20 m and 15 m around it
DEFAULT_SPACING_M: Final = 0.1  # five points on the shortest wave


@dataclass(frozen=True, slots=True, eq=False)
class Terrain:
    """Heights on a square grid over the map frame, bilinear in between.

    Raises:
        InvalidField: the grid is not 2-D, smaller than 2 x 2, or holds a number that is not finite.
    """

    heights: FloatArray  # (ny, nx) [m], row = y, column = x
    spacing_m: float  # between neighbours, along x and y
    origin: tuple[float, float]  # (x, y) [m] of heights[0, 0]

    def __post_init__(self) -> None:
        heights = np.ascontiguousarray(self.heights, dtype=np.float64)  # (ny, nx)
        if heights.ndim != 2 or min(heights.shape) < 2:
            raise InvalidField(f"terrain: got a {heights.shape} grid, must be 2-D, 2 x 2 or larger")
        if not np.isfinite(heights).all():
            row, column = np.argwhere(~np.isfinite(heights))[0]
            raise InvalidField(
                f"terrain: got {heights[row, column]} at row {row}, column {column}, "
                "every height must be finite"
            )
        if not (math.isfinite(self.spacing_m) and self.spacing_m > 0.0):
            raise InvalidField(f"terrain: got spacing {self.spacing_m} m, must be above 0")
        if not all(math.isfinite(value) for value in self.origin):
            raise InvalidField(f"terrain: got origin {self.origin}, must be finite")
        heights.setflags(write=False)
        object.__setattr__(self, "heights", heights)

    @property
    def size_m(self) -> tuple[float, float]:
        """Return the extent along x and y [m]."""
        ny, nx = self.heights.shape
        return (nx - 1) * self.spacing_m, (ny - 1) * self.spacing_m

    @property
    def centre(self) -> tuple[float, float]:
        """Return (x, y) [m] of the middle of the field."""
        return (
            self.origin[0] + 0.5 * self.size_m[0],
            self.origin[1] + 0.5 * self.size_m[1],
        )

    def contains(self, x: ArrayLike, y: ArrayLike, margin: float = 0.0) -> bool:
        """Return whether every point (x, y) [m] lies at least `margin` [m] inside the field."""
        u = np.asarray(x) - self.origin[0]
        v = np.asarray(y) - self.origin[1]
        inside = (
            (u >= margin)
            & (u <= self.size_m[0] - margin)
            & (v >= margin)
            & (v <= self.size_m[1] - margin)
        )
        return bool(np.all(inside))

    def height(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the height [m] at (x, y) [m]; beyond the field, that of its nearest edge."""
        ny, nx = self.heights.shape
        u = np.clip((np.asarray(x) - self.origin[0]) / self.spacing_m, 0.0, nx - 1.0)
        v = np.clip((np.asarray(y) - self.origin[1]) / self.spacing_m, 0.0, ny - 1.0)
        i = np.minimum(u.astype(np.int64), nx - 2)
        j = np.minimum(v.astype(np.int64), ny - 2)
        p, q = u - i, v - j
        south = (1.0 - p) * self.heights[j, i] + p * self.heights[j, i + 1]
        north = (1.0 - p) * self.heights[j + 1, i] + p * self.heights[j + 1, i + 1]
        return (1.0 - q) * south + q * north

    def tilted(self, slope_rad: float, uphill_rad: float = 0.0) -> Terrain:
        """Return this ground on a plane that rises by `slope_rad` towards `uphill_rad`.

        The direction is counter-clockwise from x; the plane is 0 at the middle of the field.

        Raises:
            InvalidField: the slope is not in [0, 1.2] rad.
        """
        if not 0.0 <= slope_rad <= 1.2:
            raise InvalidField(f"terrain: got slope {slope_rad} rad, must be in [0, 1.2]")
        if not math.isfinite(uphill_rad):
            raise InvalidField(f"terrain: got uphill direction {uphill_rad}, must be finite")
        ny, nx = self.heights.shape
        x = self.origin[0] + self.spacing_m * np.arange(nx) - self.centre[0]  # (nx,)
        y = self.origin[1] + self.spacing_m * np.arange(ny) - self.centre[1]  # (ny,)
        along = math.cos(uphill_rad) * x + math.sin(uphill_rad) * y[:, None]  # (ny, nx)
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
) -> Terrain:
    """Return an isotropic random field whose every straight section is of an ISO 8608 class.

    The one-sided spectrum of a section is G_d(n) = G_d(n0) (n/n0)^-2 between 0.05 and 2 cycles/m
    (ISO 8608:2016, eq. (C.1)) and 0 above. White noise is shaped by the two-dimensional spectrum
    that has these sections (see `_spectrum`).

    Raises:
        InvalidField: the class is not a letter A to F, or the size is out of range.
    """
    if iso_class not in ISO_8608:
        raise InvalidField(
            f"terrain: got class {iso_class!r}, must be one of {', '.join(ISO_8608)}"
        )
    shape, origin = _grid(size_m, spacing_m, centre)
    noise = np.fft.rfft2(generator.standard_normal(shape))
    ny, nx = shape
    n_x = np.fft.rfftfreq(nx, spacing_m)  # (nx//2 + 1,) [cycle/m]
    n_y = np.fft.fftfreq(ny, spacing_m)  # (ny,)
    frequency = np.hypot(n_x, n_y[:, None])  # (ny, nx//2 + 1)
    resolution = max(n_x[1], n_y[1])
    # unit white noise has the two-sided spectrum spacing^2
    gain = np.sqrt(_spectrum(frequency, ISO_8608[iso_class], resolution)) / spacing_m
    return Terrain(np.fft.irfft2(noise * gain, s=shape), spacing_m, origin)


def from_file(
    path: Path,
    spacing_m: float = DEFAULT_SPACING_M,
    centre: tuple[float, float] = (0.0, 0.0),
) -> Terrain:
    """Return the height map [m] in a .npy file, or in text with commas or blanks between numbers.

    Rows run along x, the first row is the southern edge.

    Raises:
        InvalidField: the file is missing, is no grid of numbers, or the grid is not usable.
    """
    try:
        if path.suffix == ".npy":
            heights = np.load(path, allow_pickle=False)
        else:
            lines = path.read_text(encoding="utf-8").replace(",", " ").splitlines()
            heights = np.loadtxt(lines, ndmin=2) if any(map(str.strip, lines)) else np.empty((0, 0))
        heights = np.asarray(heights, dtype=np.float64)
    except (OSError, ValueError, TypeError) as error:
        raise InvalidField(f"terrain file {path}: {_first_line(error)}") from error
    try:
        terrain = Terrain(heights, spacing_m, (0.0, 0.0))
        middle = terrain.centre
        return Terrain(heights, spacing_m, (centre[0] - middle[0], centre[1] - middle[1]))
    except InvalidField as error:
        raise InvalidField(f"terrain file {path}: {error}") from error


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def _grid(
    size_m: tuple[float, float], spacing_m: float, centre: tuple[float, float]
) -> tuple[tuple[int, int], tuple[float, float]]:
    """Return shape (ny, nx) and origin of a field; refuse what cannot be one."""
    if not (math.isfinite(spacing_m) and 0.0 < spacing_m <= 0.25):
        # two points on the shortest wave of the spectrum
        raise InvalidField(f"terrain: got spacing {spacing_m} m, must be above 0, at most 0.25")
    if not all(2.0 <= side <= 1000.0 for side in size_m):
        raise InvalidField(f"terrain: got size {size_m} m, each side must be in [2, 1000]")
    nx, ny = (round(side / spacing_m) + 1 for side in size_m)
    origin = (
        centre[0] - 0.5 * (nx - 1) * spacing_m,
        centre[1] - 0.5 * (ny - 1) * spacing_m,
    )
    return (ny, nx), origin


def _spectrum(frequency: FloatArray, roughness: float, resolution: float) -> FloatArray:
    """Return the two-sided isotropic spectrum [m^4] whose sections are G_d(n0) (n/n0)^-2.

    A section at frequency n collects all waves with that component along it,
    G(n) = 2 integral S(sqrt(n^2 + m^2)) dm. Solved for S (an Abel integral) with G cut off at
    K = 2 cycles/m:

        S(k) = G_d(n0) n0^2 / (4 k^3) * (2/pi) (theta + cot theta),   cos theta = k / K.

    The integrable pole at k = K is capped half a grid frequency below it.
    """
    inside = (frequency >= LOWEST_FREQUENCY) & (frequency < HIGHEST_FREQUENCY)
    k = np.where(inside, frequency, 1.0)
    cosine = np.minimum(k, HIGHEST_FREQUENCY - 0.5 * resolution) / HIGHEST_FREQUENCY
    theta = np.arccos(cosine)
    shape = (2.0 / np.pi) * (theta + cosine / np.sqrt(1.0 - cosine**2))
    power = roughness * REFERENCE_FREQUENCY**2 / (4.0 * k**3) * shape
    return np.where(inside, power, 0.0)
