"""Published NMPC of the paper's vehicle: printed model, slip factors, path-parametrised targets.

Kayacan, Kayacan, Ramon and Saeys (2015), IEEE Transactions on Control Systems Technology 23(1),
cited by the paper with its mean errors. From the paper: the reference by place ("space-based"),
lambda as an input, delta_i = lambda - beta, slip factors, moving-horizon estimator. From memory:
horizon of 3 s, one Gauss-Newton iteration a period, one desired point at a fixed distance ahead of
the nearest point (1.6 m), bounds of the steering. All else is assumed, and an option.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Final, Literal, get_args

import numpy as np

from ..errors import InvalidReference, check_choice, check_positive
from ..laws.tracking_controller import FeedbackLaw, TrackingController
from ..mpc.articulated_error import rotation
from ..mpc.condensing import StageBounds
from ..mpc.lmpc import HorizonTuning, Solver
from ..reference.path import Projection
from ..reference.reference import Reference
from ..types import Diagnostics, Estimate, FloatArray, Input
from ..vehicle import CommandLimits, Vehicle
from .gauss_newton import GaussNewton
from .nmpc_model import Task, new_motion
from .printed_model import OUTPUTS, printed_model

Parametrisation = Literal["path", "time"]

_M: Final = len(Input)
_RUN_ON_M: Final = 20.0  # of reference beyond the end of the path, for a vehicle that arrives early
_NO_SLIP: Final = np.ones(3)


@dataclass(frozen=True)
class NmpcPathOptions(HorizonTuning):
    """Options of `nmpc-path`.

    Outputs are x, y of the tractor, x, y of the trailer [m] and the speed of the rims [m/s]. Bounds
    hold for delta_t, delta_i and hp themselves, step weights for the changes of delta_t, lambda
    and hp from period to period.

    Raises:
        InvalidTuning: a value is out of its range.
    """

    outputs: ClassVar[int] = OUTPUTS

    horizon: int = 15
    moves: int = 15
    output_weight: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0, 1.0)
    input_bound: tuple[float, ...] = (math.radians(35.0), math.radians(20.0), 1.0)
    look_ahead_m: float = 1.6  # from the nearest point of the path to the target
    # What the targets follow: the place on the path, or the reference at the times of the horizon
    parametrised_by: Parametrisation = "path"
    solver: Solver = "daqp"  # of the QP: the faster one, or "piqp"

    def __post_init__(self) -> None:
        HorizonTuning.__post_init__(self)
        check_positive("look_ahead_m", self.look_ahead_m, zero=True)
        check_choice("parametrised_by", self.parametrised_by, get_args(Parametrisation))


class Targets:
    """Targets of a horizon: x, y, psi of tractor and trailer, speed of the rims."""

    def __init__(self, reference: Reference, period_s: float, options: NmpcPathOptions) -> None:
        speed = reference.speed.top_speed
        beyond = options.horizon + math.ceil((_RUN_ON_M + options.look_ahead_m) / speed / period_s)
        grid = reference.on_grid(period_s, beyond=beyond)
        x, y, psi_t, psi_i, _, _, v = grid.state.T
        self._table = np.stack([x, y, psi_t, *grid.trailer_xy.T, psi_i, v], axis=1)  # (N, 7)
        self._distance = grid.distance_m
        self._ticks = np.arange(len(v), dtype=float)
        self.projection = Projection(grid.state[:, :2])
        self._options = options

    def at(self, k: int, x: float, y: float) -> FloatArray:
        """Return the targets (Np, 7) at tick `k` for a tractor point [m]."""
        horizon = self._options.horizon
        if self._options.parametrised_by == "time":
            return self._table[k + 1 : k + 1 + horizon]
        nearest = self.projection.place(x, y)
        distance = np.interp(nearest, self._ticks, self._distance) + self._options.look_ahead_m
        place = float(np.interp(distance, self._distance, self._ticks))
        target = [np.interp(place, self._ticks, column) for column in self._table.T]
        return np.tile(target, (horizon, 1))


class PrintedFeedback(FeedbackLaw):
    """The NMPC as a feedback law: its action is the whole input (delta_t, lambda, hp).

    Where the QP has no accepted solution, the previous input is held.
    """

    def __init__(self, reference: Reference, period_s: float, options: NmpcPathOptions) -> None:
        self._options = options
        self._targets = Targets(reference, period_s, options)
        model = printed_model(reference.vehicle, period_s)
        limits = CommandLimits.of(reference.vehicle, period_s)
        bound = np.array(options.input_bound)
        self._lower = np.maximum(-bound, limits.lower)
        self._upper = np.minimum(bound, limits.upper)
        self._step = np.minimum(np.array(options.input_rate) * period_s, limits.step)
        # The bounds of a tick are written into those of the problem, since they move with beta.
        none = np.zeros((1, _M * options.moves))
        bounds = StageBounds(none, none, none, none)
        self._solver = GaussNewton((model,), bounds, options, iterations=1)
        self._motion = new_motion(model, options.horizon)
        self._plan = np.zeros((options.moves, _M))  # the last plan, Delta u_e
        self._lambda: float | None = None  # of the period before

    def resume(self, previous: object) -> None:
        """Keep the place on the path and the plan, see `ttempc.types.Controller.resume`."""
        if isinstance(previous, PrintedFeedback):  # the tractor's path is the same
            self._targets.projection = previous._targets.projection
            self._plan = previous._plan
            self._lambda = previous._lambda

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Diagnostics:
        """Return the actions of tick `k`, see `FeedbackLaw`."""
        options = self._options
        beta = estimate.hitch_angle
        x, y, psi_t, psi_i, _, _, ground = estimate.state.tolist()
        factors = _NO_SLIP if estimate.slip_factors is None else estimate.slip_factors
        targets = self._targets.at(k, x, y)

        # The solver's unknowns are steps of u_e = u_r - u; without a feedforward u_e = -u.
        previous = sent.copy()
        previous[Input.DELTA_I] += beta
        if self._lambda is not None:
            previous[Input.DELTA_I] = self._lambda
        lower = -self._upper
        upper = -self._lower
        lower[Input.DELTA_I] -= beta
        upper[Input.DELTA_I] -= beta
        bounds = np.stack([lower, upper, -self._step, self._step])
        self._solver.first.bounds[0] = np.tile(bounds, options.moves)
        task = Task(
            k=0,
            state=np.array([x, y, psi_t, *estimate.trailer_xy, psi_i, ground / factors[0]]),
            disturbance=np.tile([*factors, beta, 0.0], (options.horizon, 1)),
            poses=targets,
            feedforward=np.zeros((options.horizon, _M)),
            previous=-previous,
            last_plan=self._plan,
            motion=self._motion,
        )
        plan = self._solver.minimise(task)
        self._plan = plan.steps
        self._lambda = -float(plan.inputs[Input.DELTA_I])

        along = plan.errors[:, :4]
        for body, psi in ((slice(0, 2), targets[:, 2]), (slice(2, 4), targets[:, 5])):
            along[:, body] = np.einsum("nij,nj->ni", rotation(psi), along[:, body])
        return Diagnostics(
            feedback=-plan.inputs,
            robust=np.zeros(_M),
            predicted_path=targets[:, [0, 1, 3, 4]] - along,
            solver=self._solver.report,
            fallback=self._solver.fallback,
        )

    def prepare(self, k: int) -> None:
        """Get ready for tick `k`, see `FeedbackLaw`."""
        self._solver.prepare()


def nmpc_path_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    options: NmpcPathOptions = NmpcPathOptions(),
) -> TrackingController:
    """Compose the NMPC on the printed model.

    Raises:
        InvalidReference: the reference is driven in reverse.
        MissingPackage: the package of the QP solver is not installed.
    """
    if vehicle.reverse:
        raise InvalidReference("nmpc-path: drives forward only, the reference is in reverse")
    grid = reference.on_grid(period_s)
    return TrackingController(
        grid,
        np.zeros((len(grid.time_s), _M)),
        PrintedFeedback(reference, period_s, options),
        CommandLimits.of(vehicle, period_s),
        measured_hitch=-1.0,
        space_based=options.parametrised_by == "path",
    )
