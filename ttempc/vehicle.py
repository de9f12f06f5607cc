"""Vehicle parameters of the control side's models."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .errors import InvalidVehicle
from .types import FloatArray

MAX_DEAD_TIME_S: Final = 2.0
"""Longest dead time of an actuator [s]: ten control periods."""

OUTSIDE_TUBES: Final = frozenset(
    {
        "trailer_turning_offset",
        "tool_behind",
        "axle_height_t",
        "axle_height_i",
        "compliance_t",
        "compliance_i",
    }
)
"""Fields of `Vehicle` on which no tube depends: those of a tool, of the estimator alone, and of a
preview."""

_AT_LIMIT: Final = 1e-9  # [rad] or fraction: distance within which a command is at a limit


class _Range(NamedTuple):
    """Range of a vehicle parameter, and its text in a message."""

    contains: Callable[[float], bool]  # false for NaN
    allowed: str
    given: str = "{}"  # format of a refused value


_POSITIVE: Final = _Range(lambda value: 0.0 < value < math.inf, "finite and above 0")
_NOT_NEGATIVE: Final = _Range(lambda value: 0.0 <= value < math.inf, "finite and 0 or above")
_DEAD_TIME: Final = _Range(
    lambda value: 0.0 <= value <= MAX_DEAD_TIME_S, f"from 0 to {MAX_DEAD_TIME_S} s"
)
_COMPLIANCE: Final = _Range(lambda value: 0.0 <= value <= 0.1, "from 0 to 0.1 rad s^2/m")
# Ranges of the fields of `Vehicle` that are not just `_POSITIVE`.
_RANGES: Final = {
    "hitch_offset": _Range(math.isfinite, "finite"),
    "steering_limit_t": _Range(
        lambda value: 0.0 < value < math.pi / 2, "above 0 and below pi/2", given="{:.3f} rad"
    ),
    "steering_limit_i": _Range(
        lambda value: 0.0 <= value < math.pi / 2,
        "from 0 (no steering) to below pi/2",
        given="{:.3f} rad",
    ),
    "dead_time_t": _DEAD_TIME,
    "dead_time_i": _DEAD_TIME,
    "dead_time_hp": _DEAD_TIME,
    "trailer_turning_offset": _Range(math.isfinite, "finite"),
    "tool_behind": _NOT_NEGATIVE,
    "axle_height_t": _NOT_NEGATIVE,
    "axle_height_i": _NOT_NEGATIVE,
    "compliance_t": _COMPLIANCE,
    "compliance_i": _COMPLIANCE,
}


@dataclass(frozen=True, slots=True)
class Vehicle:
    """Lengths, limits and actuator constants of a tractor with a steerable trailer.

    The defaults are the vehicle of Kayacan, Ramon and Saeys (2016), "the paper". SI units,
    angles in radians.

    Raises:
        InvalidVehicle: a value is not finite or out of its range.

    Examples:
        >>> vehicle = Vehicle(wheelbase=1.6, trailer_length=2.0)  # [m]
        >>> vehicle.input_max  # front steering [rad], trailer steering [rad], hydrostat
        array([0.61086524, 0.43633231, 1.        ])
    """

    wheelbase: float = 1.4  # L^t, front axle to rear axle of the tractor [m]; paper, sec. II
    hitch_offset: float = 0.3  # a, rear axle to RJ1 [m]; assumed, L^d = a + d = 1.1 m is printed
    drawbar_length: float = 0.8  # d, RJ1 to RJ2 [m]; assumed, as above
    trailer_length: float = 1.3  # L^i, RJ2 to trailer axle [m]; paper, sec. II
    speed_gain: float = 1.4  # K, steady speed at hydrostat position 1 [m/s]; paper, sec. II
    speed_time_constant: float = 2.05  # tau [s]; paper, sec. II
    steering_lag_t: float = 0.15  # lag of the front steering actuator [s]; assumed
    steering_lag_i: float = 0.20  # lag of the trailer steering actuator [s]; assumed
    steering_limit_t: float = math.radians(35.0)  # stop of the front steering [rad]; assumed
    # Stop of the trailer steering [rad]; assumed. 0: a plain trailer, without steering
    steering_limit_i: float = math.radians(25.0)
    steering_rate_t: float = math.radians(55.0)  # [rad/s]; paper, eq. (constraints)
    steering_rate_i: float = math.radians(35.0)  # [rad/s]; paper, eq. (constraints)
    hp_rate: float = 0.30  # hydrostat position per second [1/s]; paper, eq. (constraints)
    # Time from a command to the first movement of its actuator: bus, solenoid, spool [s].
    dead_time_t: float = 0.0  # front steering
    dead_time_i: float = 0.0  # trailer steering
    dead_time_hp: float = 0.0  # hydrostat
    # The trailer turns about a point c behind its axle, where a tool that the soil holds drags it
    # outwards; 0 without one [m]. c lengthens the trailer in its yaw equation alone.
    trailer_turning_offset: float = 0.0
    tool_behind: float = 0.0  # tool point behind the trailer axle [m]; 0: no tool
    # Axle points above the ground about which the bodies roll [m]: radii of their wheels, assumed.
    # 0: roll does not move the point
    axle_height_t: float = 0.4
    axle_height_i: float = 0.3
    # Side slip of an axle by the lateral acceleration of its body [rad s^2/m]: mass on the axle
    # over the cornering stiffness of its tyres; 0: not known
    compliance_t: float = 0.019  # rear axle of the tractor; kayacan2016
    compliance_i: float = 0.0243  # trailer axle; kayacan2016
    reverse: bool = False  # gear: hydrostat positions -1..0 in reverse, else 0..1 as in the paper

    def __post_init__(self) -> None:
        for item in fields(self):
            if item.name == "reverse":
                continue
            value = getattr(self, item.name)
            allowed = _RANGES.get(item.name, _POSITIVE)
            if not allowed.contains(value):
                given = allowed.given.format(value)
                raise InvalidVehicle(f"vehicle.{item.name}: got {given}, must be {allowed.allowed}")

    @property
    def is_plain(self) -> bool:
        """Whether the trailer has no steering."""
        return self.steering_limit_i == 0.0

    @property
    def drawbar_offset(self) -> float:
        """L^d [m], rear axle of the tractor to RJ2 if the drawbar is in line with the tractor."""
        return self.hitch_offset + self.drawbar_length

    def motion_per_input(self, speed_mps: float) -> FloatArray:
        """Return the motion that a unit of each input causes at a speed, (3,).

        In straight motion a unit of front steering causes the lateral acceleration v^2 / L^t, of
        trailer steering the lateral speed v d / (d + L^i), and of the hydrostat the acceleration
        K / tau.
        """
        lateral_acceleration = speed_mps**2 / self.wheelbase
        share = self.drawbar_length / (self.drawbar_length + self.trailer_length)
        lateral_speed = speed_mps * share
        acceleration = self.speed_gain / self.speed_time_constant
        return np.array([lateral_acceleration, lateral_speed, acceleration])

    @property
    def dead_times(self) -> FloatArray:
        """Dead time of each input [s], (3,) in the order of `Input`."""
        return np.array([self.dead_time_t, self.dead_time_i, self.dead_time_hp])

    def without_dead_times(self) -> Vehicle:
        """Return the same vehicle with actuators that start at once."""
        return replace(self, dead_time_t=0.0, dead_time_i=0.0, dead_time_hp=0.0)

    @property
    def input_min(self) -> FloatArray:
        """Smallest command, (3,) in the order of `Input`."""
        hp = -1.0 if self.reverse else 0.0
        return np.array([-self.steering_limit_t, -self.steering_limit_i, hp])

    @property
    def input_max(self) -> FloatArray:
        """Largest command, (3,) in the order of `Input`."""
        hp = 0.0 if self.reverse else 1.0
        return np.array([self.steering_limit_t, self.steering_limit_i, hp])

    @property
    def input_rate(self) -> FloatArray:
        """Largest change of a command per second, (3,) in the order of `Input`."""
        return np.array([self.steering_rate_t, self.steering_rate_i, self.hp_rate])


@dataclass(frozen=True, slots=True)
class CommandLimits:
    """Limits of commands, and of their change from one command to the next.

    All arrays are (3,) in the order of `Input`: [rad], [rad] and a fraction.

    Examples:
        >>> limits = CommandLimits.of(Vehicle(), period_s=0.2)
        >>> command, limited = limits.apply(np.array([0.5, 0.0, 0.7]), np.array([0.0, 0.0, 0.7]))
        >>> round(float(command[0]), 3), limited.tolist()  # 55 deg/s over 0.2 s
        (0.192, [True, False, False])
    """

    lower: FloatArray  # smallest command
    upper: FloatArray  # largest command
    step: FloatArray  # largest change in one period

    @classmethod
    def of(cls, vehicle: Vehicle, period_s: float) -> CommandLimits:
        """Return the limits of `vehicle` for a command every `period_s` [s]."""
        return cls(vehicle.input_min, vehicle.input_max, vehicle.input_rate * period_s)

    def clamp(self, desired: FloatArray) -> FloatArray:
        """Return `desired` (3,) clipped to the amplitudes, without regard to the rates."""
        return np.minimum(np.maximum(desired, self.lower), self.upper)

    def holds(self, command: FloatArray, previous: FloatArray) -> NDArray[np.bool_]:
        """Return where `command` (3,) is at an amplitude or rate limit from `previous` (3,)."""
        lowest, highest = self._range_from(previous)
        return (command <= lowest + _AT_LIMIT) | (command >= highest - _AT_LIMIT)

    def apply(
        self, desired: FloatArray, previous: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the allowed command (3,) nearest to `desired` (3,), and where it differs (3,).

        `previous` (3,) is the command of one period before. It must be within the amplitudes. It
        replaces an entry of `desired` that is not finite.
        """
        finite = np.where(np.isfinite(desired), desired, previous)
        lowest, highest = self._range_from(previous)
        command = np.minimum(np.maximum(finite, lowest), highest)
        return command, command != desired

    def _range_from(self, previous: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the smallest and the largest command one period after `previous`, (3,) each."""
        lowest = np.maximum(self.lower, previous - self.step)
        highest = np.minimum(self.upper, previous + self.step)
        return lowest, highest
