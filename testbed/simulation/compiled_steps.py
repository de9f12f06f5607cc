"""The plant's step: physics with soil wheels in one compiled call, `soil_steps`.

Its parts: `actuation/actuators.py`, `wheels/tyre_kernel.py`, `vehicle/steering_coupling.py`,
`implement/tool_kernel.py`, `dynamics.py`, `clearance.py`, `moment.py`.

MuJoCo's functions are called by their symbols in its library, without Python in between. An error
inside MuJoCo, such as a lack of memory for its stack, therefore ends the process; a state that is
not finite is found when the call has ended.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import ctypes
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import llvmlite.binding
import mujoco
import numpy as np
from numba import config
from numpy.typing import NDArray

from ttempc.jit import cached_njit
from ttempc.types import FloatArray

from ..actuation.actuators import move_valves
from ..ground.ground import Ground
from ..implement.mounted import MountedImplement
from ..implement.tool_kernel import tool_step
from ..vehicle.steering_coupling import couple_joints
from ..wheels.tyre_kernel import wheel_step
from ..wheels.wheel_models import SoilWheels
from .clearance import chassis_arguments, clearance
from .dynamics import EXPLICIT, all_positions, dynamics_arguments, move, positions
from .moment import write_moment


def clock() -> np.ndarray:
    """Return MuJoCo's variable with the address of the clock that it reads 20 times a step, (1,).

    The bindings for Python set it; without a clock a step takes 6 % less. `mjData.timer`, which
    nobody reads, then stays as it is.
    """
    address = llvmlite.binding.address_of_symbol("mjcb_time")
    return np.ctypeslib.as_array((ctypes.c_ssize_t * 1).from_address(address))


_CLOCK: Final = int(clock()[0])


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def soil_steps(
    model: int,
    data: int,
    wheels: tuple[Any, ...],
    coupling: tuple[Any, ...],
    tool: tuple[Any, ...] | None,
    dynamics: tuple[Any, ...],
    chassis: tuple[Any, ...],
    reaches: FloatArray,
    limits: FloatArray,
    looked: FloatArray,
    moment: tuple[Any, ...],
    flags: np.ndarray,
    unused: int,
    clock: np.ndarray,
    timer: int,
    timestep: float,
    valves: FloatArray,
    valve_state: FloatArray,
    command: FloatArray,
    time: float,
    stride: int,
    rows: FloatArray,
    poses: FloatArray,
    tools: FloatArray,
) -> None:
    """Run physics steps: valves, forces of the soil, accelerations and integration, positions.

    MuJoCo searches for contacts only where the chassis may have come down to the ground since the
    last look at its clearance, and looks at joint limits only where one is passed.

    Args:
        model, data: addresses; positions and velocities are up to date before and after.
        wheels, coupling, dynamics, chassis, moment: arguments of `wheel_step`, `couple_joints`, of
            `move`, of `clearance`, and of `write_moment` from places on.
        tool: arguments of `tool_step`, None without an implement.
        reaches: (nv,) largest distance by which a unit of each degree of freedom moves a point of
            the chassis, [m] or [m/m].
        limits: (n, 3) place in the positions, least and greatest value of each limited joint.
        looked: (nq + 2,) positions at the end of the last call, whether there was no constraint,
            and the distance [m] that the chassis could then move without meeting the ground. Both
            hold at these positions only.
        flags: (1,) flags of MuJoCo's model by which parts are off, as found afterwards.
        unused: flags of the parts without use while no shape is near the ground and no limit is
            passed.
        clock: (1,) `clock()`; 0 meanwhile.
        timer: its value afterwards.
        timestep, time: of the physics, at the start [s].
        valves, valve_state: of `move_valves`, (0, 7) where the set points are the command.
        command: (3,) held over the steps.
        stride: number of physics steps to each stop.
        rows, poses, tools: arrays of `Moments`; one is written at each stop.
    """
    clock[0] = 0
    given = flags[0]
    places, qpos, qvel, ctrl = moment[0], moment[3][0], moment[3][1], moment[3][3]
    free = looked[-1]  # distance that the chassis can move without meeting the ground [m]
    for i in range(qpos.size):
        if looked[i] != qpos[i]:
            free = 0.0
    smooth = free > 0.0 and looked[-2] > 0.0
    for axis in range(3):
        ctrl[axis] = command[axis]
    for stop in range(rows.shape[0]):
        for _ in range(stride):
            if valves.size:
                move_valves(valves, valve_state, command, qpos[places[6]], qpos[places[7]])
                for axis in range(3):
                    ctrl[axis] = valve_state[4 + axis]
            wheel_step(*wheels)
            couple_joints(*coupling)
            if tool is not None:
                tool_step(*tool)
            move(model, data, smooth, timestep, dynamics)
            # The shapes are where they were before the step, the velocities those that moved them.
            motion = 0.0
            for dof in range(qvel.size):
                motion += abs(qvel[dof]) * reaches[dof]
            motion *= timestep
            if not free > motion:
                free = clearance(*chassis)
            free -= motion
            inside = free > 0.0
            for joint in range(limits.shape[0]):
                angle = qpos[int(limits[joint, 0])]
                inside = inside and limits[joint, 1] <= angle <= limits[joint, 2]
            if inside and smooth:
                positions(model, data, dynamics)
            else:  # also once more where constraints end, so that none is left
                flags[0] = given | unused if inside else given
                all_positions(model, data)
                smooth = inside
            time += timestep
        write_moment(time, rows[stop], poses[stop], tools[stop], *moment)
    flags[0], clock[0] = given, timer
    looked[-1], looked[-2] = free, smooth
    for i in range(qpos.size):  # a slice would compile numba's texts of errors
        looked[i] = qpos[i]


def compiled_steps(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    wheels: SoilWheels,
    implement: MountedImplement | None,
    ground: Ground,
    moment: tuple[Any, ...],
) -> Callable[..., object] | None:
    """Return `soil_steps` of a plant from `valves` on, None under NUMBA_DISABLE_JIT.

    `moment` are the arguments of `write_moment` from `places` on.
    """
    if config.DISABLE_JIT:
        return None
    model.opt.disableflags |= EXPLICIT
    limited = np.flatnonzero(model.jnt_limited)
    within = model.jnt_range[limited] + np.outer(model.jnt_margin[limited], [1.0, -1.0])
    return partial(
        soil_steps,
        model._address,
        data._address,
        wheels.arguments,
        wheels.coupling,
        implement.arguments if implement else None,  # None: `tool_step` is not compiled
        dynamics_arguments(model, data),
        *chassis_arguments(model, data, ground),
        np.column_stack([model.jnt_qposadr[limited], within]),
        np.zeros(model.nq + 2),
        moment,
        disable_flags(model),
        int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT),
        clock(),
        _CLOCK,
        model.opt.timestep,
    )


def disable_flags(model: mujoco.MjModel) -> NDArray[np.int32]:
    """Return a view of `model.opt.disableflags`, (1,), which the bindings copy.

    It lies in MuJoCo's `mjOption` after the numbers up to `o_friction`. Where a release has another
    order, the view is one of nothing: steps then search for contacts always.
    """
    option = model.opt
    names = ("integrator", "cone", "jacobian", "solver", "iterations", "ls_iterations")
    names = (*names, "noslip_iterations", "ccd_iterations", "disableflags", "enableflags")
    address = option.o_friction.ctypes.data + option.o_friction.nbytes
    found = np.ctypeslib.as_array((ctypes.c_int * len(names)).from_address(address))
    if found.tolist() != [getattr(option, name) for name in names]:
        return np.zeros(1, dtype=np.int32)
    return found[-2:-1]
