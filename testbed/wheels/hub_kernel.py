"""Wheels of any MuJoCo model as the bodies of the wheel law, and its forces back, compiled.

`tyre_kernel.wheel_step` expects a wheel to be a body with its centre at the origin and its axle
along y. A wheel of another model has both somewhere in its body's frame: `read_hubs` writes the
motion of all wheels in the form that the law expects, `apply_hubs` brings the wrenches back.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from typing import Final, NamedTuple, Self

import mujoco
import numpy as np

from ttempc.jit import FAST, cached_njit, record
from ttempc.types import FloatArray

from ..bodies import LEFT, Bodies, axis_of, row_vector
from ..kernel_options import KERNEL
from ..vectors import Vector, add, cross, scale, subtract

HUB: Final = np.dtype(
    [
        ("body", np.float64),  # that spins with the wheel
        ("root", np.float64),  # body about whose subtree's centre MuJoCo has the velocity
        ("centre", np.float64, (3,)),  # [m] of the wheel, in the body's frame
        ("axle", np.float64, (3,)),  # unit vector to the wheel's left, in the body's frame
    ]
)
"""Place of a wheel on its body."""

_kernel = cached_njit(**KERNEL, fastmath=FAST)


class Hubs(NamedTuple):
    """The n wheels of a model, between MuJoCo's arrays and those of the wheel law."""

    places: FloatArray  # (n, fields) rows `HUB`
    bodies: Bodies  # of MuJoCo's data, a row a body
    wheels: Bodies  # of the wheel law, a row a wheel

    @classmethod
    def of(cls, places: FloatArray, data: mujoco.MjData, wheels: Bodies) -> Self:
        """Return the wheels at these places of a model with this data."""
        return cls(places, Bodies.of(data), wheels)


def wheel_bodies(count: int) -> Bodies:
    """Return the arrays of a number of wheels, to be written by `read_hubs`.

    The wheel law takes velocities about the centre of the subtree of body 1 and adds the motion of
    the wheel about it. That centre is the origin here.
    """
    return Bodies(
        positions=np.zeros((count, 3)),
        axes=np.zeros((count, 9)),
        mass_centres=np.zeros((count, 3)),
        velocities=np.zeros((count, 6)),
        subtree_centres=np.zeros((2, 3)),
        wrenches=np.zeros((count, 6)),
    )


@_kernel
def read_hubs(hubs: Hubs) -> None:
    """Write position, axle and motion of each wheel, in the map frame."""
    bodies = hubs.bodies
    wheels = hubs.wheels
    for wheel in range(hubs.places.shape[0]):
        place = record(hubs.places[wheel], HUB)
        body = int(place.body)
        centre = _to_map(bodies, body, (place.centre[0], place.centre[1], place.centre[2]))
        position = add(row_vector(bodies.positions, body), centre)
        axle = _to_map(bodies, body, (place.axle[0], place.axle[1], place.axle[2]))

        # velocity of the origin of the map, if it moved with the body
        rotation = row_vector(bodies.velocities, body)
        at_root = bodies.velocities[body, 3:]
        root = row_vector(bodies.subtree_centres, int(place.root))
        velocity = subtract((at_root[0], at_root[1], at_root[2]), cross(rotation, root))

        for axis in range(3):
            wheels.positions[wheel, axis] = position[axis]
            wheels.axes[wheel, 3 * axis + LEFT] = axle[axis]
            wheels.velocities[wheel, axis] = rotation[axis]
            wheels.velocities[wheel, 3 + axis] = velocity[axis]


@_kernel
def apply_hubs(hubs: Hubs) -> None:
    """Write the wrenches on the wheels as forces at the centres of mass of their bodies."""
    bodies = hubs.bodies
    wheels = hubs.wheels
    for wheel in range(hubs.places.shape[0]):
        body = int(record(hubs.places[wheel], HUB).body)
        force = row_vector(wheels.wrenches, wheel)
        moments = wheels.wrenches[wheel, 3:]
        arm = subtract(row_vector(wheels.positions, wheel), row_vector(bodies.mass_centres, body))
        moment = add((moments[0], moments[1], moments[2]), cross(arm, force))
        for axis in range(3):
            bodies.wrenches[body, axis] = force[axis]
            bodies.wrenches[body, 3 + axis] = moment[axis]


@cached_njit(**KERNEL, inline="always", fastmath=FAST)
def _to_map(bodies: Bodies, body: int, vector: Vector) -> Vector:
    """Return a vector of a body's frame in the map frame."""
    total = (0.0, 0.0, 0.0)
    for axis in range(3):
        total = add(total, scale(vector[axis], axis_of(bodies.axes, body, axis)))
    return total
