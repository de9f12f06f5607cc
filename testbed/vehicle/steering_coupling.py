"""Coupling of joints by a stiff spring with a damper in place of a constraint of MuJoCo.

A constraint makes the steering exact at the price of MuJoCo's solver: two of them take 40 % of a
step of this vehicle without ground. The follower's angle is a quartic phi of the leader's delta,
and the gap g = phi(delta) - theta gives a torque k g + c dg/dt on the follower and phi' times it,
reversed, on the leader: as much power as leaves the one arrives at the other or in the damper.
With the inertia I that followers and leader together oppose to a gap, and a time T,

    k = I / T^2,  c = I / T,

explicit steps of the length T close a gap in two, and at shorter ones a swing fades.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from typing import Final

import mujoco
import numpy as np

from ttempc.jit import cached_njit
from ttempc.types import FloatArray

COUPLING_S: Final = 0.004
"""T, the longest physics step."""


def coupling_table(model: mujoco.MjModel) -> FloatArray:
    """Return the coupled joints of a model, (n, 11), from its constraints, which may be inactive.

    A row has places of the follower's and the leader's position, then of their velocities, the
    quartic from order 0, k and c.
    """
    rows = []
    for constraint in np.flatnonzero(model.eq_type == mujoco.mjtEq.mjEQ_JOINT):
        joints = [model.eq_obj1id[constraint], model.eq_obj2id[constraint]]
        places, dofs = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        followers = np.count_nonzero(model.eq_obj2id == joints[1])
        follower, leader = model.dof_M0[dofs].tolist()
        inertia = 1.0 / (1.0 / follower + followers / leader)
        gains = inertia / COUPLING_S**2, inertia / COUPLING_S
        rows.append([*places, *dofs, *model.eq_data[constraint, :5], *gains])
    return np.array(rows).reshape(-1, 11)


@cached_njit(error_model="numpy", boundscheck=False)
def couple_joints(
    coupling: FloatArray, qpos: FloatArray, qvel: FloatArray, force: FloatArray
) -> None:
    """Add the torques of all couplings to `force`, (nv,) [N m].

    Args:
        coupling: (n, 11) `coupling_table`.
        qpos: (nq,) MuJoCo's positions.
        qvel: (nv,) MuJoCo's velocities.
        force: (nv,) MuJoCo's passive forces, made anew by every `mj_step1`.
    """
    for row in range(coupling.shape[0]):
        theta, delta = qpos[int(coupling[row, 0])], qpos[int(coupling[row, 1])]
        follower, leader = int(coupling[row, 2]), int(coupling[row, 3])
        c0, c1, c2 = coupling[row, 4], coupling[row, 5], coupling[row, 6]
        c3, c4 = coupling[row, 7], coupling[row, 8]
        angle = c0 + delta * (c1 + delta * (c2 + delta * (c3 + delta * c4)))
        slope = c1 + delta * (2.0 * c2 + delta * (3.0 * c3 + delta * 4.0 * c4))
        rate = slope * qvel[leader] - qvel[follower]
        torque = coupling[row, 9] * (angle - theta) + coupling[row, 10] * rate
        force[follower] += torque
        force[leader] -= slope * torque
