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
    a vehicle at rest does not wander. Valves and drive act at any time. All values are assumed, for
    firm even ground: every metre of travel moves an axle some millimetres aside of where it rolls,
    as a slip angle of a quarter of a degree does. Rough soft ground has two to three times that.

    Raises:
        InvalidTuning: a value is not finite or not above 0.
    """

    slip_forward: float = 0.002  # wheel slip, bumps: way along the tractor [m/sqrt(m)]
    slip_lateral: float = 0.0035  # side slip of the rear axle: way across the tractor [m/sqrt(m)]
    yaw_t: float = 0.004  # side slip of the front axle: yaw of the tractor [rad/sqrt(m)]
    yaw_i: float = 0.0035  # side slip of the trailer axle: yaw of the trailer [rad/sqrt(m)]
    steering: float = 0.003  # lag and play of both steering valves [rad/sqrt(s)]
    drive: float = 0.015  # hydrostat and motion resistance: speed [(m/s)/sqrt(s)]

    def __post_init__(self) -> None:
        _require_positive(self)

    def density(self, yaw_t: float, speed: float) -> FloatArray:
        """Return the covariance that the model gathers a second, (7, 7) in the order of `State`."""
        travel = abs(speed)
        forward, lateral = self.slip_forward**2 * travel, self.slip_lateral**2 * travel
        cos, sin = math.cos(yaw_t), math.sin(yaw_t)
        density = np.zeros((7, 7))
        density[State.X, State.X] = forward * cos**2 + lateral * sin**2
        density[State.Y, State.Y] = forward * sin**2 + lateral * cos**2
        density[State.X, State.Y] = density[State.Y, State.X] = (forward - lateral) * cos * sin
        density[State.PSI_T, State.PSI_T] = self.yaw_t**2 * travel
        density[State.PSI_I, State.PSI_I] = self.yaw_i**2 * travel
        density[State.DELTA_T, State.DELTA_T] = self.steering**2
        density[State.DELTA_I, State.DELTA_I] = self.steering**2
        density[State.V, State.V] = self.drive**2
        return density
