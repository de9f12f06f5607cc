"""Limits of commands in amplitude and rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .types import FloatArray
from .vehicle import Vehicle

_AT_LIMIT = 1e-9  # [rad] or fraction: distance within which a command is at a limit


@dataclass(frozen=True, slots=True)
class CommandLimits:
    """Amplitudes of commands, and their largest change from one command to the next.

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
        lowest = np.maximum(self.lower, previous - self.step) + _AT_LIMIT
        highest = np.minimum(self.upper, previous + self.step) - _AT_LIMIT
        return (command <= lowest) | (command >= highest)

    def apply(
        self, desired: FloatArray, previous: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the allowed command (3,) nearest to `desired` (3,), and where it differs (3,).

        An entry of `desired` that is not finite is replaced by that of `previous` (3,), the command
        of one period before, which must be within the amplitudes.
        """
        finite = np.where(np.isfinite(desired), desired, previous)
        lowest = np.maximum(self.lower, previous - self.step)
        highest = np.minimum(self.upper, previous + self.step)
        command = np.minimum(np.maximum(finite, lowest), highest)
        return command, command != desired
