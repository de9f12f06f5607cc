"""NMPC on the printed model with a space-based reference.

The controller that was published for the paper's vehicle: Kayacan, Kayacan, Ramon and Saeys (2015),
IEEE Transactions on Control Systems Technology 23(1), cited by the paper with its mean errors. From
the paper: the space-based reference, lambda as an input, delta_i = lambda - beta, slip factors,
moving-horizon estimator. From memory: horizon of 3 s, one Gauss-Newton iteration a period, one
desired point at a fixed distance ahead of the nearest point (1.6 m), bounds of the steering. All
else is assumed, and an option.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ttempc.baselines.nmpc import GaussNewton
from ttempc.baselines.nmpc_model import Task
from ttempc.errors import InvalidReference, check_positive
from ttempc.guidance.controllers import parse_options
from ttempc.laws.tracking_controller import FeedbackLaw, TrackingController
from ttempc.mpc.articulated_error import rotation
from ttempc.mpc.condensing import StageBounds
from ttempc.mpc.lmpc import HorizonTuning
from ttempc.reference.path import Projection
from ttempc.reference.reference import Reference
from ttempc.types import Diagnostics, Estimate, FloatArray, Input
from ttempc.vehicle import CommandLimits, Vehicle

from .model import PrintedModel

_M = len(Input)
_RUN_ON_M = 20.0  # of reference beyond the end of the path, for a vehicle that arrives early
_NO_SLIP = np.ones(3)


@dataclass(frozen=True)
class PrintedNmpcOptions(HorizonTuning):
    """Options of `controller`; every field is a key that a scenario may set.

    Outputs are x, y of the tractor, x, y of the trailer [m] and the speed of the rims [m/s]. Bounds
    hold for delta_t, delta_i and hp themselves, step weights for the changes of delta_t, lambda
    and hp from period to period.

    Raises:
        InvalidTuning: a value is out of its range.
    """

    outputs: ClassVar[int] = 5

    horizon: int = 15
    moves: int = 15
    output_weight: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0, 1.0)
    input_bound: tuple[float, ...] = (math.radians(35.0), math.radians(20.0), 1.0)
    look_ahead_m: float = 1.6  # from the nearest point of the path to the target

    def __post_init__(self) -> None:
        HorizonTuning.__post_init__(self)
        check_positive("look_ahead_m", self.look_ahead_m, zero=True)


class SpaceBasedTargets:
    """Targets of a horizon that starts at the place on the path nearest to the tractor point."""

    def __init__(self, reference: Reference, period_s: float, options: PrintedNmpcOptions) -> None:
        speed = reference.speed.top_speed
        beyond = options.horizon + math.ceil((_RUN_ON_M + options.look_ahead_m) / speed / period_s)
        grid = reference.on_grid(period_s, beyond=beyond)
        x, y, psi_t, psi_i, _, _, v = grid.state.T
        self._table = np.stack([x, y, psi_t, *grid.trailer_xy.T, psi_i, v])  # (7, N)
        self._distance = grid.distance_m
        self._ticks = np.arange(len(v), dtype=float)
        self._projection = Projection(grid.state[:, :2])
        self._look_ahead_m, self._horizon = options.look_ahead_m, options.horizon

    def at(self, x: float, y: float) -> FloatArray:
        """Return the targets (Np, 7) for a tractor point: see `PrintedModel`."""
        place = self._projection.place(x, y)
        distance = np.interp(place, self._ticks, self._distance) + self._look_ahead_m
        place = float(np.interp(distance, self._distance, self._ticks))
        target = [np.interp(place, self._ticks, column) for column in self._table]
        return np.tile(target, (self._horizon, 1))


class PrintedFeedback(FeedbackLaw):
    """The NMPC as a feedback law: its action is the whole input (delta_t, lambda, hp).

    Where the QP has no accepted solution, the previous input is held.
    """

    def __init__(self, reference: Reference, period_s: float, options: PrintedNmpcOptions) -> None:
        self._options = options
        self._targets = SpaceBasedTargets(reference, period_s, options)
        model = PrintedModel(reference.vehicle, period_s)
        own: Any = model  # it has the shape of an `ArticulatedModel`
        self._solver = GaussNewton(own, options, iterations=1)
        limits = CommandLimits.of(reference.vehicle, period_s)
        bound = np.array(options.input_bound)
        self._lower, self._upper = np.maximum(-bound, limits.lower), np.minimum(bound, limits.upper)
        self._step = np.minimum(np.array(options.input_rate) * period_s, limits.step)
        self._plan = np.zeros((options.moves, _M))  # the last plan, Delta u_e
        self._lambda: float | None = None  # of the period before

    def resume(self, previous: object) -> None:
        """Keep the place on the path and the plan, see `ttempc.types.Resuming`."""
        if isinstance(previous, PrintedFeedback):  # the tractor's path is the same
            self._targets._projection = previous._targets._projection
            self._plan, self._lambda = previous._plan, previous._lambda

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Diagnostics:
        """Return the actions of tick `k`, see `FeedbackLaw`."""
        options, beta = self._options, estimate.hitch_angle
        x, y, psi_t, psi_i, _, _, ground = estimate.state.tolist()
        factors = _NO_SLIP if estimate.slip_factors is None else estimate.slip_factors
        targets = self._targets.at(x, y)
        previous = sent.copy()
        previous[Input.DELTA_I] += beta
        if self._lambda is not None:
            previous[Input.DELTA_I] = self._lambda
        lower, upper = self._lower.copy(), self._upper.copy()
        lower[Input.DELTA_I] += beta
        upper[Input.DELTA_I] += beta
        # The solver's unknowns are steps of u_e = u_r - u; without a feedforward u_e = -u.
        rows = -upper, -lower, -self._step, self._step
        bounds = StageBounds(*(np.tile(row, options.moves) for row in rows))
        held = bounds.clamp_previous(-previous)
        task = Task(
            state=np.array([x, y, psi_t, *estimate.trailer_xy, psi_i, ground / factors[0]]),
            disturbance=np.tile([*factors, beta, 0.0], (options.horizon, 1)),
            poses=targets,
            feedforward=np.zeros((options.horizon, _M)),
            previous=held,
            bounds=bounds,
        )
        guess = np.vstack([self._plan[1:], np.zeros(_M)])
        plan = self._solver.minimise(task, guess.reshape(-1))
        self._plan = np.zeros_like(guess) if plan.steps is None else plan.steps.reshape(-1, _M)
        inputs = -bounds.clamp(held + self._plan[0])
        self._lambda = float(inputs[Input.DELTA_I])
        along = plan.errors[:, :4]
        for body, psi in ((slice(0, 2), targets[:, 2]), (slice(2, 4), targets[:, 5])):
            along[:, body] = np.einsum("nij,nj->ni", rotation(psi), along[:, body])
        return Diagnostics(
            feedback=inputs,
            robust=np.zeros(_M),
            predicted_path=targets[:, [0, 1, 3, 4]] - along,
            solver=plan.report,
            fallback=plan.fallback,
        )

    def prepare(self, k: int) -> None:
        """Get ready for tick `k`, see `FeedbackLaw`."""
        self._solver.prepare()


def controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    **options: object,
) -> TrackingController:
    """Compose the NMPC on the printed model.

    Args:
        vehicle: model parameters.
        reference: what to follow.
        period_s: control period [s].
        options: of `PrintedNmpcOptions`.

    Raises:
        InvalidReference: the reference is driven in reverse.
        InvalidTuning: an option is unknown or out of its range.
        MissingPackage: the package of the QP solver is not installed.
    """
    if vehicle.reverse:
        raise InvalidReference("kayacan.nmpc: drives forward only, the reference is in reverse")
    chosen: PrintedNmpcOptions = parse_options(PrintedNmpcOptions, options)
    grid = reference.on_grid(period_s)
    return TrackingController(
        grid,
        np.zeros((len(grid.time_s), _M)),
        PrintedFeedback(reference, period_s, chosen),
        CommandLimits.of(vehicle, period_s),
        measured_hitch=-1.0,
        space_based=True,
    )
