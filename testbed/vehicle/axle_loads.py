"""Static axle loads of the vehicle on level ground, by moments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from .vehicle_parts import VehicleParts

GRAVITY: Final = 9.81  # [m/s^2] as in MuJoCo
_OVERLOAD: Final = 1.5  # static load over rated load from which a run says so; assumed


@dataclass(frozen=True, slots=True)
class AxleLoads:
    """Static load of each axle and of the pin between tractor and drawbar [N]."""

    front: float
    rear: float
    trailer: float
    pin: float  # downward on the tractor

    @classmethod
    def of(cls, vehicle: VehicleParts) -> AxleLoads:
        """Return the static loads of a vehicle with its load."""
        tractor, drawbar, trailer = vehicle.tractor, vehicle.drawbar, vehicle.trailer
        load, reach = vehicle.load, drawbar.length_m + trailer.length_m
        # drawbar and trailer are one beam in pitch: moments about the trailer axle, then about
        # the rear axle of the tractor
        ahead = (
            trailer.mass_kg * trailer.centre_forward_m
            + drawbar.mass_kg * (trailer.length_m + 0.5 * drawbar.length_m)
            + load.mass_kg * load.forward_m
        )
        pin = GRAVITY * ahead / reach
        front = (
            GRAVITY * tractor.mass_kg * tractor.centre_forward_m - pin * vehicle.hitch.offset_m
        ) / tractor.wheelbase_m
        towed = GRAVITY * (trailer.mass_kg + drawbar.mass_kg + load.mass_kg)
        return cls(front, GRAVITY * tractor.mass_kg + pin - front, towed - pin, pin)


def overload_notes(vehicle: VehicleParts) -> tuple[str, ...]:
    """Return a line for each axle whose tyres carry far more than their rated load.

    They are not refused: the law is linear in the load up to the rim on the ground, at which
    `Plant.reset` refuses. Its range is exceeded all the same, for a real tyre would be harmed.
    """
    loads = AxleLoads.of(vehicle)
    shares = {
        axle: 0.5 * getattr(loads, axle) / wheel.rated_load_n
        for axle, wheel in vehicle.wheels.items()
    }
    return tuple(
        f"{axle} tyres overloaded: each carries {share:.1f} times its rated load of "
        f"{vehicle.wheels[axle].rated_load_n:g} N"
        for axle, share in shares.items()
        if share > _OVERLOAD
    )
