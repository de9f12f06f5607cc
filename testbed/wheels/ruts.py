"""Ruts, compiled: a wheel presses the ground that it drives over.

A wheel presses the ground to the depth at which the work of sinkage is the soil's resistance.
After M. G. Bekker ("Introduction to Terrain-Vehicle Systems", 1969, by J. Y. Wong's "Theory of
Ground Vehicles") pressure grows as z^n under a plate, and a strip of contact length l and width b
sinks by z_1, with

    p = W / (b l) at z_1,   b_w p z_1 / (n + 1) = W resistance_bn (1 / Bn - 1 / Bn_hard).

b_w < b is the width of a flat strip on which as much work is done as on the rut with its flanks.
Bn_hard is the mobility number on ground that no cone penetrates: the resistance that is left there
is no work of sinkage, so that pressing ends at its strength.

W is the mean of the wheel's load over `LOAD_LENGTH_M`. z_1 grows faster than the load. With the
load of the moment, a wheel that bounces would dig a hole under its largest load, and the hole would
make it bounce more: a washboard whose waves are those of the time step and of the grid.

Passes add after Abebe, Tanaka and Yamazaki (J. Terramechanics 26 (1989) 139, from memory): equal
ones give z_N = z_1 N^(1/a), so that any wheel in a rut of depth z makes it (z^a + z_1^a)^(1/a)
deep, and only that much work resists it. The state is the height of the ground; it is pressed just
ahead of the contact, so that a wheel does not climb out of its own rut, and its sides are flanks of
the ground like any other. All lengths of a rut are fixed: the grid only samples it.
"""

import math
from typing import Any, Final, NamedTuple, Self

import numpy as np

from ttempc.jit import cached_njit, record
from ttempc.types import FloatArray

from ..ground.surface import Grid
from ..kernel_options import INLINED, KERNEL
from ..vectors import Vector, dot
from . import tyre

# n: 0.62 on sandy loam of medium density, 0.42 to 0.89 of dense to loose (Cranfield, thesis of
# D. Ansorge, table 8)
_EXPONENT: Final = 0.62
# a: 2 to 3 on loose soil, up to 5 on firm soil
_PASSES: Final = 3.0
LOAD_LENGTH_M: Final = 3.0
"""Distance over which the load of a wheel is averaged [m]; assumed, two waves of a farm tractor
that bounces at 2 Hz and 3 m/s."""
FLANK_M: Final = 0.15
"""Width of a flank, with its middle under the edge of the tyre [m]; assumed, the sides of a rut
8 cm deep stand at 30 deg. A narrower tyre has flanks of its own width."""
# [m] half length of the strip that is pressed at once, weighted as a hat
_STRIP: Final = 0.05
# [m] from strip to strip
_STEP: Final = 0.5 * _STRIP
# [m] keeps the depth over the sinkage finite
_LEAST_SINKAGE_M: Final = 1e-6
# [rad] largest turn of a wheel on its way to the strip
_LARGEST_TURN: Final = 0.5
# length of the fan of look-ups under a wheel over its radius
_FAN_LENGTH: Final = float(2.0 * np.sin(tyre.FAN_ANGLES[-1]))

PRESS: Final = np.dtype(
    [
        ("travel", np.float64),  # [m] since the wheel last pressed
        ("load", np.float64),  # [N] mean over `LOAD_LENGTH_M`; 0: the wheel has not rolled yet
        ("excess", np.float64),  # work of sinkage over that on new soil, minus 1
    ]
)
"""State of a wheel that leaves a rut."""


class Ruts(NamedTuple):
    """State of the ruts of n wheels; every array is empty where wheels leave none."""

    firm: FloatArray  # (ny, nx) [m] heights before any wheel
    heights: FloatArray  # (ny, nx) [m] present heights, changed in place
    presses: FloatArray  # (n, 3) rows `PRESS`, changed in place

    @classmethod
    def none(cls) -> Self:
        """Return the state of wheels that leave no ruts."""
        firm = np.empty((0, 0))
        firm.setflags(write=False)  # as the heights of a terrain: one compiled version
        return cls(firm, np.empty((0, 0)), np.empty((0, len(PRESS.names or ()))))


class Strip(NamedTuple):
    """A strip of ground across the path of a wheel."""

    x: float  # [m] middle
    y: float
    ahead: tuple[float, float]  # unit vector along the path
    width: float  # [m] of the tyre
    travel: float  # [m] from the strip before


@cached_njit(**INLINED)
def rolls_on(ruts: Ruts, wheel: int, load: float, distance: float) -> bool:
    """Let a wheel roll on and return whether it has come to its next strip.

    Args:
        ruts: the wheel's row `PRESS` is changed in place.
        wheel: number of the wheel.
        load: of the wheel [N].
        distance: that it rolls [m].
    """
    press = record(ruts.presses[wheel], PRESS)
    press.travel += distance
    due = press.travel > _STEP
    if due:
        share = min(1.0, press.travel / LOAD_LENGTH_M) if press.load > 0.0 else 1.0
        press.load += share * (load - press.load)
    return due


@cached_njit(**INLINED)
def strip_ahead(
    ruts: Ruts,
    wheel: int,
    tyre: Any,  # noqa: ANN401 - a record `TYRE`
    motion: tuple[Vector, Vector, Vector, Vector],
) -> Strip:
    """Return the strip just ahead of the look-ups of a wheel, on the arc on which it rolls.

    Args:
        ruts: with the wheel's row `PRESS`.
        wheel: number of the wheel.
        tyre: record `TYRE` of the wheel.
        motion: centre [m], axle, velocity [m/s] and rotation [rad/s] of the wheel.
    """
    centre, axle, velocity, rotation = motion
    speed = math.hypot(velocity[0], velocity[1])
    distance = 0.5 * _FAN_LENGTH * tyre.radius + _STRIP
    yaw_rate = rotation[2] - dot(rotation, axle) * axle[2]
    turn = yaw_rate * distance / speed
    turn = min(_LARGEST_TURN, max(-_LARGEST_TURN, turn))

    # the chord of the arc has half its turn
    heading = math.atan2(velocity[1], velocity[0])
    return Strip(
        x=centre[0] + distance * math.cos(heading + 0.5 * turn),
        y=centre[1] + distance * math.sin(heading + 0.5 * turn),
        ahead=(math.cos(heading + turn), math.sin(heading + turn)),
        width=tyre.width,
        travel=record(ruts.presses[wheel], PRESS).travel,
    )


@cached_njit(**INLINED)
def press_strip(
    ruts: Ruts, grid: Grid, wheel: int, strip: Strip, half_length: float, sinkage: float
) -> None:
    """Press the strip ahead of a wheel and let its resistance follow.

    It follows the work on the strips over half the length of the contact.

    Args:
        ruts: changed in place.
        grid: of the heights.
        wheel: number of the wheel.
        strip: that it comes to.
        half_length: of the contact [m].
        sinkage: z_1 [m].
    """
    row = record(ruts.presses[wheel], PRESS)
    if sinkage > _LEAST_SINKAGE_M:
        work = press(ruts, grid, strip, sinkage)
        followed = min(1.0, 0.5 * strip.travel / half_length)
        row.excess += followed * (work - 1.0 - row.excess)
    row.travel = 0.0


@cached_njit(**KERNEL)
def press(ruts: Ruts, grid: Grid, strip: Strip, sinkage: float) -> float:
    """Press the ground under a strip across a wheel and return the work over that on new soil.

    A point of the grid at a distance s along the path and y across it has the depth z_1 g(y) when
    all strips have passed it, with g the `profile` of a rut. One strip adds, to the depth to the
    power of a, the share of the hat h(s) that it covers.

    Args:
        ruts: its heights are changed.
        grid: of the heights.
        strip: with its width, and the length up to the strip before.
        sinkage: z_1 [m].
    """
    ny, nx = ruts.firm.shape
    along_x, along_y = strip.ahead
    half_width = 0.5 * (strip.width + FLANK_M)

    # points of the grid in the rectangle around the strip
    reach_x = (_STRIP * abs(along_x) + half_width * abs(along_y)) / grid.spacing
    reach_y = (_STRIP * abs(along_y) + half_width * abs(along_x)) / grid.spacing
    column = (strip.x - grid.x) / grid.spacing
    row = (strip.y - grid.y) / grid.spacing
    first_column = max(0, math.ceil(column - reach_x))
    last_column = min(nx - 1, math.floor(column + reach_x))
    first_row = max(0, math.ceil(row - reach_y))
    last_row = min(ny - 1, math.floor(row + reach_y))

    work = 0.0
    for j in range(first_row, last_row + 1):
        for i in range(first_column, last_column + 1):
            x = (i - column) * grid.spacing
            y = (j - row) * grid.spacing
            hat = 1.0 - abs(x * along_x + y * along_y) / _STRIP
            depth = profile(strip.width, y * along_x - x * along_y)
            if hat <= 0.0 or depth <= 0.0:
                continue
            share = strip.travel / _STRIP * hat

            # its depth before and after, over z_1
            firm = ruts.firm[j, i]
            before = max(0.0, (firm - ruts.heights[j, i]) / sinkage)
            after = (before**_PASSES + share * depth**_PASSES) ** (1.0 / _PASSES)
            work += _sinkage_work(after) - _sinkage_work(before)
            ruts.heights[j, i] = firm - after * sinkage

    return work * grid.spacing**2 / (strip.travel * working_width(strip.width))


@cached_njit(**INLINED)
def profile(width: float, across: float) -> float:
    """Return the depth of a rut over that of its bottom, at a distance from its middle [m].

    Args:
        width: of the tyre [m].
        across: distance [m].
    """
    flank = min(FLANK_M, width)
    inside = 0.5 * (width + flank) - abs(across)
    return min(1.0, max(0.0, inside / flank))


@cached_njit(**INLINED)
def working_width(width: float) -> float:
    """Return b_w, the integral of the profile to the power of n + 1 across the rut [m].

    Args:
        width: of the tyre [m].
    """
    flank = min(FLANK_M, width)
    return width - flank + 2.0 * flank / (_EXPONENT + 2.0)


@cached_njit(**INLINED)
def _sinkage_work(depth: float) -> float:
    """Return the work of sinkage to a depth, over that to z_1; below, the pressure is that at z_1.

    Args:
        depth: over z_1.
    """
    virgin = min(1.0, depth)
    return virgin ** (_EXPONENT + 1.0) + (_EXPONENT + 1.0) * (depth - virgin)


@cached_njit(**INLINED)
def sinkage_of(half_length: float, width: float, resistance: float) -> float:
    """Return z_1, the sinkage on new soil [m].

    Args:
        half_length: of the contact [m].
        width: of the tyre [m].
        resistance: of sinkage, over the load.
    """
    return 2.0 * half_length * (_EXPONENT + 1.0) * resistance * width / working_width(width)
