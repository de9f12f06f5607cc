"""The controller `ttempc`: offset-free linear MPC on the articulated model, and a robust law."""

from __future__ import annotations

import math

import numpy as np

from ..limits import CommandLimits
from ..mpc.articulated_error import error_dynamics, error_state, remaining_bounds
from ..mpc.lmpc import FeedbackAction, LinearMpc
from ..mpc.prediction import PredictedPath
from ..mpc.qp import CondensedHorizon, HorizonTuning
from ..reference.reference import Reference, ReferenceSample
from ..tube.reference_tube import TubeDesign, tightened
from ..types import Estimate, FloatArray, Input, State
from ..vehicle import Vehicle
from .lq_robust_law import RegulatorTuning, RobustAction, RobustRegulator
from .one_step_monitor import StepSet
from .tracking_controller import Actions, TrackingController, around_exact_feedforward

_N, _M = len(State), len(Input)

# Four seconds ahead, six free steps; outputs are x, y of tractor and trailer in their frames.
# The hydrostat, which lags by two seconds, is moved freely: that takes a tenth to a fourth off the
# error along the path wherever the ground changes. Steering is not: with a twentieth of its weights
# a wet slope gains a tenth more, and worn valves cycle at twice the error (docs/ablation.md).
TUNING = HorizonTuning(
    horizon=20,
    moves=6,
    output_weight=(1.0, 1.0, 1.0, 1.0),  # [1/m^2]
    step_weight=(1.0, 1.0, 0.02),  # [1/rad^2], [1/rad^2], for a hydrostat position of 0..1
    input_bound=(math.radians(20.0), math.radians(20.0), 0.5),
)


class ArticulatedFeedback:
    """Linear MPC on the articulated error model, and the robust law beside it where there is one.

    The MPC knows the disturbance that lasts, unless `disturbed` is False.
    """

    def __init__(
        self,
        grid: ReferenceSample,
        reference: Reference,
        feedforward: FloatArray,
        period_s: float,
        tuning: HorizonTuning,
        robust: RegulatorTuning | None,
        disturbed: bool,
        design: TubeDesign | None,
    ) -> None:
        a, b, c = error_dynamics(reference, period_s, len(grid.time_s) - 1)
        self._feedforward = feedforward  # u_r (N, 3)
        bounds = remaining_bounds(feedforward, CommandLimits.of(reference.vehicle, period_s))
        if robust and robust.tightened:
            taken = np.tile(robust.saturation, (len(feedforward), 1))
            bounds = tightened(bounds, taken, np.zeros_like(taken), period_s)
        horizon = CondensedHorizon(a, b, tuning, period_s, c, bounds)
        self._mpc = LinearMpc(horizon)
        self._robust = RobustRegulator(a, b, c, period_s, robust) if robust else None
        one_step = robust is not None and robust.nominal == "one-step"
        self._steps = StepSet(design, c[:-1, :, :_N]) if design and one_step else None
        self._known = 1.0 if disturbed else 0.0
        self._state = grid.state
        self._vehicle = reference.vehicle
        self._path = PredictedPath(grid, horizon.prediction)

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Actions:
        """Return the actions of tick `k`."""
        state = error_state(self._state[k], estimate, self._vehicle)
        state[_N:] *= self._known
        before = self._feedforward[max(k - 1, 0)] - sent  # u_e(k-1)
        if self._robust is None:
            return self._actions(k, self._mpc.step(k, state, before))
        robust = self._robust.step(k, state, before)
        feedback = self._mpc.step(k, robust.mpc_state, robust.mpc_before)
        self._robust.note(k, robust.mpc_state, feedback.input)
        return self._actions(k, feedback, robust)

    def _actions(
        self, k: int, feedback: FeedbackAction, robust: RobustAction | None = None
    ) -> Actions:
        return Actions(
            feedback=-feedback.input,
            robust=robust.input if robust else np.zeros(_M),
            modelling_error=robust.modelling_error if robust else None,
            predicted_path=self._path.of(k, feedback.plan),
            solver=feedback.report,
            fallback=feedback.fallback or (robust.fallback if robust else ""),
            tube=self._steps.report(k, robust.nominal, robust.deviation)
            if robust and self._steps
            else None,
        )

    def prepare(self, k: int) -> None:
        """Warm up for tick `k`, see `ttempc.types.Preparing`."""
        self._mpc.prepare(k)


def articulated_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    tuning: HorizonTuning = TUNING,
    robust: RegulatorTuning | None = RegulatorTuning(),  # noqa: B008 - frozen
    disturbed: bool = True,
    design: TubeDesign | None = None,
) -> TrackingController:
    """Compose feedforward, MPC of the articulated model and robust law: the controller `ttempc`.

    `robust` of None leaves the robust action out, `disturbed` of False tells the MPC nothing of
    the disturbances that the filter knows. `design` is the tube against whose set each step's
    disturbance is held, for the record, in the one-step reading of the robust law; it changes no
    command.

    Raises:
        InvalidTube: the design was made for another vehicle, or the law is to have its authority
            free (`RegulatorTuning.tightened`) and the feedforward leaves less.
    """
    if design:
        design.require(vehicle, period_s)

    def law(grid: ReferenceSample, feedforward: FloatArray) -> ArticulatedFeedback:
        return ArticulatedFeedback(
            grid, reference, feedforward, period_s, tuning, robust, disturbed, design
        )

    return around_exact_feedforward(vehicle, reference, period_s, tuning.horizon, law)


def nominal_controller(
    vehicle: Vehicle, reference: Reference, period_s: float
) -> TrackingController:
    """Compose `ttempc` without its robust action."""
    return articulated_controller(vehicle, reference, period_s, robust=None)
