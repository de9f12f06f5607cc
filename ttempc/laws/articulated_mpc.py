"""Offset-free linear MPC on the articulated model, growing tube, saturated robust law: `ttempc`."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Final, Self

import numpy as np

from ..errors import check_choice, check_flag, check_positive
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
from ..reference.reference import GUIDED, Guided, Reference, ReferenceSample, guided
from ..tube.reference_tube import GrowingTube, TubeDesign, report_rows, tightened
from ..types import FloatArray, State
from ..vehicle import CommandLimits, Vehicle
from .articulated_law import NOMINAL, ONE_STEP, TUBE_READING, ArticulatedLaw, law_of
from .lq_robust_law import LqRobustTuning, robust_gains
from .tracking_controller import TrackingController, around_exact_feedforward

_PERIOD_S: Final = 0.2  # of the paper, for which horizon and weights are given
_ROUNDING: Final = 1e-9


@dataclass(frozen=True)
class MpcOptions(HorizonTuning):
    """Horizon, weights and bounds of an MPC on the articulated error model.

    The outputs are x and y of tractor and trailer in the frames of their references. The horizon
    is four seconds, with six free steps of 0.2 s each. The step weights are low ones that leave a
    margin: with a sixth of that of the front steering worn valves cycle, with a fifth of that of
    the hydrostat it runs into the limit of its rate without a smaller error (docs/ablation.md).

    Horizon and weights are those of a period of 0.2 s and the vehicle of the paper at 1 m/s;
    `for_vehicle` has those of others.
    """

    outputs: ClassVar[int] = 4

    horizon: int = 20  # N_p, predicted periods of 0.2 s
    moves: int = 6  # N_c, free input steps of 0.2 s
    output_weight: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)  # [1/m^2]
    # [1/rad^2], [1/rad^2], for a hydrostat position as a fraction
    step_weight: tuple[float, ...] = (0.3, 0.1, 0.1)
    # [rad], [rad], fraction
    input_bound: tuple[float, ...] = (math.radians(20.0), math.radians(20.0), 0.5)

    # tau of y + tau y' in the place of the cross-track errors y in the cost [s]
    damping_s: float = 0.6

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
    """Options of `ttempc-nominal`."""

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
class ArticulatedOptions(LqRobustTuning, NominalOptions):
    """Options of `ttempc`: those of its MPC and of its robust law."""

    robust: bool = True  # whether the robust law acts

    def __post_init__(self) -> None:
        NominalOptions.__post_init__(self)
        LqRobustTuning.__post_init__(self)
        check_flag("robust", self.robust)


# Time after which a plan can move a point across its path: the steering's lag, and its first effect
# through the heading. Nearer stages would ask for nothing but slack. Assumed.
_RESPONSE_S: Final = 0.8


def articulated_law(
    grid: ReferenceSample,
    reference: Reference,
    feedforward: FloatArray,
    period_s: float,
    tuning: HorizonTuning,
    robust: LqRobustTuning | None,
    options: NominalOptions,
    design: TubeDesign | None,
) -> ArticulatedLaw:
    """Return the MPC on the articulated error model, with or without the robust law.

    In the one-step reading of the robust law a `design` gives a monitor of the residual of each
    step. The deviation of the estimate from its prediction is then the disturbance w of that step
    alone. It lies in the design's set W of single steps, whatever the gain, to W's coverage; the
    true error lies in W widened by the error of the estimate. The margin is 1 less the gauge of w
    in W.

    Raises:
        InvalidTube: the law is to have its authority free and the feedforward leaves less.
        InvalidTuning: no gain stabilises the last stage.
    """
    a, b, c = error_dynamics(reference, period_s, len(grid.time_s) - 1)
    bounds = remaining_bounds(feedforward, CommandLimits.of(reference.vehicle, period_s))
    kind, tube = NOMINAL, None
    parts: dict[str, FloatArray | float] = {"disturbances": float(options.disturbances)}
    if robust:
        kind = ONE_STEP if robust.nominal == "one-step" else TUBE_READING
        parts["limit"] = np.array(robust.saturation)
        parts["gains"] = robust_gains(a, b, c, robust) / parts["limit"][:, None]
        parts["forgetting"] = math.exp(-period_s / robust.memory_s)
        if robust.tightening == "saturation":
            reserved = np.tile(robust.saturation, (len(feedforward), 1))
            bounds = tightened(bounds, reserved, np.zeros_like(reserved), period_s)
        elif robust.tightening == "tube" and design:
            tube = GrowingTube.along(design, a, b, c, feedforward, tuning)
            parts |= {"ancillary": tube.gains, "reserve": tube.reserve}
    if design and kind == ONE_STEP:
        rows = report_rows(c[:-1, :, : len(State)])
        flat = rows.reshape(-1, len(State))
        width = design.disturbance.support(flat) + design.estimate_error.support(flat)
        faces = np.ascontiguousarray(design.disturbance.faces)[None]
        parts |= {"faces": faces, "rows": rows, "half_widths": width.reshape(rows.shape[:2])}
    spread, limit = np.zeros(tuning.horizon + 1), math.radians(options.hitch_limit_deg)
    if tube:
        spread[:-1], spread[-1] = tube.hitch, tube.hitch[-1]
    soft = None
    if reference.corridor and options.corridor:
        first = math.ceil(_RESPONSE_S / period_s - _ROUNDING)
        soft = corridor_bounds(reference.corridor, grid, c, first, tuning.horizon)
        if reference.corridor.hitch_limit is not None:
            reference.corridor.require_hitch(grid.hitch_angle)
            limit = min(limit, reference.corridor.hitch_limit)
    soft = hitch_bounds(grid, limit, spread).beside(soft)
    of_plan = tube.bounds if tube else None
    weighted = damped(a, c, period_s, options.damping_s)
    horizon = CondensedHorizon(a, b, tuning, period_s, c, bounds, of_plan, soft, weighted)
    law = law_of(kind, grid.state, feedforward, reference.vehicle, **parts)
    return ArticulatedLaw(law, horizon, PredictedPath(grid))


def articulated_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    options: NominalOptions = ArticulatedOptions(),
    design: TubeDesign | None = None,
) -> TrackingController:
    """Compose feedforward, MPC of the articulated model and robust law: the controller `ttempc`.

    With `NominalOptions` the robust law is left out. With a `design`, the inputs of the MPC are
    tightened by the tube that grows from the estimate, and, in the one-step reading of the robust
    law, the containment of each step's residual is logged, which changes no command.

    Raises:
        InvalidTube: the design was made for another vehicle, or the law is to have its authority
            free (`tightening = "saturation"`) and the feedforward leaves less.
    """
    if design:
        design.require(vehicle, period_s)
    reference = guided(reference, options.guided)
    speed = reference.speed.top_speed
    tuning, robust = options.for_vehicle(vehicle, speed, period_s), None
    if isinstance(options, ArticulatedOptions) and options.robust:
        robust = options.for_speed(vehicle, speed)

    def law(grid: ReferenceSample, feedforward: FloatArray) -> ArticulatedLaw:
        return articulated_law(
            grid, reference, feedforward, period_s, tuning, robust, options, design
        )

    return around_exact_feedforward(vehicle, reference, period_s, tuning.horizon, law)
