"""Bodies of a MuJoCo model at given places, without its joints and without physics."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray


def place_bodies(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    bodies: NDArray[np.intp],
    xyz: FloatArray,
    quat: FloatArray,
) -> None:
    """Put bodies, and every shape on them, to their places in `data`.

    Args:
        model: of the bodies.
        data: whose places of bodies and geoms are written, in place.
        bodies: (n,) their numbers in the model.
        xyz: (n, 3) [m] map frame.
        quat: (n, 4) w, x, y, z.
    """
    data.xpos[bodies], data.xquat[bodies] = xyz, quat
    turn = rotation_matrices(data.xquat)  # (nbody, 3, 3)
    moved = np.isin(model.geom_bodyid, bodies)
    of = model.geom_bodyid[moved]
    offset = np.einsum("nij,nj->ni", turn[of], model.geom_pos[moved])
    data.geom_xpos[moved] = data.xpos[of] + offset
    own = rotation_matrices(model.geom_quat[moved])
    data.geom_xmat[moved] = (turn[of] @ own).reshape(-1, 9)


def rotation_matrices(quat: FloatArray) -> FloatArray:
    """Return the rotation matrices (n, 3, 3) of unit quaternions (n, 4), w, x, y, z."""
    w, x, y, z = quat.T
    rows = (
        *(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        *(2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        *(2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
    return np.stack(rows, axis=-1).reshape(-1, 3, 3)
