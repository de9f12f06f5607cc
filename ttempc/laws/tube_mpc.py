"""The controller `ttempc-tube`: a nominal vehicle under MPC, and a gain that keeps to its tube."""

from __future__ import annotations

import numpy as np

from ..mpc.articulated_error import error_state
from ..mpc.lmpc import LinearMpc
from ..mpc.ordered_product import ordered_product
from ..mpc.prediction import PredictedPath
from ..mpc.qp import CondensedHorizon, HorizonTuning
from ..reference.reference import Reference, ReferenceSample
from ..tube.reference_tube import ReferenceTube, TubeDesign, seen
from ..types import Estimate, FloatArray, Input, State, TubeReport
from ..vehicle import Vehicle
from .articulated_mpc import TUNING
from .tracking_controller import Actions, TrackingController, around_exact_feedforward

_N, _M = len(State), len(Input)
_OUTSIDE = "outside its tube: nominal state restarted at the estimate"


class TubeFeedback:
    """Tube MPC after Mayne, Seron and Rakovic (2005), on the estimate (Mayne et al. 2006).

    A nominal error zbar obeys the model under the MPC, within bounds that the tube has tightened,
    and knows the disturbance s that the estimator has found:

        zbar(k+1) = A zbar(k) + B ubar(k) - E s(k),   u_e = ubar + K (zhat - zbar).

    The estimate's deviation zhat - zbar then obeys A + B K under what each step adds beside the
    model, and stays in the tube as long as that stays in its set. The nominal error follows from
    itself alone: noise reaches the commands through K only. Constraints are those of the inputs,
    and the reference lies inside them: every tick has a solution, and no terminal set is needed.
    Where the deviation leaves the tube, as after a push or on ground unlike that of the data, the
    nominal error starts again at the estimate, and the tick says so.
    """

    def __init__(
        self, grid: ReferenceSample, along: ReferenceTube, horizon: CondensedHorizon
    ) -> None:
        tube = along.tube
        self._mpc = LinearMpc(horizon)
        self._state, self._vehicle = grid.state, along.vehicle
        self._path = PredictedPath(grid, horizon.prediction)
        # One product of (A B) with (z, s, m, u) gives the successor.
        self._model = np.concatenate([along.a, along.b], axis=2)[:, :_N]  # (T, 7, 19)
        self._gains = tube.system.gains
        self._seen = seen(tube.system.c)  # (T, 9, 7)
        self._half_widths = along.half_widths
        # States, trailer point and inputs by the deviation, each in its own half width.
        rows = np.concatenate([self._seen, self._gains], axis=1)
        widths = np.concatenate([tube.states, tube.outputs[:, 2:], tube.inputs], axis=1)
        self._share = rows / widths[..., None]  # (T, 12, 7)
        self._nominal: FloatArray | None = None
        self._tick = -1
        self._before: FloatArray = np.zeros(_M)  # ubar(k-1)

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Actions:
        """Return the actions of tick `k`."""
        state = error_state(self._state[k], estimate, self._vehicle)  # (zhat, s, m)
        here = state[:_N].copy()
        nominal = here if self._nominal is None or k != self._tick else self._nominal
        deviation = here - nominal
        margin = 1.0 - float(np.abs(ordered_product(self._share[k], deviation)).max())
        ancillary = ordered_product(self._gains[k], deviation)
        inside = margin >= 0.0
        report = TubeReport(
            inside, margin, ordered_product(self._seen[k], nominal), self._half_widths[k]
        )
        if inside:
            state[:_N] = nominal
        else:
            ancillary = np.zeros(_M)
        feedback = self._mpc.step(k, state, self._before)
        self._before = feedback.input
        self._nominal = ordered_product(self._model[k], np.concatenate([state, feedback.input]))
        self._tick = k + 1
        return Actions(
            feedback=-feedback.input,
            robust=-ancillary,
            predicted_path=self._path.of(k, feedback.plan),
            solver=feedback.report,
            fallback=feedback.fallback or ("" if inside else _OUTSIDE),
            tube=report,
        )

    def prepare(self, k: int) -> None:
        """Warm up for tick `k`, see `ttempc.types.Preparing`."""
        self._mpc.prepare(k)


def tube_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    design: TubeDesign,
    tuning: HorizonTuning = TUNING,
) -> TrackingController:
    """Compose feedforward, nominal MPC and ancillary gain of `design`.

    Raises:
        InvalidTube: see `ReferenceTube.along`.
    """
    design.require(vehicle, period_s)

    def law(grid: ReferenceSample, feedforward: FloatArray) -> TubeFeedback:
        along = ReferenceTube.along(design, reference, len(feedforward))
        horizon = CondensedHorizon(along.a, along.b, tuning, period_s, along.c, along.bounds)
        return TubeFeedback(grid, along, horizon)

    return around_exact_feedforward(vehicle, reference, period_s, tuning.horizon, law)
