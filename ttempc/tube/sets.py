"""Convex sets by their support functions: boxes, zonotopes, half-spaces and whatever adds to them.

A closed convex set S is known by h_S(a) = max {a'x : x in S}. Sums and linear maps are exact in
it, h_{S+T} = h_S + h_T and h_{MS}(a) = h_S(M'a); no vertex is ever enumerated, so that seven
dimensions and hundreds of terms cost as little as one. Only the outer set of a Pontryagin
difference has to be given by faces, S - T = {x : a_j'x <= b_j - h_T(a_j)}.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from ..errors import EmptySet
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
class Box:
    """{x : lower <= x <= upper}.

    Raises:
        EmptySet: a lower bound lies above the upper one; says which and by how much.
    """

    lower: FloatArray  # (n,)
    upper: FloatArray  # (n,)

    def __post_init__(self) -> None:
        gap = self.lower - self.upper
        if np.any(gap > 0.0):
            worst = int(np.argmax(gap))
            raise EmptySet(np.eye(len(gap))[worst], float(gap[worst]))

    @property
    def dimension(self) -> int:
        """Return n."""
        return len(self.lower)

    def support(self, directions: FloatArray) -> FloatArray:
        """Return h(a) = sum of max(a_j lower_j, a_j upper_j), (k,)."""
        return np.maximum(directions * self.lower, directions * self.upper).sum(axis=1)

    def contains(self, points: FloatArray, slack: float = 0.0) -> NDArray[np.bool_]:
        """Whether each of `points` (k, n) is inside, or outside by no more than `slack`."""
        return np.all((points >= self.lower - slack) & (points <= self.upper + slack), axis=1)

    def erode(self, other: ConvexSet) -> Box:
        """Return the Pontryagin difference {x : x + other inside this box}.

        Raises:
            EmptySet: `other` is wider than this box; says in which direction and by how much.
        """
        unit = np.eye(self.dimension)
        return Box(self.lower + other.support(-unit), self.upper - other.support(unit))


@dataclass(frozen=True)
class Zonotope:
    """{centre + generators e : |e_j| <= 1}."""

    centre: FloatArray  # (n,)
    generators: FloatArray  # (n, g)

    @property
    def dimension(self) -> int:
        """Return n."""
        return len(self.centre)

    def support(self, directions: FloatArray) -> FloatArray:
        """Return h(a) = a'centre + sum |a'generators|, (k,)."""
        return directions @ self.centre + np.abs(directions @ self.generators).sum(axis=1)

    def gauge(self, point: FloatArray) -> float:
        """Return the smallest r with `point` (n,) in the set scaled by r about its centre.

        By the linear programme min r, generators e = point - centre, |e_j| <= r; infinite where
        no scaling reaches the point.
        """
        n, g = self.generators.shape
        rows = np.hstack([np.vstack([np.eye(g), -np.eye(g)]), -np.ones((2 * g, 1))])
        answer = linprog(
            np.eye(g + 1)[g],
            A_ub=rows,
            b_ub=np.zeros(2 * g),
            A_eq=np.hstack([self.generators, np.zeros((n, 1))]),
            b_eq=point - self.centre,
            bounds=[(None, None)] * g + [(0.0, None)],
        )
        return float(answer.fun) if answer.status == 0 else float("inf")


@dataclass(frozen=True)
class Polytope:
    """{x : normals x <= offsets}.

    Raises:
        EmptySet: no point satisfies all rows; the direction is the normal of the row that would
            have to give way the most, the gap by how much all rows would have to give way.
    """

    normals: FloatArray  # (m, n)
    offsets: FloatArray  # (m,)

    def __post_init__(self) -> None:
        m, n = self.normals.shape
        answer = linprog(  # min t, normals x <= offsets + t
            np.eye(n + 1)[n],
            A_ub=np.hstack([self.normals, -np.ones((m, 1))]),
            b_ub=self.offsets,
            bounds=[(None, None)] * n + [(-1.0, None)],
        )
        if answer.fun > 1e-12:
            row = int(np.argmin(answer.ineqlin.marginals))
            raise EmptySet(self.normals[row], float(answer.fun))

    @property
    def dimension(self) -> int:
        """Return n."""
        return self.normals.shape[1]

    def support(self, directions: FloatArray) -> FloatArray:
        """Return h(a) by a linear programme each, infinite where the set is unbounded, (k,)."""
        free = [(None, None)] * self.dimension
        found = [linprog(-a, self.normals, self.offsets, bounds=free) for a in directions]
        return np.array([-one.fun if one.status == 0 else np.inf for one in found])

    def contains(self, points: FloatArray, slack: float = 0.0) -> NDArray[np.bool_]:
        """Whether each of `points` (k, n) is inside, or outside by no more than `slack`."""
        return np.all(points @ self.normals.T <= self.offsets + slack, axis=1)

    def erode(self, other: ConvexSet) -> Polytope:
        """Return the Pontryagin difference {x : x + other inside this set}.

        Raises:
            EmptySet: nothing is left; says in which direction and by how much.
        """
        return Polytope(self.normals, self.offsets - other.support(self.normals))


@dataclass(frozen=True)
class SupportSet:
    """Any convex set, given by nothing but its support function."""

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


def excess(inner: ConvexSet, outer: ConvexSet, directions: FloatArray) -> float:
    """Return by how much `inner` reaches beyond `outer`, at most, over the `directions` (k, n).

    At or below 0 where `inner` lies inside as far as these directions tell. That proves it where
    they hold all normals of `outer`; else it does so the better the denser they are.
    """
    return float(np.max(inner.support(directions) - outer.support(directions)))


def directions_in(dimension: int, count: int, generator: np.random.Generator) -> FloatArray:
    """Return unit vectors in all directions, both of every axis first, (`count`, n)."""
    axes = np.vstack([np.eye(dimension), -np.eye(dimension)])
    others = generator.standard_normal((max(0, count - len(axes)), dimension))
    return np.vstack([axes, others / np.linalg.norm(others, axis=1, keepdims=True)])[:count]


def outline(of: ConvexSet, plane: FloatArray, count: int = 180) -> FloatArray:
    """Return the corners of the projection onto the rows of `plane` (2, n), (`count`, 2).

    The polygon of the tangents in `count` directions: never smaller than the projection.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)  # (count, 2)
    reach = of.support(normal @ plane)
    pairs = np.stack([normal, np.roll(normal, -1, axis=0)], axis=1)  # neighbouring tangents
    corners = np.linalg.solve(pairs, np.stack([reach, np.roll(reach, -1)], axis=1)[..., None])
    return np.asarray(corners[..., 0], dtype=np.float64)
