"""When a run is over because the vehicle is lost."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from ..ground.terrain import Terrain
from ..truth import Truth
from ..vehicle.vehicle import PlantVehicle

_STOP_GIVES_DEG: Final = 2.0  # a stop is no wall; assumed


@dataclass(frozen=True, slots=True)
class TerminationLimits:
    """Beyond these a vehicle is lost; all of them assumed, far outside normal driving."""

    tilt: float = math.radians(60.0)  # [rad] roll or pitch of tractor or trailer
    fold: float = math.radians(80.0)  # [rad] between tractor and drawbar, or drawbar and trailer
    deviation: float = 5.0  # [m] of the tractor point from its reference

    @classmethod
    def of(cls, vehicle: PlantVehicle) -> TerminationLimits:
        """Return the limits for a vehicle: jack-knifed is a drawbar as good as at its stop."""
        return cls(fold=math.radians(vehicle.hitch.yaw_limit_deg - _STOP_GIVES_DEG))


def check_termination(
    truth: Truth,
    reference_xy: tuple[float, float],
    terrain: Terrain,
    limits: TerminationLimits,
) -> str | None:
    """Return in words why the vehicle is lost, None while it is not.

    Args:
        truth: the plant now.
        reference_xy: where the tractor point should be [m].
        terrain: the field.
        limits: what counts as lost.
    """
    for body, pose in (("tractor", truth.tractor), ("trailer", truth.trailer)):
        if max(abs(pose.roll), abs(pose.pitch)) > limits.tilt:
            return f"roll-over of the {body}"
        if not terrain.contains(pose.x, pose.y):
            return f"the {body} left the field at ({pose.x:.1f}, {pose.y:.1f}) m"
    if max(abs(truth.beta), abs(truth.delta_i)) > limits.fold:
        return f"jack-knife, drawbar at {math.degrees(truth.beta):.0f} deg to the tractor"
    away = math.hypot(truth.tractor.x - reference_xy[0], truth.tractor.y - reference_xy[1])
    if away > limits.deviation:
        return f"diverged, the tractor is {away:.1f} m from its reference"
    return None
