"""Noise models of the filter: standard deviations of the sensors and of the process."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from ..errors import InvalidTuning, UnknownSensor
from ..types import FloatArray, Sensor
from .augmented_state import SIZE, AugmentedState


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

    Example:
        >>> SensorNoise(gnss=0.015).of(Sensor.GNSS_TRACTOR)  # RTK of 1.5 cm
        0.015
    """

    gnss: float = 0.03  # [m] each axis
    steering: float = math.radians(1.0)  # both steering angles [rad]
    hitch: float = math.radians(1.0)  # [rad]; not printed, assumed as for the steering angles
    encoder: float = 0.1  # [m/s]

    def __post_init__(self) -> None:
        _require_positive(self)

    def of(self, sensor: Sensor) -> float:
        """Return the standard deviation of each entry of one sample of `sensor`.

        Raises:
            UnknownSensor: the sensor is none of the paper's.
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
    """White noise of the model of `augmented_state`, in physical terms.

    The effect of slip and bumps grows with the square root of the distance travelled; a vehicle at
    rest gathers none. Valves and drive act at any time. Persistent disturbances - a slope, soft
    soil, a biased sensor - are entries of the augmented state, which perform a random walk and fade
    over a distance. All else is noise on the state itself. Its size depends on the ground, which is
    not known beforehand: it is close to zero on pavement, and on a ploughed field twice that of
    grass. The first four values hold for a ground of roughness 1. Their variances are proportional
    to the roughness, which the filter learns from the likelihood of its innovations.

    All values but the last block maximise the likelihood of the innovations of one recorded run
    each on `pavement`, `grass`, `wet-grass`, `side-slope`, `wet-slope` and `patchy`. The exception
    is `slip_walk`, whose likelihood was largest at 0, because those fields do not change along the
    way.

    Raises:
        InvalidTuning: a value is not finite or not above 0.
    """

    slip_forward: float = 0.0057  # wheel slip, bumps: position along the tractor [m/sqrt(m)]
    slip_lateral: float = 0.0048  # rear axle side slip: position across the tractor [m/sqrt(m)]
    yaw_t: float = 0.014  # side slip of the front axle: yaw of the tractor [rad/sqrt(m)]
    yaw_i: float = 0.0048  # side slip of the trailer axle: yaw of the trailer [rad/sqrt(m)]

    steering: float = 0.0018  # lag and play of both steering valves [rad/sqrt(s)]
    drive: float = 0.0034  # hydrostat: speed of the rim [(m/s)/sqrt(s)]
    slip_walk: float = 0.0003  # random walk of the persistent side slips [rad/sqrt(m)]
    steering_walk: float = 0.0005  # random walk of the steering disturbance [rad/sqrt(m)]
    drive_walk: float = 0.00065  # random walk of the drive disturbance [(m/s^2)/sqrt(s)]
    wheel_walk: float = 0.0057  # random walk of the persistent wheel slip [1/sqrt(m)]
    side_walk: float = 0.00013  # random walk of the side slip on a slope [rad/sqrt(m)]
    climb_walk: float = 0.0014  # random walk of the wheel slip on a slope [1/sqrt(m)]
    body_fading_m: float = 120.0  # distance over which a body-fixed disturbance fades by 1/e [m]

    map_fading_m: float = 500.0  # the same of map-fixed disturbances [m]; assumed
    roughness: float = 0.5  # initial value; assumed, as are the next two
    roughness_sd: float = 1.0  # standard deviation of the initial value
    roughness_walk: float = 0.05  # random walk of the roughness [1/sqrt(m)]

    def __post_init__(self) -> None:
        _require_positive(self)

    def variances(self) -> FloatArray:
        """Return the variances in the order of `AugmentedState`, then of the roughness, (17,)."""
        deviations = [
            self.slip_forward,
            self.slip_lateral,
            self.yaw_t,
            self.yaw_i,
            self.steering,
            self.steering,
            self.drive,
            self.slip_walk,
            self.slip_walk,
            self.steering_walk,
            self.drive_walk,
            self.wheel_walk,
            self.side_walk,
            self.side_walk,
            self.climb_walk,
            self.climb_walk,
            self.roughness_walk,
        ]
        return np.square(deviations)

    def fading_m(self) -> FloatArray:
        """Return the distance over which each disturbance fades by a factor 1/e, (9,) [m]."""
        return np.array([self.body_fading_m] * 5 + [self.map_fading_m] * 4)

    def density(self, psi_t: float, speed: float, roughness: float) -> FloatArray:
        """Return the covariance that an augmented state gathers per second, (16, 16).

        At the heading `psi_t` [rad] and the rim speed `speed` [m/s].
        """
        rates = np.full(SIZE, abs(speed))  # distance or time per second
        over_time = AugmentedState.DELTA_T, AugmentedState.DELTA_I, AugmentedState.RIM
        rates[[*over_time, AugmentedState.DRIVE]] = 1.0
        rates[: AugmentedState.DELTA_T] *= roughness
        density = np.diag(self.variances()[:-1] * rates)
        turn = np.array([[math.cos(psi_t), -math.sin(psi_t)], [math.sin(psi_t), math.cos(psi_t)]])
        density[:2, :2] = turn @ density[:2, :2] @ turn.T
        return density
