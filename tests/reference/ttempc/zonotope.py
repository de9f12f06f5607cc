"""Zonotope with its support function and its gauge, as a reference for sets of `ttempc.tube`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from ttempc.types import FloatArray


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
        """Return h(a) = a'centre + sum |a'generators| of `directions` (k, n), (k,)."""
        return directions @ self.centre + np.abs(directions @ self.generators).sum(axis=1)

    def gauge(self, point: FloatArray) -> float:
        """Return the smallest r with `point` (n,) in the set scaled by r about its centre.

        By the linear programme min r, generators e = point - centre, |e_j| <= r; infinite where
        no scaling reaches the point.
        """
        n, g = self.generators.shape
        solution = linprog(
            np.eye(g + 1)[g],
            A_ub=np.hstack([np.vstack([np.eye(g), -np.eye(g)]), -np.ones((2 * g, 1))]),
            b_ub=np.zeros(2 * g),
            A_eq=np.hstack([self.generators, np.zeros((n, 1))]),
            b_eq=point - self.centre,
            bounds=[(None, None)] * g + [(0.0, None)],
        )
        return float(solution.fun) if solution.status == 0 else math.inf

    def vertices(self) -> FloatArray:
        """Return the images of all corners of the cube of e, its vertices among them, (2^g, n)."""
        g = self.generators.shape[1]
        corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * g)).reshape(g, -1)
        return self.centre + (self.generators @ corners).T
