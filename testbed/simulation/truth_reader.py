"""Truth reader: `Truth` from MuJoCo's data."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import math

import mujoco
import numpy as np

from ttempc.types import FloatArray

from ..implement.mounted import MountedImplement
from ..truth import Pose, Truth, Wheels


class TruthReader:
    """Reader of the present state; positions and velocities in `data` must be up to date.

    Args:
        model: of the plant.
        data: of the plant; it is not changed.
        output: (6, 7) report of the wheels, in the order of `WHEELS` and `Output`.
        rear_radius: of the driven wheels [m].
        implement: on the trailer, None without one.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        output: FloatArray,
        rear_radius: float,
        implement: MountedImplement | None = None,
    ) -> None:
        self._data, self._output, self._rear_radius = data, output, rear_radius
        self._implement = implement
        # views of MuJoCo's arrays, bound once: an attribute of `data` is a new array every time
        self._xpos, self._xquat, self._sites = data.xpos, data.xquat, data.site_xpos
        tractor, drawbar, trailer = (
            model.body(name).id for name in ("tractor", "drawbar", "trailer")
        )
        self._tractor_xyz, self._trailer_xyz = data.xpos[tractor], data.xpos[trailer]
        self._tractor_axes, self._trailer_axes = data.xmat[tractor], data.xmat[trailer]
        self._drawbar_axes = data.xmat[drawbar]
        self._tractor_motion, self._trailer_motion = data.cvel[tractor], data.cvel[trailer]
        self._centre = data.subtree_com[1]  # to which `cvel` refers
        self._qpos, self._qvel, self._act, self._ctrl = data.qpos, data.qvel, data.act, data.ctrl
        antennas = [model.site(f"antenna_{name}").id for name in ("tractor", "trailer")]
        self._antennas = np.array(antennas)  # an array: numpy would convert a list at every read
        self.lever_arms = model.site_pos[self._antennas]  # (2, 3) [m] bodies' frames
        self._beta, self._delta_t, self._delta_i = (
            int(model.joint(name).qposadr[0]) for name in ("rj1_yaw", "steer", "rj2_yaw")
        )
        self._rear = [int(model.joint(name).dofadr[0]) for name in ("rear_left", "rear_right")]
        self._hydrostat = int(model.actuator("hydrostat").actadr[0])

    def truth(self) -> Truth:
        """Return the present state; wheel forces are those of the step that led to it."""
        xyz, axes = self._tractor_xyz.tolist(), self._tractor_axes.tolist()
        xx, xy, _, yx, yy, _, zx, zy, _ = axes
        _, _, yaw_rate, *_ = motion = self._tractor_motion.tolist()
        vx, vy, vz = self._velocity(xyz, motion)
        qpos, qvel = self._qpos.item, self._qvel.item
        left, right = self._rear
        return Truth(
            time_s=self._data.time,
            tractor=_pose(xyz, axes),
            trailer=_pose(self._trailer_xyz.tolist(), self._trailer_axes.tolist()),
            antennas=self._sites.take(self._antennas, axis=0),
            psi_d=_yaw(self._drawbar_axes.tolist()),
            beta=qpos(self._beta),
            delta_t=qpos(self._delta_t),
            delta_i=qpos(self._delta_i),
            speed=vx * xx + vy * yx + vz * zx,
            lateral_speed=vx * xy + vy * yy + vz * zy,
            yaw_rate_t=yaw_rate,
            yaw_rate_i=self._trailer_motion.item(2),
            rim_speed=0.5 * self._rear_radius * (qvel(left) + qvel(right)),
            hp=self._act.item(self._hydrostat),
            set_points=self._ctrl.copy(),
            wheels=Wheels(*self._output.T.copy()),  # `Output` has the order of its fields
            body_xyz=self._xpos.copy(),
            body_quat=self._xquat.copy(),
            tool=self._implement and self._implement.tool(),
        )

    def _velocity(self, xyz: list[float], motion: list[float]) -> tuple[float, float, float]:
        """Return the velocity of a body's origin `xyz` [m/s], map frame; `motion` is its `cvel`."""
        x, y, z = xyz
        wx, wy, wz, vx, vy, vz = motion
        cx, cy, cz = self._centre.tolist()
        rx, ry, rz = x - cx, y - cy, z - cz
        return vx + (wy * rz - wz * ry), vy + (wz * rx - wx * rz), vz + (wx * ry - wy * rx)


def _pose(xyz: list[float], axes: list[float]) -> Pose:
    x, y, z = xyz
    return Pose(
        x=x,
        y=y,
        z=z,
        yaw=_yaw(axes),
        pitch=math.asin(min(1.0, max(-1.0, -axes[6]))),
        roll=math.atan2(axes[7], axes[8]),
    )


def _yaw(axes: list[float]) -> float:
    """Return the yaw [rad] of a rotation matrix, nine numbers row by row."""
    return math.atan2(axes[3], axes[0])
