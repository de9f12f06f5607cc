"""Tube MPC with an ancillary gain: `ttempc-tube`."""

from dataclasses import dataclass

import numpy as np

from ..models.linear import ordered_product
from ..mpc.articulated_error import PredictedPath, error_state
from ..mpc.lmpc import CondensedHorizon, LinearMpc
from ..reference.reference import Reference, ReferenceSample
from ..tube.reference_tube import ReferenceTube, TubeDesign, report_rows
from ..types import Diagnostics, Estimate, FloatArray, Input, State, TubeReport
from ..vehicle import Vehicle
from .articulated_mpc import MpcOptions
from .tracking_controller import FeedbackLaw, TrackingController, around_exact_feedforward

_N, _M = len(State), len(Input)
_OUTSIDE = "outside its tube: nominal state restarted at the estimate"


@dataclass(frozen=True)
class TubeMpcOptions(MpcOptions):
    """Options of `ttempc-tube`: those of its nominal MPC. The tube has a file of its own."""


class TubeFeedback(FeedbackLaw):
    """Tube MPC after Mayne, Seron and Rakovic (2005), on the estimate (Mayne et al. 2006).

    The nominal error zbar follows the model under the MPC, within bounds that the tube has
    tightened, and with the disturbance s of the estimator:

        zbar(k+1) = A zbar(k) + B ubar(k) - E s(k),   u_e = ubar + K (zhat - zbar).

    The deviation zhat - zbar of the estimate then obeys A + B K under the disturbance of each step,
    and stays in the tube as long as the windows of that disturbance stay in their set. The nominal
    error depends on no estimate of the state: noise reaches the commands through K only. The
    constraints are those of the inputs at the free stages, and the reference satisfies them: every
    tick has a solution, and no terminal set is needed. Stability with active constraints is not
    proven. Membership is tested by half widths, in a box around the set. Where the deviation leaves
    that box, as after a push or on ground unlike that of the
    data, the nominal error restarts at the estimate, and the fallback of the tick says so.
    """

    def __init__(
        self, grid: ReferenceSample, along: ReferenceTube, horizon: CondensedHorizon
    ) -> None:
        tube = along.tube
        self.mpc = LinearMpc(horizon)
        self._state, self._vehicle = grid.state, along.vehicle
        self._path, self._horizon = PredictedPath(grid), horizon
        self._model = np.concatenate([along.a, along.b], axis=2)[:, :_N]  # (T, 7, 19) of (z, s, u)
        self._gains = tube.system.gains  # (T, 3, 7)
        self._rows = report_rows(tube.system.c)  # (T, 9, 7)
        self._half_widths = along.half_widths  # (T, 9)
        # States, trailer point and inputs of the deviation, each divided by its half width.
        rows = np.concatenate([self._rows, self._gains], axis=1)
        widths = np.concatenate([tube.states, tube.outputs[:, 2:], tube.inputs], axis=1)
        self._normalised = rows / widths[..., None]  # (T, 12, 7)
        self._nominal: FloatArray | None = None  # zbar of the coming tick
        self._tick = -1  # the coming tick
        self._previous: FloatArray = np.zeros(_M)  # ubar(k-1)

    def resume(self, previous: object) -> None:
        """Keep the nominal input, see `ttempc.types.Resuming`; the state starts anew."""
        if isinstance(previous, TubeFeedback):
            self._previous = previous._previous

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Diagnostics:
        state = error_state(self._state[k], estimate, self._vehicle)  # (16,) zhat, s, m
        error = state[:_N].copy()
        nominal = error if self._nominal is None or k != self._tick else self._nominal
        deviation = error - nominal
        margin = 1.0 - float(np.abs(ordered_product(self._normalised[k], deviation)).max())
        ancillary = ordered_product(self._gains[k], deviation)
        inside = margin >= 0.0
        report = TubeReport(
            inside=inside,
            margin=margin,
            nominal=ordered_product(self._rows[k], nominal),
            half_width=self._half_widths[k],
        )
        if inside:
            state[:_N] = nominal
        else:
            ancillary = np.zeros(_M)
        feedback = self.mpc.step(k, state, self._previous)
        self._previous = feedback.input
        self._nominal = ordered_product(self._model[k], np.concatenate([state, feedback.input]))
        self._tick = k + 1
        return Diagnostics(
            feedback=-feedback.input,
            robust=-ancillary,
            predicted_path=self._path.less(k, self._horizon.outputs([k], feedback.plan[None])[0]),
            solver=feedback.report,
            fallback=feedback.fallback or ("" if inside else _OUTSIDE),
            tube=report,
        )

    def prepare(self, k: int) -> None:
        self.mpc.prepare(k)


def tube_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    options: TubeMpcOptions = TubeMpcOptions(),
    *,
    design: TubeDesign,
) -> TrackingController:
    """Compose feedforward, nominal MPC and ancillary gain of `design`: `ttempc-tube`.

    Raises:
        InvalidTube: see `ReferenceTube.along`.
    """
    design.require(vehicle, period_s)
    options = options.for_vehicle(vehicle, reference.speed.top_speed, period_s)

    def law(grid: ReferenceSample, feedforward: FloatArray) -> TubeFeedback:
        along = ReferenceTube.along(design, reference, len(feedforward))
        horizon = CondensedHorizon(along.a, along.b, options, period_s, along.c, along.bounds)
        return TubeFeedback(grid, along, horizon)

    return around_exact_feedforward(vehicle, reference, period_s, options.horizon, law)
