"""Physics steps with soil wheels in one compiled call.

MuJoCo's functions are called by their symbols in its library, without Python in between. An error
inside MuJoCo, such as a lack of memory for its stack, therefore ends the process; a state that is
not finite remains a warning of MuJoCo's.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

import llvmlite.binding
import mujoco
import numpy as np
from numba import config, types
from numpy.typing import NDArray

from ttempc.jit import cached_njit
from ttempc.types import FloatArray

from ..ground.terrain import Terrain
from ..implement.mounted import MountedImplement
from ..implement.tool_kernel import tool_step
from ..wheels.soil_wheels import SoilWheels
from ..wheels.tyre_kernel import wheel_step
from .clearance_kernel import TILE_M, clearance

for _pattern in ("libmujoco*.so*", "libmujoco*.dylib", "mujoco.dll"):
    for _library in Path(mujoco.__file__).parent.glob(_pattern):
        # loaded already by `mujoco`: this makes its symbols known to numba
        llvmlite.binding.load_library_permanently(str(_library))

_OF_MODEL_AND_DATA: Final = types.void(types.intp, types.intp)
_step1: Final = types.ExternalFunction("mj_step1", _OF_MODEL_AND_DATA)
_step2: Final = types.ExternalFunction("mj_step2", _OF_MODEL_AND_DATA)


def _clock() -> np.ndarray:
    """Return MuJoCo's variable with the address of the clock that it reads 20 times a step, (1,).

    The bindings for Python set it; without a clock a step takes 6 % less. `mjData.timer`, which
    nobody reads, then stays as it is.
    """
    address = llvmlite.binding.address_of_symbol("mjcb_time")
    return np.ctypeslib.as_array((ctypes.c_ssize_t * 1).from_address(address))


_CLOCK: Final = int(_clock()[0])


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def soil_steps(
    model: int,
    data: int,
    wheels: tuple[Any, ...],
    tool: tuple[Any, ...],
    has_tool: bool,
    chassis: tuple[Any, ...],
    reaches: FloatArray,
    looked: FloatArray,
    qpos: FloatArray,
    qvel: FloatArray,
    ground_type: np.ndarray,
    clock: np.ndarray,
    timer: int,
    timestep: float,
    steps: int,
) -> None:
    """Run physics steps: forces of the soil, accelerations and integration, positions.

    The ground takes part in MuJoCo's search for contacts only where the chassis may have come down
    to it since the last look at its clearance: on a slope the search takes as long as two steps.

    Args:
        model: address of MuJoCo's model.
        data: address of MuJoCo's data; positions and velocities are up to date before and after.
        wheels: arguments of `wheel_step`.
        tool: arguments of `tool_step`.
        has_tool: whether there is an implement.
        chassis: arguments of `clearance`.
        reaches: (nv,) largest distance by which a unit of each degree of freedom moves a point of
            the chassis, [m] or [m/m].
        looked: (nq + 1,) positions at the end of the last call, and the distance [m] that the
            chassis could then move without meeting the ground. It holds at these positions only.
        qpos: (nq,) MuJoCo's positions.
        qvel: (nv,) MuJoCo's velocities.
        ground_type: (1,) contact type of the ground in MuJoCo's model, as found afterwards.
        clock: (1,) `_clock`; 0 meanwhile.
        timer: its value afterwards.
        timestep: of the physics [s].
        steps: number of physics steps.
    """
    clock[0] = 0
    touching = ground_type[0]
    free = looked[-1]  # distance that the chassis can move without meeting the ground [m]
    for i in range(qpos.size):
        if looked[i] != qpos[i]:
            free = 0.0
    for _ in range(steps):
        wheel_step(*wheels)
        if has_tool:
            tool_step(*tool)
        _step2(model, data)
        # The shapes are where they were before the step, the velocities those that moved them.
        motion = 0.0
        for dof in range(qvel.size):
            motion += abs(qvel[dof]) * reaches[dof]
        motion *= timestep
        if not free > motion:
            free = clearance(*chassis)
        free -= motion
        ground_type[0] = 0 if free > 0.0 else touching
        _step1(model, data)
    ground_type[0], clock[0] = touching, timer
    looked[:-1], looked[-1] = qpos, free


def compiled_steps(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    wheels: SoilWheels,
    implement: MountedImplement | None,
    terrain: Terrain,
) -> Callable[[int], object] | None:
    """Return the function that runs a number of physics steps of a plant with soil wheels.

    It is None under NUMBA_DISABLE_JIT.
    """
    if config.DISABLE_JIT:
        return None
    ground = model.geom("ground").id
    shapes: NDArray[np.int64] = np.flatnonzero(model.geom_conaffinity & model.geom_contype[ground])
    rows, columns = (int(np.ceil(side / TILE_M)) for side in reversed(terrain.size_m))
    chassis = (
        data.geom_xpos,
        data.geom_xmat,
        shapes,
        np.array([_half_lengths(model, shape, ground) for shape in shapes.tolist()]),
        float(model.geom_rbound[shapes].max()),
        terrain.heights,
        np.array([*terrain.origin, terrain.spacing_m]),
        np.zeros((rows, columns, 4)),
    )
    return partial(
        soil_steps,
        model._address,
        data._address,
        wheels.arguments,
        implement.arguments if implement else _without_tool(data, wheels),
        implement is not None,
        chassis,
        _reaches(model, shapes),
        np.zeros(model.nq + 1),
        data.qpos,
        data.qvel,
        model.geom_contype[ground : ground + 1],
        _clock(),
        _CLOCK,
        model.opt.timestep,
    )


def _without_tool(data: mujoco.MjData, wheels: SoilWheels) -> tuple[Any, ...]:
    """Return arguments of the types of `tool_step`'s, so that there is one compiled version."""
    heights, cone_indices, grid = wheels.arguments[2:5]
    law, offsets, work = np.zeros(12), np.zeros(0), np.zeros((0, 2))
    bodies = (0, data.xpos, data.xmat, data.xipos, data.cvel, data.subtree_com)
    lift, output = np.zeros(2), np.zeros((0, 3))
    return law, offsets, work, heights, cone_indices, grid, *bodies, lift, output, data.xfrc_applied


def _half_lengths(model: mujoco.MjModel, shape: int, ground: int) -> list[float]:
    """Return half lengths and radius of a rounded box that holds a shape, (4,) [m]."""
    a, b, c = model.geom_size[shape].tolist()
    margin = float(model.geom_margin[shape] + model.geom_margin[ground])
    match model.geom_type[shape]:
        case mujoco.mjtGeom.mjGEOM_BOX:
            return [a, b, c, margin]
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            return [0.0, 0.0, b, a + margin]
        case _:
            return [0.0, 0.0, 0.0, float(model.geom_rbound[shape]) + margin]


def _reaches(model: mujoco.MjModel, shapes: NDArray[np.int64]) -> FloatArray:
    """Return how far a unit of each degree of freedom moves a point of the chassis at most, (nv,).

    A rotation moves it by its distance from the joint's anchor: at most the sum of the offsets
    between the bodies on the way, and the reach of the shape.
    """
    reaches = np.zeros(model.nv)
    for shape in shapes:
        body = int(model.geom_bodyid[shape])
        distance = float(np.linalg.norm(model.geom_pos[shape]) + model.geom_rbound[shape])
        while body:
            first = int(model.body_jntadr[body])
            for joint in range(first, first + int(model.body_jntnum[body])):
                distance += 2.0 * float(np.linalg.norm(model.jnt_pos[joint]))
            for dof in np.flatnonzero(model.dof_bodyid == body):
                joint = model.dof_jntid[dof]
                free = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE
                slides = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
                unit = slides or (free and dof < model.jnt_dofadr[joint] + 3)
                reaches[dof] = max(reaches[dof], 1.0 if unit else distance)
            distance += float(np.linalg.norm(model.body_pos[body]))
            body = int(model.body_parentid[body])
    return reaches
