"""Dimensions of a study's grid, made from its axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, qmc

from ttempc.types import FloatArray

from ...testbed.randomness import generator
from .study import DrawnAxis, GridAxis, Scalar, Study

Change = Mapping[str, Scalar]  # dotted key -> value

_TAIL_SD = float(norm.ppf(0.975))  # `low` and `high` of a normal axis are 2.5 and 97.5 %


@dataclass(frozen=True, slots=True)
class Dimension:
    """One factor of the grid; its entries are combined with those of all others."""

    entries: Sequence[Change]
    relative: frozenset[str] = frozenset()  # keys whose values are factors
    optional: frozenset[str] = frozenset()  # keys that a scenario may lack
    selects_controller: bool = False  # all its entries meet the same terrain and noise


def dimensions(study: Study) -> tuple[Dimension, ...]:
    """Return the dimensions of a study: one for each axis, one for all drawn axes together."""
    result = []
    for axis in study.axis:
        if isinstance(axis, DrawnAxis):
            continue
        values = grid(axis) if isinstance(axis, GridAxis) else axis.values
        result.append(
            Dimension(
                [_change(axis.names, value) for value in values],
                frozenset(axis.names if axis.relative else ()),
                frozenset(axis.names if axis.optional else ()),
                selects_controller="controller" in axis.names,
            )
        )
    drawn = [axis for axis in study.axis if isinstance(axis, DrawnAxis)]
    if drawn:
        assert study.samples is not None
        points = draw(drawn, study.samples, study.draw)
        changes = [
            {name: value for axis, value in zip(drawn, point, strict=True) for name in axis.names}
            for point in points.tolist()
        ]
        relative = frozenset(name for axis in drawn if axis.relative for name in axis.names)
        optional = frozenset(name for axis in drawn if axis.optional for name in axis.names)
        result.append(Dimension(changes, relative, optional))
    return tuple(result)


def grid(axis: GridAxis) -> tuple[float, ...]:
    """Return the values of a grid axis; its ends are exactly `low` and `high`."""
    space = np.geomspace if axis.spacing == "log" else np.linspace
    inner = space(axis.low, axis.high, axis.count)[1:-1]
    # Four digits, so that an axis shows 387.3 kPa, not 387.2983346207417 kPa.
    return (axis.low, *(float(f"{value:.4g}") for value in inner), axis.high)


def draw(axes: Sequence[DrawnAxis], samples: int, seed: int) -> FloatArray:
    """Return `samples` points of the drawn axes, (samples, len(axes)).

    Every independent axis has its own generator, so that adding an axis does not change the
    values of the others.
    """
    uniform = np.empty((samples, len(axes)))
    joint = [column for column, axis in enumerate(axes) if axis.kind == "latin-hypercube"]
    if joint:
        sampler = qmc.LatinHypercube(len(joint), rng=generator(seed, "latin-hypercube"))
        uniform[:, joint] = sampler.random(samples)
    for column, axis in enumerate(axes):
        if axis.kind == "random":
            uniform[:, column] = generator(seed, f"random {axis.label}").random(samples)
    return np.column_stack(
        [_quantile(axis, uniform[:, column]) for column, axis in enumerate(axes)]
    )


def _quantile(axis: DrawnAxis, probability: FloatArray) -> FloatArray:
    """Return the quantiles of the axis's distribution at these probabilities, (n,) each."""
    low, high = axis.low, axis.high
    if axis.distribution == "uniform":
        return low + probability * (high - low)
    if axis.distribution == "log-uniform":
        return low * (high / low) ** probability
    return norm.ppf(probability, 0.5 * (low + high), 0.5 * (high - low) / _TAIL_SD)


def _change(names: Sequence[str], value: Scalar | tuple[Scalar, ...]) -> Change:
    values = value if isinstance(value, tuple) else (value,) * len(names)
    return dict(zip(names, values, strict=True))
