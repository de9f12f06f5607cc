"""Termination of a run: roll-over, jack-knife, off the field, stuck, diverged."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

from ..ground.terrain import Terrain
from ..truth import Truth
from ..vehicle.vehicle import PlantVehicle

_LEAST_TRAVEL_M: Final = 1.0  # of the driven wheels: a vehicle that stands does not slip
_STOP_MARGIN_DEG: Final = 2.0  # of jack-knife to the stop, which is elastic; assumed


@dataclass(frozen=True, slots=True)
class TerminationLimits:
    """Limits beyond which a run terminates; all assumed, far outside normal driving."""

    tilt: float = math.radians(60.0)  # [rad] roll or pitch of tractor or trailer
    fold: float = math.radians(80.0)  # [rad] between tractor and drawbar, or drawbar and trailer
    deviation: float = 5.0  # [m] of the tractor point from its reference
    # A vehicle is stuck whose driven wheels slip that much, on the mean of a time, while it is that
    # far from its reference; chosen on laps of `grass` with class F at 110 to 130 kPa.
    stuck_slip: float = 0.4
    stuck_time: float = 5.0  # [s]
    stuck_deviation: float = 4.0  # [m]
    # A vehicle that the supervisor stops may be farther from its reference, which goes on, but it
    # must stand after this time.
    stop_time: float = 10.0  # [s]
    wait_time: float = 30.0  # [s] for which it may stand before the run ends
    standing: float = 0.05  # [m/s] largest speed of a vehicle that stands

    @classmethod
    def of(cls, vehicle: PlantVehicle) -> TerminationLimits:
        """Return the limits for a vehicle: a jack-knife is a drawbar near its stop."""
        return cls(fold=math.radians(vehicle.hitch.yaw_limit_deg - _STOP_MARGIN_DEG))


class MeanSlip:
    """Slip of the driven wheels over a time: the share of their travel that the vehicle did not go.

    It needs no slip of the wheel model, and travel in reverse counts against travel forward.
    """

    def __init__(self) -> None:
        # time [s], travel of the driven wheels and of the tractor [m] since the start
        self._travels: deque[tuple[float, float, float]] = deque()

    def update(self, now: Truth, window: float) -> float:
        """Return the mean slip of the last `window` seconds up to this state of the plant.

        It is 0 where the wheels went less than a metre.
        """
        travels = self._travels
        last_s, by_wheels, by_tractor = travels[-1] if travels else (now.time_s, 0.0, 0.0)
        passed_s = now.time_s - last_s
        by_wheels += passed_s * now.wheel_speed
        by_tractor += passed_s * now.speed
        travels.append((now.time_s, by_wheels, by_tractor))
        while len(travels) > 2 and now.time_s - travels[1][0] > window - 1e-6:
            travels.popleft()

        _, first_by_wheels, first_by_tractor = travels[0]
        travel = by_wheels - first_by_wheels
        if abs(travel) < _LEAST_TRAVEL_M:
            return 0.0
        return 1.0 - (by_tractor - first_by_tractor) / travel


def check_termination(
    now: Truth,
    distance_m: float,
    terrain: Terrain,
    limits: TerminationLimits,
    slip: float = 0.0,
    *,
    stopping: bool = False,
) -> str | None:
    """Return the reason to terminate the run as text, None if there is none.

    Args:
        now: present state of the plant.
        distance_m: of the tractor point from its reference.
        terrain: the field.
        limits: termination limits.
        slip: `MeanSlip` of the last `limits.stuck_time`.
        stopping: the supervisor has stopped the vehicle for `limits.stop_time` at most, or it
            stands: it may be far from its reference.
    """
    for body, at in (("tractor", now.tractor), ("trailer", now.trailer)):
        if max(abs(at.roll), abs(at.pitch)) > limits.tilt:
            return f"roll-over of the {body}"
        if not terrain.contains(at.x, at.y):
            return f"the {body} left the field at ({at.x:.1f}, {at.y:.1f}) m"
    if max(abs(now.beta), abs(now.delta_i)) > limits.fold:
        return f"jack-knife, drawbar at {math.degrees(now.beta):.0f} deg to the tractor"
    if slip > limits.stuck_slip and distance_m > limits.stuck_deviation:
        return (
            f"stuck: slip {slip:.2f} over {min(now.time_s, limits.stuck_time):g} s, "
            f"the tractor is {distance_m:.1f} m from its reference"
        )
    if distance_m > limits.deviation and not stopping:
        return f"diverged, the tractor is {distance_m:.1f} m from its reference"
    return None
