"""Moments of a plant as rows of numbers, from MuJoCo's data."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import math
from typing import Any

import mujoco
import numpy as np

from ttempc.jit import cached_njit
from ttempc.types import FloatArray

from ..implement.mounted import MountedImplement


def moment_arguments(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    output: FloatArray,
    rear_radius: float,
    implement: MountedImplement | None = None,
) -> tuple[Any, ...]:
    """Return the arguments of `write_moment` from `places` on; they outlive a reset of the data."""
    places = [
        *(model.body(name).id for name in ("tractor", "drawbar", "trailer")),
        *(model.site(f"antenna_{name}").id for name in ("tractor", "trailer")),
        *(model.joint(name).qposadr[0] for name in ("rj1_yaw", "steer", "rj2_yaw")),
        *(model.joint(name).dofadr[0] for name in ("rear_left", "rear_right")),
        model.actuator("hydrostat").actadr[0],
    ]
    state = (
        *(data.qpos, data.qvel, data.act, data.ctrl, data.xpos, data.xquat, data.xmat),
        *(data.cvel, data.subtree_com, data.site_xpos),
    )
    behind = implement.settings.behind_m if implement else 0.0
    worked = (implement.lift, implement.output) if implement else (np.zeros(2), np.zeros((0, 3)))
    return np.array(places, dtype=np.int64), float(rear_radius), behind, state, output, *worked


@cached_njit(error_model="numpy", boundscheck=False)
def write_moment(
    time: float,
    row: FloatArray,
    poses: FloatArray,
    tool: FloatArray,
    places: np.ndarray,
    rear_radius: float,
    behind: float,
    state: tuple[FloatArray, ...],
    output: FloatArray,
    lift: FloatArray,
    worked: FloatArray,
) -> None:
    """Write the present state as one of `Moments`: `row`, `poses` and `tool` are written.

    Args:
        time: [s].
        row, poses, tool: one of each of the arrays of `Moments`.
        places: (11,) bodies of tractor, drawbar and trailer; sites of the antennas; positions of
            beta, delta_t and delta_i; velocities of the rear wheels; activation of the hydrostat.
        rear_radius: of the driven wheels [m].
        behind: distance of the tool point behind the trailer point [m].
        state: MuJoCo's qpos, qvel, act, ctrl, xpos, xquat, xmat, cvel, subtree_com, site_xpos.
        output: (6, 7) report of the wheels.
        lift: (2,) lowered share of the implement, distance driven [m].
        worked: (n, 3) depth, draft and side force of its points.
    """
    qpos, qvel, act, ctrl, xpos, xquat, xmat, cvel, com, sites = state
    tractor, drawbar, trailer = places[0], places[1], places[2]
    row[0] = time
    for axle in range(2):  # of tractor and trailer
        body = places[2 * axle]
        row[1 + 3 * axle], row[2 + 3 * axle] = xpos[body, 0], xpos[body, 1]
        row[3 + 3 * axle] = math.atan2(xmat[body, 3], xmat[body, 0])
        row[7 + 3 * axle] = xpos[body, 2]
        row[8 + 3 * axle] = math.asin(min(1.0, max(-1.0, -xmat[body, 6])))
        row[9 + 3 * axle] = math.atan2(xmat[body, 7], xmat[body, 8])
        for axis in range(3):
            row[68 + 3 * axle + axis] = sites[places[3 + axle], axis]
    row[13] = math.atan2(xmat[drawbar, 3], xmat[drawbar, 0])
    row[14], row[15], row[16] = qpos[places[5]], qpos[places[6]], qpos[places[7]]
    row[17] = act[places[10]]
    # `cvel` is the velocity at the centre of mass
    wx, wy, wz = cvel[tractor, 0], cvel[tractor, 1], cvel[tractor, 2]
    rx, ry = xpos[tractor, 0] - com[1, 0], xpos[tractor, 1] - com[1, 1]
    rz = xpos[tractor, 2] - com[1, 2]
    vx = cvel[tractor, 3] + (wy * rz - wz * ry)
    vy = cvel[tractor, 4] + (wz * rx - wx * rz)
    vz = cvel[tractor, 5] + (wx * ry - wy * rx)
    row[18] = vx * xmat[tractor, 0] + vy * xmat[tractor, 3] + vz * xmat[tractor, 6]
    row[19] = vx * xmat[tractor, 1] + vy * xmat[tractor, 4] + vz * xmat[tractor, 7]
    row[20], row[21] = wz, cvel[trailer, 2]
    row[22] = 0.5 * rear_radius * (qvel[places[8]] + qvel[places[9]])
    for axis in range(3):
        row[23 + axis] = ctrl[axis]
    for wheel in range(6):
        for column in range(7):
            row[26 + 7 * wheel + column] = output[wheel, column]
    for body in range(xpos.shape[0]):
        for axis in range(3):
            poses[body, axis] = xpos[body, axis]
        for part in range(4):
            poses[body, 3 + part] = xquat[body, part]
    if tool.size:
        for axis in range(3):
            tool[axis] = xpos[trailer, axis] - behind * xmat[trailer, 3 * axis]
        tool[3], tool[4], tool[5] = behind, lift[0], lift[1]
        points = worked.shape[0]
        for point in range(points):
            for part in range(3):
                tool[6 + part * points + point] = worked[point, part]
