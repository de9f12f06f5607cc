"""Polytopes given by their half-spaces: constraints, Pontryagin differences, terminal sets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from ..errors import InvalidTube
from ..types import FloatArray
from .sets import ConvexSet

_MOST_STEPS = 500  # of the recursion of `admissible_subset`
_UNBOUNDED = 3  # status of scipy's linprog
_SLACK = 1e-9  # tolerance of the linear programmes, relative to the offsets


@dataclass(frozen=True)
class Polytope:
    """The set {x : normals x <= offsets}, bounded or not. It satisfies `ConvexSet`.

    Raises:
        InvalidTube: the shapes do not fit or a value is not finite.
    """

    normals: FloatArray  # (h, n)
    offsets: FloatArray  # (h,)

    def __post_init__(self) -> None:
        fit = self.normals.ndim == 2 and self.offsets.shape == self.normals.shape[:1]
        if not fit or not (np.isfinite(self.normals).all() and np.isfinite(self.offsets).all()):
            raise InvalidTube(
                f"polytope: got normals {self.normals.shape} and offsets {self.offsets.shape}, "
                "must be (h, n) and (h,), all finite"
            )

    @classmethod
    def box(cls, lower: FloatArray, upper: FloatArray) -> Polytope:
        """Return {x : lower <= x <= upper}; an infinite bound is none."""
        unit = np.eye(len(lower))
        normals, offsets = np.vstack([unit, -unit]), np.concatenate([upper, -np.asarray(lower)])
        return cls(normals[offsets < np.inf], offsets[offsets < np.inf])

    @property
    def dimension(self) -> int:
        """Return n."""
        return self.normals.shape[1]

    def support(self, directions: FloatArray) -> FloatArray:
        """Return h(a) of each of the `directions` (k, n), infinite where unbounded, (k,).

        Raises:
            InvalidTube: the polytope is empty.
        """
        reach = np.empty(len(directions))
        for row, direction in enumerate(directions):
            programme = scipy.optimize.linprog(
                -direction, self.normals, self.offsets, bounds=(None, None)
            )
            if programme.status not in (0, _UNBOUNDED):
                raise InvalidTube(f"polytope: {programme.message}")
            reach[row] = np.inf if programme.status == _UNBOUNDED else -programme.fun
        return reach

    def contains(self, points: FloatArray, tolerance: float = 0.0) -> np.ndarray:
        """Return whether each of the `points` (k, n) lies in the polytope, (k,) of bool."""
        return np.all(points @ self.normals.T <= self.offsets + tolerance, axis=1)

    def difference(self, other: ConvexSet) -> Polytope:
        """Return the Pontryagin difference {x : x + y in the polytope for every y in `other`}.

        It is exact: each offset loses the support of `other` along its normal.

        Raises:
            InvalidTube: the difference is empty; with the constraints that exclude each other.
        """
        taken = other.support(self.normals)
        difference = Polytope(self.normals, self.offsets - taken)
        difference.require_interior(taken)
        return difference

    def require_interior(self, taken: FloatArray) -> None:
        """Refuse a polytope without a point; `taken` (h,) was subtracted from its offsets.

        Raises:
            InvalidTube: with the constraints that exclude each other.
        """
        # The largest ball in it has the radius r: normals x + r |normals| <= offsets. Bounded by 1,
        # because the sign of r alone matters.
        length = np.linalg.norm(self.normals, axis=1, keepdims=True)
        n = self.dimension
        ball = scipy.optimize.linprog(
            np.append(np.zeros(n), -1.0),
            np.hstack([self.normals, length]),
            self.offsets,
            bounds=[*[(None, None)] * n, (None, 1.0)],
        )
        if ball.x[-1] >= 0.0:
            return
        rows = np.flatnonzero(ball.ineqlin.marginals < 0.0)
        numbers = ", ".join(
            f"row {i}: {taken[i]:.4g} of {taken[i] + self.offsets[i]:.4g}" for i in rows
        )
        raise InvalidTube(f"the tightened set is empty: the tube takes, of the bounds, {numbers}")


def admissible_subset(closed: FloatArray, constraints: Polytope) -> Polytope:
    """Return the largest subset of `constraints` that z(k+1) = `closed` z(k) never leaves.

    The recursion of Gilbert and Tan (1991): constraints on closed^i z are added until those of the
    next step are redundant. The set of a nominal loop under tightened constraints is the terminal
    set of a tube MPC.

    Args:
        closed: A + B K (n, n).
        constraints: on z, the origin in their interior.

    Raises:
        InvalidTube: the loop does not contract, the origin is not in the interior, or the recursion
            does not end.
    """
    growth = float(np.abs(np.linalg.eigvals(closed)).max())
    if growth >= 1.0 or not np.all(constraints.offsets > 0.0):
        raise InvalidTube(
            f"no admissible subset: the largest eigenvalue has the modulus {growth:.4f} (must be "
            f"below 1), the smallest offset is {constraints.offsets.min():.4g} (must be above 0)"
        )
    result, rows = constraints, constraints.normals
    scale = _SLACK * (1.0 + np.abs(constraints.offsets))
    for _ in range(_MOST_STEPS):
        rows = rows @ closed
        new = result.support(rows) > constraints.offsets + scale
        if not new.any():
            return result
        result = Polytope(
            np.vstack([result.normals, rows[new]]),
            np.concatenate([result.offsets, constraints.offsets[new]]),
        )
    raise InvalidTube(
        f"no admissible subset after {_MOST_STEPS} steps: the largest eigenvalue has the modulus "
        f"{growth:.4f}"
    )
