"""The plant: vehicle, ground and soil in MuJoCo, moved by commands, seen as `Truth`."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np

from testbed.appearance import paint_ground
from testbed.errors import InvalidPlant, PlantDiverged
from testbed.native_wheels import NativeWheels
from testbed.soil import SoilMap
from testbed.terrain import Terrain
from testbed.truth import WHEELS, Pose, Truth, Wheels
from testbed.tyre_kernel import Output, wheel_step
from testbed.vehicle_model import (
    PlantVehicle,
    WheelModel,
    build_spec,
    mjcf_of,
    physics_model,
    tyres_of,
)
from ttempc.types import Command, FloatArray

_STATE: Final = mujoco.mjtState.mjSTATE_INTEGRATION
_SETTLE_CHUNK_S: Final = 0.1  # loads are compared this far apart
_SETTLE_CHUNKS: Final = 30  # and no more often than this
_SETTLED: Final = 1e-4  # largest change of a wheel load over the weight


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """Everything that the plant's future depends on."""

    physics: FloatArray  # MuJoCo's integration state
    deflection: FloatArray  # (6, 3) [m] tread deflections: without them 29 mm off after 10 s
    output: FloatArray  # (6, 7) what the wheels last reported


class Plant:
    """A tractor with a trailer on a field; one step is tyres, then MuJoCo.

    Args:
        vehicle: true values that differ from the mjcf.
        terrain: shape of the ground.
        soil: its strength.
        wheels: "soil" (`testbed.tyre`) or "contact" (MuJoCo's own, `testbed.native_wheels`).
        timestep_s: of the physics.

    Raises:
        InvalidPlant: a setting that cannot be.
    """

    def __init__(
        self,
        vehicle: PlantVehicle,
        terrain: Terrain,
        soil: SoilMap,
        *,
        wheels: WheelModel = "soil",
        timestep_s: float = 0.002,
    ) -> None:
        self.vehicle, self.terrain, self.soil = vehicle, terrain, soil
        self._spec = build_spec(vehicle, terrain, wheels, timestep_s)
        self.model = physics_model(self._spec)
        self.data = mujoco.MjData(self.model)
        model, data = self.model, self.data
        self.body_names = tuple(model.body(i).name for i in range(model.nbody))
        self.tyres = tyres_of(model)
        self._deflection = np.zeros((len(WHEELS), 3))
        self._output = np.zeros((len(WHEELS), len(Output)))
        self._joints = {
            name: (model.joint(name).qposadr[0], model.joint(name).dofadr[0])
            for name in ("rj1_yaw", "rj2_yaw", "steer", *WHEELS)
        }
        self._bodies = {name: model.body(name).id for name in ("tractor", "drawbar", "trailer")}
        self._wheel_dofs = np.array([self._joints[wheel][1] for wheel in WHEELS])
        wheel_bodies = np.array([model.body(wheel).id for wheel in WHEELS])
        self._hydrostat = int(model.actuator("hydrostat").actadr[0])
        cone_indices = soil.rasterised(terrain)  # (ny, nx)
        if wheels == "soil":
            self._grid = np.array([*terrain.origin, terrain.spacing_m, timestep_s])
            # views of MuJoCo's arrays, bound once: they outlive a reset of the data
            self._tyre_arguments = (
                self.tyres.table(),
                terrain.heights,
                cone_indices,
                self._grid,
                wheel_bodies,
                data.xpos,
                data.xmat,
                data.cvel,
                data.subtree_com,
                self._deflection,
                self._output,
                data.xfrc_applied,
            )
            self._native = None
        else:
            self._native = NativeWheels(model, self.tyres, terrain, cone_indices)

    def reset(self, x: float, y: float, yaw: float, speed: float) -> Truth:
        """Put the vehicle on the ground, in line, and let it roll from there.

        It stands braked until its wheel loads are steady; then every body gets the forward speed
        and every wheel its spin, and time starts at 0.

        Args:
            x: east position of the tractor point [m].
            y: north position [m].
            yaw: heading [rad], counter-clockwise from east.
            speed: forward speed at the start [m/s].

        Raises:
            InvalidPlant: a value is not finite, or the vehicle would not stand on the field.
        """
        if not all(map(math.isfinite, (x, y, yaw, speed))):
            raise InvalidPlant(f"reset: got {(x, y, yaw, speed)}, every value must be finite")
        mujoco.mj_resetData(self.model, self.data)
        self._deflection[:] = 0.0
        self._output[:] = 0.0
        self._place(x, y, yaw)
        if not self.terrain.contains(*self._wheel_places(), margin=0.5):
            raise InvalidPlant(
                f"reset: at ({x}, {y}) the vehicle stands outside the field, which reaches from "
                f"{self.terrain.origin} over {self.terrain.size_m} m"
            )
        self._settle(x, y)
        self._roll(speed)
        self.data.time = 0.0
        mujoco.mj_step1(self.model, self.data)
        return self.truth()

    def advance(self, command: Command, steps: int) -> Truth:
        """Hold a command for a number of physics steps.

        Raises:
            PlantDiverged: the state is no longer one that physics could have led to.
        """
        data = self.data
        data.ctrl[:] = command.delta_t, command.delta_i, command.hp
        before = data.time
        self._run(steps)
        self._check(before, steps)
        return self.truth()

    @property
    def timestep_s(self) -> float:
        """Physics step [s]."""
        return self.model.opt.timestep

    @property
    def mjcf(self) -> str:
        """The whole model as MuJoCo compiled it, without the heights of the ground."""
        return mjcf_of(self._spec)

    def drawn_model(self) -> mujoco.MjModel:
        """Return a model to look at: the bodies of `model`, with every shape and a painted ground.

        `model` itself holds only what the physics needs.
        """
        model = self._spec.compile()
        paint_ground(model, self.terrain, self.soil.rasterised(self.terrain))
        return model

    def snapshot(self) -> Snapshot:
        """Return the present state, to be handed to `restore`."""
        physics = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, physics, _STATE)
        return Snapshot(physics, self._deflection.copy(), self._output.copy())

    def restore(self, snapshot: Snapshot) -> Truth:
        """Go back to a state; what follows is the same, bit for bit, as it was the first time."""
        mujoco.mj_setState(self.model, self.data, snapshot.physics, _STATE)
        self._deflection[:] = snapshot.deflection
        self._output[:] = snapshot.output
        mujoco.mj_step1(self.model, self.data)
        return self.truth()

    def truth(self) -> Truth:
        """Return the present state; wheel forces are those of the step that led to it."""
        data = self.data
        tractor, trailer = self._bodies["tractor"], self._bodies["trailer"]
        velocity = self._velocity(tractor)
        axes = data.xmat[tractor].reshape(3, 3)
        left, right = self._joints["rear_left"][1], self._joints["rear_right"][1]
        rear_radius = self.tyres.radius[WHEELS.index("rear_left")]
        output = self._output
        return Truth(
            time_s=data.time,
            tractor=self._pose(tractor),
            trailer=self._pose(trailer),
            psi_d=_yaw(data.xmat[self._bodies["drawbar"]]),
            beta=float(data.qpos[self._joints["rj1_yaw"][0]]),
            delta_t=float(data.qpos[self._joints["steer"][0]]),
            delta_i=float(data.qpos[self._joints["rj2_yaw"][0]]),
            speed=float(velocity @ axes[:, 0]),
            lateral_speed=float(velocity @ axes[:, 1]),
            yaw_rate_t=float(data.cvel[tractor, 2]),
            yaw_rate_i=float(data.cvel[trailer, 2]),
            rim_speed=float(0.5 * rear_radius * (data.qvel[left] + data.qvel[right])),
            hp=float(data.act[self._hydrostat]),
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

    def _run(self, steps: int, after_step: Callable[[], None] | None = None) -> None:
        """Step the physics; positions and velocities are up to date before and after.

        A step is forces of the ground, accelerations and integration (mj_step2), positions and
        velocities (mj_step1): the same as mj_step with the tyres in its middle.
        """
        model, data = self.model, self.data
        step1, step2 = mujoco.mj_step1, mujoco.mj_step2
        if self._native is not None:
            self._native.prepare(data, self._output[:, Output.LOAD])
            for step in range(steps):
                step2(model, data)
                if step == steps - 1:  # while contacts and their forces are of one step
                    self._native.report(data, self._output)
                if after_step:
                    after_step()
                step1(model, data)
            return
        arguments = self._tyre_arguments
        for _ in range(steps):
            wheel_step(*arguments)
            step2(model, data)
            if after_step:
                after_step()
            step1(model, data)

    def _check(self, before: float, steps: int) -> None:
        """Refuse what MuJoCo hides: it resets itself on NaN and carries on from time 0."""
        data = self.data
        for kind in range(int(mujoco.mjtWarning.mjNWARNING)):
            if data.warning[kind].number:
                raise PlantDiverged(
                    f"MuJoCo warned at {before:.3f} s: {mujoco.mjtWarning(kind).name} "
                    f"({data.warning[kind].number} times, last info {data.warning[kind].lastinfo})"
                )
        expected = before + steps * self.model.opt.timestep
        if not abs(data.time - expected) < 1e-6:
            raise PlantDiverged(f"time went from {before:.3f} s to {data.time}, not {expected:.3f}")
        if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
            raise PlantDiverged(f"the state is not finite at {data.time:.3f} s")

    def _place(self, x: float, y: float, yaw: float) -> None:
        """Put the vehicle in line on the plane through the ground under its wheels."""
        data, qpos = self.data, self.data.qpos
        qpos[:7] = x, y, 0.0, math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)
        mujoco.mj_kinematics(self.model, data)
        wheels_x, wheels_y = self._wheel_places()
        ground = self.terrain.height(wheels_x, wheels_y)
        design = np.column_stack([wheels_x - x, wheels_y - y, np.ones_like(wheels_x)])
        slope_x, slope_y, height = np.linalg.lstsq(design, ground, rcond=None)[0]
        up = np.array([-slope_x, -slope_y, 1.0]) / math.hypot(slope_x, slope_y, 1.0)
        ahead = np.array([math.cos(yaw), math.sin(yaw), 0.0])
        ahead -= (ahead @ up) * up
        ahead /= np.linalg.norm(ahead)
        mujoco.mju_mat2Quat(qpos[3:7], np.column_stack([ahead, np.cross(up, ahead), up]).ravel())
        qpos[:3] = np.array([x, y, height]) + self.tyres.radius[2] * up
        qpos[:2] = x, y
        mujoco.mj_step1(self.model, data)

    def _wheel_places(self) -> tuple[FloatArray, FloatArray]:
        wheels = self.data.xpos[[self.model.body(wheel).id for wheel in WHEELS]]
        return wheels[:, 0], wheels[:, 1]

    def _settle(self, x: float, y: float) -> None:
        """Let the vehicle sink onto its tyres at (x, y), wheels locked, all motion damped."""
        data = self.data
        data.ctrl[:] = 0.0
        fade = math.exp(-10.0 * self.model.opt.timestep)

        def brake() -> None:
            data.qvel[:] *= fade
            data.qvel[self._wheel_dofs] = 0.0

        weight = -self.model.opt.gravity[2] * self.model.body_mass.sum()
        steps = round(_SETTLE_CHUNK_S / self.model.opt.timestep)
        mujoco.mj_step1(self.model, data)
        for _ in range(_SETTLE_CHUNKS):
            previous = self._output[:, Output.LOAD].copy()
            self._run(steps, brake)
            # on a slope it gives way by millimetres until its treads hold it
            sunk = data.qpos[2] - self.terrain.height(*data.qpos[:2])
            data.qpos[:3] = x, y, self.terrain.height(x, y) + sunk
            mujoco.mj_step1(self.model, data)
            load = self._output[:, Output.LOAD]
            steady = np.abs(load - previous).max() < _SETTLED * weight
            if steady and load.sum() > 0.5 * weight:  # not while it still falls
                break

    def _roll(self, speed: float) -> None:
        """Give every body the forward speed, every wheel its spin, the hydrostat its position."""
        data = self.data
        ahead = data.xmat[self._bodies["tractor"]].reshape(3, 3)[:, 0]
        data.qvel[:] = 0.0
        data.qvel[:3] = speed * ahead
        data.qvel[self._wheel_dofs] = speed / self.tyres.radius
        data.act[self._hydrostat] = speed / self.model.numeric("hydrostat_speed_gain").data[0]

    def _velocity(self, body: int) -> FloatArray:
        """Return the velocity of a body's origin, (3,) [m/s], map frame."""
        rotation, velocity = self.data.cvel[body, :3], self.data.cvel[body, 3:]
        return velocity + np.cross(rotation, self.data.xpos[body] - self.data.subtree_com[1])

    def _pose(self, body: int) -> Pose:
        matrix = self.data.xmat[body]
        x, y, z = self.data.xpos[body].tolist()
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
