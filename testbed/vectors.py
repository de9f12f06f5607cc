"""3-vectors for kernels: a vector is a tuple of three numbers."""

import math
from typing import Final

from ttempc.jit import FAST, cached_njit

from .kernel_options import INLINED

Vector = tuple[float, float, float]

ZERO: Final = (0.0, 0.0, 0.0)
VERTICAL: Final = (0.0, 0.0, 1.0)
"""Unit vector out of level ground."""

_inlined = cached_njit(**INLINED, fastmath=FAST)


@_inlined
def dot(a: Vector, b: Vector) -> float:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@_inlined
def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@_inlined
def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@_inlined
def subtract(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@_inlined
def scale(factor: float, a: Vector) -> Vector:
    """Return factor a."""
    return factor * a[0], factor * a[1], factor * a[2]


@_inlined
def norm(a: Vector) -> float:
    """Return |a|."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
