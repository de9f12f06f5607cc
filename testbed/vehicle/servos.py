"""Servos of the vehicle: steering cylinders and drive, sized by the weight of the empty vehicle.

A load of a scenario does not change them.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import math
from dataclasses import replace
from typing import Final

import mujoco
import numpy as np

from ttempc.types import FloatArray

from ..errors import InvalidPlant
from ..ground.soil import SoilMap
from ..truth import WHEELS
from ..wheels.soil_law import SoilLaw
from ..wheels.tyre import Tyres, mobility
from .vehicle import GRAVITY, AxleLoads, PlantVehicle, Steering

# Largest cylinder torque over (axle load x lever), and the error of the angle at which a cylinder
# reaches it; assumed. The torque is far above that of the tyres, so that the ground does not steer.
# The lever is the wheel's radius in front and the trailer's length behind.
_FRONT_TORQUE: Final = 3.6
_FRONT_DEFLECTION: Final = 0.15  # [rad]
_TRAILER_TORQUE: Final = 1.4
_TRAILER_DEFLECTION: Final = 0.08  # [rad]
# Of a plain trailer, whose drawbar is welded to its frame [rad]; assumed
_RIGID_DEFLECTION: Final = 0.01
_NO_ANGLE: Final = 1e-9  # [rad]
# Inertia of linkage and oil of the front steering over the servo's damping; assumed. Without it the
# implicit damper and the constraints of the knuckles are inconsistent at a time step of 4 ms.
_LINKAGE_TIME: Final = 1e-3  # [s]
# Largest torque of the drive over the largest that the rear wheels transmit: the wheels slip before
# the drive stalls. And its loss of speed under that torque, by leakage, over the top wheel speed.
_DRIVE_TORQUE: Final = 1.4  # assumed, see above
_DRIVE_DROOP: Final = 0.034  # assumed, see above
_FIRM_KPA: Final = SoilMap.named("hard").background
_DRIVEN: Final = np.array([wheel.startswith("rear") for wheel in WHEELS])


def put_servos(spec: mujoco.MjSpec, vehicle: PlantVehicle, law: SoilLaw) -> None:
    """Put the servos of front axle, RJ2 and drive into a model.

    Those of the steering are position servos behind a rate limit; the lag of one is its damping
    over its stiffness. The drive is a first-order lag, then a speed servo on the mean of the driven
    wheels.
    """
    loads = AxleLoads.of(_empty(vehicle))
    front = _FRONT_TORQUE * loads.front * vehicle.front_wheel.radius_m
    damping = _put_steering(
        spec.actuator("steer"), vehicle.front_steering, front, _FRONT_DEFLECTION
    )
    spec.joint("steer").armature = _LINKAGE_TIME * damping  # [kg m^2]
    trailer = _TRAILER_TORQUE * loads.trailer * vehicle.trailer.length_m
    deflection = _TRAILER_DEFLECTION if vehicle.trailer_steering.limit_deg else _RIGID_DEFLECTION
    _put_steering(spec.actuator("trailer_steer"), vehicle.trailer_steering, trailer, deflection)
    lag, wheel_speed, damping, torque = drive_servo(vehicle, law)
    hydrostat = spec.actuator("hydrostat")
    hydrostat.dynprm[0] = lag
    hydrostat.gainprm[0] = damping * wheel_speed
    hydrostat.biasprm[2] = -damping
    hydrostat.forcerange = [-torque, torque]
    differential = spec.tendon("differential")  # limited further by `drive_limits`
    differential.actfrclimited = True
    differential.actfrcrange = [-torque, torque]


def _put_steering(
    actuator: mujoco.MjsActuator, steering: Steering, torque: float, give: float
) -> float:
    """Put a servo with the largest `torque` [N m]; return its damping [N m s/rad]."""
    stiffness = torque / give  # [N m/rad]
    damping = stiffness * steering.lag_s
    limit = math.radians(steering.limit_deg)
    actuator.dyntype = mujoco.mjtDyn.mjDYN_PID
    actuator.dynprm[1] = math.radians(steering.rate_degps)
    actuator.biasprm[1] = -stiffness
    actuator.biasprm[2] = -damping
    # MuJoCo takes an empty range for none: that of a plain trailer has a width
    actuator.ctrlrange = [-max(limit, _NO_ANGLE), max(limit, _NO_ANGLE)]
    actuator.forcerange = [-torque, torque]
    return damping


def drive_servo(vehicle: PlantVehicle, law: SoilLaw) -> tuple[float, float, float, float]:
    """Return the drive for which a step test on soil "hard" identifies the vehicle's K and tau.

    It is its lag [s], the wheels' set point at hydrostat position 1 [rad/s], damping [N m s/rad]
    and largest torque [N m] of both wheels together.

    K: at steady speed the driven wheels slip by s and the servo droops by T / damping, so that

        wheel speed = (K / r) / (1 - s) + T / damping.

    tau: the speed over ground lags behind the wheels by m v / C, with C = dF/ds the slope of the
    traction equation at small slip (on average over a step v = K / 2). The wheels lag behind the
    servo by m r^2 / damping. The rest of tau is the lag of the valve.
    """
    empty = _empty(vehicle)
    tyres = tyres_of(vehicle)
    load = wheel_loads(empty)  # (6,)
    radius = vehicle.rear_wheel.radius_m
    gain = vehicle.hydrostat.speed_gain_mps
    law = law.of(tyres.radial)
    bn, _ = mobility(law, tyres, load, np.full(len(WHEELS), _FIRM_KPA))
    slope = (load * law.traction_slip * law.largest_traction_ratio(bn))[_DRIVEN].sum()  # [N]
    torque = _DRIVE_TORQUE * law.traction * load[_DRIVEN].sum() * radius
    damping = torque / (_DRIVE_DROOP * gain / radius)
    slip = equilibrium_slip(law, tyres, load, _FIRM_KPA, pull=0.0)
    wheel_torque = radius * (load * law.gross_traction_ratio(bn, slip * _DRIVEN))[_DRIVEN].sum()
    mass = load.sum() / GRAVITY
    wheel_lag = mass * 0.5 * gain / slope + mass * radius**2 / damping  # [s]
    tau = vehicle.hydrostat.time_constant_s
    if tau <= wheel_lag:
        raise InvalidPlant(
            f"hydrostat.time_constant_s = {tau}: wheels and tyres alone take {wheel_lag:.2f} s to "
            f"bring {mass:.0f} kg to speed"
        )
    wheel_speed = gain / radius / (1.0 - slip) + wheel_torque / damping
    return float(tau - wheel_lag), float(wheel_speed), float(damping), float(torque)


def equilibrium_slip(
    law: SoilLaw, tyres: Tyres, load: FloatArray, cone_index: float, pull: float
) -> float:
    """Return the slip of the driven wheels at which traction less motion resistance is `pull`.

    `load` is that on each wheel [N], (6,), `cone_index` that of the soil under all of them [kPa],
    `pull` the drawbar pull beyond that of the trailer [N].
    """
    law = law.of(tyres.radial)
    bn, _ = mobility(law, tyres, load, np.full(len(WHEELS), cone_index))

    def surplus(slip: float) -> float:
        slips = np.where(_DRIVEN, slip, law.towed_slip(bn))
        return float(load @ law.net_traction_ratio(bn, slips)) - pull

    largest = max(np.linspace(0.0, 0.9, 91), key=surplus)  # resistance grows with slip, too
    if surplus(largest) <= 0.0:
        raise InvalidPlant(f"the vehicle cannot move itself on soil of {cone_index:g} kPa")
    low = 0.0
    high = float(largest)
    for _ in range(50):  # bisection: scipy.optimize would take 16 MB of every worker
        middle = 0.5 * (low + high)
        low, high = (middle, high) if surplus(middle) < 0.0 else (low, middle)
    return high


def wheel_loads(vehicle: PlantVehicle) -> FloatArray:
    """Return the static load of each wheel on level ground [N], (6,) in the order of `WHEELS`."""
    loads = AxleLoads.of(vehicle)
    return 0.5 * np.array([getattr(loads, wheel.split("_")[0]) for wheel in WHEELS])


def tyres_of(vehicle: PlantVehicle) -> Tyres:
    """Return the tyres of the wheels in the order of `WHEELS`."""
    return Tyres.of([vehicle.wheels[wheel.split("_")[0]] for wheel in WHEELS])


def _empty(vehicle: PlantVehicle) -> PlantVehicle:
    return replace(vehicle, load=replace(vehicle.load, mass_kg=0.0))
