"""Convex sets given by their support functions.

A closed convex set S is determined by h_S(a) = max {a'x : x in S}. Sums and linear maps are exact
in it, h_{S+T} = h_S + h_T and h_{MS}(a) = h_S(M'a). No vertex is enumerated, so that seven
dimensions and hundreds of terms cost little.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..types import FloatArray


class ConvexSet(Protocol):
    """A closed convex set in n dimensions."""

    @property
    def dimension(self) -> int:
        """Return n."""
        ...

    def support(self, directions: FloatArray) -> FloatArray:
        """Return h(a) of each of the `directions` (k, n), (k,)."""
        ...


@dataclass(frozen=True)
class SupportSet:
    """A convex set given by its support function."""

    dimension: int
    function: Callable[[FloatArray], FloatArray]  # (k, n) -> (k,)

    def support(self, directions: FloatArray) -> FloatArray:
        """Return h(a) of each of the `directions` (k, n), (k,)."""
        return self.function(directions)


def minkowski_sum(sets: Sequence[ConvexSet]) -> SupportSet:
    """Return {x_1 + x_2 + ... : x_j in set j}."""
    dimension = sets[0].dimension
    return SupportSet(dimension, lambda a: np.sum([one.support(a) for one in sets], axis=0))


def linear_map(matrix: FloatArray, of: ConvexSet) -> SupportSet:
    """Return {matrix x : x in `of`}, `matrix` (m, n)."""
    return SupportSet(len(matrix), lambda a: of.support(a @ matrix))


def directions_in(dimension: int, count: int, generator: np.random.Generator) -> FloatArray:
    """Return `count` unit vectors, (`count`, n): both of every axis first, the others random."""
    axes = np.vstack([np.eye(dimension), -np.eye(dimension)])
    others = generator.standard_normal((max(0, count - len(axes)), dimension))
    return np.vstack([axes, others / np.linalg.norm(others, axis=1, keepdims=True)])[:count]


def outline(of: ConvexSet, plane: FloatArray, count: int = 180) -> FloatArray:
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
