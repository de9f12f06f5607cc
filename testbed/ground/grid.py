"""Grid: heights or strengths on a square grid over the map frame, from memory or a file."""

import io
import math
from dataclasses import dataclass
from pathlib import Path
from tokenize import TokenError
from typing import BinaryIO, ClassVar, Final, Self

import numpy as np
from numpy.typing import ArrayLike

from ttempc.types import FloatArray

from ..errors import InvalidField, first_line
from ..foreign_files import MOST_TEXT_BYTES, read_bounded

MOST_POINTS: Final = 20_000_000
"""Largest number of points of a grid: 160 MB, and eight times that while roughness is drawn."""

LARGEST: Final = 1e6  # of values and their negatives; squares and slopes stay finite


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Values on a square grid, bilinear in between; a subclass defines their meaning.

    Raises:
        InvalidField: the grid is not 2-D, smaller than 2 x 2, or holds a value that is NaN or huge.
    """

    what: ClassVar[str] = "grid"  # the noun that starts a refusal

    values: FloatArray  # (ny, nx), row = y, column = x
    spacing_m: float  # between neighbours, along x and y
    origin: tuple[float, float]  # (x, y) [m] of values[0, 0]

    def __post_init__(self) -> None:
        values = np.ascontiguousarray(self.values, dtype=np.float64)  # (ny, nx)
        if values.ndim != 2 or min(values.shape) < 2:
            raise InvalidField(
                f"{self.what}: got a {values.shape} grid, must be 2-D, 2 x 2 or larger"
            )
        wrong = ~(np.abs(values) <= LARGEST)
        self._refuse_where(wrong, values, f"every value must be finite, at most {LARGEST:g}")
        if not (math.isfinite(self.spacing_m) and self.spacing_m > 0.0):
            raise InvalidField(f"{self.what}: got spacing {self.spacing_m} m, must be above 0")
        if not all(math.isfinite(value) for value in self.origin):
            raise InvalidField(f"{self.what}: got origin {self.origin}, must be finite")
        values.setflags(write=False)
        object.__setattr__(self, "values", values)

    @classmethod
    def from_file(
        cls, path: Path, spacing_m: float, centre: tuple[float, float] = (0.0, 0.0)
    ) -> Self:
        """Return the grid in a .npy file, or in text with commas or blanks between numbers.

        Rows run along x, the first row is the southern edge.

        Raises:
            InvalidField: the file is missing or not a grid of numbers, or the grid is invalid.
        """
        where = f"{cls.what} file {path}"
        try:
            if path.suffix == ".npy":
                data = read_bounded(path, 8 * MOST_POINTS + 4096)
                check_array_header(io.BytesIO(data), len(data))
                values = np.load(io.BytesIO(data), allow_pickle=False)
            else:
                lines = read_bounded(path, MOST_TEXT_BYTES).decode().replace(",", " ").splitlines()
                some = any(line.partition("#")[0].strip() for line in lines)
                values = np.loadtxt(lines, ndmin=2) if some else np.empty((0, 0))
            values = values.astype(np.float64, casting="same_kind")  # refuses complex numbers
        except OSError as error:
            raise InvalidField(f"{where}: {error.strerror}") from error
        except (ValueError, TypeError, EOFError, TokenError) as error:
            raise InvalidField(f"{where}: {first_line(error)}") from error
        try:
            middle = cls(values, spacing_m, (0.0, 0.0)).centre
            return cls(values, spacing_m, (centre[0] - middle[0], centre[1] - middle[1]))
        except InvalidField as error:
            raise InvalidField(f"{where}: {error}") from error

    @property
    def size_m(self) -> tuple[float, float]:
        """Extent along x and y [m]."""
        ny, nx = self.values.shape
        return (nx - 1) * self.spacing_m, (ny - 1) * self.spacing_m

    @property
    def centre(self) -> tuple[float, float]:
        """(x, y) [m] of the middle of the grid."""
        return (self.origin[0] + 0.5 * self.size_m[0], self.origin[1] + 0.5 * self.size_m[1])

    def points(self) -> tuple[FloatArray, FloatArray]:
        """Return x (nx,) and y (ny, 1) [m] of the grid's points; together they make (ny, nx)."""
        ny, nx = self.values.shape
        x = self.origin[0] + self.spacing_m * np.arange(nx)
        y = self.origin[1] + self.spacing_m * np.arange(ny)
        return x, y[:, None]

    def inside(self, x: ArrayLike, y: ArrayLike, margin: float = 0.0) -> np.ndarray:
        """Return where (x, y) [m] lies at least `margin` [m] inside the grid, boolean."""
        u = np.asarray(x) - self.origin[0]
        v = np.asarray(y) - self.origin[1]
        return (
            (u >= margin)
            & (u <= self.size_m[0] - margin)
            & (v >= margin)
            & (v <= self.size_m[1] - margin)
        )

    def contains(self, x: ArrayLike, y: ArrayLike, margin: float = 0.0) -> bool:
        """Return whether every point (x, y) [m] lies at least `margin` [m] inside the grid."""
        if isinstance(x, float) and isinstance(y, float):  # numpy takes 8 us for one point
            (ny, nx) = self.values.shape
            (x0, y0) = self.origin
            side = self.spacing_m
            width = (nx - 1) * side
            depth = (ny - 1) * side
            return margin <= x - x0 <= width - margin and margin <= y - y0 <= depth - margin
        return bool(np.all(self.inside(x, y, margin)))

    def at(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the value at (x, y) [m]; beyond the grid, that of its nearest edge."""
        ny, nx = self.values.shape
        u = (np.asarray(x) - self.origin[0]) / self.spacing_m
        v = (np.asarray(y) - self.origin[1]) / self.spacing_m
        u = np.minimum(np.maximum(u, 0.0), nx - 1.0)  # np.clip takes ten times as long for a point
        v = np.minimum(np.maximum(v, 0.0), ny - 1.0)
        i = np.minimum(u.astype(np.int64), nx - 2)
        j = np.minimum(v.astype(np.int64), ny - 2)
        p = u - i
        q = v - j
        south = (1.0 - p) * self.values[j, i] + p * self.values[j, i + 1]
        north = (1.0 - p) * self.values[j + 1, i] + p * self.values[j + 1, i + 1]
        return (1.0 - q) * south + q * north

    def _refuse_where(self, wrong: np.ndarray, values: FloatArray, allowed: str) -> None:
        """Refuse the grid if a value is wrong; the message has the first one."""
        if wrong.any():
            row, column = np.argwhere(wrong)[0]
            raise InvalidField(
                f"{self.what}: got {values[row, column]} at row {row}, column {column}, {allowed}"
            )


def check_points(nx: int, ny: int, what: str) -> None:
    """Refuse a grid that takes too much memory, before it is made.

    Raises:
        InvalidField: with the number of points and the limit.
    """
    if nx * ny > MOST_POINTS:
        raise InvalidField(
            f"{what}: {nx} x {ny} points, must be {MOST_POINTS} in all or fewer: a smaller "
            "field or a larger spacing"
        )


def check_array_header(stream: BinaryIO, size: int) -> None:
    """Refuse a .npy array of `size` bytes that declares another size, before it is allocated.

    Raises:
        ValueError: with the declared size.
    """
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError("format of the array is not 1.0")
    shape, _, kind = np.lib.format.read_array_header_1_0(stream)
    declared = math.prod(shape) * kind.itemsize
    if declared != size - stream.tell():
        raise ValueError(f"declares {declared} bytes, has {size - stream.tell()}")
