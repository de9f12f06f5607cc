"""Servos of the vehicle: steering cylinders and drive, sized by the weight of the empty vehicle.

A load of a scenario does not change them.
"""

import math
import re
from dataclasses import dataclass, replace
from typing import Final

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
_FRONT_GIVE: Final = 0.15  # [rad]
_TRAILER_TORQUE: Final = 1.4
_TRAILER_GIVE: Final = 0.08  # [rad]
# Inertia of linkage and oil of the front steering over the servo's damping; assumed. Without it the
# implicit damper and the constraints of the knuckles are inconsistent at a time step of 4 ms.
LINKAGE_TIME: Final = 1e-3  # [s]
# Largest torque of the drive over the largest that the rear wheels transmit: the wheels slip before
# the drive stalls. And its loss of speed under that torque, by leakage, over the top wheel speed.
_DRIVE_TORQUE: Final = 1.4  # assumed
_DRIVE_DROOP: Final = 0.034  # assumed
_FIRM_KPA: Final = SoilMap.named("hard").background
_DRIVEN: Final = np.array([wheel.startswith("rear") for wheel in WHEELS])


@dataclass(frozen=True, slots=True)
class SteeringServo:
    """Position servo on a steering joint behind a rate limit; its lag is damping / stiffness."""

    stiffness: float  # [N m/rad]
    damping: float  # [N m s/rad]
    torque: float  # [N m] largest
    rate: float  # [rad/s] of the set point
    limit: float  # [rad] to each side


@dataclass(frozen=True, slots=True)
class DriveServo:
    """First-order lag, then a speed servo on the mean of the driven wheels."""

    lag: float  # [s]
    wheel_speed: float  # [rad/s] set point at hydrostat position 1
    damping: float  # [N m s/rad]
    torque: float  # [N m] largest, both wheels together


def steering_servos(vehicle: PlantVehicle) -> tuple[SteeringServo, SteeringServo]:
    """Return the servos of the front axle and of RJ2."""
    loads = AxleLoads.of(_empty(vehicle))
    front = _FRONT_TORQUE * loads.front * vehicle.front_wheel.radius_m
    trailer = _TRAILER_TORQUE * loads.trailer * vehicle.trailer.length_m
    return (
        _steering_servo(vehicle.front_steering, front, _FRONT_GIVE),
        _steering_servo(vehicle.trailer_steering, trailer, _TRAILER_GIVE),
    )


def drive_servo(vehicle: PlantVehicle, law: SoilLaw) -> DriveServo:
    """Return the drive for which a step test on soil "hard" identifies the vehicle's K and tau.

    K: at steady speed the driven wheels slip by s and the servo droops by T / damping, so that

        wheel speed = (K / r) / (1 - s) + T / damping.

    tau: the speed over ground lags behind the wheels by m v / C, with C = dF/ds the slope of the
    traction equation at small slip (on average over a step v = K / 2). The wheels lag behind the
    servo by m r^2 / damping. The rest of tau is the lag of the valve.
    """
    empty, tyres = _empty(vehicle), tyres_of(vehicle)
    load = wheel_loads(empty)  # (6,)
    radius, gain = vehicle.rear_wheel.radius_m, vehicle.hydrostat.speed_gain_mps
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
    return DriveServo(float(tau - wheel_lag), float(wheel_speed), float(damping), float(torque))


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
    low, high = 0.0, float(largest)
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
    wheels = [vehicle.wheels[wheel.split("_")[0]] for wheel in WHEELS]
    return Tyres(
        radius=np.array([wheel.radius_m for wheel in wheels]),
        width=np.array([wheel.width_m for wheel in wheels]),
        section_height=np.array([wheel.section_height_m for wheel in wheels]),
        relative_deflection=np.array([wheel.relative_deflection for wheel in wheels]),
        rated_load=np.array([wheel.rated_load_n for wheel in wheels]),
        damping=np.array([wheel.damping_spm for wheel in wheels]),
        radial=np.array([re.search(r"\dR", wheel.size) is not None for wheel in wheels]),
    )


def _empty(vehicle: PlantVehicle) -> PlantVehicle:
    return replace(vehicle, load=replace(vehicle.load, mass_kg=0.0))


def _steering_servo(steering: Steering, torque: float, give: float) -> SteeringServo:
    stiffness = torque / give
    return SteeringServo(
        stiffness=stiffness,
        damping=stiffness * steering.lag_s,
        torque=torque,
        rate=math.radians(steering.rate_degps),
        limit=math.radians(steering.limit_deg),
    )
