"""Linear MPC on the printed error model with the printed robust law: `paper`."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np

from ..laws.nominal_state import NominalState
from ..laws.tracking_controller import Actions, TrackingController
from ..limits import CommandLimits
from ..models.tracking_error import POSITIONS, estimated_error
from ..mpc.discretisation import zero_order_hold
from ..mpc.lmpc import LinearMpc
from ..mpc.prediction import PredictedPath
from ..mpc.qp import CondensedHorizon
from ..reference.feedforward import exact_feedforward
from ..reference.reference import Reference, ReferenceSample
from ..types import Estimate, FloatArray, Input
from ..vehicle import Vehicle
from .error_model import linearise
from .feedforward import printed_feedforward
from .options import PaperOptions, PrintedSignOptions
from .robust_law import RobustLaw

_M = len(Input)


class PaperFeedback:
    """Linear MPC on the printed error model, and the tanh law on the modelling error.

    Args:
        grid: the reference at every tick.
        vehicle: its constants.
        period_s: control period [s].
        options: with the hydrostat's entries in the unit of the equations.
    """

    def __init__(
        self, grid: ReferenceSample, vehicle: Vehicle, period_s: float, options: PaperOptions
    ) -> None:
        self._grid = grid
        a, b = zero_order_hold(*linearise(grid, vehicle, options), period_s)
        # No period starts at the last sample: it is only predicted.
        horizon = CondensedHorizon(a[:-1], b[:-1], options, period_s)
        self._mpc = LinearMpc(horizon)
        self._previous: FloatArray = np.zeros(_M)  # u_e(k-1)
        self._nominal = NominalState(a, b, options.nominal)
        self._robust = None
        if options.robust:
            self._robust = RobustLaw(options, options.robust_sign, period_s)
        self._to_vehicle = np.array([1.0, 1.0, 1.0 / options.hp_full_scale])
        self._path, self._horizon = PredictedPath(grid), horizon

    def fresh(self) -> PaperFeedback:
        """Return the law before its first tick, see `FeedbackLaw`."""
        law = copy.copy(self)
        law._mpc = self._mpc.fresh()
        law._previous = np.zeros(_M)
        law._nominal = self._nominal.fresh()
        law._robust = self._robust.fresh() if self._robust else None
        return law

    def resume(self, previous: object) -> None:
        """Keep the input of the last tick, see `ttempc.types.Resuming`."""
        if isinstance(previous, PaperFeedback):
            self._previous = previous._previous

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Actions:
        """Return the actions of tick `k`, see `FeedbackLaw`."""
        error = estimated_error(estimate, self._grid, k)
        nominal = self._nominal.at(k, error)
        mpc_state = self._nominal.mpc_state(nominal, error)
        feedback = self._mpc.step(k, mpc_state, self._previous)
        self._previous = feedback.input
        self._nominal.advance(k, mpc_state, feedback.input)
        errors = self._horizon.prediction(k)[:, POSITIONS]
        u_m, z_m = np.zeros(_M), None
        if self._robust:
            u_m, z_m = self._robust.step(k, nominal, error)
        return Actions(
            feedback=-feedback.input * self._to_vehicle,
            robust=u_m * self._to_vehicle,
            modelling_error=z_m,
            predicted_path=self._path.of(k, errors, feedback.plan),
            solver=feedback.report,
            fallback=feedback.fallback,
        )

    def prepare(self, k: int) -> None:
        """Get ready for tick `k`, see `FeedbackLaw`."""
        self._mpc.prepare(k)


def paper_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    options: PaperOptions = PaperOptions(),  # noqa: B008 - frozen
) -> TrackingController:
    """Compose the paper's controller: `paper`."""
    options = _in_paper_unit(options)
    grid = reference.on_grid(period_s, beyond=options.horizon)
    ticks = len(grid.time_s) - options.horizon
    if options.feedforward == "printed":
        feedforward = printed_feedforward(grid, vehicle, options)[:ticks]
    else:
        feedforward = exact_feedforward(reference, ticks, period_s)
        feedforward[:, Input.DELTA_I] += grid.hitch_angle[:ticks]  # lambda_r = beta_r + delta_i_r
    feedforward[:, Input.HP] /= options.hp_full_scale
    feedback = PaperFeedback(grid, vehicle, period_s, options)
    limits = CommandLimits.of(vehicle, period_s)
    measured_hitch = options.hitch_angle == "measured"
    return TrackingController(grid, feedforward, feedback, limits, measured_hitch=measured_hitch)


def printed_sign_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    options: PrintedSignOptions = PrintedSignOptions(),  # noqa: B008 - frozen
) -> TrackingController:
    """Compose the paper's controller with the sign as printed: `paper-printed-sign`."""
    return paper_controller(vehicle, reference, period_s, options)


def _in_paper_unit(options: PaperOptions) -> PaperOptions:
    """Return the options with the hydrostat's entries in the unit of the equations."""
    delta_t, delta_i, hp = options.saturation
    scale = options.hp_full_scale
    return replace(
        options,
        input_bound=(*options.input_bound[: Input.HP], options.input_bound[Input.HP] * scale),
        input_rate=(*options.input_rate[: Input.HP], options.input_rate[Input.HP] * scale),
        saturation=(delta_t, delta_i, hp * scale),
    )
