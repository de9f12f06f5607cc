"""What may be sent to the vehicle: amplitude and rate, always, for every controller."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .types import FloatArray
from .vehicle import Vehicle


@dataclass(frozen=True, slots=True)
class CommandLimits:
    """The set of commands that the vehicle can take next, given the one before.

    All arrays are (3,) in the order of `Input`.
    """

    lower: FloatArray  # smallest command
    upper: FloatArray  # largest command
    step: FloatArray  # largest change in one period

    @classmethod
    def of(cls, vehicle: Vehicle, period_s: float) -> CommandLimits:
        """Return the limits of `vehicle` for a command every `period_s`."""
        return cls(vehicle.input_min, vehicle.input_max, vehicle.input_rate * period_s)

    def clamp(self, wanted: FloatArray) -> FloatArray:
        """Return `wanted` (3,) within the amplitudes alone."""
        return np.minimum(np.maximum(wanted, self.lower), self.upper)

    def apply(
        self, wanted: FloatArray, previous: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the allowed command nearest to `wanted`, and where it differs.

        An entry of `wanted` that is not finite becomes the one of `previous`, which must itself
        be allowed.
        """
        finite = np.where(np.isfinite(wanted), wanted, previous)
        least = np.maximum(self.lower, previous - self.step)
        most = np.minimum(self.upper, previous + self.step)
        command = np.minimum(np.maximum(finite, least), most)
        return command, command != wanted
