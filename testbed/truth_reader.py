"""How `Truth` is read out of MuJoCo's data: which body, joint and site holds which number."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math

import mujoco
import numpy as np

from testbed.truth import Pose, Truth, Wheels
from testbed.tyre_kernel import Output
from ttempc.types import FloatArray


class TruthReader:
    """Reads the state that positions and velocities in `data` are up to date with.

    Args:
        model: of the plant.
        data: that is read; never written.
        output: (6, 7) what the wheels report, in the order of `WHEELS` and `Output`.
        rear_radius: of the driven wheels [m].
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        output: FloatArray,
        rear_radius: float,
    ) -> None:
        self._data, self._output, self._rear_radius = data, output, rear_radius
        self._tractor, self._drawbar, self._trailer = (
            model.body(name).id for name in ("tractor", "drawbar", "trailer")
        )
        self._antennas = [model.site(f"antenna_{name}").id for name in ("tractor", "trailer")]
        self.lever_arms = model.site_pos[self._antennas]  # (2, 3) [m] bodies' frames
        self._beta, self._delta_t, self._delta_i = (
            model.joint(name).qposadr[0] for name in ("rj1_yaw", "steer", "rj2_yaw")
        )
        self._rear = [model.joint(name).dofadr[0] for name in ("rear_left", "rear_right")]
        self._hydrostat = int(model.actuator("hydrostat").actadr[0])

    def truth(self) -> Truth:
        """Return the present state; wheel forces are those of the step that led to it."""
        data, output = self._data, self._output
        tractor, trailer = self._tractor, self._trailer
        velocity = self._velocity(tractor)
        axes = data.xmat[tractor].reshape(3, 3)
        left, right = self._rear
        return Truth(
            time_s=data.time,
            tractor=self._pose(tractor),
            trailer=self._pose(trailer),
            antennas=data.site_xpos[self._antennas],
            psi_d=_yaw(data.xmat[self._drawbar]),
            beta=float(data.qpos[self._beta]),
            delta_t=float(data.qpos[self._delta_t]),
            delta_i=float(data.qpos[self._delta_i]),
            speed=float(velocity @ axes[:, 0]),
            lateral_speed=float(velocity @ axes[:, 1]),
            yaw_rate_t=float(data.cvel[tractor, 2]),
            yaw_rate_i=float(data.cvel[trailer, 2]),
            rim_speed=float(0.5 * self._rear_radius * (data.qvel[left] + data.qvel[right])),
            hp=float(data.act[self._hydrostat]),
            set_points=data.ctrl.copy(),
            wheels=Wheels(
                load=output[:, Output.LOAD].copy(),
                slip=output[:, Output.SLIP].copy(),
                slip_angle=output[:, Output.SLIP_ANGLE].copy(),
                force_long=output[:, Output.FORCE_LONG].copy(),
                force_lat=output[:, Output.FORCE_LAT].copy(),
                cone_index=output[:, Output.CONE_INDEX].copy(),
                ground=output[:, Output.GROUND].copy(),
            ),
            body_xyz=data.xpos.copy(),
            body_quat=data.xquat.copy(),
        )

    def _velocity(self, body: int) -> FloatArray:
        """Return the velocity of a body's origin, (3,) [m/s], map frame."""
        rotation, velocity = self._data.cvel[body, :3], self._data.cvel[body, 3:]
        return velocity + np.cross(rotation, self._data.xpos[body] - self._data.subtree_com[1])

    def _pose(self, body: int) -> Pose:
        matrix = self._data.xmat[body]
        x, y, z = self._data.xpos[body].tolist()
        return Pose(
            x=x,
            y=y,
            z=z,
            yaw=_yaw(matrix),
            pitch=math.asin(min(1.0, max(-1.0, -matrix[6]))),
            roll=math.atan2(matrix[7], matrix[8]),
        )


def _yaw(matrix: FloatArray) -> float:
    """Return the yaw [rad] of a rotation matrix, (9,) row major."""
    return math.atan2(matrix[3], matrix[0])
