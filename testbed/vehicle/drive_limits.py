"""Limits of the drive, compiled: power of the engine and parking brake.

The servo of the hydrostat has the largest torque T_0 of its hydraulics, which a fault
may lower. Driving, the engine gives the differential less where the wheels turn fast,

    T <= P / omega,

with P the largest power at the driven wheels and omega their mean speed. Braking, the torque of the
hydraulics stays: it goes into the engine's drag and the relief valves.

A hydrostat at position 0 leaks: a vehicle on a slope creeps. Where its set point and its position
are 0, a brake closes that allows `_CREEP` of that speed.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import math
from typing import Final, NamedTuple, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from ttempc.jit import cached_njit
from ttempc.types import FloatArray

from ..kernel_options import KERNEL
from .vehicle import PlantVehicle

_CREEP: Final = 0.02  # speed with the brake over that without; assumed
_CLOSED: Final = 1e-3  # position of the hydrostat below which the brake closes; assumed
_SLOWEST: Final = 1e-3  # [rad/s] floor of the wheels' speed in divisions
_VELOCITY_GAIN: Final = 2  # place in the bias of an actuator


class DriveLimits(NamedTuple):
    """Limits of one drive and the views of MuJoCo's arrays on which they act."""

    torque: float  # [N m] T_0, of both driven wheels
    power: float  # [W] P, infinite without a limit
    bearing: float  # [N m s/rad] damping of each driven wheel with the brake open
    brake: float  # [N m s/rad] and with the brake closed
    actuator: int  # number of the hydrostat
    position: int  # place of its position among the activations
    wheels: NDArray[np.int64]  # (2,) degrees of freedom of the driven wheels
    ctrl: FloatArray
    activations: FloatArray  # `act`
    speeds: FloatArray  # `actuator_velocity`
    force_limits: FloatArray  # (2,) [N m] of the differential, `tendon_actfrcrange`, written
    damping: FloatArray  # (nv,) `dof_damping`, written

    @classmethod
    def of(cls, model: mujoco.MjModel, data: mujoco.MjData, vehicle: PlantVehicle) -> Self:
        """Return the limits of a vehicle's drive."""
        hydrostat = model.actuator("hydrostat")
        servo_damping = -float(hydrostat.biasprm[_VELOCITY_GAIN])
        power_kw = vehicle.hydrostat.power_kw
        wheels = [model.joint(wheel).dofadr[0] for wheel in ("rear_left", "rear_right")]
        return cls(
            torque=float(hydrostat.forcerange[1]),
            power=math.inf if power_kw is None else 1e3 * power_kw,
            bearing=float(model.dof_damping[wheels[0]]),
            brake=0.5 * servo_damping / _CREEP,
            actuator=int(hydrostat.id),
            position=int(hydrostat.actadr[0]),
            wheels=np.array(wheels, dtype=np.int64),
            ctrl=data.ctrl,
            activations=data.act,
            speeds=data.actuator_velocity,
            force_limits=model.tendon_actfrcrange[model.tendon("differential").id],
            damping=model.dof_damping,
        )


@cached_njit(**KERNEL)
def limit_drive(drive: DriveLimits) -> None:
    """Set torque limits and brake for one physics step."""
    speed = drive.speeds[drive.actuator]
    most = min(drive.torque, drive.power / max(abs(speed), _SLOWEST))
    drive.force_limits[0] = -drive.torque if speed > 0.0 else -most
    drive.force_limits[1] = most if speed > 0.0 else drive.torque

    held = drive.ctrl[drive.actuator] == 0.0 and abs(drive.activations[drive.position]) < _CLOSED
    for wheel in drive.wheels:
        drive.damping[wheel] = drive.brake if held else drive.bearing
