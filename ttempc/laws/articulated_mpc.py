"""Offset-free linear MPC on the articulated model, growing tube, saturated robust law: `ttempc`."""

from __future__ import annotations

import copy
import math
from dataclasses import replace

import numpy as np

from ..limits import CommandLimits
from ..mpc.articulated_error import error_dynamics, error_state, remaining_bounds
from ..mpc.corridor_bounds import corridor_bounds
from ..mpc.lmpc import FeedbackAction, LinearMpc
from ..mpc.prediction import PredictedPath
from ..mpc.qp import CondensedHorizon, HorizonTuning
from ..reference.reference import Reference, ReferenceSample
from ..tube.growing_tube import GrowingTube
from ..tube.reference_tube import TubeDesign, tightened
from ..types import Estimate, FloatArray, Input, State
from ..vehicle import Vehicle
from .articulated_options import ArticulatedOptions, NominalOptions
from .kept_plan import KeptPlan
from .lq_robust_law import LqRobustLaw, LqRobustTuning, RobustAction
from .one_step_monitor import OneStepMonitor
from .tracking_controller import Actions, TrackingController, around_exact_feedforward

_N, _M = len(State), len(Input)
_RESPONSE_S = 0.8
_EXCESS = 1e-3  # [m], [rad] violation of the corridor from which it counts as left; assumed


class ArticulatedFeedback:
    """Linear MPC on the articulated error model, with or without the robust law.

    Args:
        grid: the reference at N + 1 ticks.
        reference: the same, at any time.
        feedforward: u_r (N, 3).
        period_s: control period [s].
        tuning: of the MPC.
        robust: of the robust law; None leaves it out.
        options: whether the MPC uses the estimated disturbances, and how it keeps to a corridor.
        design: tube for the one-step monitor and for `tightening = "tube"`; None leaves both out.

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
        self._mpc = LinearMpc(horizon)
        self._robust = LqRobustLaw(a, b, c, period_s, robust) if robust else None
        one_step = robust is not None and robust.nominal == "one-step"
        self._monitor = OneStepMonitor(design, c[:-1, :, :_N]) if design and one_step else None
        self._disturbance_scale = 1.0 if options.disturbances else 0.0
        self._state = grid.state
        self._vehicle = reference.vehicle
        self._path, self._horizon = PredictedPath(grid), horizon

    def fresh(self) -> ArticulatedFeedback:
        """Return the law before its first tick, see `FeedbackLaw`."""
        law = copy.copy(self)
        law._mpc = self._mpc.fresh()
        law._robust = self._robust.fresh() if self._robust else None
        law._plan = self._plan.fresh() if self._plan else None
        return law

    def resume(self, previous: object) -> None:
        """Keep the autocorrelation of the residual, see `ttempc.types.Resuming`."""
        if isinstance(previous, ArticulatedFeedback) and self._robust and previous._robust:
            self._robust.resume(previous._robust)

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Actions:
        """Return the actions of tick `k`, see `FeedbackLaw`."""
        state = error_state(self._state[k], estimate, self._vehicle)  # (16,) z_e, s, m
        state[_N:] *= self._disturbance_scale
        previous = self._feedforward[max(k - 1, 0)] - sent  # u_e(k-1)
        if self._robust is None:
            return self._actions(k, self._mpc.step(k, state, previous))
        robust = self._robust.step(k, state, previous)
        feedback = self._mpc.step(k, robust.mpc_state, robust.mpc_previous)
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
    ) -> Actions:
        tube = None
        if robust and self._monitor:
            tube = self._monitor.report(k, robust.nominal, robust.deviation)
        return Actions(
            feedback=-feedback.input,
            robust=np.zeros(_M) if action is None else action,
            modelling_error=robust.modelling_error if robust else None,
            predicted_path=self._path.of(k, self._horizon.prediction(k), feedback.plan),
            solver=feedback.report,
            fallback=feedback.fallback or (robust.fallback if robust else ""),
            tube=tube,
            leaves_corridor=feedback.excess is not None and bool((feedback.excess > _EXCESS).any()),
        )

    def prepare(self, k: int) -> None:
        """Get ready for tick `k`, see `FeedbackLaw`."""
        self._mpc.prepare(k)


def articulated_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    options: ArticulatedOptions = ArticulatedOptions(),  # noqa: B008 - frozen
    design: TubeDesign | None = None,
) -> TrackingController:
    """Compose feedforward, MPC of the articulated model and robust law: the controller `ttempc`.

    With a `design`, the inputs of the MPC are tightened by the tube that grows from the estimate
    (`ttempc.tube.growing_tube`), and the one-step monitor logs the containment of each step's
    residual, in the one-step reading of the robust law; the monitor changes no command. Without
    one nothing is tightened.

    Raises:
        InvalidTube: the design was made for another vehicle, or the law is to have its authority
            free (`tightening = "saturation"`) and the feedforward leaves less.
    """
    if design:
        design.require(vehicle, period_s)
    robust = options if options.robust else None
    return _compose(vehicle, reference, period_s, options, robust, design)


def nominal_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    options: NominalOptions = NominalOptions(),  # noqa: B008 - frozen
) -> TrackingController:
    """Compose `ttempc` without its robust law: the controller `ttempc-nominal`."""
    return _compose(vehicle, reference, period_s, options, robust=None, design=None)


def _compose(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    options: NominalOptions,
    robust: LqRobustTuning | None,
    design: TubeDesign | None,
) -> TrackingController:
    speed = reference.speed.top_speed
    tuning = options.for_vehicle(vehicle, speed, period_s)
    if robust:
        robust = robust.for_speed(vehicle, speed)

    def law(grid: ReferenceSample, feedforward: FloatArray) -> ArticulatedFeedback:
        return ArticulatedFeedback(
            grid=grid,
            reference=reference,
            feedforward=feedforward,
            period_s=period_s,
            tuning=tuning,
            robust=robust,
            options=options,
            design=design,
        )

    return around_exact_feedforward(vehicle, reference, period_s, tuning.horizon, law)
