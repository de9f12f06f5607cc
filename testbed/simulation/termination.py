"""Termination of a run: roll-over, jack-knife, off the field, stuck, diverged."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

from ..ground.terrain import Terrain
from ..truth import Truth
from ..vehicle.vehicle import PlantVehicle

_SHORTEST_WAY_M: Final = 1.0  # of the rims: a vehicle that stands does not slip
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
    """Slip of the driven wheels over a time: of the way of their rims, what the vehicle did not go.

    It needs no slip of the wheel model, and a way back counts against the way forth.
    """

    def __init__(self) -> None:
        self._ways: deque[tuple[float, float, float]] = deque()  # time, way of rims, of tractor

    def update(self, now: Truth, window: float) -> float:
        """Return the mean slip of the last `window` seconds up to this state of the plant.

        It is 0 where the rims went less than a metre.
        """
        ways = self._ways
        last, rims, tractor = ways[-1] if ways else (now.time_s, 0.0, 0.0)
        step = now.time_s - last
        ways.append((now.time_s, rims + step * now.wheel_speed, tractor + step * now.speed))
        while len(ways) > 2 and now.time_s - ways[1][0] > window - 1e-6:
            ways.popleft()
        way = ways[-1][1] - ways[0][1]
        return 0.0 if abs(way) < _SHORTEST_WAY_M else 1.0 - (ways[-1][2] - ways[0][2]) / way


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
