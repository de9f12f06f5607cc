"""From the axes of a study to the dimensions of its grid: what is crossed with what."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, qmc

from proving_ground.testbed.randomness import generator
from ttempc.types import FloatArray

from .study import DrawnAxis, GridAxis, Scalar, Study

Change = Mapping[str, Scalar]  # dotted key -> value

_TAIL_SD = float(norm.ppf(0.975))  # `low` and `high` of a normal axis are 2.5 and 97.5 %


@dataclass(frozen=True, slots=True)
class Dimension:
    """One factor of the grid: its entries are crossed with those of all others."""

    entries: Sequence[Change]
    relative: frozenset[str] = frozenset()  # keys whose values are factors
    drives: bool = False  # says who drives: the same terrain and noise for every entry


def dimensions(study: Study) -> tuple[Dimension, ...]:
    """Return the dimensions of a study: an axis each, all drawn axes together one."""
    found = []
    for axis in study.axis:
        if isinstance(axis, DrawnAxis):
            continue
        values = grid(axis) if isinstance(axis, GridAxis) else axis.values
        found.append(
            Dimension(
                [_change(axis.names, value) for value in values],
                frozenset(axis.names if axis.relative else ()),
                drives="controller" in axis.names,
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
        found.append(Dimension(changes, relative))
    return tuple(found)


def grid(axis: GridAxis) -> tuple[float, ...]:
    """Return the values of a grid axis; its ends are exactly those of the study."""
    space = np.geomspace if axis.spacing == "log" else np.linspace
    inner = space(axis.low, axis.high, axis.count)[1:-1]
    # A study is read by people: four digits, lest 387.2983346207417 kPa stand on an axis.
    return (axis.low, *(float(f"{value:.4g}") for value in inner), axis.high)


def draw(axes: Sequence[DrawnAxis], samples: int, seed: int) -> FloatArray:
    """Return `samples` points of the drawn axes, (samples, len(axes)).

    Every axis that is random by itself has a generator of its own, so that another axis does not
    move its values.
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


def _quantile(axis: DrawnAxis, share: FloatArray) -> FloatArray:
    """Return the value below which a share of the axis's distribution lies."""
    low, high = axis.low, axis.high
    if axis.distribution == "uniform":
        return low + share * (high - low)
    if axis.distribution == "log-uniform":
        return low * (high / low) ** share
    return norm.ppf(share, 0.5 * (low + high), 0.5 * (high - low) / _TAIL_SD)


def _change(names: Sequence[str], value: Scalar | tuple[Scalar, ...]) -> Change:
    values = value if isinstance(value, tuple) else (value,) * len(names)
    return dict(zip(names, values, strict=True))
