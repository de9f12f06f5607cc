"""Poses of the bodies of a MuJoCo model, set without joints and without physics."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ttempc.types import FloatArray


def place_bodies(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    bodies: NDArray[np.intp],
    xyz: FloatArray,
    quat: FloatArray,
) -> None:
    """Set the poses of bodies and of all geoms on them.

    Args:
        model: of the bodies.
        data: whose poses of bodies and geoms are written, in place.
        bodies: ids in the model, (n,).
        xyz: positions in the map frame [m], (n, 3).
        quat: attitudes w, x, y, z, (n, 4).
    """
    data.xpos[bodies], data.xquat[bodies] = xyz, quat
    moved = np.isin(model.geom_bodyid, bodies)
    body = model.geom_bodyid[moved]
    attitude = rotation(data.xquat[body])
    data.geom_xpos[moved] = data.xpos[body] + attitude.apply(model.geom_pos[moved])
    geom_attitude = attitude * rotation(model.geom_quat[moved])
    data.geom_xmat[moved] = geom_attitude.as_matrix().reshape(-1, 9)


def rotation(quat: FloatArray) -> Rotation:
    """Return the rotations of quaternions w, x, y, z as in MuJoCo, (4,) or (n, 4)."""
    return Rotation.from_quat(np.roll(quat, -1, axis=-1))  # SciPy's order is x, y, z, w
