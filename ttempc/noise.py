"""How much the filter trusts its sensors and its model, in physical terms."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from ttempc.errors import InvalidTuning, UnknownSensor
from ttempc.types import FloatArray, Sensor, State


def _require_positive(owner: SensorNoise | ProcessNoise) -> None:
    for item in fields(owner):
        value = getattr(owner, item.name)
        if not math.isfinite(value) or value <= 0.0:
            name = f"{type(owner).__name__}.{item.name}"
            raise InvalidTuning(f"{name}: got {value}, must be finite and above 0")


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Standard deviations of the sensors; the defaults are the paper's, sec. II.

    Raises:
        InvalidTuning: a value is not finite or not above 0.
    """

    gnss: float = 0.03  # [m] each axis
    steering: float = math.radians(1.0)  # both steering angles [rad]
    hitch: float = math.radians(1.0)  # [rad]; not printed, taken as the steering angles'
    encoder: float = 0.1  # [m/s]

    def __post_init__(self) -> None:
        _require_positive(self)

    def of(self, sensor: Sensor) -> float:
        """Return the standard deviation of each entry of one sample of `sensor`.

        Raises:
            UnknownSensor: it is none of the paper's.
        """
        match sensor:
            case Sensor.GNSS_TRACTOR | Sensor.GNSS_TRAILER:
                return self.gnss
            case Sensor.STEERING_TRACTOR | Sensor.STEERING_TRAILER:
                return self.steering
            case Sensor.HITCH:
                return self.hitch
            case Sensor.ENCODER:
                return self.encoder
            case _:
                raise UnknownSensor(f"{sensor}: its noise is not known, only the paper's sensors'")


@dataclass(frozen=True, slots=True)
class ProcessNoise:
    """What the articulated model does not know, as white noise with a cause.

    Slip and bumps come with distance: their effect grows with the square root of the travel, and
    a vehicle at rest does not wander. Valves and drive act at any time. What lasts - a slope, soft
    soil, a bent sensor - is a `Disturbance`, which wanders and fades over `memory_m`; what does
    not last is noise on the state itself. All values are assumed, such that the innovations are as
    large as the filter says on firm even ground and nearly so on grass; on rough soft slopes they
    are larger.

    Raises:
        InvalidTuning: a value is not finite or not above 0.
    """

    slip_forward: float = 0.0005  # wheel slip, bumps: way along the tractor [m/sqrt(m)]
    slip_lateral: float = 0.0005  # side slip of the rear axle: way across the tractor [m/sqrt(m)]
    yaw_t: float = 0.001  # side slip of the front axle: yaw of the tractor [rad/sqrt(m)]
    yaw_i: float = 0.001  # side slip of the trailer axle: yaw of the trailer [rad/sqrt(m)]
    steering: float = 0.003  # lag and play of both steering valves [rad/sqrt(s)]
    drive: float = 0.003  # hydrostat and motion resistance: speed [(m/s)/sqrt(s)]
    slip_walk: float = 0.003  # change of the lasting side slips [rad/sqrt(m)]
    steering_walk: float = 0.002  # change of the lasting steering disturbance [rad/sqrt(m)]
    drive_walk: float = 0.004  # change of the lasting drive disturbance [(m/s^2)/sqrt(s)]
    wheel_walk: float = 0.008  # change of the lasting wheel slip [1/sqrt(m)]
    memory_m: float = 50.0  # way over which a disturbance that is seen no more fades [m]

    def __post_init__(self) -> None:
        _require_positive(self)

    def density(self, yaw_t: float, speed: float) -> FloatArray:
        """Return the covariance that the model gathers a second, (12, 12).

        In the order of `State`, then `Disturbance`.
        """
        travel = abs(speed)
        forward, lateral = self.slip_forward**2 * travel, self.slip_lateral**2 * travel
        cos, sin = math.cos(yaw_t), math.sin(yaw_t)
        slip_walk, steering_walk = self.slip_walk**2 * travel, self.steering_walk**2 * travel
        yaws = self.yaw_t**2 * travel, self.yaw_i**2 * travel
        wheel_walk = self.wheel_walk**2 * travel
        walks = slip_walk, slip_walk, steering_walk, self.drive_walk**2, wheel_walk
        density = np.diag([0.0, 0.0, *yaws, *[self.steering**2] * 2, self.drive**2, *walks])
        density[State.X, State.X] = forward * cos**2 + lateral * sin**2
        density[State.Y, State.Y] = forward * sin**2 + lateral * cos**2
        density[State.X, State.Y] = density[State.Y, State.X] = (forward - lateral) * cos * sin
        return density
