"""`[controller]`: who drives, and what it believes."""

from __future__ import annotations

from typing import Literal

from pydantic.dataclasses import dataclass

from experiments.settings.base import STRICT, Positive
from ttempc.vehicle import Vehicle


@dataclass(frozen=True, config=STRICT)
class BelievedVehicle:
    """What the controller and its estimator believe the vehicle to be."""

    wheelbase_m: Positive = 1.4
    hitch_offset_m: Positive = 0.3
    drawbar_m: Positive = 0.8
    trailer_m: Positive = 1.3
    speed_gain_mps: Positive = 1.4
    speed_time_constant_s: Positive = 2.05

    def vehicle(self) -> Vehicle:
        """Return the vehicle as the control side knows it.

        Raises:
            InvalidVehicle: it cannot be.
        """
        return Vehicle(
            wheelbase=self.wheelbase_m,
            hitch_offset=self.hitch_offset_m,
            drawbar_length=self.drawbar_m,
            trailer_length=self.trailer_m,
            speed_gain=self.speed_gain_mps,
            speed_time_constant=self.speed_time_constant_s,
        )


@dataclass(frozen=True, config=STRICT)
class ControllerSettings:
    """Who drives."""

    name: str = "paper"
    estimator: Literal["ekf", "truth"] = "ekf"
    vehicle: BelievedVehicle = BelievedVehicle()
