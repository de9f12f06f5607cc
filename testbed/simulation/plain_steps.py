"""Physics steps of a plant by MuJoCo's own functions, called from Python.

Its order is that of `compiled_steps.soil_steps`. Under `NUMBA_DISABLE_JIT=1` the kernels are Python
as well, so that a debugger stops in each of them.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from collections.abc import Callable
from dataclasses import dataclass

import mujoco

from ..actuation.actuators import move_valves, put_set_points
from ..implement.mounted import MountedImplement
from ..truth import TruthBlock
from ..vehicle.drive_limits import DriveLimits, limit_drive
from ..vehicle.steering_coupling import Coupling, couple_joints
from ..wheels.wheel_forces import WheelForces
from .held_command import HeldCommand
from .truth_rows import State, write_truth


@dataclass(frozen=True, slots=True, eq=False)
class PlainSteps:
    """Steps of one plant."""

    model: mujoco.MjModel
    data: mujoco.MjData
    wheels: WheelForces
    coupling: Coupling
    implement: MountedImplement | None
    drive: DriveLimits
    state: State

    def __call__(
        self,
        held: HeldCommand,
        truths: TruthBlock,
        after_step: Callable[[], object] = lambda: None,
    ) -> None:
        """Run physics steps and write the state at each stop into a row of `truths`.

        A step is forces of the ground, accelerations and integration (mj_step2), positions and
        velocities (mj_step1): the same as mj_step with these forces in its middle.
        """
        data = self.data
        places = self.state.places
        data.ctrl[:] = held.command
        for stop in range(len(truths.rows)):
            for _ in range(held.stride):
                if held.axes.size:
                    delta_t = float(data.qpos[places.delta_t])
                    delta_i = float(data.qpos[places.delta_i])
                    move_valves(held.axes, held.valves, held.command, delta_t, delta_i)
                    put_set_points(held.valves, self.state.ctrl)

                self.wheels.step()
                couple_joints(self.coupling)
                if self.implement:
                    self.implement.step()
                limit_drive(self.drive)

                mujoco.mj_step2(self.model, data)
                after_step()
                mujoco.mj_step1(self.model, data)
            write_truth(data.time, self.state, truths, stop)
