"""Conventional guidance, a PID loop for each of front steering, trailer steering and speed: `pid`.

Feedback on cross-track and heading error beside a feedforward of the path's curvature is the
guidance of commercial machines (O'Connor, Bell, Elkaim and Parkinson 1996, "Automatic steering of
farm vehicles using GPS", Proc. Precision Agriculture; Thuilot, Cariou, Martinet and Berducat 2002,
"Automatic guidance of a farm tractor relying on a single CP-DGPS", Autonomous Robots 13). Each
loop is designed by itself, on straight motion at the reference's speed, without the other two.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..errors import check_choice, check_positive
from ..laws.tracking_controller import ExactCourse, FeedbackLaw, TrackingController
from ..models.kinematics import Error, tracking_error, trailer_point
from ..reference.reference import GUIDED, Guided, Reference, guided
from ..tuning import SearchRange
from ..types import Diagnostics, Estimate, FloatArray, Input, State
from ..vehicle import Vehicle

# Bandwidth in reverse with a plain trailer over that of the front steering by itself: with four
# poles in place of three, a share of 1 cycles on grass, 0.45 to 0.75 give the same errors
_PUSHING_SHARE = 0.55

# [rad] or of the hydrostat: a command that its limits changed by less was not limited. Without it
# the last bit of a sum decides whether an integral grows
_ROUNDING = 1e-9


@dataclass(frozen=True)
class PidOptions:
    """Options of `pid`."""

    search_space: ClassVar[tuple[SearchRange, ...]] = (
        SearchRange("lag_ratio", 2.5, 9.0),
        SearchRange("trailer_lag_ratio", 2.5, 9.0),
        SearchRange("swing_deg", 0.5, 6.0),
    )

    # Time constants of the steering loops over what their design leaves out: the valve's lag, half
    # of a period, and what the valve's largest rate takes for `swing_deg`. With 6, a triple pole
    # keeps a phase margin of 40 deg; these are the best of 34 sets on the benchmark's trials, on
    # tuning seeds
    lag_ratio: float = 4.4
    trailer_lag_ratio: float = 4.0
    swing_deg: float = 1.6
    # Lowest speed that gains are computed for [m/s]; they grow without bound towards 0; assumed
    least_speed_mps: float = 0.3
    # Largest heading at which the tractor approaches its path from beside [deg]: a cross-track
    # error counts up to that which asks for it, and the integral grows within it alone
    capture_deg: float = 24.0
    guided: Guided = "tool"  # the point behind that keeps to its line; without a tool the axle

    def __post_init__(self) -> None:
        check_positive("capture_deg", self.capture_deg)
        for name in ("lag_ratio", "trailer_lag_ratio", "least_speed_mps"):
            check_positive(name, getattr(self, name))
        check_positive("swing_deg", self.swing_deg, zero=True)
        check_choice("guided", self.guided, GUIDED)


@dataclass(frozen=True, slots=True)
class PidGains:
    """Gains on an error e: action = -(proportional e + integral int e dt + derivative e')."""

    proportional: FloatArray  # (N,) at every tick
    integral: FloatArray  # (N,)
    derivative: FloatArray  # (N,)


def front_steering_gains(
    speed: FloatArray, vehicle: Vehicle, period_s: float, options: PidOptions = PidOptions()
) -> PidGains:
    """Return the gains from the tractor's cross-track error [m] to its steering [rad].

    e' = v psi_e, psi_e' = v delta_t / L^t: two integrators, e'' = v^2 delta_t / L^t. With all
    three actions the poles are those of s^3 + 3 p s^2 + 3 p^2 s + p^3, p in `poles`. `speed` is v
    at every tick (N,) [m/s].
    """
    p = poles(vehicle, period_s, options)[0]
    inverse = vehicle.wheelbase / _design_speed(speed, options) ** 2
    return PidGains(3.0 * p**2 * inverse, p**3 * inverse, 3.0 * p * inverse)


def trailer_steering_gains(
    speed: FloatArray, vehicle: Vehicle, period_s: float, options: PidOptions = PidOptions()
) -> PidGains:
    """Return the gains from the trailer's cross-track error [m] to its steering [rad].

    With D = d + L^i, a point at the end of a straight trailer behind a tractor on the path obeys

        (D / v) e' + e = -d delta_i:

    the steering offsets the trailer by up to the drawbar's length, over a distance D. The loop is
    of first order: two actions place both poles at -p, and a derivative would only pass noise on.
    In reverse the lag is negative, and the same two poles stabilise the trailer. Forwards a loop
    slower than the trailer itself would need a gain of the wrong sign: then p = v / 2D, the
    integral action alone. `speed` is that of the trailer point at every tick (N,) [m/s].
    """
    d = vehicle.drawbar_length
    lag = (d + vehicle.trailer_length + vehicle.trailer_turning_offset) / _design_speed(
        speed, options
    )
    p = np.maximum(poles(vehicle, period_s, options)[1], 0.5 / np.abs(lag))
    return PidGains((1.0 - 2.0 * p * lag) / d, -(p**2) * lag / d, np.zeros_like(lag))


def reverse_gains(
    speed: FloatArray, vehicle: Vehicle, period_s: float, options: PidOptions = PidOptions()
) -> tuple[PidGains, FloatArray]:
    """Return the gains from errors of a plain trailer in reverse to the front steering [rad].

    The trailer folds by itself and has no steering: the tractor's has to steer it. With
    L = d + L_i and the speed v < 0, on straight motion,

        e' = v psi_i,   psi_i' = (v lambda - a psi_t') / L,   lambda' = psi_t' - psi_i',

    where psi_t' = v delta_t / L_t. Of the trailer's cross-track error e, its integral, the heading
    psi_i and the angle lambda to the tractor, all fed back, the four poles are those of (s + p)^4
    (Ackermann's formula), p 55 % of that in `poles`. Besides the gains on e it returns that on
    lambda (N,). `speed` is v at every tick (N,) [m/s].
    """
    v = _design_speed(speed, options)
    length = vehicle.drawbar_length + vehicle.trailer_length
    turn = v / vehicle.wheelbase  # psi_t' per front steering
    integral, error, heading, fold = range(4)
    a = np.zeros((len(v), 4, 4))
    b = np.zeros((len(v), 4))
    a[:, integral, error] = 1.0
    a[:, error, heading] = v
    a[:, heading, fold] = v / length
    a[:, fold, fold] = -v / length
    b[:, heading] = -vehicle.hitch_offset * turn / length
    b[:, fold] = turn - b[:, heading]
    columns = [b]
    for _ in range(3):
        columns.append(np.einsum("nij,nj->ni", a, columns[-1]))
    p = _PUSHING_SHARE * poles(vehicle, period_s, options)[0]
    wanted = np.linalg.matrix_power(a + p * np.eye(4), 4)
    last = np.zeros((len(v), 4, 1))
    last[:, 3] = 1.0
    controllability = np.stack(columns, axis=-1)
    row = np.linalg.solve(controllability.transpose(0, 2, 1), last)[..., 0]
    gains = np.einsum("ni,nij->nj", row, wanted)
    return PidGains(gains[:, error], gains[:, integral], gains[:, heading] / v), gains[:, fold]


def speed_gains(speed: FloatArray, vehicle: Vehicle) -> PidGains:
    """Return the gains from the along-track error [m] to the hydrostat's position.

    A PI law on the speed error v - (v_r - k e), whose set point falls as the vehicle runs ahead,
    equals all three actions on e, since e' = v - v_r. The poles of

        tau v' + v = K hp

    and e go to -1 / tau, as fast as the drive by itself. `speed` (N,) gives the number of ticks.
    """
    tau = vehicle.speed_time_constant
    unit = np.ones_like(speed) / vehicle.speed_gain
    return PidGains(3.0 / tau * unit, 1.0 / tau**2 * unit, 2.0 * unit)


def _design_speed(speed: FloatArray, options: PidOptions) -> FloatArray:
    """Return the speed, its modulus raised to the least one (N,) [m/s]."""
    return np.copysign(np.maximum(np.abs(speed), options.least_speed_mps), speed)


def poles(
    vehicle: Vehicle, period_s: float, options: PidOptions = PidOptions()
) -> tuple[float, float]:
    """Return the bandwidths p of the steering loops of tractor and trailer [1/s]."""
    ratios = np.array([options.lag_ratio, options.trailer_lag_ratio])
    swing_s = math.radians(options.swing_deg) / vehicle.input_rate[:2]
    lags = np.array([vehicle.steering_lag_t, vehicle.steering_lag_i]) + swing_s + 0.5 * period_s
    front, trailer = (1.0 / (ratios * lags)).tolist()
    return front, trailer


class PidFeedback(FeedbackLaw):
    """Three PID loops; an integral does not grow while its input is at a limit.

    In reverse with a plain trailer the front steering is on the errors of the trailer.
    """

    def __init__(self, course: ExactCourse, options: PidOptions) -> None:
        self._course = course
        grid = course.grid
        vehicle = course.vehicle
        period_s = course.period_s
        speed = grid.state[:, State.V]
        self._pushes = vehicle.reverse and vehicle.is_plain
        front = front_steering_gains(speed, vehicle, period_s, options)
        self._fold = np.zeros(len(speed))  # gain on lambda
        if self._pushes:
            front, self._fold = reverse_gains(speed, vehicle, period_s, options)
        loops = (
            front,
            trailer_steering_gains(grid.speed_i, vehicle, period_s, options),
            speed_gains(speed, vehicle),
        )
        self._proportional = np.stack([loop.proportional for loop in loops], axis=-1)  # (N, 3)
        self._integral = np.stack([loop.integral for loop in loops], axis=-1)
        self._derivative = np.stack([loop.derivative for loop in loops], axis=-1)
        # P e = D v sin(heading) on the approach to the path; the trailer follows the tractor
        approach = np.abs(loops[0].derivative * speed / loops[0].proportional)
        limit = approach * np.sin(np.radians(min(options.capture_deg, 90.0)))
        self._capture = np.stack([limit, limit, np.full_like(limit, np.inf)], axis=-1)  # (N, 3)
        self._speed = np.stack([speed, grid.speed_i], axis=-1)  # (N, 2)
        self._integrals = np.zeros(3)  # the integral actions
        self._unlimited = course.feedforward[0]  # the previous command before the limits

    def resume(self, previous: object) -> None:
        """Keep the integral actions, see `ttempc.types.Controller.resume`."""
        if isinstance(previous, PidFeedback):
            self._integrals = previous._integrals
            self._unlimited = previous._unlimited

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Diagnostics:
        course = self._course
        grid = course.grid
        point = trailer_point(estimate.state, course.vehicle)
        z_e = tracking_error(estimate.state, point, grid.state[k], grid.trailer_xy[k])
        error = -np.array([z_e[Error.Y_T], z_e[Error.Y_I], z_e[Error.X_T]])
        speed_t, speed_i = self._speed[k]
        rate = -np.array(
            [speed_t * np.sin(z_e[Error.PSI_T]), speed_i * np.sin(z_e[Error.PSI_I]), z_e[Error.V]]
        )
        fold = z_e[Error.PSI_I] - z_e[Error.PSI_T]  # lambda less that of the reference
        if self._pushes:
            error[Input.DELTA_T] = error[Input.DELTA_I]
            rate[Input.DELTA_T] = rate[Input.DELTA_I]
        growth = -self._integral[k] * error * course.period_s
        beyond = self._unlimited - sent
        beyond[np.abs(beyond) < _ROUNDING] = 0.0
        winding_up = (beyond * growth > 0.0) | (np.abs(error) > self._capture[k])
        error = np.clip(error, -self._capture[k], self._capture[k])
        if k > 0:
            self._integrals = self._integrals + np.where(winding_up, 0.0, growth)
        feedback = self._integrals - self._proportional[k] * error - self._derivative[k] * rate
        feedback[Input.DELTA_T] -= self._fold[k] * fold
        self._unlimited = course.feedforward[k] + feedback
        return Diagnostics(feedback=feedback, robust=np.zeros(len(Input)))


def pid_controller(
    vehicle: Vehicle, reference: Reference, period_s: float, options: PidOptions = PidOptions()
) -> TrackingController:
    """Compose the exact feedforward and conventional guidance."""
    course = ExactCourse(guided(reference, options.guided), period_s)
    return course.controller(PidFeedback(course, options))
