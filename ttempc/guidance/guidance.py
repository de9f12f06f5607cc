"""Guidance of a vehicle along a reference: estimator, controller, supervisor, command limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from ..errors import EstimatorFailed, GuidanceFailed, InvalidReference, InvalidTime
from ..estimation.noise import SensorNoise
from ..reference.path import Path
from ..reference.posture import check_drivable
from ..reference.reference import ConstantSpeed, Reference, check_pace
from ..tube.reference_tube import TubeDesign
from ..types import (
    Command,
    Controller,
    ControlStep,
    Diagnostics,
    Estimate,
    Estimator,
    Measurement,
    WarmingUp,
)
from ..vehicle import Vehicle
from .controllers import make_controller
from .dead_time import DeadTimeCompensation, compensated
from .estimators import EstimatorFactory, estimator_factory
from .supervisor import SafetyLimits, Supervisor

ControllerFactory = Callable[..., Controller]
"""Makes a controller from vehicle, reference and control period [s], options as keywords."""


class Guidance:
    """Drives a vehicle along a reference, one control period after the other.

    Every period of `period_s`, call `update` with the samples that arrived since, then `step`:

        >>> from ttempc import Vehicle, figure_eight
        >>> guidance = Guidance(Vehicle(), figure_eight())
        >>> guidance.warm_up()
        >>> estimate = guidance.update(1763775600.0, [])  # time [s], samples since the last call
        >>> guidance.step().delta_t, guidance.diagnostics.fallback
        (0.0, 'estimate not finite: command held')

    `update` runs the estimator. `step` checks the estimate against the reference, asks the
    controller, and limits its command. On a bad estimate or a controller far from the reference it
    holds the command, slows down or stops (see `Supervisor`); `diagnostics.fallback` gives the
    reason.

    Time stamps are seconds on any one clock, of the Unix epoch for example. The first `update`
    defines the start of the reference. Control ticks are counted: tick k, the k-th call of `step`,
    belongs to k * `period_s` on the reference. A loop that misses a period delays the reference.

    Args:
        vehicle: model parameters of estimator and controller.
        reference: where both axle points should be over time; of a `Path`, at `speed_mps`.
        period_s: control period [s].
        controller: a name of `ttempc.CONTROLLERS`, a factory called with vehicle, reference and
            period [s], or a controller. Around the former two the dead times of the vehicle are
            compensated, see `DeadTimeCompensation`; a controller is asked as it is.
        estimator: a name of `ttempc.ESTIMATORS`, a factory called with vehicle and sensor noise,
            or an estimator.
        options: keyword options of the controller by name or factory, such as `horizon`.
        sensor_noise: standard deviations that the estimator assumes.
        tube: design of the tube for controllers that need or monitor one.
        safety: where the supervisor slows down and stops.
        speed_mps: speed along a `Path` [m/s]; a `Reference` has its own.

    Raises:
        InvalidReference: the vehicle cannot follow the reference: curvature, steering rates,
            speed; the message names the place.
        InvalidPath: the vehicle cannot follow the path at all.
        UnknownController, UnknownEstimator: a name that does not exist.
        InvalidTuning: an option that is unknown or out of its range.
        InvalidTube: the tube is missing or belongs to another vehicle.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        reference: Reference | Path,
        period_s: float = 0.2,
        controller: str | ControllerFactory | Controller = "ttempc",
        estimator: str | EstimatorFactory | Estimator = "ekf",
        *,
        options: Mapping[str, object] | None = None,
        sensor_noise: SensorNoise | None = None,
        tube: TubeDesign | None = None,
        safety: SafetyLimits | None = None,
        speed_mps: float = 1.0,
    ) -> None:
        if isinstance(reference, Path):
            check_drivable(reference, vehicle)
            reference = Reference(reference, vehicle, ConstantSpeed(speed_mps))
        elif reference.vehicle != vehicle:
            raise InvalidReference("reference: was made for another vehicle than the guidance")
        else:
            check_drivable(reference.path, vehicle)
        check_pace(reference, period_s)
        self._vehicle, self._reference, self._period_s = vehicle, reference, period_s
        self._estimator = _estimator(estimator, vehicle, sensor_noise or SensorNoise())
        self._controller = _controller(controller, reference, period_s, options, tube)
        self._supervisor = Supervisor(self._controller, reference, period_s, safety)
        self._origin_s: float | None = None  # of the clock
        self._time_s = -math.inf  # of the last update, from the origin
        self._estimate: Estimate | None = None
        self._control_step: ControlStep | None = None
        self._tick = 0

    @property
    def vehicle(self) -> Vehicle:
        """Model parameters."""
        return self._vehicle

    @property
    def reference(self) -> Reference:
        """The reference that is followed."""
        return self._reference

    @property
    def space_based(self) -> bool:
        """Whether the controller follows the reference by place and not by time."""
        return self._supervisor.space_based

    @property
    def period_s(self) -> float:
        """Control period [s]."""
        return self._period_s

    @property
    def tick(self) -> int:
        """Number of the next control tick, counted from 0."""
        return self._tick

    @property
    def finished(self) -> bool:
        """Whether the next tick lies at or beyond the end of the reference."""
        return self._tick * self._period_s >= self._reference.duration_s - 1e-9

    @property
    def control_step(self) -> ControlStep:
        """Command and diagnostics of the last `step`.

        Raises:
            GuidanceFailed: there was no step yet.
        """
        if self._control_step is None:
            raise GuidanceFailed("control_step: call step() first")
        return self._control_step

    @property
    def diagnostics(self) -> Diagnostics:
        """Explanation of the last command: actions, solver, tracking error, fallback."""
        return self.control_step.diagnostics

    def warm_up(self) -> None:
        """Compile and load everything that `update` and `step` need; changes no later result.

        The first call on a machine compiles for some ten seconds, later ones load the result in a
        fraction of a second. Without it the first ticks take that time.
        """
        for part in (self._estimator, self._controller):
            if isinstance(part, WarmingUp):
                part.warm_up()

    def prepare(self) -> None:
        """Do the work of the next `step` that needs no samples, where the controller can.

        Optional: call it while waiting for the samples of the next tick.
        """
        self._supervisor.prepare(self._tick)

    def update(self, time_s: float, measurements: Sequence[Measurement]) -> Estimate:
        """Run the estimator to `time_s` and return its estimate.

        Args:
            time_s: present time [s] on the clock of the samples.
            measurements: the samples that arrived since the last update, in the order of arrival,
                late ones included; each with the time at which it was taken.

        Raises:
            InvalidTime: `time_s` is not finite or before that of the last update.
            EstimatorFailed: the estimator raised, or returned no `Estimate`.
        """
        if not math.isfinite(time_s):
            raise InvalidTime(f"update: time_s = {time_s}, must be finite")
        if self._origin_s is None:
            self._origin_s = time_s
        # Seconds from the start keep their resolution; those of the Unix epoch have steps of 2e-7.
        origin = self._origin_s
        now = time_s - origin
        if now < self._time_s:
            raise InvalidTime(
                f"update: time_s = {time_s} is {self._time_s - now:g} s before the last update"
            )
        if origin:
            measurements = [replace(item, time_s=item.time_s - origin) for item in measurements]
        sent = None if self._control_step is None else self._control_step.command
        try:
            estimate: object = self._estimator.update(now, measurements, sent)
        except Exception as error:  # a user's estimator may raise anything
            raise EstimatorFailed(
                f"the estimator raised at {now:.3f} s: {type(error).__name__}: {error}"
            ) from error
        if not isinstance(estimate, Estimate):
            raise EstimatorFailed(
                f"the estimator returned {type(estimate).__name__} at {now:.3f} s, must be an "
                "Estimate"
            )
        self._time_s, self._estimate = now, estimate
        return replace(estimate, time_s=estimate.time_s + origin) if origin else estimate

    def step(self) -> Command:
        """Return the command for the period that starts at the time of the last `update`.

        Raises:
            GuidanceFailed: `update` was not called yet.
            ControllerFailed: the controller raised, or returned no usable step.
        """
        if self._estimate is None:
            raise GuidanceFailed("step: call update(time_s, measurements) first")
        self._control_step = self._supervisor.step(self._estimate, self._tick, self._time_s)
        if isinstance(self._controller, DeadTimeCompensation):
            self._controller.record(self._control_step.command, self._tick)
        self._tick += 1
        return self._control_step.command


def _estimator(
    estimator: str | EstimatorFactory | Estimator, vehicle: Vehicle, noise: SensorNoise
) -> Estimator:
    if isinstance(estimator, str):
        estimator = estimator_factory(estimator)
    if isinstance(estimator, type) or not hasattr(estimator, "update"):
        return estimator(vehicle, noise)  # pyright: ignore[reportCallIssue] - a factory
    return estimator  # pyright: ignore[reportReturnType] - it has `update`


def _controller(
    controller: str | ControllerFactory | Controller,
    reference: Reference,
    period_s: float,
    options: Mapping[str, object] | None,
    tube: TubeDesign | None,
) -> Controller:
    if not isinstance(controller, str | type) and hasattr(controller, "step"):
        return controller  # pyright: ignore[reportReturnType] - it has `step`

    def make(vehicle: Vehicle, reference: Reference) -> Controller:
        if isinstance(controller, str):
            return make_controller(controller, vehicle, reference, period_s, tube, options)
        return controller(vehicle, reference, period_s, **(options or {}))  # pyright: ignore[reportCallIssue] - a factory

    return compensated(make, reference, period_s)
