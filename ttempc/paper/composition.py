"""The paper's controller: linear MPC on the printed error model, and the tanh law beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..laws.robust_law import Nominal, RobustGains, RobustLaw
from ..laws.tracking_controller import Actions, TrackingController
from ..limits import CommandLimits
from ..models.tracking_error import POSITIONS, estimated_error
from ..mpc.discretisation import zero_order_hold
from ..mpc.lmpc import LinearMpc
from ..mpc.prediction import PredictedPath
from ..mpc.qp import CondensedHorizon, HorizonTuning
from ..reference.feedforward import exact_feedforward
from ..reference.reference import Reference, ReferenceSample
from ..types import Estimate, FloatArray, Input
from ..vehicle import Vehicle
from .equations import PaperEquations
from .error_model import linearise
from .feedforward import printed_feedforward


class PaperFeedback:
    """Linear MPC on the printed error model, and the tanh law on the modelling error."""

    def __init__(
        self,
        grid: ReferenceSample,
        vehicle: Vehicle,
        period_s: float,
        equations: PaperEquations,
        tuning: HorizonTuning,
        gains: RobustGains | None,
    ) -> None:
        self._grid = grid
        a, b = zero_order_hold(*linearise(grid, vehicle, equations), period_s)
        # No period starts at the last sample: it is only predicted.
        horizon = CondensedHorizon(a[:-1], b[:-1], tuning, period_s)
        self._mpc = LinearMpc(horizon)
        self._previous = np.zeros(len(Input))  # u_e(k-1)
        self._nominal = Nominal(a, b, equations.nominal)
        self._robust = RobustLaw(gains, equations.robust_sign, period_s) if gains else None
        self._to_vehicle = np.array([1.0, 1.0, 1.0 / equations.hp_full_scale])
        self._path = PredictedPath(grid, horizon.prediction[:, :, POSITIONS])

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Actions:
        """Return the actions of tick `k`."""
        error = estimated_error(estimate, self._grid, k)
        nominal = self._nominal.at(k, error)
        mpc_state = self._nominal.mpc_state(nominal, error)
        feedback = self._mpc.step(k, mpc_state, self._previous)
        self._previous = feedback.input
        self._nominal.advance(k, mpc_state, feedback.input)
        u_m, z_m = np.zeros(3), None
        if self._robust:
            u_m, z_m = self._robust.step(k, nominal, error)
        return Actions(
            feedback=-feedback.input * self._to_vehicle,
            robust=u_m * self._to_vehicle,
            modelling_error=z_m,
            predicted_path=self._path.of(k, feedback.plan),
            solver=feedback.report,
            fallback=feedback.fallback,
        )

    def prepare(self, k: int) -> None:
        """Warm up for tick `k`, see `ttempc.types.Preparing`."""
        self._mpc.prepare(k)


def paper_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    equations: PaperEquations | None = None,
    tuning: HorizonTuning | None = None,
    gains: RobustGains | None = RobustGains(),  # noqa: B008 - frozen
) -> TrackingController:
    """Compose the paper's controller; `gains` of None leaves the robust action out."""
    equations = equations or PaperEquations()
    tuning, gains = _in_paper_unit(tuning or HorizonTuning(), gains, equations.hp_full_scale)
    grid = reference.on_grid(period_s, beyond=tuning.horizon)
    ticks = len(grid.time_s) - tuning.horizon
    if equations.feedforward == "printed":
        feedforward = printed_feedforward(grid, vehicle, equations)[:ticks]
    else:
        feedforward = exact_feedforward(reference, ticks, period_s)
        feedforward[:, Input.DELTA_I] += grid.hitch_angle[:ticks]  # lambda_r = beta_r + delta_i_r
    feedforward[:, Input.HP] /= equations.hp_full_scale
    feedback = PaperFeedback(grid, vehicle, period_s, equations, tuning, gains)
    limits = CommandLimits.of(vehicle, period_s)
    measured_hitch = equations.hitch_angle == "measured"
    return TrackingController(grid, feedforward, feedback, limits, measured_hitch=measured_hitch)


def printed_sign_controller(
    vehicle: Vehicle, reference: Reference, period_s: float
) -> TrackingController:
    """Compose the paper's controller with the robust action's sign as printed.

    It reads the nominal state as the tube's own. In the one-step reading the modelling error has
    no memory of where the vehicle is, and its sign decides next to nothing.
    """
    equations = PaperEquations(robust_sign=1, nominal="tube")
    return paper_controller(vehicle, reference, period_s, equations)


def _in_paper_unit(
    tuning: HorizonTuning, gains: RobustGains | None, full_scale: float
) -> tuple[HorizonTuning, RobustGains | None]:
    """Return tuning and gains with the hydrostat's entries in the unit of the equations."""

    def scaled(values: tuple[float, ...]) -> tuple[float, ...]:
        return (*values[: Input.HP], values[Input.HP] * full_scale)

    tuning = replace(
        tuning, input_bound=scaled(tuning.input_bound), input_rate=scaled(tuning.input_rate)
    )
    if gains:
        gains = replace(gains, saturation=scaled(gains.saturation))
    return tuning, gains
