"""Physics steps with soil wheels in one compiled call; a lower bound of the chassis' clearance.

MuJoCo's functions are called by their symbols in its library, without Python in between. An error
inside MuJoCo, such as a lack of memory for its stack, therefore ends the process; a state that is
not finite remains a warning of MuJoCo's.

The clearance: each tile of the field has a plane that no height in its window exceeds. The window
is the tile, widened by the reach of the largest shape of the chassis and by `MOTION_M`. A shape
with its centre in the tile is clear of the ground as long as it is above the plane, and stays so
while no point of the chassis has moved farther than it was above the plane, or than `MOTION_M`.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import ctypes
import math
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

from ..actuation.actuators import move_valves
from ..ground.ground import Ground
from ..implement.mounted import MountedImplement
from ..implement.tool_kernel import tool_step
from ..vehicle.steering_coupling import couple_joints
from ..wheels.tyre_kernel import wheel_step
from ..wheels.wheel_models import SoilWheels
from .moment import write_moment

for _pattern in ("libmujoco*.so*", "libmujoco*.dylib", "mujoco.dll"):
    for _library in Path(mujoco.__file__).parent.glob(_pattern):
        # loaded already by `mujoco`: this makes its symbols known to numba
        llvmlite.binding.load_library_permanently(str(_library))

MOTION_M: Final = 0.2  # largest motion from one look at the shapes to the next
TILE_M: Final = 0.5
# of the plane over the heights: MuJoCo keeps them in single precision
_ROUNDING_M: Final = 1e-3

_OF_MODEL_AND_DATA: Final = types.void(types.intp, types.intp)
_step1: Final = types.ExternalFunction("mj_step1", _OF_MODEL_AND_DATA)
_step2: Final = types.ExternalFunction("mj_step2", _OF_MODEL_AND_DATA)


def clock() -> np.ndarray:
    """Return MuJoCo's variable with the address of the clock that it reads 20 times a step, (1,).

    The bindings for Python set it; without a clock a step takes 6 % less. `mjData.timer`, which
    nobody reads, then stays as it is.
    """
    address = llvmlite.binding.address_of_symbol("mjcb_time")
    return np.ctypeslib.as_array((ctypes.c_ssize_t * 1).from_address(address))


_CLOCK: Final = int(clock()[0])


@cached_njit(error_model="numpy", boundscheck=False)
def clearance(
    centres: FloatArray,
    axes: FloatArray,
    shapes: np.ndarray,
    halves: FloatArray,
    reach: float,
    heights: FloatArray,
    grid: FloatArray,
    planes: FloatArray,
) -> float:
    """Return a lower bound of the distance that the chassis may move before it meets the ground.

    It is at most `MOTION_M` [m], 0 where the ground may be touched or a shape is beside the field.

    Args:
        centres, axes: MuJoCo's `geom_xpos`, (ngeom, 3) [m], and `geom_xmat`, (ngeom, 9).
        shapes: (n,) indices of the shapes of the chassis.
        halves: (n, 4) [m] half lengths of a box along its axes, then the radius by which it is
            rounded.
        reach: [m] of the farthest point of any shape from its centre.
        heights: (ny, nx) [m] of the ground.
        grid: (3,) x and y [m] of the first grid point, spacing [m].
        planes: (ty, tx, 4) slopes along x and y, height [m] at the middle of the tile, and 1;
            tiles that were not used yet are zeros, and are written.
    """
    least = MOTION_M
    for item in range(shapes.size):
        shape = shapes[item]
        x, y, z = centres[shape, 0], centres[shape, 1], centres[shape, 2]
        column, row = math.floor((x - grid[0]) / TILE_M), math.floor((y - grid[1]) / TILE_M)
        if not (0 <= column < planes.shape[1] and 0 <= row < planes.shape[0]):
            return 0.0
        if planes[row, column, 3] == 0.0:
            _put_plane(planes[row, column], column, row, reach, heights, grid)
        px, py, height = planes[row, column, 0], planes[row, column, 1], planes[row, column, 2]
        along_x = x - (grid[0] + (column + 0.5) * TILE_M)
        along_y = y - (grid[1] + (row + 0.5) * TILE_M)
        steepness = math.sqrt(px * px + py * py + 1.0)
        above = z - height - px * along_x - py * along_y - halves[item, 3] * steepness
        for axis in range(3):
            to_normal = axes[shape, 6 + axis] - px * axes[shape, axis] - py * axes[shape, 3 + axis]
            above -= abs(to_normal) * halves[item, axis]
        if not above > 0.0:  # nor where it is not a number
            return 0.0
        least = min(least, above / steepness)
    return least


@cached_njit(error_model="numpy", boundscheck=False)
def _put_plane(
    plane: FloatArray, column: int, row: int, reach: float, heights: FloatArray, grid: FloatArray
) -> None:
    """Write the plane of a tile, (4,): the mean slopes of its window, above all its heights."""
    ny, nx = heights.shape
    spacing = grid[2]
    middle_x, middle_y = (column + 0.5) * TILE_M, (row + 0.5) * TILE_M
    half = 0.5 * TILE_M + reach + MOTION_M
    # outwards to the next points: a facet that is partly in the window is wholly below the plane
    left = max(0, math.floor((middle_x - half) / spacing))
    right = min(nx - 1, math.ceil((middle_x + half) / spacing))
    low = max(0, math.floor((middle_y - half) / spacing))
    high = min(ny - 1, math.ceil((middle_y + half) / spacing))
    mid_column, mid_row = 0.5 * (left + right), 0.5 * (low + high)
    sum_x, sum_y, square_x, square_y = 0.0, 0.0, 0.0, 0.0
    for j in range(low, high + 1):
        for i in range(left, right + 1):
            u, v = i - mid_column, j - mid_row
            sum_x += u * heights[j, i]
            sum_y += v * heights[j, i]
            square_x += u * u
            square_y += v * v
    px, py = sum_x / (square_x * spacing), sum_y / (square_y * spacing)
    top = -math.inf
    for j in range(low, high + 1):
        for i in range(left, right + 1):
            along_x, along_y = i * spacing - middle_x, j * spacing - middle_y
            top = max(top, heights[j, i] - px * along_x - py * along_y)
    plane[0], plane[1], plane[2], plane[3] = px, py, top + _ROUNDING_M, 1.0


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def soil_steps(
    model: int,
    data: int,
    wheels: tuple[Any, ...],
    coupling: tuple[Any, ...],
    tool: tuple[Any, ...] | None,
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
        wheels, coupling, chassis, moment: arguments of `wheel_step`, `couple_joints`, `clearance`,
            and of `write_moment` from places on.
        tool: arguments of `tool_step`, None without an implement.
        reaches: (nv,) largest distance by which a unit of each degree of freedom moves a point of
            the chassis, [m] or [m/m].
        limits: (n, 3) place in the positions, least and greatest value of each limited joint.
        looked: (nq + 1,) positions at the end of the last call, and the distance [m] that the
            chassis could then move without meeting the ground. It holds at these positions only.
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
            _step2(model, data)
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
            flags[0] = given | unused if inside else given
            _step1(model, data)
            time += timestep
        write_moment(time, rows[stop], poses[stop], tools[stop], *moment)
    flags[0], clock[0] = given, timer
    looked[-1] = free
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
    terrain, field = ground.terrain, model.geom("ground").id
    shapes: NDArray[np.int64] = np.flatnonzero(model.geom_conaffinity & model.geom_contype[field])
    rows, columns = (int(np.ceil(side / TILE_M)) for side in reversed(terrain.size_m))
    chassis = (
        data.geom_xpos,
        data.geom_xmat,
        shapes,
        np.array([_half_lengths(model, shape, field) for shape in shapes.tolist()]),
        float(model.geom_rbound[shapes].max()),
        terrain.heights,
        np.array([*terrain.origin, terrain.spacing_m]),
        np.zeros((rows, columns, 4)),
    )
    limited = np.flatnonzero(model.jnt_limited)
    within = model.jnt_range[limited] + np.outer(model.jnt_margin[limited], [1.0, -1.0])
    return partial(
        soil_steps,
        model._address,
        data._address,
        wheels.arguments,
        wheels.coupling,
        implement.arguments if implement else None,  # None: `tool_step` is not compiled
        chassis,
        _reaches(model, shapes),
        np.column_stack([model.jnt_qposadr[limited], within]),
        np.zeros(model.nq + 1),
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
