"""Set of disturbances, bounded along its axes over windows of steps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np
import scipy

from ..errors import InvalidTube
from ..types import FloatArray

Shape = Literal["box", "zonotope", "ellipsoid"]

_ITERATIONS = 100  # of `worst`: within 1 % of the largest sum along the tubes of this project
_NOTHING = 1e-300  # multiplier of a step that no window limits


@dataclass(frozen=True)
class DisturbanceSet:
    """Sequences w(0), w(1), ... with bounded energy in every window of N successive steps.

    With y = axes^-1 w, in every window

        box, zonotope:  sum over the window of y_a^2 <= 1 for each axis a,
        ellipsoid:      sum over the window and all axes of y_a^2 <= 1.

    With N = 1 these are a box (axes along the coordinates), a zonotope (axes of principal
    components) and an ellipsoid for each single step. The energy of noise in a window is far less
    than N times the largest energy of a single step, so that a longer window bounds the same data
    more tightly: by a factor of 0.62 for white Gaussian noise, N = 5 and a coverage of 99.9 %.

    Raises:
        InvalidTube: the axes are not a regular square matrix, the window is not positive, or there
            is no such shape.
    """

    axes: FloatArray  # (n, n) a column for each axis, its length the half width along it
    window: int = 1  # N [steps]
    shape: Shape = "zonotope"

    def __post_init__(self) -> None:
        if self.window < 1:
            raise InvalidTube(f"window: got {self.window} steps, must be 1 or more")
        if self.shape not in get_args(Shape):
            raise InvalidTube(f"shape: got {self.shape!r}, must be one of {get_args(Shape)}")
        square = self.axes.ndim == 2 and self.axes.shape[0] == self.axes.shape[1]
        regular = square and bool(np.isfinite(self.axes).all())
        if not regular or np.linalg.matrix_rank(_scaled(self.axes)) < len(self.axes):
            raise InvalidTube(
                f"axes: got {self.axes.shape} with the lengths "
                f"{np.linalg.norm(self.axes, axis=0).tolist()}, must be square and of full rank"
            )

    @classmethod
    def through(
        cls, directions: FloatArray, floor: float, window: int = 1, shape: Shape = "zonotope"
    ) -> DisturbanceSet:
        """Return the set of w = E d, widened to full rank by `floor` along all other directions.

        The certificate of a tube needs a set with an interior; a small `floor` costs little width.

        Args:
            directions: E (n, g), a column for each entry of d, its length the half width along it.
            floor: half width along the orthogonal complement of the columns, above 0.
            window: N [steps].
            shape: of the set, see the class.

        Raises:
            InvalidTube: the columns depend on each other, or the floor is not above 0.
        """
        others = scipy.linalg.null_space(directions.T)
        return cls(np.hstack([directions, floor * others]), window, shape)

    @property
    def dimension(self) -> int:
        """Return n."""
        return len(self.axes)

    def fill(self, disturbances: FloatArray) -> FloatArray:
        """Return the gauge of every window of a run (k, n), at most 1 inside, (k - N + 1,)."""
        energy = np.linalg.solve(self.axes, disturbances.T) ** 2  # (n, k)
        windows = np.lib.stride_tricks.sliding_window_view(energy, self.window, axis=1).sum(axis=2)
        return np.sqrt(self._along(windows))

    def gauge(self, disturbance: FloatArray) -> float:
        """Return the gauge of a `disturbance` (n,) in the set of single steps, at most 1 inside."""
        return math.sqrt(self._along((self._inverse @ disturbance) ** 2))

    def _along(self, energies: FloatArray) -> FloatArray:
        """Return the bounded energy (...) from those along the axes (n, ...)."""
        return energies.sum(axis=0) if self.shape == "ellipsoid" else energies.max(axis=0)

    def reach(self, energies: FloatArray) -> FloatArray:
        """Return the largest weighted sum over a window, (...).

        `energies` (..., n) holds, for each axis, the sum over the window of the squared weights of
        its entries. By Cauchy and Schwarz each axis adds up to the root of its own; an ellipsoid
        adds up to the root of their sum.
        """
        if self.shape == "ellipsoid":
            return np.sqrt(energies.sum(axis=-1))
        return np.sqrt(energies).sum(axis=-1)

    def support(self, directions: FloatArray) -> FloatArray:
        """Return the support function of the set of single steps, (k,) for `directions` (k, n)."""
        return self.reach((directions @ self.axes) ** 2)

    @cached_property
    def _inverse(self) -> FloatArray:
        return np.linalg.inv(self.axes).astype(np.float64)

    @property
    def faces(self) -> tuple[FloatArray, float]:
        """Return rows f (n, n) and r: |f w| <= r for all f is sufficient for a step w inside."""
        inner = 1.0 / math.sqrt(self.dimension) if self.shape == "ellipsoid" else 1.0
        return self._inverse, inner

    def worst(self, coefficients: FloatArray) -> FloatArray:
        """Return an admissible run w (T, n) with a large sum of `coefficients` (T, n) times w.

        Every sliding window of the run lies in the set. Up to T = N the sum is the largest one. For
        more steps the dual problem, one multiplier for each window, is minimised by its majoriser:
        a multiplier is multiplied by the root of the energy in its window. The sum converges to the
        largest one from below.
        """
        along, axis = coefficients @ self.axes, 1 if self.shape == "ellipsoid" else None
        window = min(self.window, len(along))
        multipliers = np.ones((len(along) - window + 1, 1 if axis else along.shape[1]))
        y, energy = along, multipliers
        for _ in range(_ITERATIONS if len(along) > window else 1):
            multipliers = multipliers * np.sqrt(energy)
            padded = np.pad(multipliers, ((window - 1,) * 2, (0, 0)))
            covering = _sliding_sums(padded, window)
            y = np.divide(along, covering, out=np.zeros_like(along), where=covering > _NOTHING)
            energy = _sliding_sums(y**2, window)
            energy = energy.sum(axis=1, keepdims=True) if axis else energy
        length = np.sqrt(energy.max(axis=0))
        return np.divide(y, length, out=np.zeros_like(y), where=length > 0.0) @ self.axes.T


def _sliding_sums(values: FloatArray, window: int) -> FloatArray:
    """Return the sums over every `window` successive rows, (k - window + 1, ...) for (k, ...)."""
    return np.lib.stride_tricks.sliding_window_view(values, window, axis=0).sum(axis=-1)


def _scaled(matrix: FloatArray) -> FloatArray:
    """Return the matrix with rows of unit length, so that its rank does not depend on units."""
    length = np.linalg.norm(matrix, axis=1, keepdims=True)
    return np.divide(matrix, length, out=np.zeros_like(matrix), where=length > 0.0)
