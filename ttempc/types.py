"""Data types and protocols of the control library: measurements, estimates, commands."""

import copy
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from .sensors import ReceiverFlag
from .sensors import Sensor as Sensor

FloatArray = NDArray[np.float64]


class Immutable:
    """An object that does not change once it is made: copies of what holds it share it."""

    def __deepcopy__(self, memo: object) -> Self:
        return self


class State(IntEnum):
    """Index of each entry of the minimal articulated state vector.

    The tractor point is the centre of the rear axle; the trailer point follows from the two yaw
    angles and the steering angle of the trailer (`ttempc.models.kinematics.trailer_point`).
    """

    X = 0  # [m] tractor point, map frame
    Y = 1  # [m]
    PSI_T = 2  # [rad] yaw of the tractor
    PSI_I = 3  # [rad] yaw of the trailer
    DELTA_T = 4  # [rad] steering angle of the front wheels
    DELTA_I = 5  # [rad] steering angle of the trailer at RJ2, psi_d - psi_i
    V = 6  # [m/s] forward speed of the tractor point, negative in reverse


class Input(IntEnum):
    """Index of each entry of an input vector (delta_t, delta_i, hp)."""

    DELTA_T = 0  # [rad]
    DELTA_I = 1  # [rad]
    HP = 2  # hydrostat position, fraction 0..1; -1..0 in reverse


class Disturbance(IntEnum):
    """Index of each entry of a disturbance that acts on the vehicle in addition to its inputs."""

    SLIP_T = 0  # [rad] side slip of the rear axle, which moves along psi_t + slip
    SLIP_I = 1  # [rad] side slip of the trailer axle
    STEERING = 2  # [rad] added to the measured front steering: bias, slip of the front axle
    DRIVE = 3  # [m/s^2] added to the acceleration by the hydrostat: soil drag, slope
    WHEEL = 4  # wheel slip 1 - v / v_w, v_w: circumferential speed of the driven wheels


class MapDisturbance(IntEnum):
    """Index of each entry of a map disturbance: the part of a `Disturbance` that a slope causes.

    It stays with the field where the vehicle turns: with unit vectors e(psi) along a heading and
    n(psi) to its left, the axles slip by n(psi)'(SIDE_X, SIDE_Y), the driven wheels by
    e(psi)'(CLIMB_X, CLIMB_Y); in reverse by as much with the other sign.
    """

    SIDE_X = 0  # [rad] east
    SIDE_Y = 1  # [rad] north
    CLIMB_X = 2  # wheel slip of a vehicle that drives east
    CLIMB_Y = 3  # wheel slip of a vehicle that drives north


_ENOUGH_SATELLITES: Final = 5  # a fix of four has no redundancy: it cannot check itself


@dataclass(frozen=True, slots=True)
class ReceiverStatus:
    """What a receiver says of itself beside `Measurement.status`; each field is optional.

    Examples:
        >>> ReceiverStatus(spoofed=True, correction_age_s=1.2).value
        (2.0, 1.2, 0.0)
    """

    dead_reckoning: bool = False  # the position is computed from other sensors, not measured
    spoofed: bool = False
    jammed: bool = False
    satellites: int | None = None  # used in the solution
    correction_age_s: float = 0.0  # of the corrections [s]; 0: not known
    protection_m: float = 0.0  # horizontal protection level [m]; 0: not known

    @property
    def value(self) -> tuple[float, float, float]:
        """Return the entries of a sample of `Sensor.RECEIVER_TRACTOR`: `ReceiverFlag`, [s], [m]."""
        flags = ReceiverFlag(0)
        if self.dead_reckoning:
            flags |= ReceiverFlag.DEAD_RECKONING
        if self.spoofed:
            flags |= ReceiverFlag.SPOOFED
        if self.jammed:
            flags |= ReceiverFlag.JAMMED
        if self.satellites is not None and self.satellites < _ENOUGH_SATELLITES:
            flags |= ReceiverFlag.FEW_SATELLITES
        return float(flags), self.correction_age_s, self.protection_m


@dataclass(frozen=True, slots=True)
class Measurement:
    """One sample of one sensor.

    Examples:
        >>> Measurement(time_s=1763775600.2, sensor=Sensor.GNSS_TRACTOR, value=(12.31, -4.02)).value
        (12.31, -4.02)
    """

    time_s: float  # time at which the sample was taken
    sensor: Sensor
    value: tuple[float, ...]  # see `Sensor` for meaning, length and unit
    status: int = 0  # of a position, as the receiver says: 1 fixed, 2 float; 0 not known
    receiver: ReceiverStatus | None = None  # of a position, what else the receiver says


class Innovation(NamedTuple):
    """Difference of one sample from its prediction, normalised by its covariance."""

    sensor: Sensor
    normalised_squared: float  # nu' S^-1 nu, chi-square with `dimension` degrees of freedom
    dimension: int
    accepted: bool = True  # False where the gate rejected the sample
    whitened: tuple[float, ...] = ()  # L^-1 nu with S = L L'; empty where it is not known
    log_determinant: float = math.nan  # log det S, NaN where it is not known


@dataclass(frozen=True, slots=True)
class Estimate:
    """Estimated state of the vehicle at one control tick."""

    time_s: float  # at which the state is estimated
    state: FloatArray  # (7,) see `State`
    covariance: FloatArray  # (7, 7) of `state`; zeros where the truth is handed through
    trailer_xy: FloatArray  # (2,) [m] trailer point, map frame
    hitch_angle: float  # [rad] beta = psi_t - psi_d
    disturbance: FloatArray = field(default_factory=lambda: np.zeros(len(Disturbance)))  # (5,)
    innovations: Sequence[Innovation] = ()  # of the samples that came in for this tick
    # (4,) see `MapDisturbance`: the part of `disturbance` that stays with the field
    map_disturbance: FloatArray = field(default_factory=lambda: np.zeros(len(MapDisturbance)))
    # (3,) mu, kappa, eta of a model with slip factors; None where
    # the estimator has none
    slip_factors: FloatArray | None = None
    # (3,) learnt factors of the noise variances, see `ttempc.estimation.noise.NoiseScale`; None
    # where the estimator learns none
    noise_factors: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Command:
    """Command to the vehicle for one control period.

    Examples:
        >>> Command(delta_t=0.1, delta_i=-0.05, hp=0.7).as_array()
        array([ 0.1 , -0.05,  0.7 ])
    """

    delta_t: float  # [rad] front steering
    delta_i: float  # [rad] trailer steering at RJ2
    hp: float  # hydrostat position, fraction 0..1; -1..0 in reverse

    def as_array(self) -> FloatArray:
        """Return the command as an (3,) array in the order of `Input`."""
        return np.array([self.delta_t, self.delta_i, self.hp], dtype=float)


SOLVER_STATUSES: Final = (
    "closed form",  # no bound is active at the unconstrained minimiser: no solver was needed
    "solved",
    "solved with soft bounds",
    "solved outside its bounds",
    "max_iter_reached",
    "primal_infeasible",
    "dual_infeasible",
    "numerics",
    "input not finite",
    "hessian not convex",
    "other",
)
"""Words of `SolverReport.status`; the log has the index, the last one for any other word."""


@dataclass(frozen=True, slots=True)
class SolverReport:
    """Result of one QP solve, as reported by the solver."""

    status: str  # one of `SOLVER_STATUSES`, or the solver's own word
    accepted: bool  # solved, finite and within its bounds
    iterations: int
    solve_time_s: float  # as measured by the solver itself; 0 where it was not needed
    primal_residual: float  # NaN where the solver reports none
    dual_residual: float  # NaN where the solver reports none

    @property
    def code(self) -> int:
        """Return the index of the status in `SOLVER_STATUSES`."""
        known = self.status in SOLVER_STATUSES
        return SOLVER_STATUSES.index(self.status if known else "other")


@dataclass(frozen=True, slots=True)
class TubeReport:
    """Tube about the reference at one tick, and the estimate's containment in it.

    Errors are z_e = T (z_r - z) of the minimal state, in the order of `State`, then x and y of the
    trailer point; positions in the frames of the reference [m].
    """

    inside: bool  # whether the deviation of the estimate from the nominal state lies in its set
    margin: float  # 1 on the nominal state, 0 on the boundary of the set, below 0 outside
    nominal: FloatArray  # (9,) error of the nominal state
    half_width: FloatArray  # (9,) within which the true error lies about the nominal one


def _no_action() -> FloatArray:
    return np.full(len(Input), np.nan)


@dataclass(frozen=True, slots=True)
class Diagnostics:
    """Explanation of a command; every field is optional. Actions are in the order of `Input`.

    A controller that does not split its command into actions leaves them out; they are NaN then.
    `total` is the sum of the three actions before the vehicle's limits; the paper's input lambda
    is expressed as delta_i = lambda - beta, with the measured hitch angle beta booked under the
    feedforward action as in the paper's figure of the control signals.
    """

    feedforward: FloatArray = field(default_factory=_no_action)  # (3,) u_f
    # (3,) contribution of the feedback, that is -u_b in the paper's terms
    feedback: FloatArray = field(default_factory=_no_action)
    robust: FloatArray = field(default_factory=_no_action)  # (3,) u_m
    # (3,) where a limit of the vehicle changed the total, or the law ended at one by itself
    limited: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(len(Input), np.bool_))
    # (7,) z_e: x, y, psi of tractor, of trailer, speed; the supervisor fills it in
    tracking_error: FloatArray | None = None
    modelling_error: FloatArray | None = None  # (4,) z_m: x, y of tractor, of trailer [m]
    predicted_path: FloatArray | None = None  # (N, 4) predicted x_t, y_t, x_i, y_i [m], map frame
    solver: SolverReport | None = None  # None where the controller solves no QP
    fallback: str = ""  # reason why another law than the controller's own acted, else empty
    stopping: bool = False  # whether the supervisor stops the vehicle, or holds it at rest
    tube: TubeReport | None = None  # None for a controller without a tube
    # Whether the plan leaves the corridor of the reference, or its bound of the hitch angle
    leaves_corridor: bool = False
    # Model parameters that were learnt and act from this tick on, in words
    learnt: tuple[str, ...] = ()

    @property
    def total(self) -> FloatArray:
        """Return the sum of the three actions, (3,)."""
        return self.feedforward + self.feedback + self.robust


@dataclass(frozen=True, slots=True)
class ControlStep:
    """A command with its diagnostics."""

    command: Command
    diagnostics: Diagnostics = field(default_factory=Diagnostics, repr=False)


class Controller(ABC):
    """Turns an estimate into a command once every control period.

    A controller owns its reference and its memory; it never sees the plant. Tick k belongs to
    time k * period of the reference. It waits where the supervisor slows the vehicle: then k
    repeats. It leaves a tick out where the vehicle does not slow down and runs away from it.

    Only `step` must be written. A guidance also takes an object that has `step` and derives from
    nothing; of the other methods it calls those that the object has.
    """

    space_based: bool = False
    """Whether it may follow the reference at the place nearest to the tractor point.

    Supervision, log and statistics then compare the vehicle with that place, not with the
    reference of the present time."""

    @abstractmethod
    def step(self, estimate: Estimate, k: int) -> ControlStep | Command:
        """Return the command for the period that starts at tick k, with or without diagnostics."""

    def prepare(self, k: int) -> None:
        """Do work of tick `k` that needs no samples; it must change no later result.

        Between two control periods the caches go cold, and a step that takes 0.1 ms in a row takes
        several times that. `prepare` is called just before the samples are read.
        """
        return

    def resume(self, previous: object) -> None:
        """Continue where `previous`, the controller for other model parameters, has stopped."""
        return

    def warm_up(self) -> None:
        """Run through the code of every later call; it must change no later result."""
        return

    def memory(self) -> object:
        """Return what the controller remembers from tick to tick, by default all attributes."""
        return vars(self)

    def restore(self, memory: object) -> None:
        """Remember what `memory` returned, of this controller or of a copy of it."""
        vars(self).update(copy.deepcopy(memory))  # pyright: ignore[reportCallIssue, reportArgumentType] - attributes


class Estimator(ABC):
    """Turns measurements into an estimate once every control period.

    Only `update` must be written. A guidance also takes an object that has `update` and derives
    from nothing.
    """

    @abstractmethod
    def update(
        self, time_s: float, measurements: Sequence[Measurement], command: Command | None
    ) -> Estimate:
        """Return the estimate at `time_s`.

        `measurements` are all samples that came in since the previous update, in the order in
        which they came: a late one bears the time at which it was taken. Samples of sensors
        that an estimator has no use for are no error. `command` is what drove the vehicle in
        that time, None before the first command.
        """

    def warm_up(self) -> None:
        """Run through the code of every later call; it must change no later result."""
        return

    def memory(self) -> object:
        """Return what the estimator remembers from tick to tick, by default all attributes."""
        return vars(self)

    def restore(self, memory: object) -> None:
        """Remember what `memory` returned, of this estimator or of a copy of it."""
        vars(self).update(copy.deepcopy(memory))  # pyright: ignore[reportCallIssue, reportArgumentType] - attributes


class VehicleGuidance(Protocol):
    """Estimation and control of a vehicle in two halves: see `ttempc.Guidance`."""

    @property
    def control_step(self) -> ControlStep: ...
    @property
    def reference_tick(self) -> int: ...
    @property
    def estimate_record(self) -> FloatArray: ...
    @property
    def tick_record(self) -> FloatArray: ...
    @property
    def diagnostics(self) -> Diagnostics: ...
    @property
    def learnt(self) -> tuple[str, ...]: ...
    @property
    def waits_for_estimate(self) -> bool: ...
    @property
    def stopping(self) -> bool: ...
    @property
    def solve_time_s(self) -> float: ...
    def predicted_path(self) -> FloatArray | None: ...
    def resume(self) -> None: ...
    def warm_up(self) -> None: ...
    def wait(self) -> None: ...
    def prepare(self) -> None: ...
    def update(
        self, time_s: float, measurements: Sequence[Measurement] | FloatArray
    ) -> Estimate: ...
    def step(self) -> Command: ...
