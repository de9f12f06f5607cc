"""Convex sets given by their support functions.

A closed convex set S is determined by h_S(a) = max {a'x : x in S}. Sums and linear maps are exact
in it, h_{S+T} = h_S + h_T and h_{MS}(a) = h_S(M'a). No vertex is enumerated, so that seven
dimensions and hundreds of terms cost little.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from ..errors import InvalidTube
from ..types import FloatArray


@dataclass(frozen=True)
class SupportSet:
    """A convex set given by its support function."""

    dimension: int
    function: Callable[[FloatArray], FloatArray]  # (k, n) -> (k,)

    def support(self, directions: FloatArray) -> FloatArray:
        """Return h(a) of each of the `directions` (k, n), (k,)."""
        return self.function(directions)


def minkowski_sum(sets: Sequence[SupportSet | DisturbanceSet]) -> SupportSet:
    """Return {x_1 + x_2 + ... : x_j in set j}."""
    dimension = sets[0].dimension
    return SupportSet(dimension, lambda a: np.sum([one.support(a) for one in sets], axis=0))


def linear_map(matrix: FloatArray, of: SupportSet | DisturbanceSet) -> SupportSet:
    """Return {matrix x : x in `of`}, `matrix` (m, n)."""
    return SupportSet(len(matrix), lambda a: of.support(a @ matrix))


def outline(of: SupportSet | DisturbanceSet, plane: FloatArray, count: int = 180) -> FloatArray:
    """Return the vertices of a polygon around the projection onto `plane` (2, n), (`count`, 2).

    The polygon is bounded by the tangents in `count` directions. It contains the projection, whose
    diameter be D, and no point of it is farther away than D / 2 tan(pi / `count`).
    """
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)  # (count, 2)
    reach = of.support(normal @ plane)
    pairs = np.stack([normal, np.roll(normal, -1, axis=0)], axis=1)  # neighbouring tangents
    corners = np.linalg.solve(pairs, np.stack([reach, np.roll(reach, -1)], axis=1)[..., None])
    return np.asarray(corners[..., 0], dtype=np.float64)


Shape = Literal["box", "zonotope"]

_ITERATIONS = 100  # of `worst`: within 1 % of the largest sum along the tubes of this project
_NOTHING = 1e-300  # multiplier of a step that no window limits


@dataclass(frozen=True)
class DisturbanceSet:
    """Sequences w(0), w(1), ... with bounded energy in every window of N successive steps.

    With y = axes^-1 w, in every window the sum of y_a^2 is at most 1 for each axis a. With N = 1
    this is a box (axes along the coordinates) or a zonotope (axes of principal components) for each
    single step. The energy of noise in a window is far less
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

    @property
    def dimension(self) -> int:
        return len(self.axes)

    def energies(self, disturbances: FloatArray) -> FloatArray:
        """Return the energy of every window of a run (k, n) along each axis, (n, k - N + 1)."""
        energy = np.linalg.solve(self.axes, disturbances.T) ** 2  # (n, k)
        return np.lib.stride_tricks.sliding_window_view(energy, self.window, axis=1).sum(axis=2)

    def fill(self, disturbances: FloatArray) -> FloatArray:
        """Return the gauge of every window of a run (k, n), at most 1 inside, (k - N + 1,)."""
        return np.sqrt(self.energies(disturbances).max(axis=0))

    def reach(self, energies: FloatArray) -> FloatArray:
        """Return the largest weighted sum over a window, (...).

        `energies` (..., n) holds, for each axis, the sum over the window of the squared weights of
        its entries. By Cauchy and Schwarz each axis adds up to the root of its own.
        """
        return np.sqrt(energies).sum(axis=-1)

    def support(self, directions: FloatArray) -> FloatArray:
        """Return the support function of the set of single steps, (k,) for `directions` (k, n)."""
        return self.reach((directions @ self.axes) ** 2)

    @cached_property
    def faces(self) -> FloatArray:
        """Return rows f (n, n): a step w lies inside where |f w| <= 1 for all of them."""
        return np.linalg.inv(self.axes).astype(np.float64)

    def worst(self, coefficients: FloatArray) -> FloatArray:
        """Return an admissible run w (T, n) with a large sum of `coefficients` (T, n) times w.

        Every sliding window of the run lies in the set. Up to T = N the sum is the largest one. For
        more steps the dual problem, one multiplier for each window, is minimised by its majoriser:
        a multiplier is multiplied by the root of the energy in its window. The sum converges to the
        largest one from below.
        """
        along = coefficients @ self.axes
        window = min(self.window, len(along))
        multipliers = np.ones((len(along) - window + 1, along.shape[1]))
        y, energy = along, multipliers
        for _ in range(_ITERATIONS if len(along) > window else 1):
            multipliers = multipliers * np.sqrt(energy)
            padded = np.pad(multipliers, ((window - 1,) * 2, (0, 0)))
            covering = _sliding_sums(padded, window)
            y = np.divide(along, covering, out=np.zeros_like(along), where=covering > _NOTHING)
            energy = _sliding_sums(y**2, window)
        length = np.sqrt(energy.max(axis=0))
        return np.divide(y, length, out=np.zeros_like(y), where=length > 0.0) @ self.axes.T


def _sliding_sums(values: FloatArray, window: int) -> FloatArray:
    """Return the sums over every `window` successive rows, (k - window + 1, ...) for (k, ...)."""
    return np.lib.stride_tricks.sliding_window_view(values, window, axis=0).sum(axis=-1)


def _scaled(matrix: FloatArray) -> FloatArray:
    length = np.linalg.norm(matrix, axis=1, keepdims=True)
    return np.divide(matrix, length, out=np.zeros_like(matrix), where=length > 0.0)


def fit_set(
    runs: Sequence[FloatArray], coverage: float, window: int = 1, shape: Shape = "box"
) -> DisturbanceSet:
    """Return the set that contains a share of all windows of the residuals, centred at 0.

    The axes of a box are the coordinate axes, those of a zonotope the principal components of the
    correlation matrix, scaled by the standard deviations. The half widths are quantiles of equal
    order along each axis, so that heavy tails along one axis do not widen the others.

    Args:
        runs: residuals w(k) = z(k+1) - A z(k) - B u(k) of each run, (steps, n) each.
        coverage: share of the windows inside the set, above 0, at most 1.
        window: length of a window in steps; the set bounds the energy in a window.
        shape: of the set.

    Raises:
        InvalidTube: coverage out of range, a run that is no (steps, n) of finite values or shorter
            than a window, or a residual that does not vary.
    """
    if not 0.0 < coverage <= 1.0:
        raise InvalidTube(f"coverage: got {coverage}, must be above 0 and at most 1")
    for number, run in enumerate(runs):
        if run.ndim != 2 or len(run) < window or not np.isfinite(run).all():
            raise InvalidTube(
                f"residuals of run {number}: got {run.shape}, must be (steps, n), finite, of "
                f"{window} steps at least"
            )
    samples = np.concatenate(runs)
    spread = samples.std(axis=0)
    if not np.all(spread > 0.0):
        raise InvalidTube(f"residuals without spread: standard deviations {spread.tolist()}")
    axes = np.diag(spread)
    if shape != "box":
        vectors, values, _ = np.linalg.svd(np.corrcoef(samples.T))
        axes = spread[:, None] * vectors * np.sqrt(values)
    unit = DisturbanceSet(axes, window, shape)
    windows = np.sqrt(np.concatenate([unit.energies(run) for run in runs], axis=1)).T
    return DisturbanceSet(axes * _joint_quantile(windows, coverage), window, shape)


def _joint_quantile(samples: FloatArray, coverage: float) -> FloatArray:
    """Return one quantile per column, all of one order, that contain a share of the rows, (n,)."""
    low, high = coverage, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        inside = (samples <= np.quantile(samples, middle, axis=0)).all(axis=1).mean()
        low, high = (middle, high) if inside < coverage else (low, middle)
    return np.quantile(samples, high, axis=0)
