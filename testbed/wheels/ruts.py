"""Ruts, compiled: a wheel presses the ground that it drives over.

A wheel presses the ground to the depth at which the work of sinkage is the soil's resistance.
After M. G. Bekker ("Introduction to Terrain-Vehicle Systems", 1969, by J. Y. Wong's "Theory of
Ground Vehicles") pressure grows as z^n under a plate, and a strip of contact length l and width b
sinks by z_1, with

    p = W / (b l) at z_1,   b p z_1 / (n + 1) = W resistance_bn / Bn.

Passes add after Abebe, Tanaka and Yamazaki (J. Terramechanics 26 (1989) 139, from memory): equal
ones give z_N = z_1 N^(1/a), so that any wheel in a rut of depth z makes it (z^a + z_1^a)^(1/a)
deep, and only that much work resists it. The state is the height of the ground; it is pressed just
ahead of the contact, so that a wheel does not climb out of its own rut, and its sides are flanks of
the ground like any other.
"""

import math
from typing import Any, Final, NamedTuple, Self

import numpy as np

from ttempc.jit import cached_njit
from ttempc.types import FloatArray

from ..ground.surface import Grid, grid_cell
from ..kernel_options import INLINED, KERNEL
from ..vectors import Vector
from . import tyre

# n: 0.62 on sandy loam of medium density, 0.42 to 0.89 of dense to loose (Cranfield, thesis of
# D. Ansorge, table 8)
_EXPONENT: Final = 0.62
# a: 2 to 3 on loose soil, up to 5 on firm soil
_PASSES: Final = 3.0
# distance from press to press and between points across the wheel, over the grid's spacing
_PRESS: Final = 0.25
# A rut is wider than its wheel by this part of the spacing, because points of the grid at its edges
# that are covered by a share f sink by f^(1/a): mean over all places of the edges.
_EDGES: Final = 2.0 / (1.0 + (_EXPONENT + 1.0) / _PASSES) - 1.0
# [m] keeps the depth over the sinkage finite
_LEAST_SINKAGE_M: Final = 1e-6
# length of the fan of look-ups under a wheel over its radius
_FAN_LENGTH: Final = float(2.0 * np.sin(tyre.FAN_ANGLES[-1]))


class Ruts(NamedTuple):
    """State of the ruts of n wheels; every array is empty where wheels leave none."""

    firm: FloatArray  # (ny, nx) [m] heights before any wheel
    heights: FloatArray  # (ny, nx) [m] present heights, changed in place
    travel: FloatArray  # (n,) [m] of each wheel since it last pressed, changed in place
    # (n,) soil's resistance under each wheel over that of new soil, minus 1; changed in place
    excess: FloatArray

    @classmethod
    def none(cls) -> Self:
        """Return the state of wheels that leave no ruts."""
        firm = np.empty((0, 0))
        firm.setflags(write=False)  # as the heights of a terrain: one compiled version
        return cls(firm, np.empty((0, 0)), np.empty(0), np.empty(0))


@cached_njit(**KERNEL)
def roll_rut(
    ruts: Ruts,
    grid: Grid,
    wheel: int,
    tyre: Any,  # noqa: ANN401 - a record `TYRE`
    motion: tuple[Vector, Vector, Vector],
    half_length: float,
    sinkage: float,
    timestep: float,
) -> float:
    """Let a wheel roll for a time step and return its rut resistance factor.

    That is the soil's resistance over that of new soil. It follows the soil that the wheel has
    pressed over half the length of its contact.

    Args:
        ruts: changed in place.
        grid: of the heights.
        wheel: number of the wheel.
        tyre: record `TYRE` of the wheel.
        motion: centre [m], axle, velocity [m/s].
        half_length: of the contact [m].
        sinkage: z_1 [m].
        timestep: [s].
    """
    centre, axle, velocity = motion
    speed = math.sqrt(velocity[0] ** 2 + velocity[1] ** 2)
    travel = ruts.travel[wheel] + speed * timestep

    if travel > _PRESS * grid.spacing:
        # the strip lies just ahead of the fan of look-ups
        ahead_s = (0.5 * _FAN_LENGTH * tyre.radius + grid.spacing) / speed
        x = centre[0] + ahead_s * velocity[0]
        y = centre[1] + ahead_s * velocity[1]
        across = (tyre.width * axle[0], tyre.width * axle[1])
        work = press(ruts, grid, x, y, across, travel, max(_LEAST_SINKAGE_M, sinkage))
        followed = min(1.0, 0.5 * travel / half_length)
        ruts.excess[wheel] += followed * (work - 1.0 - ruts.excess[wheel])
        travel = 0.0

    ruts.travel[wheel] = travel
    return 1.0 + ruts.excess[wheel]


@cached_njit(**KERNEL)
def press(
    ruts: Ruts,
    grid: Grid,
    x: float,
    y: float,
    across: tuple[float, float],
    travel: float,
    sinkage: float,
) -> float:
    """Press the ground under a strip across a wheel and return the work over that on new soil.

    Args:
        ruts: its heights are changed.
        grid: of the heights.
        x, y: middle of the strip [m].
        across: its width along both axes [m].
        travel: its length [m].
        sinkage: z_1 [m].
    """
    ny, nx = ruts.firm.shape
    width = math.hypot(across[0], across[1])
    points = math.ceil(width / (_PRESS * grid.spacing))
    area = travel * width / (points * grid.spacing**2)  # share of a grid point's area

    work = 0.0
    for k in range(points):
        # grid point under this point of the strip
        place = (k + 0.5) / points - 0.5
        i, p = grid_cell((x + place * across[0] - grid.x) / grid.spacing, nx - 1)
        j, q = grid_cell((y + place * across[1] - grid.y) / grid.spacing, ny - 1)
        row = j + (q >= 0.5)
        column = i + (p >= 0.5)

        # its depth before and after, over z_1
        firm = ruts.firm[row, column]
        before = (firm - ruts.heights[row, column]) / sinkage
        after = (max(0.0, before) ** _PASSES + area) ** (1.0 / _PASSES)
        work += _sinkage_work(after) - _sinkage_work(before)
        ruts.heights[row, column] = firm - after * sinkage

    return work * grid.spacing**2 / (travel * (width + _EDGES * grid.spacing))


@cached_njit(**INLINED)
def _sinkage_work(depth: float) -> float:
    """Return the work of sinkage to a depth, over that to z_1; below, the pressure is that at z_1.

    Args:
        depth: over z_1.
    """
    virgin = min(1.0, depth)
    return virgin ** (_EXPONENT + 1.0) + (_EXPONENT + 1.0) * (depth - virgin)


@cached_njit(**INLINED)
def sinkage_of(half_length: float, resistance_bn: float, bn: float) -> float:
    """Return z_1, the sinkage on new soil [m].

    Args:
        half_length: of the contact [m].
        resistance_bn: of the soil's law.
        bn: mobility number Bn.
    """
    return 2.0 * half_length * (_EXPONENT + 1.0) * resistance_bn / bn
