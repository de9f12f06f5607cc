"""Offset-free linear MPC on the articulated model, growing tube, saturated robust law: `ttempc`."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Final, Self

import numpy as np

from ..errors import check_flag
from ..models.linear import ordered_product
from ..mpc.articulated_error import (
    PredictedPath,
    corridor_bounds,
    error_dynamics,
    error_state,
    remaining_bounds,
)
from ..mpc.lmpc import CondensedHorizon, FeedbackAction, HorizonTuning, LinearMpc
from ..reference.corridor import SpeedTube
from ..reference.reference import Reference, ReferenceSample
from ..tube.reference_tube import GrowingTube, TubeDesign, report_rows, tightened
from ..types import Diagnostics, Estimate, FloatArray, Input, State, TubeReport
from ..vehicle import CommandLimits, Vehicle
from .lq_robust_law import LqRobustLaw, LqRobustTuning, RobustAction
from .tracking_controller import FeedbackLaw, TrackingController, around_exact_feedforward

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
        SpeedTube(self.corridor_at_rest_m, self.corridor_per_speed_s)


@dataclass(frozen=True)
class ArticulatedOptions(LqRobustTuning, NominalOptions):
    """Options of `ttempc`: those of its MPC and of its robust law."""

    robust: bool = True  # whether the robust law acts

    def __post_init__(self) -> None:
        NominalOptions.__post_init__(self)
        LqRobustTuning.__post_init__(self)
        check_flag("robust", self.robust)


_N, _M = len(State), len(Input)


class KeptPlan:
    """Backup policy u_e = ubar_j + K m of the last accepted plan, m = zhat - zbar_j.

    zbar_j starts at the estimate at which the plan was made. It follows the model under ubar_j and
    the disturbances that the estimator gives at each tick. ubar_j are the planned inputs; after a
    first input that the robust action has moved away from them, they approach the plan at the rate
    that the tightening leaves. K m saturates at the share of the inputs that the tightening has
    reserved for it. A (T, 16, 16) and B (T, 16, 3) are those of `error_dynamics`.
    """

    def __init__(self, tube: GrowingTube, a: FloatArray, b: FloatArray) -> None:
        self._tube, self._a, self._b = tube, a, b
        self._made = -1  # tick of the plan
        self._plan: FloatArray = np.zeros(0)
        self._next: tuple[int, FloatArray, FloatArray] | None = None  # tick, zbar, ubar before it

    def record(self, k: int, state: FloatArray, u: FloatArray, plan: FloatArray) -> None:
        """Keep the plan of tick `k` from the `state` (16,), whose first input became `u` (3,)."""
        self._made, self._plan, self._next = k, plan, (k, state, u)

    def inputs(self, k: int, estimate: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return ubar and K m (3,) of tick `k` at the estimate (16,); None without a plan.

        Up to the last stage of its horizon a plan can be kept, at every tick.
        """
        stage = k - self._made
        if self._next is None or self._next[0] != k - 1 or stage >= len(self._tube.reserve):
            return None
        _, state, u = self._next
        state = ordered_product(self._a[k - 1], state) + ordered_product(self._b[k - 1], u)
        inputs = self._plan[len(state) :].reshape(-1, _M)  # u_e before it and its steps
        planned = inputs[: stage + 2].sum(axis=0)
        # A robust action may have moved the first input away from the plan by more than a step.
        bounds, at = self._tube.bounds, _M * min(stage, len(inputs) - 2)
        lower = u + bounds.step_lower[self._made, at : at + _M]
        upper = u + bounds.step_upper[self._made, at : at + _M]
        u = np.minimum(np.maximum(planned, lower), upper)
        self._next = k, np.concatenate([state[:_N], estimate[_N:]]), u
        ancillary = ordered_product(self._tube.gains[k], (estimate - state)[:_N])
        reserve = self._tube.reserve[stage, k]
        return u, np.minimum(np.maximum(ancillary, -reserve), reserve)


class OneStepMonitor:
    """Containment of the residual of each step, for a law that predicts its nominal state anew.

    The nominal state is predicted from the estimate of the previous tick and the input that was
    sent. The deviation zhat - zbar is then the disturbance w of that step alone. It lies in the
    design's set W of single steps, whatever the gain, to W's coverage; the true error lies in W
    widened by the error of the estimate. Nothing has to contract, and nothing follows for later
    steps. `outputs` are C (T, 4, 7) of the error dynamics.
    """

    def __init__(self, design: TubeDesign, outputs: FloatArray) -> None:
        self._faces = design.disturbance.faces
        self._rows = report_rows(outputs)  # (T, 9, 7)
        rows = self._rows.reshape(-1, outputs.shape[-1])
        width = design.disturbance.support(rows) + design.estimate_error.support(rows)
        self._half_widths = width.reshape(self._rows.shape[:2])  # (T, 9)

    def report(self, k: int, nominal: FloatArray, deviation: FloatArray) -> TubeReport:
        """Return the containment of the `deviation` (7,) from the `nominal` error (7,) at tick `k`.

        The margin is 1 less the gauge of the deviation in W.
        """
        gauge = float(np.abs(ordered_product(self._faces, deviation)).max())
        errors = ordered_product(self._rows[k], nominal)
        return TubeReport(gauge <= 1.0, 1.0 - gauge, errors, self._half_widths[k])


# Time after which a plan can move a point across its path: the steering's lag, and its first effect
# through the heading. Nearer stages would ask for nothing but slack. Assumed.
_RESPONSE_S = 0.8
_EXCESS = 1e-3  # [m], [rad] violation of the corridor from which it counts as left; assumed


class ArticulatedFeedback(FeedbackLaw):
    """Linear MPC on the articulated error model, with or without the robust law.

    Raises:
        InvalidTube: the law is to have its authority free and the feedforward leaves less.
    """

    def __init__(
        self,
        grid: ReferenceSample,
        reference: Reference,
        feedforward: FloatArray,
        period_s: float,
        tuning: HorizonTuning,
        robust: LqRobustTuning | None,
        options: NominalOptions,
        design: TubeDesign | None,
    ) -> None:
        a, b, c = error_dynamics(reference, period_s, len(grid.time_s) - 1)
        self._feedforward = feedforward
        bounds = remaining_bounds(feedforward, CommandLimits.of(reference.vehicle, period_s))
        tube = None
        if robust and robust.tightening == "saturation":
            reserved = np.tile(robust.saturation, (len(feedforward), 1))
            bounds = tightened(bounds, reserved, np.zeros_like(reserved), period_s)
        elif robust and robust.tightening == "tube" and design:
            tube = GrowingTube.along(design, a, b, c, feedforward, tuning)
        soft = None
        if reference.corridor and options.corridor:
            first = math.ceil(_RESPONSE_S / period_s - 1e-9)
            soft = corridor_bounds(reference.corridor, grid, c, first)
        of_plan = tube.bounds if tube else None
        horizon = CondensedHorizon(a, b, tuning, period_s, c, bounds, of_plan, soft)
        self._plan = KeptPlan(tube, a, b) if tube else None
        self.mpc = LinearMpc(horizon)
        self._robust = LqRobustLaw(a, b, c, period_s, robust) if robust else None
        one_step = robust is not None and robust.nominal == "one-step"
        self._monitor = OneStepMonitor(design, c[:-1, :, :_N]) if design and one_step else None
        self._disturbance_scale = 1.0 if options.disturbances else 0.0
        self._state = grid.state
        self._vehicle = reference.vehicle
        self._path, self._horizon = PredictedPath(grid), horizon

    def resume(self, previous: object) -> None:
        """Keep the autocorrelation of the residual, see `ttempc.types.Resuming`."""
        if isinstance(previous, ArticulatedFeedback) and self._robust and previous._robust:
            self._robust.resume(previous._robust)

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Diagnostics:
        state = error_state(self._state[k], estimate, self._vehicle)  # (16,) z_e, s, m
        state[_N:] *= self._disturbance_scale
        previous = self._feedforward[max(k - 1, 0)] - sent  # u_e(k-1)
        if self._robust is None:
            return self._actions(k, self.mpc.step(k, state, previous))
        robust = self._robust.step(k, state, previous)
        feedback = self.mpc.step(k, robust.mpc_state, robust.mpc_previous)
        action = robust.input
        if self._plan:
            feedback, action = self._keep_viable(self._plan, k, feedback, robust)
        self._robust.record_feedback(k, robust.mpc_state, feedback.input)
        return self._actions(k, feedback, robust, action)

    def _keep_viable(
        self, plan: KeptPlan, k: int, feedback: FeedbackAction, robust: RobustAction
    ) -> tuple[FeedbackAction, FloatArray]:
        """Return feedback and robust action (3,) with a sum from which all later plans exist.

        The robust action saturates there. Without a solution of the QP, the last plan is kept, and
        its ancillary gain is the robust action.
        """
        state, previous, action = robust.mpc_state, robust.mpc_previous, robust.input
        kept = plan.inputs(k, state) if feedback.fallback else None
        if kept is not None:
            note = f"QP {feedback.report.status}: last plan kept by the ancillary gain"
            feedback = replace(feedback, input=kept[0], fallback=note)
            action = -kept[1]
        total = self._horizon.admissible(k, feedback.input - action, previous)
        if not feedback.fallback:
            plan.record(k, state, total, feedback.plan)
        return feedback, feedback.input - total

    def _actions(
        self,
        k: int,
        feedback: FeedbackAction,
        robust: RobustAction | None = None,
        action: FloatArray | None = None,
    ) -> Diagnostics:
        tube = None
        if robust and self._monitor:
            tube = self._monitor.report(k, robust.nominal, robust.deviation)
        return Diagnostics(
            feedback=-feedback.input,
            robust=np.zeros(_M) if action is None else action,
            modelling_error=robust.modelling_error if robust else None,
            predicted_path=self._path.less(k, self._horizon.outputs([k], feedback.plan[None])[0]),
            solver=feedback.report,
            fallback=feedback.fallback or (robust.fallback if robust else ""),
            tube=tube,
            leaves_corridor=feedback.excess is not None and bool((feedback.excess > _EXCESS).any()),
        )

    def prepare(self, k: int) -> None:
        self.mpc.prepare(k)


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
    speed = reference.speed.top_speed
    tuning, robust = options.for_vehicle(vehicle, speed, period_s), None
    if isinstance(options, ArticulatedOptions) and options.robust:
        robust = options.for_speed(vehicle, speed)

    def law(grid: ReferenceSample, feedforward: FloatArray) -> ArticulatedFeedback:
        return ArticulatedFeedback(
            grid, reference, feedforward, period_s, tuning, robust, options, design
        )

    return around_exact_feedforward(vehicle, reference, period_s, tuning.horizon, law)
