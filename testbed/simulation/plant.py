"""Plant: vehicle, ground and soil in MuJoCo, driven by commands, read as `Truth`."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import math
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import mujoco
import numpy as np

from ttempc.types import Command, FloatArray

from ..actuation.actuators import VALVE, Actuators, ActuatorSpecification, CommandPath
from ..bodies import Bodies
from ..errors import InvalidPlant, PlantDiverged
from ..ground.ground import Ground
from ..ground.soil import RandomField, SoilMap
from ..ground.terrain import Terrain
from ..implement.implement import Implement
from ..implement.mounted import MountedImplement, draw_implement, frame_height
from ..implement.tool_kernel import tool_surface
from ..truth import TOOL_SIZE, TRUTH_SIZE, WHEELS, Truth, TruthBlock, Wheels
from ..vehicle.appearance import paint_ground
from ..vehicle.drive_limits import DriveLimits, limit_drive
from ..vehicle.servos import tyres_of
from ..vehicle.steering_coupling import Coupling
from ..vehicle.vehicle import PlantVehicle
from ..vehicle.vehicle_model import build_spec, level_model, physics_model
from ..wheels.soil_law import SoilLaw
from ..wheels.tyre import Tyres
from ..wheels.wheel_forces import WheelForces
from .compiled_steps import CompiledSteps, compiled_steps
from .fast_mujoco.self_check import CHECKED_STEPS, SELF_CHECK
from .held_command import HeldCommand
from .plain_steps import PlainSteps
from .truth_rows import State, write_truth

if TYPE_CHECKING:
    from ..messages.scenery import Scenery

_DEFAULT_LAW: Final = SoilLaw()
_STATE: Final = mujoco.mjtState.mjSTATE_INTEGRATION
_NO_AXES: Final = np.zeros((0, len(VALVE.names or ())))
_NO_STATE: Final = np.zeros(0)
_CHECKED_COMMAND: Final = np.array([0.1, -0.1, 0.5])  # of the self-check: all servos move
_SETTLE_CHUNK_S: Final = 0.1  # between comparisons of the wheel loads
_SETTLE_CHUNKS: Final = 30  # largest number of comparisons
_BALANCE: Final = 0.02  # largest difference of the ground's force to the weight, over the weight
_SETTLED: Final = 1e-4  # largest change of a wheel load over the weight


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """Complete state of the plant."""

    physics: FloatArray  # MuJoCo's integration state
    wheel_state: FloatArray  # `WheelForces.state`
    output: FloatArray  # (6, 7) last report of the wheels
    implement: FloatArray  # `MountedImplement.state`, empty without an implement
    valves: Any  # state of `Plant.actuators`: commands that are still in the command path


class Plant:
    """A tractor with a trailer on a field; one step is forces of the ground, then MuJoCo.

    Args:
        vehicle: the true vehicle.
        terrain: shape of the ground.
        soil: strength of the ground.
        wheel_law: coefficients of traction, motion resistance and side force.
        timestep_s: of the physics.
        actuators: imperfections between a command and the servos; none by default.
        implement: on the trailer; none by default.
        draft_variation: of the implement by place, `Implement.variation`; none by default.

    Raises:
        InvalidPlant: a setting is impossible.
    """

    def __init__(
        self,
        vehicle: PlantVehicle,
        terrain: Terrain,
        soil: SoilMap,
        *,
        wheel_law: SoilLaw = _DEFAULT_LAW,
        timestep_s: float = 0.002,
        actuators: ActuatorSpecification | None = None,
        implement: Implement | None = None,
        draft_variation: RandomField | None = None,
    ) -> None:
        self.vehicle = vehicle
        self.terrain = terrain
        self.soil = soil
        self.tyres = tyres_of(vehicle)
        self.soil_law: Final = wheel_law
        self.wheel_law = wheel_law.of(self.tyres.radial)  # of each wheel

        # The model and the state of MuJoCo
        self._spec = build_spec(vehicle, terrain, wheel_law, timestep_s)
        if implement:
            draw_implement(self._spec, implement, frame_height(vehicle, implement.behind_m))
        self.model = physics_model(self._spec)
        self.data = mujoco.MjData(self.model)
        model = self.model
        data = self.data
        self.body_names = tuple(model.body(i).name for i in range(model.nbody))

        # What acts on the bodies beside MuJoCo's own forces
        self.ground = Ground(terrain, soil.rasterised(terrain), soil.ruts)
        self.wheels: Final = WheelForces(
            self.tyres,
            self.ground,
            self.wheel_law,
            Bodies.of(data),
            np.array([model.body(wheel).id for wheel in WHEELS]),
            float(model.opt.timestep),
        )
        self.coupling: Final = Coupling.of(model, data)
        self.implement = implement and MountedImplement(
            implement,
            model,
            data,
            vehicle,
            tool_surface(implement, self.ground, soil.background, draft_variation),
        )

        # The true state, and the steps that lead to the next one
        rear_radius = self.tyres.radius[WHEELS.index("rear_left")]
        self._state = State.of(model, data, self.wheels.output, rear_radius, self.implement)
        places = self._state.places
        # from tractor and trailer point to their antennas, (2, 3) [m] bodies' frames
        self.lever_arms: FloatArray = model.site_pos[[places.antenna_t, places.antenna_i]]
        drive = self._drive = DriveLimits.of(model, data, vehicle)
        parts = (model, data, self.wheels, self.coupling, self.implement)
        self._plain = PlainSteps(*parts, drive, self._state)
        compiled = compiled_steps(*parts, self.ground, drive, self._state)
        self._steps: PlainSteps | CompiledSteps = compiled or self._plain

        # views of MuJoCo's arrays, bound once
        self._warnings = data.warning.number
        self._qpos = data.qpos
        self._qvel = data.qvel
        self._wheel_dofs = np.array([model.joint(wheel).dofadr[0] for wheel in WHEELS])
        self._hydrostat = int(model.actuator("hydrostat").actadr[0])
        self._steering_angles = (places.delta_t, places.delta_i)
        self.actuators: CommandPath = Actuators(
            actuators or ActuatorSpecification(),
            timestep_s,
            (vehicle.front_steering, vehicle.trailer_steering),
        )
        self._valves: Any = self.actuators.start(hp=0.0)

    def reset(self, x: float, y: float, yaw: float, speed: float) -> Truth:
        """Put the vehicle on the ground, in line, rolling.

        Its wheels are locked until their loads are steady. Then every body gets the forward speed
        and every wheel its spin, and time starts at 0.

        Args:
            x: east position of the tractor point [m].
            y: north position [m].
            yaw: heading [rad], counter-clockwise from east.
            speed: forward speed at the start [m/s].

        Raises:
            InvalidPlant: a value is not finite, the place is outside the field, or the vehicle does
                not stand there on its wheels, see `check_standing`.
        """
        if not all(map(math.isfinite, (x, y, yaw, speed))):
            raise InvalidPlant(f"reset: got {(x, y, yaw, speed)}, every value must be finite")
        mujoco.mj_resetData(self.model, self.data)
        self.wheels.reset()
        if self.implement:
            self.implement.state[:] = 0.0
        self._place(x, y, yaw)
        if not self.terrain.contains(*self._wheel_places(), margin=0.5):
            raise InvalidPlant(
                f"reset: at ({x}, {y}) the vehicle stands outside the field, which reaches from "
                f"{self.terrain.origin} over {self.terrain.size_m} m"
            )
        self._settle(x, y)
        check_standing(self.model, self.data, self.tyres, self.wheels.report)
        self._roll(speed)
        self.data.time = 0.0
        mujoco.mj_step1(self.model, self.data)
        self._check_steps()
        return self.truth()

    def advance(self, command: Command, steps: int) -> Truth:
        """Return the state after a number of physics steps, as `drive`."""
        return self.drive(command, 1, steps).truth(0)

    def drive(self, command: Command, stops: int, stride: int) -> TruthBlock:
        """Hold a command and return the state after every `stride` physics steps, `stops` times.

        It is one compiled call, unless the command path is of Python. The arrays are new.

        Raises:
            PlantDiverged: the state is not finite, or MuJoCo warned or reset itself.
        """
        before = self.data.time
        truths = self._block(stops)
        path = self.actuators
        if isinstance(path, Actuators):
            axes = _NO_AXES if path.passive else path.axes
            held = HeldCommand(axes, self._valves, command.as_array(), before, stride)
            self._steps(held, truths)
        else:
            self._drive_by_path(path, command, stride, truths)
        self._check(before, stops * stride)
        return truths

    def _drive_by_path(
        self, path: CommandPath, command: Command, stride: int, truths: TruthBlock
    ) -> None:
        """Drive with a command path of Python, which is asked for its set points every step."""
        for step in range(len(truths.rows) * stride):
            angles = map(self._qpos.item, self._steering_angles)
            self._valves = path.step(self._valves, command, *angles)
            set_points = np.array(path.set_points(self._valves))
            held = HeldCommand(_NO_AXES, _NO_STATE, set_points, self.data.time, 1)
            stop = step // stride
            self._steps(held, TruthBlock(*(part[stop : stop + 1] for part in truths)))

    @property
    def timestep_s(self) -> float:
        """Physics step [s]."""
        return self.model.opt.timestep

    @cached_property
    def _level(self) -> tuple[mujoco.MjModel, str]:
        return level_model(self._spec)

    @property
    def mjcf(self) -> str:
        """MJCF of the whole model as MuJoCo compiled it, without the heights of the ground."""
        return self._level[1]

    @property
    def scenery(self) -> "Scenery":
        """Static data for viewers."""
        # Imported here so that a run that nobody watches loads no messages.
        from ..messages.scenery import Scenery, shapes_of

        return Scenery(self.body_names, self.ground, shapes_of(self._level[0], self.ground))

    def drawn_model(self) -> mujoco.MjModel:
        """Return a model for rendering: the bodies of `model` with all shapes and a painted ground.

        `model` itself has no visual shapes.
        """
        model = self._spec.compile()
        paint_ground(model, self.terrain, self.ground.cone_index)
        return model

    def snapshot(self) -> Snapshot:
        """Return the present state for `restore`."""
        physics = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, physics, _STATE)
        implement = self.implement.state.copy() if self.implement else np.empty(0)
        return Snapshot(
            physics=physics,
            wheel_state=self.wheels.state.copy(),
            output=self.wheels.output.copy(),
            implement=implement,
            valves=copy(self._valves),
        )

    def restore(self, snapshot: Snapshot) -> Truth:
        """Return to a state; the same commands then give the same truths, bit for bit."""
        mujoco.mj_setState(self.model, self.data, snapshot.physics, _STATE)
        self.wheels.state[:] = snapshot.wheel_state
        self.wheels.output[:] = snapshot.output
        if self.implement:
            self.implement.state[:] = snapshot.implement
        self._valves = copy(snapshot.valves)
        mujoco.mj_step1(self.model, self.data)
        return self.truth()

    def present(self) -> TruthBlock:
        """Return the present state; wheel forces are those of the step that led to it."""
        truths = self._block(1)
        write_truth(self.data.time, self._state, truths, 0)
        return truths

    def truth(self) -> Truth:
        """Return the view of `present`."""
        return self.present().truth(0)

    def _block(self, count: int) -> TruthBlock:
        """Return arrays for a number of states, to be written."""
        tool = TOOL_SIZE + self.implement.output.size if self.implement else 0
        return TruthBlock(
            rows=np.empty((count, TRUTH_SIZE)),
            poses=np.empty((count, self.model.nbody, 7)),
            tools=np.empty((count, tool)),
        )

    def _check_steps(self) -> None:
        """Take plain steps where compiled ones move otherwise; see `fast_mujoco.self_check`."""
        if self._steps is self._plain:
            return
        if SELF_CHECK.passed is None:
            start = self.snapshot()
            blocks = []
            for steps in (self._steps, self._plain):
                block = self._block(CHECKED_STEPS)
                steps(HeldCommand(_NO_AXES, _NO_STATE, _CHECKED_COMMAND, 0.0, 1), block)
                blocks.append(block)
                self.restore(start)
            SELF_CHECK.compare(*blocks)
        if not SELF_CHECK.passed:
            self._steps = self._plain

    def _check(self, before: float, steps: int) -> None:
        """Raise on divergence: MuJoCo itself resets on NaN and continues from time 0."""
        data = self.data
        if any(self._warnings.tolist()):
            kind = int(self._warnings.argmax())
            raise PlantDiverged(
                f"MuJoCo warned at {before:.3f} s: {mujoco.mjtWarning(kind).name} "
                f"({data.warning[kind].number} times, last info {data.warning[kind].lastinfo})"
            )
        expected = before + steps * self.model.opt.timestep
        if not abs(data.time - expected) < 1e-6:
            raise PlantDiverged(f"time went from {before:.3f} s to {data.time}, not {expected:.3f}")
        if not math.isfinite(sum(self._qpos.tolist()) + sum(self._qvel.tolist())):
            raise PlantDiverged(f"the state is not finite at {data.time:.3f} s")

    def _place(self, x: float, y: float, yaw: float) -> None:
        """Put the vehicle in line on the plane through the ground under its wheels."""
        data = self.data
        qpos = data.qpos
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
        """Let the vehicle settle on its tyres at (x, y), wheels locked, all motion damped."""
        data = self.data
        fade = math.exp(-10.0 * self.model.opt.timestep)

        def brake() -> None:
            data.qvel[:] *= fade
            data.qvel[self._wheel_dofs] = 0.0
            if self.implement:
                self.implement.state[:] = 0.0  # the tools stay raised

        weight = -self.model.opt.gravity[2] * self.model.body_mass.sum()
        steps = round(_SETTLE_CHUNK_S / self.model.opt.timestep)
        held = HeldCommand(_NO_AXES, _NO_STATE, np.zeros(3), 0.0, steps)
        truths = self._block(1)
        load = self.wheels.report.load
        mujoco.mj_step1(self.model, data)
        for _ in range(_SETTLE_CHUNKS):
            previous = load.copy()
            self._plain(held, truths, after_step=brake)
            # on a slope the vehicle moves by millimetres until its treads are deflected
            height = data.qpos[2] - self.terrain.height(*data.qpos[:2])
            data.qpos[:3] = x, y, self.terrain.height(x, y) + height
            mujoco.mj_step1(self.model, data)
            steady = np.abs(load - previous).max() < _SETTLED * weight
            if steady and load.sum() > 0.5 * weight:  # not during the fall
                break

    def _roll(self, speed: float) -> None:
        """Give every body the forward speed, every wheel its spin, the hydrostat its position."""
        data = self.data
        ahead = data.body("tractor").xmat.reshape(3, 3)[:, 0]
        data.qvel[:] = 0.0
        data.qvel[:3] = speed * ahead
        data.qvel[self._wheel_dofs] = speed / self.tyres.radius
        hp = speed / self.vehicle.hydrostat.speed_gain_mps
        data.act[self._hydrostat] = hp
        data.ctrl[:] = 0.0, 0.0, hp  # the set points of the present speed, until the first command
        self._valves = self.actuators.start(hp)
        limit_drive(self._drive)


def check_standing(
    model: mujoco.MjModel, data: mujoco.MjData, tyres: Tyres, report: Wheels
) -> None:
    """Refuse a settled vehicle that touches the ground with more than its tyres, or still falls.

    The force of the ground along the vehicle's upward axis must be the weight's part along it, to
    within 2 %. The wheel loads are normal to the ground below each wheel, which may be the flank of
    a furrow: their sum alone is up to 2 % larger. `report` is that of the wheels after a physics
    step. A tyre that is pressed flat on its rim is refused: there its law ends.
    """
    place = "reset: at ({:.1f}, {:.1f}) m".format(*data.qpos[:2])
    for pair in data.contact.geom:
        bodies = {model.body(model.geom_bodyid[geom]).name for geom in pair} - {"world"}
        if not bodies <= set(WHEELS):
            raise InvalidPlant(f"{place} the {', '.join(sorted(bodies))} touches the ground")
    height = data.xpos[[model.body(wheel).id for wheel in WHEELS], 2] - report.ground
    spare = height - (tyres.radius - tyres.section_height)  # of the rim above the ground
    worst = int(np.argmin(spare))
    if spare[worst] <= 0.0:
        load = report.load[worst]
        rated = tyres.rated_load[worst]
        raise InvalidPlant(
            f"{place} the {WHEELS[worst]} tyre is pressed flat on its rim: "
            f"it carries {load:.0f} N, {load / rated:.1f} times its rated load"
        )
    force = data.xfrc_applied[:, :3].sum(axis=0)
    up = data.body("tractor").xmat.reshape(3, 3)[:, 2]
    share = -(force @ up) / (model.body_mass.sum() * (model.opt.gravity @ up))
    if not abs(share - 1.0) <= _BALANCE:
        raise InvalidPlant(
            f"{place} the vehicle does not come to rest on its wheels: the ground carries "
            f"{share:.0%} of its weight"
        )
