"""The controllers by name, as compositions u = u_f - u_b + u_m."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from ttempc.equations import PaperEquations
from ttempc.error_model import POSITIONS, linearise, tracking_error, zero_order_hold
from ttempc.errors import UnknownController
from ttempc.feedforward import exact_feedforward, printed_feedforward
from ttempc.limits import CommandLimits
from ttempc.lmpc import LinearMpc
from ttempc.qp import CondensedHorizon, HorizonTuning
from ttempc.reference import Reference, ReferenceSample
from ttempc.robust import Nominal, RobustGains, RobustLaw
from ttempc.types import (
    Command,
    Controller,
    ControlStep,
    Diagnostics,
    Estimate,
    FloatArray,
    Input,
    SolverReport,
    State,
)
from ttempc.vehicle import Vehicle


@dataclass(frozen=True, slots=True)
class Actions:
    """The actions of one tick in the coordinates of the model that made them, (3,) each."""

    feedback: FloatArray  # -u_b
    robust: FloatArray  # u_m
    modelling_error: FloatArray | None = None  # (4,) z_m [m]
    predicted_path: FloatArray | None = None  # (Np, 4) [m], map frame
    solver: SolverReport | None = None
    fallback: str = ""


class FeedforwardOnly:
    """The feedback law that does nothing."""

    def step(self, k: int, error: FloatArray) -> Actions:
        """Return no feedback and no robust action."""
        return Actions(np.zeros(3), np.zeros(3))


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
        a, b = zero_order_hold(*linearise(grid, vehicle, equations), period_s)
        # No period starts at the last sample: it is only predicted.
        horizon = CondensedHorizon(a[:-1], b[:-1], tuning, period_s)
        self._mpc = LinearMpc(horizon)
        self._nominal = Nominal(a, b, equations.nominal)
        self._robust = RobustLaw(gains, equations.robust_sign, period_s) if gains else None
        # Predicted path = reference - predicted error turned into the map frame, to first order.
        ahead = 1 + np.arange(horizon.ticks)[:, None] + np.arange(tuning.horizon)  # (ticks, Np)
        to_map = _rotations(grid.state[:, State.PSI_T], grid.state[:, State.PSI_I])[ahead]
        by_plan = -to_map @ horizon.prediction[:, :, POSITIONS]  # (ticks, Np, 4, n + m + m Nc)
        self._path_by_plan = by_plan.reshape(horizon.ticks, 4 * tuning.horizon, -1)
        self._reference_path = np.concatenate([grid.state[:, :2], grid.trailer_xy], axis=1)[ahead]

    def step(self, k: int, error: FloatArray) -> Actions:
        """Return the actions of tick `k` for the tracking error z_e (7,)."""
        nominal = self._nominal.at(k, error)
        mpc_state = self._nominal.mpc_state(nominal, error)
        feedback = self._mpc.step(k, mpc_state)
        self._nominal.advance(k, mpc_state, feedback.input)
        u_m, z_m = np.zeros(3), None
        if self._robust:
            u_m, z_m = self._robust.step(k, nominal, error)
        path = self._reference_path[k]
        return Actions(
            feedback=-feedback.input,
            robust=u_m,
            modelling_error=z_m,
            predicted_path=path + (self._path_by_plan[k] @ feedback.plan).reshape(path.shape),
            solver=feedback.report,
            fallback=feedback.fallback,
        )


class TrackingController:
    """Feedforward along a precomputed reference, a feedback law, and the vehicle's limits.

    The vehicle is taken to start on the reference with its inputs. Where the estimate is not
    finite the last command is held; beyond the reference's end the last tick's reference is
    tracked.
    """

    def __init__(
        self,
        grid: ReferenceSample,
        feedforward: FloatArray,
        feedback: PaperFeedback | FeedforwardOnly,
        limits: CommandLimits,
        ticks: int,
        equations: PaperEquations,
    ) -> None:
        self._state = grid.state
        self._trailer_xy = grid.trailer_xy
        self._hitch_angle = grid.hitch_angle
        self._feedforward = feedforward  # (ticks, 3) delta_t, lambda, HP in the paper's unit
        self._feedback = feedback
        self._limits = limits
        self._ticks = ticks
        self._measured_hitch = equations.hitch_angle == "measured"
        self._scale = np.array([1.0, 1.0, 1.0 / equations.hp_full_scale])
        self._previous = limits.clamp(grid.inputs[0])

    def step(self, estimate: Estimate, k: int) -> ControlStep:
        """Return the command for the period that starts at tick `k`."""
        k = min(k, self._ticks - 1)
        known = [*estimate.state.tolist(), *estimate.trailer_xy.tolist(), estimate.hitch_angle]
        if not math.isfinite(sum(known)):
            return self._hold("estimate not finite: previous command held")
        error = tracking_error(
            estimate.state, estimate.trailer_xy, self._state[k], self._trailer_xy[k]
        )
        actions = self._feedback.step(k, error)
        feedforward = self._feedforward[k] * self._scale
        beta = estimate.hitch_angle if self._measured_hitch else self._hitch_angle[k]
        feedforward[Input.DELTA_I] -= beta  # delta^i = lambda - beta
        feedback, robust = actions.feedback * self._scale, actions.robust * self._scale
        command, limited = self._limits.apply(feedforward + feedback + robust, self._previous)
        self._previous = command
        return ControlStep(
            Command(*command.tolist()),
            Diagnostics(
                feedforward=feedforward,
                feedback=feedback,
                robust=robust,
                limited=limited,
                tracking_error=error,
                modelling_error=actions.modelling_error,
                predicted_path=actions.predicted_path,
                solver=actions.solver,
                fallback=actions.fallback,
            ),
        )

    def _hold(self, why: str) -> ControlStep:
        """Return the previous command again, booked as feedforward."""
        return ControlStep(
            Command(*self._previous.tolist()),
            Diagnostics(
                feedforward=self._previous,
                feedback=np.zeros(3),
                robust=np.zeros(3),
                limited=np.zeros(3, dtype=np.bool_),
                fallback=why,
            ),
        )


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
    feedback = PaperFeedback(grid, vehicle, period_s, equations, tuning, gains)
    limits = CommandLimits.of(vehicle, period_s)
    return TrackingController(grid, feedforward, feedback, limits, ticks, equations)


def feedforward_controller(
    vehicle: Vehicle, reference: Reference, period_s: float
) -> TrackingController:
    """Compose the exact feedforward alone: what the reference asks for, whatever happens."""
    grid = reference.on_grid(period_s)
    ticks = len(grid.time_s)
    equations = PaperEquations(feedforward="geometry", hitch_angle="reference")
    feedforward = exact_feedforward(reference, ticks, period_s)
    feedforward[:, Input.DELTA_I] += grid.hitch_angle
    limits = CommandLimits.of(vehicle, period_s)
    return TrackingController(grid, feedforward, FeedforwardOnly(), limits, ticks, equations)


def printed_sign_controller(
    vehicle: Vehicle, reference: Reference, period_s: float
) -> TrackingController:
    """Compose the paper's controller with the robust action's sign as printed.

    It reads the nominal state as the tube's own. In the one-step reading the modelling error has
    no memory of where the vehicle is, and its sign decides next to nothing.
    """
    equations = PaperEquations(robust_sign=1, nominal="tube")
    return paper_controller(vehicle, reference, period_s, equations)


@dataclass(frozen=True, slots=True)
class Composition:
    """A controller that users can ask for by name."""

    about: str
    make: Callable[[Vehicle, Reference, float], Controller]


CONTROLLERS = MappingProxyType(
    {
        "paper": Composition(
            "the paper's equations as printed, errata 4, 6 and 7 corrected", paper_controller
        ),
        "paper-printed-sign": Composition(
            "the same with erratum 6 as printed: the vehicle is lost", printed_sign_controller
        ),
        "feedforward": Composition(
            "inputs of the exact reference geometry, no feedback", feedforward_controller
        ),
    }
)


def make_controller(
    name: str, vehicle: Vehicle, reference: Reference, period_s: float
) -> Controller:
    """Return the controller called `name` for a command every `period_s`.

    Raises:
        UnknownController: with the names that exist.
    """
    if name not in CONTROLLERS:
        raise UnknownController(
            f"controller {name!r} does not exist; allowed are {', '.join(sorted(CONTROLLERS))}"
        )
    return CONTROLLERS[name].make(vehicle, reference, period_s)


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


def _rotations(psi_t: FloatArray, psi_i: FloatArray) -> FloatArray:
    """Return the matrices that turn (x_t, y_t, x_i, y_i) errors into the map frame, (N, 4, 4)."""
    rotation = np.zeros((len(psi_t), 4, 4))
    for first, angle in ((0, psi_t), (2, psi_i)):
        rotation[:, first, first] = rotation[:, first + 1, first + 1] = np.cos(angle)
        rotation[:, first + 1, first] = np.sin(angle)
        rotation[:, first, first + 1] = -np.sin(angle)
    return rotation
