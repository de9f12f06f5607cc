"""Stanley's law and pure pursuit, written against the interface of controllers alone.

    ttempc run grass --controller geometric:Stanley
    ttempc bench geometric:PurePursuit --quick

The tractor is steered by the law, forward only. The trailer's steering is the reference's with a
proportional law on the trailer's offset, the drive likewise on the distance along the path. The
gains are the best of eight settings of Stanley's law on seed 1 of the trials `wet-slope` and
`tool`. Hoffmann et al. (2007), "Autonomous automobile trajectory tracking for off-road driving",
American Control Conference; Coulter (1992), "Implementation of the pure pursuit path tracking
algorithm", CMU-RI-TR-92-01.
"""

import math

import numpy as np

from ttempc import Command

NEAR = 15  # ticks before and after the present one among which the nearest place is searched
SLOWEST_MPS = 0.2  # of the speed in a law that divides by it


def lateral(dx, dy, yaw):
    """Return how far a point lies to the left of a reference with this yaw [m]."""
    return dy * math.cos(yaw) - dx * math.sin(yaw)


class Geometric:
    """Nearest place on the reference, drive and trailer; `front` steers the tractor."""

    def __init__(self, vehicle, reference, period_s, *, offset, heading, along):
        if vehicle.reverse:
            raise ValueError("a geometric law of this file drives forward only")
        self.vehicle, self.offset, self.heading, self.along = vehicle, offset, heading, along
        self.grid = reference.on_grid(period_s, beyond=100)

    def step(self, estimate, k):
        """Return the command of control tick k."""
        grid = self.grid
        x, y, yaw, yaw_i, _, _, v = estimate.state.tolist()
        first, last = max(k - NEAR, 0), k + NEAR
        near = first + int(np.argmin(np.hypot(*(grid.state[first:last, :2] - (x, y)).T)))
        front = self.front(x, y, yaw, max(v, SLOWEST_MPS), near)
        wanted = grid.state[near]
        dx, dy = (estimate.trailer_xy - grid.trailer_xy[near]).tolist()
        left = lateral(dx, dy, wanted[3])
        turned = math.remainder(yaw_i - wanted[3], math.tau)
        trailer = grid.inputs[near, 1] + self.offset * left + self.heading * turned
        dx, dy = (grid.state[k, :2] - (x, y)).tolist()
        behind = dx * math.cos(wanted[2]) + dy * math.sin(wanted[2])
        bounds = zip(self.vehicle.input_min, self.vehicle.input_max, strict=True)
        command = (front, trailer, grid.inputs[k, 2] + self.along * behind)
        return Command(*(min(max(u, a), b) for u, (a, b) in zip(command, bounds, strict=True)))

    def front(self, x, y, yaw, v, near):
        """Return the front steering [rad]; `near`: tick of the nearest place."""
        raise NotImplementedError


class Stanley(Geometric):
    """The wheel turns to the heading of the path at the front axle, and towards it."""

    def __init__(self, vehicle, reference, period_s, gain=1.0, offset=6.0, heading=0.0, along=0.3):
        super().__init__(vehicle, reference, period_s, offset=offset, heading=heading, along=along)
        self.gain = gain  # [1/s]

    def front(self, x, y, yaw, v, near):
        """Return the front steering [rad]."""
        x_r, y_r, yaw_r, _, delta_r, *_ = self.grid.state[near].tolist()
        arm, way = self.vehicle.wheelbase, yaw_r + delta_r  # of the front axle on the reference
        dx = x - x_r + arm * (math.cos(yaw) - math.cos(yaw_r))
        dy = y - y_r + arm * (math.sin(yaw) - math.sin(yaw_r))
        off = lateral(dx, dy, way)
        return math.remainder(way - yaw, math.tau) - math.atan2(self.gain * off, v)


class PurePursuit(Geometric):
    """The rear axle drives on the arc to a point of the path that is `ahead_s` of driving away."""

    def __init__(
        self, vehicle, reference, period_s, ahead_s=2.0, offset=6.0, heading=0.0, along=0.3
    ):
        super().__init__(vehicle, reference, period_s, offset=offset, heading=heading, along=along)
        self.ahead_s = ahead_s

    def front(self, x, y, yaw, v, near):
        """Return the front steering [rad]."""
        points = self.grid.state[near : near + 50, :2] - (x, y)
        away = np.hypot(*points.T)
        at = int(np.argmax(away >= self.ahead_s * v)) or len(away) - 1
        angle = math.atan2(points[at, 1], points[at, 0]) - yaw
        return math.atan2(2.0 * self.vehicle.wheelbase * math.sin(angle), away[at])
