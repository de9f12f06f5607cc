"""Look-up in a grid, compiled for the kernels of wheels and tools."""

from __future__ import annotations

from ttempc.jit import cached_njit


@cached_njit(inline="always")
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
