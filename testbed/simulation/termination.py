"""Termination of a run: roll-over, jack-knife, off the field, diverged."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from ..ground.terrain import Terrain
from ..truth import Truth
from ..vehicle.vehicle import PlantVehicle

_STOP_MARGIN_DEG: Final = 2.0  # of jack-knife to the stop, which is elastic; assumed


@dataclass(frozen=True, slots=True)
class TerminationLimits:
    """Limits beyond which a run terminates; all assumed, far outside normal driving."""

    tilt: float = math.radians(60.0)  # [rad] roll or pitch of tractor or trailer
    fold: float = math.radians(80.0)  # [rad] between tractor and drawbar, or drawbar and trailer
    deviation: float = 5.0  # [m] of the tractor point from its reference

    @classmethod
    def of(cls, vehicle: PlantVehicle) -> TerminationLimits:
        """Return the limits for a vehicle: a jack-knife is a drawbar near its stop."""
        return cls(fold=math.radians(vehicle.hitch.yaw_limit_deg - _STOP_MARGIN_DEG))


def check_termination(
    truth: Truth,
    reference_xy: tuple[float, float],
    terrain: Terrain,
    limits: TerminationLimits,
) -> str | None:
    """Return the reason to terminate the run as text, None if there is none.

    Args:
        truth: present state of the plant.
        reference_xy: reference of the tractor point [m].
        terrain: the field.
        limits: termination limits.
    """
    for body, pose in (("tractor", truth.tractor), ("trailer", truth.trailer)):
        if max(abs(pose.roll), abs(pose.pitch)) > limits.tilt:
            return f"roll-over of the {body}"
        if not terrain.contains(pose.x, pose.y):
            return f"the {body} left the field at ({pose.x:.1f}, {pose.y:.1f}) m"
    if max(abs(truth.beta), abs(truth.delta_i)) > limits.fold:
        return f"jack-knife, drawbar at {math.degrees(truth.beta):.0f} deg to the tractor"
    distance = math.hypot(truth.tractor.x - reference_xy[0], truth.tractor.y - reference_xy[1])
    if distance > limits.deviation:
        return f"diverged, the tractor is {distance:.1f} m from its reference"
    return None
