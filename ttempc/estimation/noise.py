"""How much the filter trusts its sensors and its model, in physical terms."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from ..errors import InvalidTuning, UnknownSensor
from ..types import FloatArray, Sensor
from .augmented_state import Belief


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
    """What the model of `augmented_state` does not know, as white noise with a cause.

    Slip and bumps come with distance: their effect grows with the square root of the travel, and
    a vehicle at rest does not wander. Valves and drive act at any time. What lasts - a slope, soft
    soil, a bent sensor - is in the belief, where it wanders and fades over a memory; what does not
    last is noise on the state itself. How much of it the ground makes is not known beforehand: a
    pavement makes next to none, a ploughed field twice that of a meadow. The first four values
    are those of a ground of roughness 1; their variances grow with the roughness, which a filter
    learns from the likelihood of its innovations.

    All but the last block are the values under which the innovations of one recorded run each on
    `pavement`, `grass`, `wet-grass`, `side-slope`, `wet-slope` and `patchy` are likeliest, except
    for `slip_walk`, which was likeliest at none: those fields do not change under the vehicle.

    Raises:
        InvalidTuning: a value is not finite or not above 0.
    """

    slip_forward: float = 0.0057  # wheel slip, bumps: way along the tractor [m/sqrt(m)]
    slip_lateral: float = 0.0048  # side slip of the rear axle: way across the tractor [m/sqrt(m)]
    yaw_t: float = 0.014  # side slip of the front axle: yaw of the tractor [rad/sqrt(m)]
    yaw_i: float = 0.0048  # side slip of the trailer axle: yaw of the trailer [rad/sqrt(m)]

    steering: float = 0.0018  # lag and play of both steering valves [rad/sqrt(s)]
    drive: float = 0.0034  # hydrostat: speed of the rim [(m/s)/sqrt(s)]
    slip_walk: float = 0.0003  # change of the lasting side slips [rad/sqrt(m)]
    steering_walk: float = 0.0005  # change of the lasting steering disturbance [rad/sqrt(m)]
    drive_walk: float = 0.00065  # change of the lasting drive disturbance [(m/s^2)/sqrt(s)]
    wheel_walk: float = 0.0057  # change of the lasting wheel slip [1/sqrt(m)]
    side_walk: float = 0.00013  # change of the side slip that a slope causes [rad/sqrt(m)]
    climb_walk: float = 0.0014  # change of the wheel slip that a slope causes [1/sqrt(m)]
    memory_m: float = 120.0  # way over which a disturbance that is seen no more fades [m]

    map_memory_m: float = 500.0  # the same of what stays with the field [m]; assumed
    roughness: float = 0.5  # at the start; assumed, as what follows
    roughness_sd: float = 1.0  # how uncertain it is at the start
    roughness_walk: float = 0.05  # how it changes along the way [1/sqrt(m)]

    def __post_init__(self) -> None:
        _require_positive(self)

    def table(self) -> FloatArray:
        """Return the variances in the order of `Belief`, then of the roughness, (17,)."""
        slip, side, climb = self.slip_walk, self.side_walk, self.climb_walk
        deviations = (
            *(self.slip_forward, self.slip_lateral, self.yaw_t, self.yaw_i),
            *(self.steering, self.steering, self.drive),
            *(slip, slip, self.steering_walk, self.drive_walk, self.wheel_walk),
            *(side, side, climb, climb, self.roughness_walk),
        )
        return np.square(deviations)

    def memories(self) -> FloatArray:
        """Return over which way each disturbance of a belief fades, (9,) [m]."""
        return np.array([self.memory_m] * 5 + [self.map_memory_m] * 4)

    def density(self, yaw_t: float, speed: float, roughness: float) -> FloatArray:
        """Return the covariance that a belief gathers a second, (16, 16)."""
        travel = abs(speed)
        over = np.full(16, travel)
        over[[Belief.DELTA_T, Belief.DELTA_I, Belief.RIM, Belief.DRIVE]] = 1.0
        over[: Belief.DELTA_T] *= roughness
        density = np.diag(self.table()[:-1] * over)
        turn = np.array([[math.cos(yaw_t), -math.sin(yaw_t)], [math.sin(yaw_t), math.cos(yaw_t)]])
        density[:2, :2] = turn @ density[:2, :2] @ turn.T
        return density
