"""Path following with side slip, as of INRAE's project Romea.

The laws steer the front axle of a tractor by the extended kinematic model, a single track whose
axles slip by beta_F and beta_R. With the deviations y and theta of the rear axle from its path of
curvature c, alpha = 1 - c y and the course theta_2 = theta + beta_R,

    y'       = v sin(theta_2)
    theta_2' = v (cos(beta_R) (tan(delta_F + beta_F) - tan(beta_R)) / L - c cos(theta_2) / alpha).

- `romea-backstepping`: the course that brings y to 0, then the turn that brings the course there.
  M. Deremetz, R. Lenain, B. Thuilot, V. Rousseau (2017), "Adaptive trajectory control of off-road
  mobile robots: a multi-model observer approach", IEEE ICRA, pp. 4407-4413; S. Ngnepiepaye Wembe,
  V. Rousseau, J. Laconte, R. Lenain (2025), "A novel control strategy for offset points tracking in
  the context of agricultural robotics", arXiv:2503.05835.
- `romea-predictive`: exact linearisation by the chained form, split into the part of the path and
  the part of the deviation. The part of the path is predicted over the lag of the valve.
  R. Lenain, B. Thuilot, C. Cariou, P. Martinet (2006), "High accuracy path tracking for vehicles in
  presence of sliding: application to farm vehicle automatic guidance for agricultural tasks",
  Autonomous Robots 21, pp. 79-97; the same (2007), "Adaptive and predictive path tracking control
  for off-road mobile robots", European Journal of Control 13, pp. 419-439.

No published law of theirs was found for a trailer with a steered drawbar. The drawbar obeys the
first step of the back-stepping on the trailer's own deviation, in both controllers: an extension of
this project, see `drawbar_steering`. A plain trailer is led by the tractor beside its path
(Cariou et al. 2010, see `slip_observer`). The speed, which the laws leave to others, is that of
`pid`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Final, Literal

import numpy as np

from ..errors import InvalidReference, check_choice, check_positive
from ..laws.tracking_controller import ExactCourse, FeedbackLaw, TrackingController
from ..models.kinematics import trailer_point, wrap_angle
from ..reference.reference import GUIDED, Guided, Reference, guided
from ..tuning import SearchRange
from ..types import Diagnostics, Disturbance, Estimate, FloatArray, Input, State
from ..vehicle import Vehicle
from .pid import PidFeedback, PidOptions
from .slip_observer import Deviation, Motion, SlipObserver, Slips

SlipSource = Literal["filter", "observer"]
SLIP_SOURCES: Final = ("filter", "observer")

_STEEPEST: Final = math.radians(80.0)  # course to which the chained form holds, singular at 90 deg


@dataclass(frozen=True)
class RomeaOptions:
    """Options that both laws have.

    Gains are over the distance, as published, up to `fastest_mps`. Above it they fall with the
    speed, so that the decay over time stays: the lags of the valves are times. An assumption of
    this project; with fixed gains a tractor of 4.5 t folds its trailer at 2.8 m/s.
    """

    fastest_mps: float = 1.2  # speed up to which the gains are those given [m/s]

    # Decay of the trailer's deviation over the distance that it travels [1/m]
    trailer_gain_per_m: float = 0.75
    # Origin of the side slips: the disturbances of the filter, or the observer of the papers
    slip: SlipSource = "filter"
    memory_s: float = 1.5  # time constant of the observer's double pole [s]
    # Largest course at which a body approaches its path from beside [deg]
    capture_deg: float = 24.0
    guided: Guided = "tool"  # the point behind that keeps to its line; without a tool the axle

    def __post_init__(self) -> None:
        for name in ("fastest_mps", "trailer_gain_per_m", "memory_s", "capture_deg"):
            check_positive(name, getattr(self, name))
        check_choice("slip", self.slip, SLIP_SOURCES)
        check_choice("guided", self.guided, GUIDED)

    @property
    def capture(self) -> float:
        """Largest course of an approach [rad], below a quarter turn."""
        return min(math.radians(self.capture_deg), _STEEPEST)


@dataclass(frozen=True)
class BackSteppingOptions(RomeaOptions):
    """Options of `romea-backstepping`."""

    search_space: ClassVar[tuple[SearchRange, ...]] = (
        SearchRange("gain_per_m", 0.1, 1.5),
        SearchRange("course_gain_per_m", 0.3, 4.0),
        SearchRange("trailer_gain_per_m", 0.1, 1.5),
        SearchRange("fastest_mps", 0.5, 3.0),
    )

    gain_per_m: float = 0.6  # course that is wanted per deviation, at the path [1/m]
    course_gain_per_m: float = 1.5  # decay of the course's error over the distance [1/m]

    def __post_init__(self) -> None:
        RomeaOptions.__post_init__(self)
        check_positive("gain_per_m", self.gain_per_m)
        check_positive("course_gain_per_m", self.course_gain_per_m)


@dataclass(frozen=True)
class PredictiveOptions(RomeaOptions):
    """Options of `romea-predictive`."""

    search_space: ClassVar[tuple[SearchRange, ...]] = (
        SearchRange("distance_gain_per_m", 0.3, 4.0),
        SearchRange("trailer_gain_per_m", 0.1, 1.5),
        SearchRange("fastest_mps", 0.5, 3.0),
        SearchRange("horizon_s", 0.2, 1.6),
        SearchRange("response_s", 0.1, 1.6),
    )

    # K_d: the deviation has a double pole at K_d / 2 over the distance, as published [1/m]
    distance_gain_per_m: float = 2.0
    horizon_s: float = 0.5  # time by which the angle of the path is predicted [s]
    response_s: float = 0.4  # time constant by which it is to be reached [s]

    def __post_init__(self) -> None:
        RomeaOptions.__post_init__(self)
        for name in ("distance_gain_per_m", "horizon_s", "response_s"):
            check_positive(name, getattr(self, name))


def front_steering(turn: float, at: Deviation, slips: Slips, wheelbase: float) -> float:
    """Return delta_F [rad] by which the course changes by `turn` [rad/m] over the distance.

    The extended kinematic model solved for delta_F: of the path alone with `turn` 0.
    """
    along = at.curvature * math.cos(at.heading + slips.rear) / at.stretch
    over = wheelbase / math.cos(slips.rear)
    return math.atan(math.tan(slips.rear) + over * (along + turn)) - slips.front


def wanted_course(gain: float, at: Deviation, most: float) -> float:
    """Return the course [rad] with tan(course) = -gain y / alpha, at most `most` to either side.

    On it y' = -gain y over the distance travelled, near the path.
    """
    course = -math.atan(gain * at.across / at.stretch)
    return min(max(course, -most), most)


def chained_turn(gain: float, at: Deviation, course: float, gear: float, most: float) -> float:
    """Return the turn [rad/m] by which y'' + K_d y' + K_p y = 0 along the path, K_p = K_d^2 / 4.

    The derivatives are by the arc length of the path, K_d is the `gain` [1/m], `gear` -1 in
    reverse, where the vehicle travels against the arc length. Far from the path y counts up to
    the value at which the course `most` is held.
    """
    alpha = at.stretch
    course = min(max(course, -_STEEPEST), _STEEPEST)
    tan = math.tan(course)
    largest = 4.0 * math.tan(most) / gain
    across = min(max(at.across, -largest), largest)
    second = -0.25 * gain**2 * across - gear * gain * alpha * tan + at.curvature * alpha * tan**2
    return second * math.cos(course) ** 3 / alpha**2


def drawbar_steering(angle: float, error: float, vehicle: Vehicle) -> float:
    """Return the drawbar's angle [rad] that turns the trailer by -`error` [rad] at once.

    `angle` is delta_i as it is. A turn of the drawbar by x, with RJ1 and the axle point where they
    are, turns the trailer by -x d cos(delta_i) / (L_i + c + d cos(delta_i)) about its axle point.
    So the drawbar sets the trailer's course itself, and the first step of the back-stepping needs
    no second one.
    """
    stop = vehicle.steering_limit_i
    angle = min(max(angle, -stop), stop)
    drawbar = vehicle.drawbar_length * math.cos(angle)
    length = vehicle.trailer_length + vehicle.trailer_turning_offset
    return angle + (length + drawbar) / drawbar * error


def predictive_gain(lag_s: float, response_s: float, horizon_s: float, period_s: float) -> float:
    """Return the gain of the set point on the way from an angle to its objective.

    Of an actuator with lag tau, delta_{n+i} = a^i delta_n + (1 - a^i) u under a constant set point
    u, a = exp(-T / tau). The u whose response is nearest, over the horizon and in the sense of
    least squares, to the approach objective - g^i (objective - delta_n), g = exp(-T / response), is

        u = delta_n + G (objective - delta_n),
        G = sum (1 - a^i) (1 - g^i) / sum (1 - a^i)^2.
    """
    steps = np.arange(1, max(1, round(horizon_s / period_s)) + 1)
    reached = 1.0 - np.exp(-steps * period_s / lag_s)
    wanted = 1.0 - np.exp(-steps * period_s / response_s)
    return float(reached @ wanted / (reached @ reached))


class PathAngle:
    """Steering angle of a path, predicted over the lag of its actuator.

    The state is that of the model of the actuator alone: measured angles have the part of the
    deviation in them.
    """

    def __init__(self, lag_s: float, options: PredictiveOptions, period_s: float) -> None:
        self._gain = predictive_gain(lag_s, options.response_s, options.horizon_s, period_s)
        self._kept = math.exp(-period_s / lag_s)  # a
        self._angle: float | None = None  # of the model, None before the first tick

    def set_point(self, objective: float, now: float) -> float:
        """Return the set point for the angle at the end of the horizon; `now` starts the model."""
        angle = now if self._angle is None else self._angle
        sent = angle + self._gain * (objective - angle)
        self._angle = self._kept * angle + (1.0 - self._kept) * sent
        return sent


def deviation(
    at: FloatArray, yaw: float, reference_xy: FloatArray, reference_yaw: float, curvature: float
) -> Deviation:
    """Return the deviation of an axle point (2,) [m] at a yaw [rad] from its path.

    The point of the reference is that of the present time. From there to the nearest point of the
    path, x away, the path is an arc: it lies c x^2 / 2 to the left and has turned by c x.
    """
    dx, dy = (at - reference_xy).tolist()
    cos = math.cos(reference_yaw)
    sin = math.sin(reference_yaw)
    along = cos * dx + sin * dy
    across = cos * dy - sin * dx
    heading = wrap_angle(yaw - reference_yaw)
    return Deviation(across - 0.5 * curvature * along**2, heading - curvature * along, curvature)


class RomeaFeedback(FeedbackLaw):
    """Laws of front axle and drawbar on the deviations of tractor and trailer."""

    def __init__(self, course: ExactCourse, options: RomeaOptions) -> None:
        self._course = course
        self._options = options
        grid = course.grid
        moving = np.abs(grid.speed_i) > 1e-6
        self._curvature_i = np.divide(
            grid.yaw_rate_i, grid.speed_i, out=np.zeros_like(grid.speed_i), where=moving
        )
        speed = np.abs(grid.state[:, State.V])
        self._share = np.minimum(1.0, options.fastest_mps / np.maximum(speed, 1e-6))  # of gains
        self._gear = -1.0 if course.vehicle.reverse else 1.0
        self._speed = PidFeedback(course, PidOptions())
        self._observer = SlipObserver(course.vehicle, course.period_s, options.memory_s)

    def resume(self, previous: object) -> None:
        """Keep the observed slips, see `ttempc.types.Controller.resume`."""
        if isinstance(previous, RomeaFeedback):
            self._speed.resume(previous._speed)
            self._observer = previous._observer

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Diagnostics:
        course = self._course
        motion = self._motion(k, estimate)
        slips = self._slips(estimate, motion)
        feedback = self._speed.step(k, estimate, sent).feedback.copy()
        at = self._beside_a_plain_trailer(motion.tractor, slips)
        front, drawbar = self._steering(k, at, motion.trailer, slips, estimate.state)
        feedback[Input.DELTA_T] = front - course.feedforward[k, Input.DELTA_T]
        feedback[Input.DELTA_I] = drawbar - course.feedforward[k, Input.DELTA_I]
        return Diagnostics(feedback=feedback, robust=np.zeros(len(Input)))

    def _steering(
        self, k: int, at: Deviation, at_i: Deviation, slips: Slips, state: FloatArray
    ) -> tuple[float, float]:
        """Return the angles of front axle and drawbar [rad] at tick `k`."""
        raise NotImplementedError

    def _motion(self, k: int, estimate: Estimate) -> Motion:
        """Return the motion of the vehicle relative to its reference at tick `k`."""
        grid = self._course.grid
        state = estimate.state
        point = trailer_point(state, self._course.vehicle)
        planned = grid.state[k]
        tractor = deviation(
            state[: State.PSI_T],
            float(state[State.PSI_T]),
            planned[: State.PSI_T],
            float(planned[State.PSI_T]),
            float(grid.curvature[k]),
        )
        trailer = deviation(
            point,
            float(state[State.PSI_I]),
            grid.trailer_xy[k],
            float(planned[State.PSI_I]),
            float(self._curvature_i[k]),
        )
        v = float(state[State.V])
        slower = float(grid.speed_i[k] / planned[State.V]) if planned[State.V] else 1.0
        return Motion(tractor, trailer, float(state[State.DELTA_T]), v, slower * v)

    def _slips(self, estimate: Estimate, motion: Motion) -> Slips:
        """Return the side slips, of the filter or of the observer.

        The filter has an angle b that is added to the front steering in place of the slip of the
        front axle: tan(delta + b) = tan(delta + beta_F) - tan(beta_R).
        """
        if self._options.slip == "observer":
            return self._observer.update(motion)
        found = estimate.disturbance
        rear = float(found[Disturbance.SLIP_T])
        steering = motion.front_steering
        turned = math.tan(steering + float(found[Disturbance.STEERING])) + math.tan(rear)
        return Slips(math.atan(turned) - steering, rear, float(found[Disturbance.SLIP_I]))

    def _beside_a_plain_trailer(self, at: Deviation, slips: Slips) -> Deviation:
        """Return the tractor's deviation from where a plain trailer slips onto its path.

        On a straight the axle of a plain trailer runs (d + L_i + c) beta_I beside its hitch: the
        tractor keeps to the other side by as much (Cariou et al. 2010).
        """
        vehicle = self._course.vehicle
        if not vehicle.is_plain:
            return at
        length = vehicle.drawbar_length + vehicle.trailer_length + vehicle.trailer_turning_offset
        return at._replace(across=at.across + length * slips.trailer)

    def _drawbar(self, k: int, at: Deviation, slips: Slips, state: FloatArray) -> float:
        """Return the drawbar's angle [rad] that brings the trailer to its wanted course."""
        options = self._options
        gain = self._gear * self._share[k] * options.trailer_gain_per_m
        wanted = wanted_course(gain, at, options.capture)
        error = at.heading + slips.trailer - wanted
        return drawbar_steering(float(state[State.DELTA_I]), error, self._course.vehicle)


class BackStepping(RomeaFeedback):
    """Back-stepping: a course for the deviation, a turn for the course."""

    _options: BackSteppingOptions

    def _steering(
        self, k: int, at: Deviation, at_i: Deviation, slips: Slips, state: FloatArray
    ) -> tuple[float, float]:
        options = self._options
        share = self._gear * self._share[k]
        wanted = wanted_course(share * options.gain_per_m, at, options.capture)
        turn = share * options.course_gain_per_m * (wanted - at.heading - slips.rear)
        front = front_steering(turn, at, slips, self._course.vehicle.wheelbase)
        return front, self._drawbar(k, at_i, slips, state)


class Predictive(RomeaFeedback):
    """Chained form, with the part of the path predicted over the lags of both valves."""

    _options: PredictiveOptions

    def __init__(self, course: ExactCourse, options: PredictiveOptions) -> None:
        super().__init__(course, options)
        vehicle = course.vehicle
        self._front_angle = PathAngle(vehicle.steering_lag_t, options, course.period_s)
        self._drawbar_angle = PathAngle(vehicle.steering_lag_i, options, course.period_s)
        self._ahead = max(1, round(options.horizon_s / course.period_s))  # [ticks]

    def resume(self, previous: object) -> None:
        super().resume(previous)
        if isinstance(previous, Predictive):
            self._front_angle = previous._front_angle
            self._drawbar_angle = previous._drawbar_angle

    def _steering(
        self, k: int, at: Deviation, at_i: Deviation, slips: Slips, state: FloatArray
    ) -> tuple[float, float]:
        options = self._options
        grid = self._course.grid
        wheelbase = self._course.vehicle.wheelbase
        then = min(k + self._ahead, len(grid.curvature) - 1)

        # The angle of the path now and at the end of the horizon, y and slips as they are
        path = front_steering(0.0, at, slips, wheelbase)
        ahead = at._replace(curvature=float(grid.curvature[then]))
        objective = front_steering(0.0, ahead, slips, wheelbase)

        # The part of the deviation is what remains of the whole law
        course = at.heading + slips.rear
        gain = self._share[k] * options.distance_gain_per_m
        turn = chained_turn(gain, at, course, self._gear, options.capture)
        beside = front_steering(turn, at, slips, wheelbase) - path
        front = self._front_angle.set_point(objective, path) + beside

        # The drawbar's angle of the path is that of the reference
        angle = float(grid.state[k, State.DELTA_I])
        angle_then = float(grid.state[then, State.DELTA_I])
        beside_i = self._drawbar(k, at_i, slips, state) - angle
        return front, self._drawbar_angle.set_point(angle_then, angle) + beside_i


def _course_of(
    name: str, vehicle: Vehicle, reference: Reference, period_s: float, options: RomeaOptions
) -> ExactCourse:
    """Return the course of a controller.

    Raises:
        InvalidReference: a plain trailer is to be pushed in reverse, where it folds.
    """
    if vehicle.is_plain and vehicle.reverse:
        raise InvalidReference(
            f"controller {name!r}: got a plain trailer in reverse, which folds unless its own "
            "deviation steers the tractor; allowed are forward driving or a steered trailer"
        )
    return ExactCourse(guided(reference, options.guided), period_s)


def backstepping_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    options: BackSteppingOptions = BackSteppingOptions(),
) -> TrackingController:
    """Compose the back-stepping law of the front axle and that of the drawbar.

    Raises:
        InvalidReference: a plain trailer in reverse.
    """
    course = _course_of("romea-backstepping", vehicle, reference, period_s, options)
    return course.controller(BackStepping(course, options))


def predictive_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    options: PredictiveOptions = PredictiveOptions(),
) -> TrackingController:
    """Compose the predictive law of the front axle and that of the drawbar.

    Raises:
        InvalidReference: a plain trailer in reverse.
    """
    course = _course_of("romea-predictive", vehicle, reference, period_s, options)
    return course.controller(Predictive(course, options))
