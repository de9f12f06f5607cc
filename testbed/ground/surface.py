"""Look-ups on the ground's grid for kernels: heights bilinear, strength of the nearest point."""

from typing import NamedTuple, Self

from ttempc.jit import FAST, cached_njit
from ttempc.types import FloatArray

from ..kernel_options import INLINED
from .ground import Ground

_inlined = cached_njit(**INLINED, fastmath=FAST)


class Grid(NamedTuple):
    """Place of a grid in the map frame."""

    x: float  # [m] first grid point
    y: float  # [m]
    spacing: float  # [m]


class Surface(NamedTuple):
    """Shape and strength of the ground on one grid; arrays are (ny, nx)."""

    grid: Grid
    heights: FloatArray  # [m]
    cone_indices: FloatArray  # [kPa]

    @classmethod
    def of(cls, ground: Ground, heights: FloatArray | None = None) -> Self:
        """Return the surface of a ground, with heights in place of its own where they are given."""
        terrain = ground.terrain
        x, y = terrain.origin
        grid = Grid(float(x), float(y), float(terrain.spacing_m))
        return cls(grid, terrain.heights if heights is None else heights, ground.cone_index)


@_inlined
def grid_cell(coordinate: float, last: int) -> tuple[int, float]:
    """Return the grid cell and the place in it, 0 to 1; beyond the grid those of the border.

    The integer clamp also holds for NaN.

    Args:
        coordinate: along one axis of the grid, in cells.
        last: index of its last point.
    """
    coordinate = min(last, max(0.0, coordinate))
    index = max(0, min(int(coordinate), last - 1))
    return index, coordinate - index


@_inlined
def ground_below(surface: Surface, x: float, y: float) -> tuple[float, float]:
    """Return height [m] and cone index [kPa] of the ground at a place [m]."""
    grid = surface.grid
    heights = surface.heights
    ny, nx = heights.shape
    per_metre = 1.0 / grid.spacing
    i, p = grid_cell((x - grid.x) * per_metre, nx - 1)
    j, q = grid_cell((y - grid.y) * per_metre, ny - 1)

    south = heights[j, i] + p * (heights[j, i + 1] - heights[j, i])
    north = heights[j + 1, i] + p * (heights[j + 1, i + 1] - heights[j + 1, i])
    cone_index = surface.cone_indices[j + (q >= 0.5), i + (p >= 0.5)]
    return south + q * (north - south), cone_index
