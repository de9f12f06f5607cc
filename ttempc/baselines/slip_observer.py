"""Observer of the side slips of all axles from the deviations of both bodies alone.

R. Lenain, B. Thuilot, C. Cariou, P. Martinet (2006), "Sideslip angles observer for vehicle guidance
in sliding conditions: application to agricultural path tracking tasks", IEEE ICRA, pp. 3183-3188:
the side slips are what makes the kinematic model move as the vehicle does. C. Cariou, R. Lenain,
B. Thuilot, P. Martinet (2010), "Path following of a vehicle-trailer system in presence of sliding:
application to automatic guidance of a towed agricultural implement", IEEE/RSJ IROS, pp. 4976-4981,
observe the side slip of a trailer's axle in the same manner.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from ..vehicle import Vehicle

_LEAST_SPEED_MPS: Final = 0.2  # below it a side slip moves nothing that could be seen; assumed
_LEAST_STRETCH: Final = 0.2  # assumed
_LARGEST_SLIP: Final = 0.3  # [rad], more than a vehicle that can be steered has


class Slips(NamedTuple):
    """Side-slip angles [rad]: from where a wheel points to where it moves, positive to the left."""

    front: float = 0.0  # beta_F, front axle
    rear: float = 0.0  # beta_R, rear axle of the tractor
    trailer: float = 0.0  # beta_I, trailer axle


class Deviation(NamedTuple):
    """Place of an axle point beside its path, at the nearest point of the path."""

    across: float  # y, distance to the left of the path [m]
    heading: float  # theta, yaw less the heading of the path [rad]
    curvature: float  # c, of the path [1/m]

    @property
    def stretch(self) -> float:
        """alpha = 1 - c y: travel of the axle point over that of the nearest point of the path.

        Near the centre of the path's circle, where the laws are singular, `_LEAST_STRETCH`.
        """
        return max(1.0 - self.curvature * self.across, _LEAST_STRETCH)


class Motion(NamedTuple):
    """What the observer sees of the vehicle at a tick."""

    tractor: Deviation
    trailer: Deviation
    front_steering: float  # delta_F [rad]
    speed: float  # of the tractor point [m/s], negative in reverse
    speed_i: float  # of the trailer point [m/s]


class _Channel:
    """A deviation z with z' = f(beta), and the side slip beta that is observed from it.

    Once a period T it predicts z by the rate f, and corrects z and beta by the error of the
    prediction, so that both errors fade with the double pole r:

        z <- z + (1 - r^2) e,    beta <- beta + (1 - r)^2 e / (T df/dbeta).
    """

    def __init__(self, period_s: float, pole: float) -> None:
        self._period_s = period_s
        self._pole = pole
        self._predicted: float | None = None  # z of the last tick, None before the first
        self.slip = 0.0

    def correct(self, seen: float, rate: float, by_slip: float) -> None:
        """Correct by the deviation that is `seen`, the mean rate f since then, and df/dbeta."""
        if self._predicted is None or abs(by_slip) < 1e-9:
            self._predicted = seen
            return
        predicted = self._predicted + self._period_s * rate
        error = seen - predicted
        self._predicted = predicted + (1.0 - self._pole**2) * error
        slip = self.slip + (1.0 - self._pole) ** 2 * error / (self._period_s * by_slip)
        self.slip = min(max(slip, -_LARGEST_SLIP), _LARGEST_SLIP)


class SlipObserver:
    """Side slips of front, rear and trailer axle, observed with a double pole at -1 / `memory_s`.

    With the deviations y and theta of the tractor and y_i and theta_i of the trailer,

        y'     = v sin(theta + beta_R)
        theta' = v cos(beta_R) (tan(delta_F + beta_F) - tan(beta_R)) / L
                 - c v cos(theta + beta_R) / alpha
        y_i'   = v_i sin(theta_i + beta_I).

    Each line has one slip that the lines before it do not know: beta_R, beta_F, beta_I.
    """

    def __init__(self, vehicle: Vehicle, period_s: float, memory_s: float) -> None:
        pole = math.exp(-period_s / memory_s)
        self._wheelbase = vehicle.wheelbase
        self._rear = _Channel(period_s, pole)
        self._front = _Channel(period_s, pole)
        self._trailer = _Channel(period_s, pole)
        self._last: Motion | None = None

    @property
    def slips(self) -> Slips:
        """Return the side slips as they are observed."""
        return Slips(self._front.slip, self._rear.slip, self._trailer.slip)

    def update(self, now: Motion) -> Slips:
        """Return the side slips after the motion of a tick; a slow vehicle leaves them."""
        last = self._last or now
        self._last = now

        # Headings and steering between the two ticks, at which the rates are taken
        heading = 0.5 * (last.tractor.heading + now.tractor.heading)
        heading_i = 0.5 * (last.trailer.heading + now.trailer.heading)
        steering = 0.5 * (last.front_steering + now.front_steering)
        moves = abs(now.speed) >= _LEAST_SPEED_MPS
        v = now.speed if moves else 0.0
        v_i = now.speed_i if moves else 0.0

        front, rear, trailer = self.slips
        course = heading + rear
        turn = math.cos(rear) * (math.tan(steering + front) - math.tan(rear)) / self._wheelbase
        along = now.tractor.curvature * math.cos(course) / now.tractor.stretch
        by_front = math.cos(rear) / (self._wheelbase * math.cos(steering + front) ** 2)
        course_i = heading_i + trailer
        self._rear.correct(now.tractor.across, v * math.sin(course), v * math.cos(course))
        self._front.correct(now.tractor.heading, v * (turn - along), v * by_front)
        self._trailer.correct(
            now.trailer.across, v_i * math.sin(course_i), v_i * math.cos(course_i)
        )
        return self.slips
