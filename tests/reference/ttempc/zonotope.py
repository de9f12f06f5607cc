"""Zonotope with its support function, as a reference for sets of `ttempc.tube`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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

    def vertices(self) -> FloatArray:
        """Return the images of all corners of the cube of e, its vertices among them, (2^g, n)."""
        g = self.generators.shape[1]
        corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * g)).reshape(g, -1)
        return self.centre + (self.generators @ corners).T
