"""The controller `ttempc`: offset-free linear MPC on the articulated model, and a robust law."""

from __future__ import annotations

import math

import numpy as np

from ttempc.belief import by_map, map_gain
from ttempc.error_model import zero_order_hold
from ttempc.kinematics import articulated_jacobian, trailer_point_jacobian, wrap_angle
from ttempc.limits import CommandLimits
from ttempc.lmpc import FeedbackAction, LinearMpc
from ttempc.prediction import PredictedPath, rotation
from ttempc.qp import CondensedHorizon, HorizonTuning, StageBounds
from ttempc.reference import Reference, ReferenceSample
from ttempc.regulator import RegulatorTuning, RobustAction, RobustRegulator
from ttempc.tracking import Actions, TrackingController, around_exact_feedforward
from ttempc.types import Disturbance, Estimate, FloatArray, Input, MapDisturbance, State
from ttempc.vehicle import Vehicle

_N, _M, _D = len(State), len(Input), len(Disturbance)
_SIZE = _N + _D + len(MapDisturbance)

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


def error_dynamics(
    reference: Reference, period_s: float, ticks: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A (N, 16, 16), B (N, 16, 3) and C (N + 1, 4, 16) along the reference.

    State (z_e, s, m): z_e = T (z_r - z) is the error of the minimal state with the position in the
    frame of the reference tractor, s the disturbance that turns with the vehicle and m the one that
    stays with the field (`MapDisturbance`), both held over the horizon; input u_e = u_r - u:

        z_e(k+1) = A_z z_e(k) + B_z u_e(k) - E (s + G(psi_r) m),   s(k+1) = s(k),  m(k+1) = m(k).

    The Jacobians of the exact model, taken in the middle of each period, are held for it (zero-
    order hold by the matrix exponential); T turns with the reference. Outputs C z_e are the errors
    of tractor and trailer point in the frames of the reference tractor and trailer.
    """
    vehicle = reference.vehicle
    middle = reference.at((np.arange(ticks) + 0.5) * period_s)
    turning = map_gains(middle, vehicle)
    slope_a, slope_b = np.zeros((ticks, _SIZE, _SIZE)), np.zeros((ticks, _SIZE, _M))
    for k, (state, inputs) in enumerate(zip(middle.state, middle.inputs, strict=True)):
        by_state, by_input, by_disturbance = articulated_jacobian(state, inputs, vehicle)
        slope_a[k, :_N, :_N] = by_state
        slope_a[k, :_N, _N : _N + _D] = -by_disturbance
        slope_a[k, :_N, _N + _D :] = -by_disturbance @ turning[k]
        slope_b[k, :_N] = by_input
    a, b = zero_order_hold(slope_a, slope_b, period_s)

    grid = reference.at(np.arange(ticks + 1) * period_s)
    turn = np.tile(np.eye(_SIZE), (ticks + 1, 1, 1))  # map frame -> reference frame
    turn[:, :2, :2] = rotation(-grid.state[:, State.PSI_T])
    back = turn.transpose(0, 2, 1)
    a, b = turn[1:] @ a @ back[:-1], turn[1:] @ b

    c = np.zeros((ticks + 1, 4, _SIZE))
    c[:, 0, State.X] = c[:, 1, State.Y] = 1.0
    trailer = np.zeros((ticks + 1, 2, _SIZE))
    trailer[:, :, :_N] = [trailer_point_jacobian(state, vehicle) for state in grid.state]
    c[:, 2:] = rotation(-grid.state[:, State.PSI_I]) @ trailer @ back
    return a, b, c


def map_gains(reference: ReferenceSample, vehicle: Vehicle) -> FloatArray:
    """Return G (N, 5, 4), what map disturbances do to the vehicle at N samples of the reference."""
    shape = reference.state[:, [State.PSI_T, State.PSI_I, State.V]].tolist()
    return np.array(
        [
            by_map(psi_t, psi_i, v, yaw_rate, vehicle)
            for (psi_t, psi_i, v), yaw_rate in zip(
                shape, reference.yaw_rate_t.tolist(), strict=True
            )
        ]
    )


def error_state(reference: FloatArray, estimate: Estimate, vehicle: Vehicle) -> FloatArray:
    """Return (z_e, s, m) of `error_dynamics` against the reference's state (7,), (16,)."""
    error = reference - estimate.state
    for yaw in (State.PSI_T, State.PSI_I):
        error[yaw] = wrap_angle(error[yaw])
    cos, sin = math.cos(reference[State.PSI_T]), math.sin(reference[State.PSI_T])
    dx, dy = error[State.X], error[State.Y]
    error[State.X], error[State.Y] = cos * dx + sin * dy, cos * dy - sin * dx
    return np.concatenate([error, *lasting_disturbance(estimate, vehicle)])


def lasting_disturbance(estimate: Estimate, vehicle: Vehicle) -> tuple[FloatArray, FloatArray]:
    """Return what of the disturbance turns with the vehicle (5,), and what with the field (4,)."""
    on_map = estimate.map_disturbance
    return estimate.disturbance - map_gain(estimate, vehicle) @ on_map, on_map


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
    ) -> None:
        a, b, c = error_dynamics(reference, period_s, len(grid.time_s) - 1)
        self._feedforward = feedforward  # u_r (N, 3)
        bounds = remaining_bounds(feedforward, CommandLimits.of(reference.vehicle, period_s))
        horizon = CondensedHorizon(a, b, tuning, period_s, c, bounds)
        self._mpc = LinearMpc(horizon)
        self._robust = RobustRegulator(a, b, c, period_s, robust) if robust else None
        self._known = 1.0 if disturbed else 0.0
        self._state = grid.state
        self._vehicle = reference.vehicle
        self._path = PredictedPath(grid, horizon.prediction)

    def step(self, k: int, error: FloatArray, estimate: Estimate, sent: FloatArray) -> Actions:
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
) -> TrackingController:
    """Compose feedforward, MPC of the articulated model and robust law: the controller `ttempc`.

    `robust` of None leaves the robust action out, `disturbed` of False tells the MPC nothing of
    the disturbances that the filter knows.
    """

    def law(grid: ReferenceSample, feedforward: FloatArray) -> ArticulatedFeedback:
        return ArticulatedFeedback(
            grid, reference, feedforward, period_s, tuning, robust, disturbed
        )

    return around_exact_feedforward(vehicle, reference, period_s, tuning.horizon, law)


def nominal_controller(
    vehicle: Vehicle, reference: Reference, period_s: float
) -> TrackingController:
    """Compose `ttempc` without its robust action."""
    return articulated_controller(vehicle, reference, period_s, robust=None)


def remaining_bounds(feedforward: FloatArray, limits: CommandLimits) -> StageBounds:
    """Return what the limits of the command leave to u_e = u_r - u at every tick."""
    change = np.diff(feedforward, axis=0, prepend=feedforward[:1])
    return StageBounds(
        lower=np.minimum(feedforward - limits.upper, 0.0),
        upper=np.maximum(feedforward - limits.lower, 0.0),
        step_lower=change - limits.step,
        step_upper=change + limits.step,
    )
