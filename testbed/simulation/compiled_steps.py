"""Physics steps of a plant in one compiled call.

`soil_steps` has the order of a step. Its parts: `actuation/actuators.py`, `wheels/tyre_kernel.py`,
`vehicle/steering_coupling.py`, `implement/tool_kernel.py`, `vehicle/drive_limits.py`,
`truth_rows.py`, and `fast_mujoco` for MuJoCo's part.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from dataclasses import dataclass
from typing import NamedTuple

import mujoco

from ttempc.jit import cached_njit

from ..actuation.actuators import move_valves, put_set_points
from ..ground.ground import Ground
from ..implement.mounted import MountedImplement
from ..implement.tool_kernel import Tools, tool_step
from ..kernel_options import KERNEL
from ..truth import TruthBlock
from ..vehicle.drive_limits import DriveLimits, limit_drive
from ..vehicle.steering_coupling import Coupling, couple_joints
from ..wheels.tyre_kernel import WheelSet, wheel_step
from ..wheels.wheel_forces import WheelForces
from .fast_mujoco.contacts import (
    ContactWatch,
    begin_watch,
    end_watch,
    is_unconstrained,
    update_positions,
)
from .fast_mujoco.library import Clock, disable_flags, missing_symbols, switched_off
from .fast_mujoco.motion import EXPLICIT, Dynamics, move
from .fast_mujoco.self_check import warn_of_plain_steps
from .held_command import HeldCommand
from .truth_rows import State, write_truth


class Machine(NamedTuple):
    """Parts of a plant that a step calls, an implement excepted."""

    wheels: WheelSet
    coupling: Coupling
    drive: DriveLimits
    dynamics: Dynamics
    contacts: ContactWatch
    state: State
    clock: Clock


@cached_njit(**KERNEL, nogil=True)
def soil_steps(
    machine: Machine, tools: Tools | None, held: HeldCommand, truths: TruthBlock
) -> None:
    """Run physics steps and write the state at each stop into a row of `truths`.

    Positions and what follows from them are up to date before and after.
    """
    dynamics = machine.dynamics
    contacts = machine.contacts
    places = machine.state.places
    qpos = dynamics.qpos
    ctrl = machine.state.ctrl
    time_s = held.time_s

    machine.clock.variable[0] = 0
    begin_watch(contacts, qpos)
    for axis in range(3):
        ctrl[axis] = held.command[axis]

    for stop in range(truths.rows.shape[0]):
        for _ in range(held.stride):
            # command -> set points of the servos
            if held.axes.size:
                delta_t = qpos[places.delta_t]
                delta_i = qpos[places.delta_i]
                move_valves(held.axes, held.valves, held.command, delta_t, delta_i)
                put_set_points(held.valves, ctrl)

            # soil and steering linkage -> forces
            wheel_step(machine.wheels)
            couple_joints(machine.coupling)
            if tools is not None:
                tool_step(tools)
            limit_drive(machine.drive)

            # forces -> acceleration, velocity, position -> all that follows from them
            move(dynamics, is_unconstrained(contacts))
            update_positions(contacts, dynamics)
            time_s += dynamics.timestep
        write_truth(time_s, machine.state, truths, stop)

    end_watch(contacts, qpos)
    machine.clock.variable[0] = machine.clock.address


@dataclass(frozen=True, slots=True, eq=False)
class CompiledSteps:
    """`soil_steps` of one plant."""

    machine: Machine
    tools: Tools | None  # None: `tool_step` is not compiled

    def __call__(self, held: HeldCommand, truths: TruthBlock) -> None:
        """Run physics steps and write the state at each stop into a row of `truths`."""
        soil_steps(self.machine, self.tools, held, truths)


def compiled_steps(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    wheels: WheelForces,
    coupling: Coupling,
    implement: MountedImplement | None,
    ground: Ground,
    drive: DriveLimits,
    state: State,
) -> CompiledSteps | None:
    """Return the compiled steps of a plant, None where they are off or MuJoCo is another one."""
    if switched_off():
        return None
    if missing := missing_symbols():
        warn_of_plain_steps(f"libmujoco has no {', '.join(missing)}")
        return None
    flags = disable_flags(model)
    if flags is None:
        warn_of_plain_steps("the options of MuJoCo's model have another order")
        return None
    model.opt.disableflags |= EXPLICIT
    machine = Machine(
        wheels=wheels.kernel,
        coupling=coupling,
        drive=drive,
        dynamics=Dynamics.of(model, data),
        contacts=ContactWatch.of(model, data, ground, flags),
        state=state,
        clock=Clock.of_library(),
    )
    return CompiledSteps(machine, implement.kernel if implement else None)
