"""Drawings of sets and tubes, on axes of the caller's."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..types import FloatArray
from .sets import ConvexSet, outline


class Axes(Protocol):
    """The methods of `matplotlib.axes.Axes` that are needed; this package does not import it."""

    def fill(self, x: ArrayLike, y: ArrayLike, **style: object) -> object:
        """Draw a filled polygon."""

    def fill_between(
        self, x: ArrayLike, low: ArrayLike, high: ArrayLike, **style: object
    ) -> object:
        """Draw a band."""


def draw_set(
    axes: Axes,
    of: ConvexSet,
    plane: tuple[int, int] = (0, 1),
    centre: FloatArray | None = None,
    **style: object,
) -> None:
    """Draw the projection of a bounded set onto two coordinates, moved to `centre` (n,).

    Args:
        axes: of matplotlib.
        of: the set; its outline is that of `ttempc.tube.sets.outline`.
        plane: horizontal and vertical coordinate.
        centre: by default the origin.
        style: keywords of `axes.fill`.
    """
    rows = np.eye(of.dimension)[list(plane)]
    corners = outline(of, rows) + (0.0 if centre is None else rows @ centre)
    axes.fill(corners[:, 0], corners[:, 1], **style)


def draw_band(
    axes: Axes, times: FloatArray, nominal: FloatArray, half_width: FloatArray, **style: object
) -> None:
    """Draw the band of a tube, `nominal` +- `half_width` (T,) of one coordinate over time (T,)."""
    axes.fill_between(times, nominal - half_width, nominal + half_width, **style)
