"""Convex sets given by their support functions.

A closed convex set S is determined by h_S(a) = max {a'x : x in S}. Sums and linear maps are exact
in it, h_{S+T} = h_S + h_T and h_{MS}(a) = h_S(M'a). No vertex is enumerated, so that seven
dimensions and hundreds of terms cost little.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidTube
from ..types import FloatArray

Shape = Literal["box", "zonotope"]

# Iterations of `DisturbanceSet.worst`: the sum is then within 1 % of the largest one, as measured
# along the tubes of this project.
_ITERATIONS: Final = 100
_NO_MULTIPLIER: Final = 1e-300  # sum of multipliers below which no window limits a step
_BISECTIONS: Final = 40  # of the order of a quantile, down to 1e-12 of the first interval


@dataclass(frozen=True)
class SupportSet:
    """A convex set given by its support function."""

    dimension: int
    function: Callable[[FloatArray], FloatArray]  # (k, n) -> (k,)

    def support(self, directions: FloatArray) -> FloatArray:
        """Return h(a) of each of the `directions` (k, n), (k,)."""
        return self.function(directions)


def minkowski_sum(sets: Sequence[SupportSet | DisturbanceSet]) -> SupportSet:
    """Return the Minkowski sum {x_1 + x_2 + ... : x_j in set j}."""

    def function(directions: FloatArray) -> FloatArray:
        return np.sum([each.support(directions) for each in sets], axis=0)

    return SupportSet(sets[0].dimension, function)


def linear_map(matrix: FloatArray, convex: SupportSet | DisturbanceSet) -> SupportSet:
    """Return the image {M x : x in `convex`} of a set under M, `matrix` (m, n)."""

    def function(directions: FloatArray) -> FloatArray:
        return convex.support(directions @ matrix)

    return SupportSet(len(matrix), function)


def outline(convex: SupportSet | DisturbanceSet, plane: FloatArray, count: int = 180) -> FloatArray:
    """Return the vertices of a polygon around the projection onto `plane` (2, n), (`count`, 2).

    The polygon is bounded by the tangents in `count` directions. It contains the projection. No
    point of the polygon is farther from the projection than D / 2 tan(pi / `count`), where D is
    the diameter of the projection.
    """
    # Tangents of the projection: normal'x = reach.
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)  # (count, 2)
    reach = convex.support(normal @ plane)  # (count,)

    # Each vertex is the intersection of two neighbouring tangents.
    next_normal = np.roll(normal, -1, axis=0)
    next_reach = np.roll(reach, -1)
    normals = np.stack([normal, next_normal], axis=1)  # (count, 2, 2)
    reaches = np.stack([reach, next_reach], axis=1)  # (count, 2)
    vertices = np.linalg.solve(normals, reaches[..., None])
    return np.asarray(vertices[..., 0], dtype=np.float64)


@dataclass(frozen=True)
class DisturbanceSet:
    """Sequences w(0), w(1), ... with bounded energy in every window of N successive steps.

    The components of a step along the axes are y = axes^-1 w. The energy along an axis is the sum
    of the squares of its component over a window. It is at most 1 along each axis and in every
    window. With N = 1 each step lies in a box (axes along the coordinates) or in a zonotope (axes
    of principal components).

    The energy of noise in a window is far less than N times the largest energy of a single step.
    A longer window therefore bounds the same data more tightly: by a factor of 0.62 for white
    Gaussian noise, N = 5 and a coverage of 99.9 %.

    Raises:
        InvalidTube: the axes are not a regular square matrix, the window is not positive, or there
            is no such shape.
    """

    axes: FloatArray  # (n, n): a column for each axis; its length is the half width along it
    window: int = 1  # N [steps]
    shape: Shape = "zonotope"

    def __post_init__(self) -> None:
        if self.window < 1:
            raise InvalidTube(f"window: got {self.window} steps, must be 1 or more")
        if self.shape not in get_args(Shape):
            raise InvalidTube(f"shape: got {self.shape!r}, must be one of {get_args(Shape)}")
        if not _is_regular(self.axes):
            raise InvalidTube(
                f"axes: got {self.axes.shape} with the lengths "
                f"{np.linalg.norm(self.axes, axis=0).tolist()}, must be square and of full rank"
            )

    @property
    def dimension(self) -> int:
        """Number n of entries of a step."""
        return len(self.axes)

    def energies(self, disturbances: FloatArray) -> FloatArray:
        """Return the energy of every window of a run (k, n) along each axis, (n, k - N + 1)."""
        of_steps = np.linalg.solve(self.axes, disturbances.T) ** 2  # (n, k)
        windows = np.lib.stride_tricks.sliding_window_view(of_steps, self.window, axis=1)
        return windows.sum(axis=2)

    def fill(self, disturbances: FloatArray) -> FloatArray:
        """Return the gauge of every window of a run (k, n), at most 1 inside, (k - N + 1,)."""
        return np.sqrt(self.energies(disturbances).max(axis=0))

    def reach(self, energies: FloatArray) -> FloatArray:
        """Return the largest weighted sum over a window, (...).

        `energies` (..., n) holds, for each axis, the sum over the window of the squared weights of
        its components. By the inequality of Cauchy and Schwarz, the weighted sum along an axis is
        at most the root of this energy.
        """
        return np.sqrt(energies).sum(axis=-1)

    def support(self, directions: FloatArray) -> FloatArray:
        """Return the support function of the set of single steps, (k,) for `directions` (k, n)."""
        return self.reach((directions @ self.axes) ** 2)

    @cached_property
    def faces(self) -> FloatArray:
        """Rows f (n, n) of the faces: a step w lies inside where |f w| <= 1 for every row."""
        return np.linalg.inv(self.axes).astype(np.float64)

    def worst(self, coefficients: FloatArray) -> FloatArray:
        """Return an admissible run w (T, n) with a large sum of `coefficients` (T, n) times w.

        Every sliding window of the run lies in the set. Up to T = N the sum is the largest one. For
        more steps the dual problem, with one multiplier for each window and axis, is minimised by
        its majoriser: each iteration multiplies a multiplier by the root of the energy in its
        window. The sum converges to the largest one from below.
        """
        weights = coefficients @ self.axes  # of the components along the axes, (T, n)
        steps = len(weights)
        window = min(self.window, steps)
        iterations = _ITERATIONS if steps > window else 1

        # For given multipliers, the best component of a step is its weight over the sum of the
        # multipliers of all windows that contain the step.
        multipliers = np.ones((steps - window + 1, weights.shape[1]))
        energy = multipliers
        components = weights
        no_window = window - 1  # rows before the first and behind the last window
        for _ in range(iterations):
            multipliers = multipliers * np.sqrt(energy)
            padded = np.pad(multipliers, ((no_window, no_window), (0, 0)))
            covering = _sliding_sums(padded, window)
            components = _divide(weights, covering, where=covering > _NO_MULTIPLIER)
            energy = _sliding_sums(components**2, window)

        # The fullest window along each axis has the energy 1.
        largest = np.sqrt(energy.max(axis=0))
        return _divide(components, largest, where=largest > 0.0) @ self.axes.T


def _is_regular(matrix: FloatArray) -> bool:
    """Return whether a matrix is square, finite and of full rank, whatever the units of its rows.

    The rows are scaled to the length 1 before the rank is computed.
    """
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not np.isfinite(matrix).all():
        return False
    length = np.linalg.norm(matrix, axis=1, keepdims=True)
    scaled = _divide(matrix, length, where=length > 0.0)
    return bool(np.linalg.matrix_rank(scaled) == len(matrix))


def _divide(values: FloatArray, divisor: FloatArray, where: NDArray[np.bool_]) -> FloatArray:
    """Return the quotient, 0 except `where` a condition holds."""
    return np.divide(values, divisor, out=np.zeros_like(values), where=where)


def _sliding_sums(values: FloatArray, window: int) -> FloatArray:
    """Return the sums over every `window` successive rows, (k - window + 1, ...) for (k, ...)."""
    return np.lib.stride_tricks.sliding_window_view(values, window, axis=0).sum(axis=-1)


def fit_set(
    runs: Sequence[FloatArray], coverage: float, window: int = 1, shape: Shape = "box"
) -> DisturbanceSet:
    """Return a set, centred at 0, that contains a share of all windows of the residuals.

    The axes of a box are the coordinate axes. The axes of a zonotope are the principal components
    of the correlation matrix, scaled by the standard deviations. The half widths are quantiles of
    the same order along every axis, so that heavy tails along one axis do not widen the others.

    Args:
        runs: residuals w(k) = z(k+1) - A z(k) - B u(k) of each run, (steps, n) each.
        coverage: share of the windows inside the set, above 0, at most 1.
        window: length of a window in steps; the set bounds the energy in a window.
        shape: of the set.

    Raises:
        InvalidTube: the coverage is out of range; a run is not (steps, n), not finite, or shorter
            than a window; or a residual does not vary.
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
    deviations = samples.std(axis=0)
    if not np.all(deviations > 0.0):
        raise InvalidTube(f"residuals without spread: standard deviations {deviations.tolist()}")

    # Directions of the axes, each with the standard deviation along it as its length.
    axes = np.diag(deviations)
    if shape != "box":
        vectors, variances, _ = np.linalg.svd(np.corrcoef(samples.T))
        axes = deviations[:, None] * vectors * np.sqrt(variances)

    # Half widths: quantiles of the root of the energy in a window, in standard deviations.
    unit = DisturbanceSet(axes, window, shape)
    energies = np.concatenate([unit.energies(run) for run in runs], axis=1)  # (n, windows)
    half_widths = _joint_quantile(np.sqrt(energies).T, coverage)
    return DisturbanceSet(axes * half_widths, window, shape)


def _joint_quantile(samples: FloatArray, coverage: float) -> FloatArray:
    """Return the quantiles of all columns whose box contains a share of the rows, (n,).

    Their order is the same for every column. It is at least the coverage, because a row is inside
    only where all its entries are, and is found by bisection.
    """
    low = coverage
    high = 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        inside = (samples <= np.quantile(samples, middle, axis=0)).all(axis=1).mean()
        if inside < coverage:
            low = middle
        else:
            high = middle
    return np.quantile(samples, high, axis=0)
