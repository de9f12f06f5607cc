"""Search for contacts and joint limits only where there may be one, compiled.

MuJoCo searches for contacts only where the chassis may have come down to the ground since its
clearance was last computed, and looks at joint limits only where one is passed.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from typing import Final, NamedTuple, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from ttempc.jit import cached_njit, record
from ttempc.types import FloatArray

from ...ground.ground import Ground
from ...kernel_options import INLINED, KERNEL
from .clearance import Chassis, clearance, reaches_of
from .library import mj_step1
from .motion import Dynamics, update_kinematics

MEMORY: Final = np.dtype(
    [
        ("clearance", np.float64),  # [m] by which the chassis can move without meeting the ground
        ("unconstrained", np.float64),  # 1 where the present state has no constraints, else 0
    ]
)
"""Knowledge of the present positions."""

_UNUSED: Final = int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)

_kernel = cached_njit(**KERNEL)
_inlined = cached_njit(**INLINED)


class ContactWatch(NamedTuple):
    """Watch over the shapes and the n limited joints of a vehicle."""

    chassis: Chassis
    # (nv,) largest distance by which a unit of each degree of freedom moves a point of the
    # chassis, [m] or [m/m]
    reaches: FloatArray
    limited: NDArray[np.int64]  # (n,) places of the limited joints in the positions
    limits: FloatArray  # (n, 2) least and greatest value of each
    memory: FloatArray  # row `MEMORY`, which holds at these positions only:
    positions: FloatArray  # (nq,)
    flags: NDArray[np.int32]  # (1,) MuJoCo's flags by which parts of a step are off
    given_flags: NDArray[np.int32]  # (1,) the same, as the plant has them

    @classmethod
    def of(
        cls,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        ground: Ground,
        flags: NDArray[np.int32],
    ) -> Self:
        """Return the watch of a plant that knows nothing yet; `flags` of `disable_flags`."""
        chassis = Chassis.of(model, data, ground)
        limited = np.flatnonzero(model.jnt_limited)
        inward = np.outer(model.jnt_margin[limited], [1.0, -1.0])
        return cls(
            chassis=chassis,
            reaches=reaches_of(model, chassis.shapes),
            limited=model.jnt_qposadr[limited].astype(np.int64),
            limits=model.jnt_range[limited] + inward,
            memory=np.zeros(len(MEMORY.names or ())),
            positions=np.zeros(model.nq),
            flags=flags,
            given_flags=np.zeros(1, dtype=np.int32),
        )


@_inlined
def begin_watch(watch: ContactWatch, qpos: FloatArray) -> None:
    """Begin a call: forget what was known where the positions were changed since the last one."""
    watch.given_flags[0] = watch.flags[0]
    memory = record(watch.memory, MEMORY)
    for place in range(qpos.size):
        if watch.positions[place] != qpos[place]:
            memory.clearance = 0.0
    if not memory.clearance > 0.0:
        memory.unconstrained = 0.0


@_inlined
def end_watch(watch: ContactWatch, qpos: FloatArray) -> None:
    """End a call: give the flags back, remember the positions."""
    watch.flags[0] = watch.given_flags[0]
    for place in range(qpos.size):  # a slice would compile numba's texts of errors
        watch.positions[place] = qpos[place]


@_inlined
def is_unconstrained(watch: ContactWatch) -> bool:
    """Return whether the present state has neither contacts nor joints at their limits."""
    return record(watch.memory, MEMORY).unconstrained > 0.0


@_kernel
def update_positions(watch: ContactWatch, dynamics: Dynamics) -> None:
    """Do as `mj_step1`, with contacts and limits only where there may be one."""
    memory = record(watch.memory, MEMORY)

    # the shapes are where they were before the step, the velocities those that moved them
    motion = dynamics.timestep * _largest_speed(watch, dynamics.qvel)
    if not memory.clearance > motion:
        memory.clearance = clearance(watch.chassis)
    memory.clearance -= motion

    absent = memory.clearance > 0.0 and _within_limits(watch, dynamics.qpos)
    if absent and memory.unconstrained > 0.0:
        update_kinematics(dynamics)
        return
    # also once more where constraints end, so that none is left
    watch.flags[0] = watch.given_flags[0] | _UNUSED if absent else watch.given_flags[0]
    mj_step1(dynamics.model, dynamics.data)
    memory.unconstrained = 1.0 if absent else 0.0


@_inlined
def _largest_speed(watch: ContactWatch, qvel: FloatArray) -> float:
    """Return an upper bound of the speed of any point of the chassis [m/s]."""
    speed = 0.0
    for dof in range(qvel.size):
        speed += abs(qvel[dof]) * watch.reaches[dof]
    return speed


@_inlined
def _within_limits(watch: ContactWatch, qpos: FloatArray) -> bool:
    for joint in range(watch.limited.size):
        angle = qpos[watch.limited[joint]]
        if not watch.limits[joint, 0] <= angle <= watch.limits[joint, 1]:
            return False
    return True
