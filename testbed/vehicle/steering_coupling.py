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

from typing import Final, NamedTuple, Self

import mujoco
import numpy as np

from ttempc.jit import cached_njit, record
from ttempc.types import FloatArray

from ..kernel_options import KERNEL

COUPLING_S: Final = 0.004
"""T, the longest physics step."""

COUPLED_PAIR: Final = np.dtype(
    [
        ("follower_position", np.float64),  # places in the positions and velocities
        ("leader_position", np.float64),
        ("follower_velocity", np.float64),
        ("leader_velocity", np.float64),
        ("order_0", np.float64),  # quartic, by the power of the leader's angle
        ("order_1", np.float64),
        ("order_2", np.float64),
        ("order_3", np.float64),
        ("order_4", np.float64),
        ("stiffness", np.float64),  # [N m/rad] k
        ("damping", np.float64),  # [N m s/rad] c
    ]
)
"""A joint that follows another one."""

_ORDERS: Final = 5


class Coupling(NamedTuple):
    """Couplings of a vehicle and the views of MuJoCo's arrays on which they act."""

    pairs: FloatArray  # (n, fields) rows `COUPLED_PAIR`
    qpos: FloatArray
    qvel: FloatArray
    force: FloatArray  # (nv,) [N m] passive forces, made anew by every `mj_step1`

    @classmethod
    def of(cls, model: mujoco.MjModel, data: mujoco.MjData) -> Self:
        """Return the couplings of a model from its constraints, which may be inactive."""
        return cls(_coupled_pairs(model), data.qpos, data.qvel, data.qfrc_passive)


def _coupled_pairs(model: mujoco.MjModel) -> FloatArray:
    rows = []
    for constraint in np.flatnonzero(model.eq_type == mujoco.mjtEq.mjEQ_JOINT):
        joints = [model.eq_obj1id[constraint], model.eq_obj2id[constraint]]
        places = model.jnt_qposadr[joints]
        dofs = model.jnt_dofadr[joints]

        # inertia that the leader and all its followers oppose to a gap
        followers = np.count_nonzero(model.eq_obj2id == joints[1])
        follower, leader = model.dof_M0[dofs].tolist()
        inertia = 1.0 / (1.0 / follower + followers / leader)

        stiffness = inertia / COUPLING_S**2
        damping = inertia / COUPLING_S
        quartic = model.eq_data[constraint, :_ORDERS]
        rows.append([*places, *dofs, *quartic, stiffness, damping])
    return np.array(rows).reshape(-1, len(COUPLED_PAIR.names or ()))


@cached_njit(**KERNEL)
def couple_joints(coupling: Coupling) -> None:
    """Add the torques of all couplings to the passive forces."""
    for row in range(coupling.pairs.shape[0]):
        pair = record(coupling.pairs[row], COUPLED_PAIR)
        follower = int(pair.follower_velocity)
        leader = int(pair.leader_velocity)
        theta = coupling.qpos[int(pair.follower_position)]
        delta = coupling.qpos[int(pair.leader_position)]

        # phi and phi' by Horner's scheme
        angle = pair.order_0 + delta * (
            pair.order_1 + delta * (pair.order_2 + delta * (pair.order_3 + delta * pair.order_4))
        )
        slope = pair.order_1 + delta * (
            2.0 * pair.order_2 + delta * (3.0 * pair.order_3 + delta * 4.0 * pair.order_4)
        )

        rate = slope * coupling.qvel[leader] - coupling.qvel[follower]
        torque = pair.stiffness * (angle - theta) + pair.damping * rate
        coupling.force[follower] += torque
        coupling.force[leader] -= slope * torque
