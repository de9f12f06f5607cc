"""Disturbance set from residuals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import InvalidTube
from ..types import FloatArray
from .disturbance_set import DisturbanceSet, Shape


def fit_set(
    runs: Sequence[FloatArray], coverage: float, window: int = 1, shape: Shape = "box"
) -> DisturbanceSet:
    """Return the set that contains a share of all windows of the residuals.

    The axes of a box are the coordinate axes. The axes of a zonotope or an ellipsoid are the
    principal components of the correlation matrix, scaled by the standard deviations. An ellipsoid
    has one radius. The half widths of the other shapes are quantiles of equal order along each
    axis, with the joint coverage asked for, so that heavy tails along one axis do not widen the
    others. The set is centred at 0: a mean of the residuals belongs into the model.

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
    if shape == "ellipsoid":
        unit = DisturbanceSet(axes, window, shape)
        radius = np.quantile(np.concatenate([unit.fill(run) for run in runs]), coverage)
        return DisturbanceSet(radius * axes, window, shape)
    single = [
        np.concatenate([_axis_fill(axes, run, window)[:, axis] for run in runs])
        for axis in range(len(axes))
    ]
    return DisturbanceSet(axes * _joint_quantile(np.array(single).T, coverage), window, shape)


def _axis_fill(axes: FloatArray, run: FloatArray, window: int) -> FloatArray:
    """Return the square root of the energy of each window along each axis, (n - window + 1, n)."""
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
