"""Motion of MuJoCo's bodies and the wrenches on them, for kernels.

Vectors are in the map frame. MuJoCo keeps the axes of a body as nine numbers, row by row, so that
an axis is every third of them, and the velocities of all bodies of a vehicle at one point, the
vehicle's centre of mass.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from typing import Final, NamedTuple, Self

import mujoco

from ttempc.jit import FAST, cached_njit
from ttempc.types import FloatArray

from .kernel_options import INLINED
from .vectors import Vector, add, cross, subtract

AHEAD: Final = 0
LEFT: Final = 1
UP: Final = 2
"""Axes of a body."""

_VEHICLE: Final = 1  # body whose subtree is the vehicle

_inlined = cached_njit(**INLINED, fastmath=FAST)


class Bodies(NamedTuple):
    """MuJoCo's arrays, a row a body; they outlive a reset of the data."""

    positions: FloatArray  # (n, 3) [m] `xpos`, origins
    axes: FloatArray  # (n, 9) `xmat`
    mass_centres: FloatArray  # (n, 3) [m] `xipos`
    velocities: FloatArray  # (n, 6) [rad/s, m/s] `cvel`, rotation and velocity
    subtree_centres: FloatArray  # (n, 3) [m] `subtree_com`
    wrenches: FloatArray  # (n, 6) [N, N m] `xfrc_applied`, force at the centre of mass and moment

    @classmethod
    def of(cls, data: mujoco.MjData) -> Self:
        """Return views of the arrays."""
        return cls(
            positions=data.xpos,
            axes=data.xmat,
            mass_centres=data.xipos,
            velocities=data.cvel,
            subtree_centres=data.subtree_com,
            wrenches=data.xfrc_applied,
        )


@_inlined
def row_vector(rows: FloatArray, row: int) -> Vector:
    """Return the first three numbers of a row."""
    return rows[row, 0], rows[row, 1], rows[row, 2]


@_inlined
def axis_of(axes: FloatArray, body: int, axis: int) -> Vector:
    """Return the axis `AHEAD`, `LEFT` or `UP` of a body, a unit vector."""
    return axes[body, axis], axes[body, 3 + axis], axes[body, 6 + axis]


@_inlined
def velocity_of(bodies: Bodies, body: int) -> Vector:
    """Return the velocity of a body's origin [m/s]."""
    at_centre = bodies.velocities[body, 3:]
    rotation = row_vector(bodies.velocities, body)
    arm = subtract(row_vector(bodies.positions, body), row_vector(bodies.subtree_centres, _VEHICLE))
    return add((at_centre[0], at_centre[1], at_centre[2]), cross(rotation, arm))


@_inlined
def apply_wrench(bodies: Bodies, body: int, force: Vector, moment: Vector) -> None:
    """Write the force [N] and the moment [N m] about the centre of mass that act on a body."""
    wrench = bodies.wrenches[body]
    for axis in range(3):
        wrench[axis] = force[axis]
        wrench[3 + axis] = moment[axis]
