"""Truth of a plant as rows of numbers, from MuJoCo's data; compiled."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import math
from typing import NamedTuple, Self

import mujoco
import numpy as np

from ttempc.jit import cached_njit, record
from ttempc.types import FloatArray

from ..bodies import AHEAD, LEFT, UP, Bodies, axis_of, row_vector, velocity_of
from ..implement.mounted import MountedImplement
from ..implement.tool_kernel import LIFT
from ..kernel_options import INLINED, KERNEL
from ..truth import TOOL, TOOL_SIZE, TRUTH, TruthBlock
from ..vectors import Vector, dot


class Places(NamedTuple):
    """Places of the vehicle's parts in MuJoCo's arrays."""

    tractor: int  # numbers of bodies
    drawbar: int
    trailer: int
    antenna_t: int  # numbers of sites
    antenna_i: int
    beta: int  # joints, in the positions
    delta_t: int
    delta_i: int
    rear_left: int  # joints, in the velocities
    rear_right: int
    hydrostat: int  # actuator, in the activations

    @classmethod
    def of(cls, model: mujoco.MjModel) -> Self:
        """Return the places in the arrays of a model."""
        return cls(
            tractor=int(model.body("tractor").id),
            drawbar=int(model.body("drawbar").id),
            trailer=int(model.body("trailer").id),
            antenna_t=int(model.site("antenna_tractor").id),
            antenna_i=int(model.site("antenna_trailer").id),
            beta=int(model.joint("rj1_yaw").qposadr[0]),
            delta_t=int(model.joint("steer").qposadr[0]),
            delta_i=int(model.joint("rj2_yaw").qposadr[0]),
            rear_left=int(model.joint("rear_left").dofadr[0]),
            rear_right=int(model.joint("rear_right").dofadr[0]),
            hydrostat=int(model.actuator("hydrostat").actadr[0]),
        )


class State(NamedTuple):
    """All that a row of the truth is made of; arrays are views and outlive a reset of the data."""

    places: Places
    bodies: Bodies
    qpos: FloatArray
    qvel: FloatArray
    act: FloatArray
    ctrl: FloatArray
    quaternions: FloatArray  # (nbody, 4) `xquat`
    sites: FloatArray  # (nsite, 3) [m] `site_xpos`
    wheels: FloatArray  # (6, 7) report of the wheels
    rear_radius: float  # [m] of the driven wheels
    tool_behind: float  # [m] distance of the tool point behind the trailer point
    lift: FloatArray  # row `LIFT` of the implement
    points: FloatArray  # (n, 3) report of the implement's points

    @classmethod
    def of(
        cls,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        wheels: FloatArray,
        rear_radius: float,
        implement: MountedImplement | None = None,
    ) -> Self:
        """Return views of a plant."""
        return cls(
            places=Places.of(model),
            bodies=Bodies.of(data),
            qpos=data.qpos,
            qvel=data.qvel,
            act=data.act,
            ctrl=data.ctrl,
            quaternions=data.xquat,
            sites=data.site_xpos,
            wheels=wheels,
            rear_radius=float(rear_radius),
            tool_behind=float(implement.settings.behind_m) if implement else 0.0,
            lift=implement.lift if implement else np.zeros(LIFT.itemsize // 8),
            points=implement.output if implement else np.zeros((0, 3)),
        )


_inlined = cached_njit(**INLINED)


@cached_njit(**KERNEL)
def write_truth(time: float, state: State, truths: TruthBlock, stop: int) -> None:
    """Write the present state into row `stop` of a block, at a time [s]."""
    _write_row(time, state, truths.rows[stop])
    _write_poses(state, truths.poses[stop])
    if truths.tools.shape[1]:
        _write_tool(state, truths.tools[stop])


@_inlined
def _yaw(bodies: Bodies, body: int) -> float:
    ahead = axis_of(bodies.axes, body, AHEAD)
    return math.atan2(ahead[1], ahead[0])


@_inlined
def _attitude(bodies: Bodies, body: int) -> Vector:
    """Return yaw, pitch and roll of a body [rad]: z, y', x''."""
    down = -axis_of(bodies.axes, body, AHEAD)[2]
    pitch = math.asin(min(1.0, max(-1.0, down)))
    left = axis_of(bodies.axes, body, LEFT)
    up = axis_of(bodies.axes, body, UP)
    return _yaw(bodies, body), pitch, math.atan2(left[2], up[2])


@cached_njit(**KERNEL)
def _write_row(time: float, state: State, row: FloatArray) -> None:
    truth = record(row, TRUTH)
    places = state.places
    bodies = state.bodies
    tractor = places.tractor
    truth.time_s = time

    truth.x_t, truth.y_t, truth.z_t = row_vector(bodies.positions, tractor)
    truth.psi_t, truth.pitch_t, truth.roll_t = _attitude(bodies, tractor)
    truth.x_i, truth.y_i, truth.z_i = row_vector(bodies.positions, places.trailer)
    truth.psi_i, truth.pitch_i, truth.roll_i = _attitude(bodies, places.trailer)
    truth.psi_d = _yaw(bodies, places.drawbar)

    truth.beta = state.qpos[places.beta]
    truth.delta_t = state.qpos[places.delta_t]
    truth.delta_i = state.qpos[places.delta_i]
    truth.hp = state.act[places.hydrostat]
    truth.delta_t_set_point = state.ctrl[0]
    truth.delta_i_set_point = state.ctrl[1]
    truth.hp_set_point = state.ctrl[2]

    velocity = velocity_of(bodies, tractor)
    truth.speed = dot(velocity, axis_of(bodies.axes, tractor, AHEAD))
    truth.lateral_speed = dot(velocity, axis_of(bodies.axes, tractor, LEFT))
    truth.yaw_rate_t = bodies.velocities[tractor, 2]
    truth.yaw_rate_i = bodies.velocities[places.trailer, 2]
    spins = state.qvel[places.rear_left] + state.qvel[places.rear_right]
    truth.wheel_speed = 0.5 * state.rear_radius * spins

    for wheel in range(state.wheels.shape[0]):
        for quantity in range(state.wheels.shape[1]):
            truth.wheels[wheel, quantity] = state.wheels[wheel, quantity]
    for axis in range(3):
        truth.antennas[0, axis] = state.sites[places.antenna_t, axis]
        truth.antennas[1, axis] = state.sites[places.antenna_i, axis]


@cached_njit(**KERNEL)
def _write_poses(state: State, poses: FloatArray) -> None:
    for body in range(poses.shape[0]):
        for axis in range(3):
            poses[body, axis] = state.bodies.positions[body, axis]
        for part in range(4):
            poses[body, 3 + part] = state.quaternions[body, part]


@cached_njit(**KERNEL)
def _write_tool(state: State, row: FloatArray) -> None:
    tool = record(row, TOOL)
    lift = record(state.lift, LIFT)
    trailer = state.places.trailer
    position = row_vector(state.bodies.positions, trailer)
    ahead = axis_of(state.bodies.axes, trailer, AHEAD)
    tool.x = position[0] - state.tool_behind * ahead[0]
    tool.y = position[1] - state.tool_behind * ahead[1]
    tool.z = position[2] - state.tool_behind * ahead[2]
    tool.behind = state.tool_behind
    tool.lowered = lift.lowered
    tool.distance = lift.distance

    # depths of all points, then their drafts, then their side forces
    count = state.points.shape[0]
    for point in range(count):
        for part in range(3):
            row[TOOL_SIZE + part * count + point] = state.points[point, part]
