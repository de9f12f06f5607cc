"""Fit of a disturbance set to residuals, and its check on held-out runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import binomtest

from ttempc.tube.disturbance_set import DisturbanceSet, Shape
from ttempc.types import FloatArray

from ..errors import InvalidFit
from ..results.statistics import proportion
from ..scenario.tube_file import HoldOut


def fit_set(
    runs: Sequence[FloatArray], coverage: float, window: int, shape: Shape
) -> DisturbanceSet:
    """Return the set that contains a share of all windows of the residuals.

    The axes of a box are the coordinate axes. The axes of a zonotope or an ellipsoid are the
    principal components of the correlation matrix, scaled by the standard deviations. An ellipsoid
    has one radius. The half widths of the other shapes are quantiles of equal order along each
    axis, with the joint coverage asked for, so that heavy tails along one axis do not widen the
    others.

    Args:
        runs: residuals of each run, (n, 7) each.
        coverage: share of the windows inside the set.
        window: length of a window in steps; the set bounds the energy in a window.
        shape: of the set.

    Raises:
        InvalidFit: a residual does not vary.
    """
    samples = np.concatenate(runs)
    spread = samples.std(axis=0)
    if not np.all(spread > 0.0):
        raise InvalidFit(f"residuals without spread: standard deviations {spread.tolist()}")
    axes = np.diag(spread)
    if shape != "box":
        vectors, values, _ = np.linalg.svd(np.corrcoef(samples.T))
        axes = spread[:, None] * vectors * np.sqrt(values)
    if shape == "ellipsoid":
        unit = DisturbanceSet(axes, window, shape)
        radius = np.quantile(np.concatenate([unit.fill(run) for run in runs]), coverage)
        return DisturbanceSet(radius * axes, window, shape)
    single = [
        np.concatenate([_axis_fill(axes, run, window)[:, axis] for run in runs])
        for axis in range(len(axes))
    ]
    return DisturbanceSet(axes * _joint_quantile(np.array(single).T, coverage), window, shape)


def hold_out(
    disturbance: DisturbanceSet, runs: Sequence[FloatArray], confidence: float, apart: int
) -> HoldOut:
    """Count the windows of held-out runs inside the set, one every `apart` steps."""
    fills = np.concatenate([disturbance.fill(run)[::apart] for run in runs])
    inside = proportion(int((fills <= 1.0).sum()), len(fills), confidence)
    return HoldOut(inside.total, inside.count, inside.low, inside.high)


def contradiction(count: HoldOut, what: str, coverage: float, confidence: float) -> str:
    """Return a sentence where a hold-out count contradicts the coverage, "" where it does not.

    The test is the one-sided binomial one.
    """
    if not count.windows:
        return ""
    p = binomtest(count.inside, count.windows, coverage, alternative="less").pvalue
    if p >= 1.0 - confidence:
        return ""
    return (
        f"{count.inside} of {count.windows} held-out windows of the {what} lie in its set, a "
        f"coverage of {coverage:g} is contradicted (binomial test, p = {p:.2g}): fit to more runs"
    )


def _axis_fill(axes: FloatArray, run: FloatArray, window: int) -> FloatArray:
    """Return the square root of the energy of each window along each axis, (n - window + 1, 7)."""
    energy = np.linalg.solve(axes, run.T) ** 2
    windows = np.lib.stride_tricks.sliding_window_view(energy, window, axis=1)
    return np.sqrt(windows.sum(axis=2)).T


def _joint_quantile(samples: FloatArray, coverage: float) -> FloatArray:
    """Return one quantile per column, all of one order, that contain a share of the rows, (n,)."""
    low, high = coverage, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        inside = (samples <= np.quantile(samples, middle, axis=0)).all(axis=1).mean()
        low, high = (middle, high) if inside < coverage else (low, middle)
    return np.quantile(samples, high, axis=0)
