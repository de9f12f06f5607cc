"""Controllers of the articulated law: options and composition.

`ttempc` is an offset-free linear MPC on the articulated model in a growing tube, with a saturated
robust law; `ttempc-nominal` its MPC alone; `ttempc-tube` a tube MPC with an ancillary gain.
"""

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Final, Self

import numpy as np

from ..errors import check_choice, check_flag, check_positive, check_vector
from ..models.linear import riccati_gains
from ..mpc.articulated_error import (
    PredictedPath,
    corridor_bounds,
    damped,
    error_dynamics,
    hitch_bounds,
    remaining_bounds,
)
from ..mpc.lmpc import CondensedHorizon, HorizonTuning
from ..reference.corridor import SpeedTube
from ..reference.reference import GUIDED, ConstantSpeed, Guided, Reference, guided
from ..tube.reference_tube import GrowingTube, ReferenceTube, TubeDesign, report_rows
from ..types import FloatArray, Input, State
from ..vehicle import Vehicle
from .articulated_law import NOMINAL, ONE_STEP, TUBE_MPC, ArticulatedLaw, law_of
from .tracking_controller import ExactCourse, TrackingController

_PERIOD_S: Final = 0.2  # of the paper, for which horizon and weights are given
_ROUNDING: Final = 1e-9


@dataclass(frozen=True)
class MpcOptions(HorizonTuning):
    """Horizon, weights and bounds of an MPC on the articulated error model.

    The outputs are x and y of tractor and trailer in the frames of their references. The horizon
    is four seconds, with six free steps of 0.2 s each. The weights are the best of 49 sets on the
    benchmark's trials and other fields (tuning seeds), as those of the rivals are, with an entry
    that is no worse: the trailer's cross-track error weighs more than the tractor's, since the
    working point is behind.

    Horizon and weights are those of a period of 0.2 s and the vehicle of the paper at 1 m/s;
    `for_vehicle` has those of others.
    """

    outputs: ClassVar[int] = 4

    horizon: int = 20  # N_p, predicted periods of 0.2 s
    moves: int = 6  # N_c, free input steps of 0.2 s
    output_weight: tuple[float, ...] = (1.0, 1.0, 1.0, 2.5)  # [1/m^2]
    # [1/rad^2], [1/rad^2], for a hydrostat position as a fraction
    step_weight: tuple[float, ...] = (0.15, 0.07, 0.15)
    # [rad], [rad], fraction
    input_bound: tuple[float, ...] = (math.radians(25.0), math.radians(20.0), 0.5)
    # tau of y + tau y', which is in the place of the cross-track errors y in the cost while the
    # vehicle enters its line from beside it; of an NMPC always [s]
    damping_s: float = 1.5

    def __post_init__(self) -> None:
        HorizonTuning.__post_init__(self)
        check_positive("damping_s", self.damping_s, zero=True)

    def for_vehicle(self, vehicle: Vehicle, speed_mps: float, period_s: float) -> Self:
        """Return the options for a vehicle, the largest speed of its reference and a period.

        - Horizon and free steps span the same time. With n steps in place of one, a ramp of an
          input has the n-th part of its cost and the errors n times theirs, hence the factor n^2
          of all step weights.
        - A step of the hydrostat has the cost of the same change of acceleration
          (`Vehicle.motion_per_input`): a drive of three times the gain cycles at the limit of its
          rate otherwise.
        - The weight of the front steering grows with the square root of the lateral acceleration
          that it causes, from that of the paper's vehicle at 1 m/s on. With its square the error
          of the farm machine at 3.3 m/s grows by half, with none the loop has little margin there.
        """
        steps = _PERIOD_S / period_s
        ratio = vehicle.motion_per_input(speed_mps) / Vehicle().motion_per_input(1.0)
        lateral, _, drive = ratio.tolist()
        front, trailer, hp = (steps**2 * weight for weight in self.step_weight)
        return replace(
            self,
            horizon=math.ceil(steps * self.horizon - _ROUNDING),
            moves=math.ceil(steps * self.moves - _ROUNDING),
            step_weight=(front * math.sqrt(max(lateral, 1.0)), trailer, drive**2 * hp),
        )


@dataclass(frozen=True)
class NominalOptions(MpcOptions):
    """Options of `ttempc-nominal`; its weights are those of a search of its own, of 39 sets."""

    # As of `MpcOptions`; with front wheels near their stop turned starts settle earlier
    input_bound: tuple[float, ...] = (math.radians(32.0), math.radians(20.0), 0.5)
    output_weight: tuple[float, ...] = (1.0, 1.0, 1.0, 3.36)
    step_weight: tuple[float, ...] = (0.1, 0.095, 0.32)
    disturbances: bool = True  # whether the MPC uses the disturbances that the filter estimates
    corridor: bool = True  # whether the MPC keeps to the corridor of the reference, if any
    hitch_limit_deg: float = 45.0  # largest |beta| of plans; that of the corridor where less
    guided: Guided = "tool"  # the point behind that keeps to its line; without a tool the axle
    # Half widths that tractor and trailer keep about the path: h_0, and h_1 by which they grow with
    # the speed. Whoever plans the reference drives a corridor as slowly as they ask, see
    # `ttempc.reference.corridor.SpeedTube`.
    corridor_at_rest_m: tuple[float, float] = (0.0, 0.0)
    corridor_per_speed_s: tuple[float, float] = (0.0, 0.0)

    @property
    def speed_tube(self) -> SpeedTube | None:
        """Return the half widths over speed; None where the MPC does not keep to a corridor."""
        if not self.corridor:
            return None
        return SpeedTube(self.corridor_at_rest_m, self.corridor_per_speed_s)

    def __post_init__(self) -> None:
        MpcOptions.__post_init__(self)
        check_flag("disturbances", self.disturbances)
        check_flag("corridor", self.corridor)
        check_positive("hitch_limit_deg", self.hitch_limit_deg)
        check_choice("guided", self.guided, GUIDED)
        SpeedTube(self.corridor_at_rest_m, self.corridor_per_speed_s)


@dataclass(frozen=True)
class ArticulatedOptions(NominalOptions):
    """Options of `ttempc`: its MPC, its robust law and its tube, in the order of `Input`.

    The weights of `ttempc-nominal` gain 2 % on the benchmark's trials and lose 9 % of the overshoot
    on a wet slope and 14 % in travel of the front steering.
    """

    output_weight: tuple[float, ...] = MpcOptions.output_weight
    step_weight: tuple[float, ...] = MpcOptions.step_weight
    # Largest action k_s [rad], [rad], fraction; the paper's.
    saturation: tuple[float, float, float] = (0.2, 0.1, 0.10)
    # Cost of an action [1/rad^2], [1/rad^2], 1, beside errors of both points at 1 / m^2 each: 2 cm
    # weigh as much as 2 deg of steering or 4 % of the hydrostat. For the vehicle of the paper up to
    # 1 m/s.
    input_weight: tuple[float, float, float] = (0.3, 0.3, 0.3)
    memory_s: float = 5.0  # time constant of the autocorrelation's average [s]
    # Whether the robust law acts: the saturated tanh action u_m alone. The tube stays.
    robust: bool = True
    # Whether the growing tube acts: it tightens the inputs at each stage of the horizon and backs
    # up the last plan. The robust law stays. Without a tube's design nothing is tightened.
    tube: bool = True

    def __post_init__(self) -> None:
        NominalOptions.__post_init__(self)
        check_vector("saturation", self.saturation, len(Input))
        check_vector("input_weight", self.input_weight, len(Input))
        check_positive("memory_s", self.memory_s)
        check_flag("robust", self.robust)
        check_flag("tube", self.tube)

    def for_vehicle(self, vehicle: Vehicle, speed_mps: float, period_s: float) -> Self:
        """Return the options for a vehicle, as `MpcOptions.for_vehicle`.

        A robust action has the cost of the same motion, and none less than the one given. With a
        fixed cost the loop's gain grows with the speed, and above 3 m/s the lags that the kinematic
        model leaves out make steering and drawbar oscillate.
        """
        ratio = vehicle.motion_per_input(speed_mps) / Vehicle().motion_per_input(1.0)
        weights = np.array(self.input_weight) * np.maximum(ratio, 1.0) ** 2
        front, trailer, hp = weights.tolist()
        options = super().for_vehicle(vehicle, speed_mps, period_s)
        return replace(options, input_weight=(front, trailer, hp))


def robust_gains(
    a: FloatArray, b: FloatArray, c: FloatArray, input_weight: tuple[float, float, float]
) -> FloatArray:
    """Return K (N, 3, 7) of u_m = k_s tanh(r K z_m / k_s), z_m = z_e - zbar_e, entry by entry.

    K is the LQ gain on the articulated error model along the reference, actuator lags included.
    zbar_e is predicted from the previous error and the input that was sent, so that z_m is the
    residual of one step. The MPC corrects it, for it has happened; the robust action acts on its
    autocorrelated part, r K z_m, with the lag-one autocorrelation

        r = sum f^j w(k-j) w(k-j-1) / sum f^j (w(k-j)^2 + w(k-j-1)^2) / 2,   w = K z_m,

    within [0, 1] and with f = exp(-period / `memory_s`). A, B and C are of `error_dynamics`.

    Raises:
        InvalidTuning: no gain stabilises the last stage.
    """
    n = len(State)
    outputs = c[:-1, :, :n]
    cost = outputs.transpose(0, 2, 1) @ outputs
    return riccati_gains(a[:, :n, :n], b[:, :n], cost, np.array(input_weight))


# Time after which a plan can move a point across its path: the steering's lag, and its first effect
# through the heading. Nearer stages would ask for nothing but slack. Assumed.
_RESPONSE_S: Final = 0.8
# In reverse: heading of the damped approach from farther away, which limits the trailer's error
# across the path on which the MPC acts, the limit along it, and the next; tuned on entries
_CAPTURE: Final = math.radians(25.0)
_AHEAD_M: Final = 0.3
_LAPS: Final = 3  # of which every one has its own tables
_SETTLED_S: Final = 80.0  # after the second lap, from whose end the gains are computed; assumed
_TRACTOR: Final = 0.55  # weight of the tractor's error across there, which else swings the bodies


def articulated_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    options: NominalOptions = ArticulatedOptions(),
    design: TubeDesign | None = None,
) -> TrackingController:
    """Compose feedforward, MPC of the articulated model and robust law: the controller `ttempc`.

    `NominalOptions` have neither robust law nor tube; of `ArticulatedOptions` each is an option of
    its own. With a `design` the tube that grows from the estimate tightens the inputs of the MPC
    and backs up its last plan, and a monitor of the residual w of each step, which changes no
    command, reports whether w lies in the design's set W of single steps. The true error then lies
    in W widened by the error of the estimate. The margin is 1 less the gauge of w in W.

    Raises:
        InvalidTube: the design was made for another vehicle.
        InvalidTuning: no gain stabilises the last stage.
    """
    if design:
        design.require(vehicle, period_s)
    reference = guided(reference, options.guided)
    options = options.for_vehicle(vehicle, reference.speed.top_speed, period_s)
    course = ExactCourse(reference, period_s, options.horizon)
    # Laps of a closed path at one speed share their tables: a place is off by half a tick at most
    lap, path = math.inf, reference.path
    if path.laps > _LAPS and isinstance(reference.speed, ConstantSpeed) and not reference.corridor:
        lap = path.lap_m / (reference.speed.speed * period_s)
    ticks = min(len(course.feedforward), 2.0 * lap + _SETTLED_S / period_s)
    grid, feedforward = course.grid, course.feedforward[: int(ticks)]
    a, b, c = error_dynamics(reference, period_s, len(feedforward))
    bounds = remaining_bounds(feedforward, course.limits)
    kind, free, soft = NOMINAL, None, None
    spread, limit = np.zeros(options.horizon + 1), math.radians(options.hitch_limit_deg)
    parts: dict[str, FloatArray | float] = {"disturbances": float(options.disturbances)}
    if vehicle.reverse and options.damping_s > 0.0:
        capture = options.damping_s * reference.speed.top_speed * math.sin(_CAPTURE)
        parts["reach"] = np.array([_AHEAD_M, capture])
    if isinstance(options, ArticulatedOptions):
        if options.robust:
            kind = ONE_STEP
            parts["limit"] = np.array(options.saturation)
            gains = robust_gains(a, b, c, options.input_weight)
            parts["gains"] = gains / parts["limit"][:, None]
            parts["forgetting"] = math.exp(-period_s / options.memory_s)
        if options.tube and design:
            tube = GrowingTube.along(design, a, b, c, feedforward, options)
            parts |= {"ancillary": tube.gains, "reserve": tube.reserve}
            free = tube.bounds
            spread[:-1], spread[-1] = tube.hitch, tube.hitch[-1]
        if design:
            kind = ONE_STEP  # whose residual the monitor judges
            rows = report_rows(c[:-1, :, : len(State)])
            flat = rows.reshape(-1, len(State))
            width = design.disturbance.support(flat) + design.estimate_error.support(flat)
            faces = np.ascontiguousarray(design.disturbance.faces)[None]
            parts |= {"faces": faces, "half_widths": width.reshape(rows.shape[:2])}
    if reference.corridor and options.corridor:
        first = math.ceil(_RESPONSE_S / period_s - _ROUNDING)
        soft = corridor_bounds(reference.corridor, grid, c, first, options.horizon)
        if reference.corridor.hitch_limit is not None:
            reference.corridor.require_hitch(grid.hitch_angle)
            limit = min(limit, reference.corridor.hitch_limit)
    front = options.input_bound[Input.DELTA_T]
    hitch = hitch_bounds(grid, course.vehicle, limit, spread, front, a, period_s)
    soft = hitch.beside(soft)
    entry = damped(a, c, period_s, options.damping_s)
    entry[:, 1] *= _TRACTOR if vehicle.reverse else 1.0
    # the rows that change: along a long reference these matrices are the largest
    a, b = a[:, : len(State)].copy(), b[:, : len(State)].copy()
    horizon = CondensedHorizon(a, b, options, period_s, c, bounds, free, soft, entry)
    del a, b, c, entry
    of_course = course.grid.state, course.feedforward, course.vehicle
    law = law_of(kind, *of_course, len(feedforward), **parts)
    return course.controller(ArticulatedLaw(law, horizon, PredictedPath(course.grid), lap))


def tube_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    options: MpcOptions = MpcOptions(),
    *,
    design: TubeDesign,
) -> TrackingController:
    """Compose tube MPC after Mayne, Seron and Rakovic (2005), on the estimate (Mayne et al. 2006).

    The nominal error zbar follows the model under the MPC, within bounds that the tube has
    tightened, and with the disturbance s of the estimator; u_e = ubar + K (zhat - zbar). Membership
    is tested by half widths, in a box around the set. Where the deviation leaves that box, the
    nominal error restarts at the estimate, and the fallback of the tick says so.

    Raises:
        InvalidTube: see `ReferenceTube.along`.
    """
    design.require(vehicle, period_s)
    options = options.for_vehicle(vehicle, reference.speed.top_speed, period_s)
    course = ExactCourse(reference, period_s, options.horizon)
    along = ReferenceTube.along(design, reference, len(course.feedforward))
    horizon = CondensedHorizon(along.a, along.b, options, period_s, along.c, along.bounds)
    tube = along.tube
    rows, gains = report_rows(tube.system.c), tube.system.gains  # (T, 9, 7), (T, 3, 7)
    # States, trailer point and inputs of the deviation, each divided by its half width.
    widths = np.concatenate([tube.states, tube.outputs[:, 2:], tube.inputs], axis=1)
    law = law_of(
        TUBE_MPC,
        course.grid.state,
        along.feedforward,
        course.vehicle,
        len(along.feedforward),
        disturbances=1.0,
        gains=gains,
        faces=np.concatenate([rows, gains], axis=1) / widths[..., None],  # (T, 12, 7)
        half_widths=along.half_widths,
    )
    return course.controller(ArticulatedLaw(law, horizon, PredictedPath(course.grid)))
