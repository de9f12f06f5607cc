"""Identification of a vehicle's lengths from the innovations of the filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ..estimation.noise import ProcessNoise, SensorNoise
from ..types import FloatArray
from ..vehicle import Vehicle
from .learner import LENGTHS, TURNING, Identification, ParameterChange
from .replay import Replay
from .window import HEADINGS, RecordedTick, Window

_PRIOR_SD: Final = 0.2  # of each length, relative; assumed
_LEAST_SHARE: Final = 0.65  # of a given length: a true one of -30 % and some
_LARGEST_SHARE: Final = 1.5  # of a given length: a true one of +30 % and some
_STEP: Final = 1e-4  # relative, of the derivatives
_MOST_STEPS: Final = 8
_MOST_LIKELY_STEPS: Final = 20
_LARGEST_STEP: Final = 0.2  # of a length
_CONVERGED_SD: Final = 0.2  # a step of this share of the standard deviations is the last

_GEOMETRY: Final = 0.01  # relative tolerance of each length; assumed
_SLIP: Final = 0.03  # relative tolerance of what tyres can feign, see `_tolerance`; assumed
_N: Final = len(LENGTHS)
_TURNING_SD_M: Final = 0.03  # up to which the turning offset counts as known; assumed
_TURNING_CHANGE_M: Final = 0.01  # of the offset, below which nothing is exchanged; assumed
_CHANGE: Final = 0.02  # relative change of the lengths below which nothing is exchanged; assumed
_CURVE_RAD: Final = 0.5  # by which the tractor has turned after a curve; assumed
# Of the given lengths: what chi-square with a degree of freedom each exceeds with 1 %
_REJECTED: Final = 13.276704135987625
KNOWN_SD: Final = 0.05
"""Relative standard deviation up to which a length counts as known; assumed."""


class LengthIdentifier:
    """Identifies the lengths of a vehicle, see `fit_lengths`.

    The given lengths stay unless the data reject them: with their fit theta, its covariance P and
    tolerances T, (theta - theta_0)' (P + T)^-1 (theta - theta_0) must be so large that it is
    exceeded with a probability of 1 % only. The tolerance is for what no length describes: slopes,
    on which horizontal distances are shorter, and tyres that slip sideways, in furrows most.

    A window without a curve changes nothing. On a straight only the swings of the control loop tell
    one length from another, and the lags of valves and tyres, which the model simplifies, bend
    those: in reverse, where they are largest, they feign a wheelbase that is short by a fifth.
    """

    def __init__(self, vehicle: Vehicle, noise: SensorNoise) -> None:
        self._given = vehicle
        self._noise = noise
        self._process = ProcessNoise.of(vehicle)

    def identify(self, window: Sequence[RecordedTick], vehicle: Vehicle) -> Identification:
        """Return `vehicle` with the lengths of the window, see `Identifier`."""
        if not _has_curve(window):
            return Identification(vehicle)
        fit = fit_lengths(window, vehicle, self._given, self._noise, self._process)
        if fit is None:
            return Identification(vehicle)
        rejected = fit.rejection > _REJECTED
        settled = self._is_settled(fit)
        present = _lengths(vehicle)
        lengths = fit.lengths if rejected else self._given_lengths(fit)

        change = lengths - present
        lengths_changed = np.linalg.norm(change[:_N] / _lengths(self._given)[:_N]) >= _CHANGE
        turning_changed = (np.abs(change[_N:]) > _TURNING_CHANGE_M).any()
        if not lengths_changed and not turning_changed:
            return Identification(vehicle, (), settled)
        rows = zip(
            _names(vehicle), present.tolist(), lengths.tolist(), fit.sd.tolist(), strict=True
        )
        changes = tuple(
            ParameterChange(name, before, after, sd)
            for name, before, after, sd in rows
            if before != after or rejected
        )
        return Identification(_with_lengths(vehicle, lengths), changes, settled)

    def _given_lengths(self, fit: LengthFit) -> FloatArray:
        """Return the given lengths, and the turning offset of a tool that fits best with them."""
        given = _lengths(self._given)
        covariance = fit.covariance
        by_lengths = np.linalg.solve(covariance[:_N, :_N], (given - fit.lengths)[:_N])
        turning = (fit.lengths + covariance[:, :_N] @ by_lengths)[_N:]
        return np.append(given[:_N], np.clip(turning, 0.0, _sizes(self._given)[_N:]))

    def _is_settled(self, fit: LengthFit) -> bool:
        """Whether more driving of this kind would change nothing."""
        wheelbase, _, _, trailer = (fit.sd / _lengths(self._given))[:_N]
        rejected = fit.rejection > _REJECTED
        known = bool(max(wheelbase, trailer) < (0.5 if rejected else 1.0) * KNOWN_SD)
        decided = rejected or fit.rejection < 0.5 * _REJECTED
        turning_known = bool((fit.sd[_N:] < _TURNING_SD_M).all())
        return known and decided and turning_known


def _has_curve(window: Sequence[RecordedTick]) -> bool:
    """Whether the estimated heading of the tractor has changed by more than `_CURVE_RAD`."""
    headings = Window.of(window).ticks[:, HEADINGS][:, 0]
    known = headings[np.isfinite(headings)]
    return len(known) > 0 and float(np.ptp(np.unwrap(known))) > _CURVE_RAD


@dataclass(frozen=True, slots=True)
class LengthFit:
    """Lengths that fit recorded samples and commands best."""

    lengths: FloatArray  # (p,) [m] in the order of `LENGTHS`, then `TURNING` of one with a tool
    covariance: FloatArray  # (p, p) [m^2] of their error
    rejection: float  # of the given lengths, see `LengthIdentifier`

    @property
    def sd(self) -> FloatArray:
        """Standard deviation of each length, (p,) [m]."""
        return np.sqrt(np.diag(self.covariance))


def fit_lengths(
    window: Sequence[RecordedTick],
    vehicle: Vehicle,
    given: Vehicle,
    noise: SensorNoise,
    process: ProcessNoise,
) -> LengthFit | None:
    """Return the lengths of largest posterior density; None where the search finds none.

    The window must contain every sensor and 15 s of driving. A length at the end of its range is
    none: the data then ask for something that no length describes. In the first curve at working
    speed that is a slip of the tyres which is not learnt yet.

    Gauss-Newton on the whitened innovations r(theta) of the filter,

        (J' J + P0^-1) d = -(J' r + P0^-1 (theta - theta_0)),    theta <- theta + d,

    with theta_0 the lengths of `given` and P0 = diag(0.2 theta_0)^2, where that of the turning
    offset c is a fifth of the tool's distance behind the axle. Side slip and the bias of the
    front steering, which the filter estimates too, could pass for a wrong wheelbase on a steady
    curve; curves to both sides, or a curve and a straight, tell them apart. On a straight the
    samples see the sum of hitch offset, drawbar and trailer length alone.

    `vehicle` is where the search starts.
    """
    data = Replay.of(window, vehicle, noise, process)
    if data is None:
        return None
    prior = _Prior.about(given)
    least, most = _bounds(given)

    def rejection(lengths: FloatArray, covariance: FloatArray, roughness: float) -> float:
        offset = (lengths - prior.mean)[:_N]
        spread = covariance[:_N, :_N] + _tolerance(given, data.squared_speed, roughness)
        return float(offset @ np.linalg.solve(spread, offset))

    here = _Point.at(_lengths(vehicle), data, vehicle, prior)
    for _ in range(_MOST_STEPS):
        target = np.clip(here.lengths + here.full_step(), least, most)
        step = target - here.lengths
        covariance = here.covariance()

        # The end of the search: a small step, or given lengths that are right on smooth ground
        is_given = (here.lengths == prior.mean).all()
        is_right = is_given and rejection(target, covariance, 1.0) < 0.5 * _REJECTED
        if is_right or here.is_small(step):
            at_an_end = ((target <= least) | (target >= most))[:_N].any()
            if at_an_end:
                return None
            return LengthFit(target, covariance, rejection(target, covariance, here.roughness))

        # A step that makes the fit worse is halved
        there = _Point.at(target, data, vehicle, prior)
        while there.cost > here.cost and not here.is_small(step):
            step = 0.5 * step
            there = _Point.at(here.lengths + step, data, vehicle, prior)
        here = there
    return None


def likely_lengths(
    window: Sequence[RecordedTick], vehicle: Vehicle, noise: SensorNoise, process: ProcessNoise
) -> tuple[FloatArray, FloatArray] | None:
    """Return the lengths of largest likelihood of a log, (4,), and their covariance [m^2].

    Gauss-Newton steps as those of `fit_lengths`, from `vehicle` on, without its prior, until they
    are small against the deviations; a step changes a length by a fifth at most. None for a log
    without a sensor, of less than 15 s, or for which the steps do not become small.
    """
    data = Replay.of(window, vehicle, noise, process)
    if data is None:
        return None
    lengths = _lengths(vehicle)[:_N]
    weak = np.diag(lengths**-2.0)  # where a direction is not excited
    for _ in range(_MOST_LIKELY_STEPS):
        # About the present lengths, the prior shortens a step and draws it nowhere
        here = _Point.at(lengths, data, vehicle, _Prior(lengths, weak))
        step = np.clip(here.full_step(), -_LARGEST_STEP * lengths, _LARGEST_STEP * lengths)
        lengths = lengths + step
        if here.is_small(step):
            return lengths, here.covariance()
    return None


@dataclass(frozen=True, slots=True)
class _Prior:
    """Normal distribution of the lengths before any data."""

    mean: FloatArray  # theta_0, (p,) [m]
    information: FloatArray  # P0^-1, (p, p) [1/m^2]

    @classmethod
    def about(cls, given: Vehicle) -> _Prior:
        """Return that about given lengths, see `fit_lengths`."""
        return cls(_lengths(given), np.diag((_PRIOR_SD * _sizes(given)) ** -2.0))


@dataclass(frozen=True, slots=True)
class _Point:
    """Lengths that a search has reached, and how well they fit data and prior."""

    lengths: FloatArray  # theta, (p,) [m]
    cost: float  # twice the negative logarithm of the posterior density
    normal: FloatArray  # J' J + P0^-1, (p, p)
    gradient: FloatArray  # J' r + P0^-1 (theta - theta_0), (p,)
    block_gradients: FloatArray  # J' r of each block of time, (blocks, p)
    roughness: float  # see `Misfit`

    @classmethod
    def at(cls, lengths: FloatArray, data: Replay, vehicle: Vehicle, prior: _Prior) -> _Point:
        """Return the point at `lengths`; what is not among them is as in `vehicle`."""
        present = _with_lengths(vehicle, lengths)
        step = _STEP * _sizes(present)[: len(lengths)]
        raised = [_with_lengths(vehicle, lengths + row) for row in np.diag(step)]
        misfit = data.run(present, raised)

        offset = lengths - prior.mean
        block_gradients = misfit.block_gradients / step
        return cls(
            lengths=lengths,
            cost=misfit.cost + float(offset @ prior.information @ offset),
            normal=misfit.normal / np.outer(step, step) + prior.information,
            gradient=block_gradients.sum(axis=0) + prior.information @ offset,
            block_gradients=block_gradients,
            roughness=misfit.roughness,
        )

    def full_step(self) -> FloatArray:
        """Return the step of Gauss-Newton, (p,) [m]."""
        return np.asarray(np.linalg.solve(self.normal, -self.gradient), dtype=np.float64)

    def is_small(self, step: FloatArray) -> bool:
        """Whether a step is small against the deviations of the lengths."""
        return bool(step @ self.normal @ step < _CONVERGED_SD**2)

    def covariance(self) -> FloatArray:
        """Return A^-1 + A^-1 B A^-1 with A = J' J + P0^-1 and B from the blocks g_b of J' r.

        B = sum (g_b - mean)(g_b - mean)' is A where the innovations are white with variance 1, and
        larger where ground outside the model makes them correlated (White 1982, "Maximum
        likelihood estimation of misspecified models", Econometrica 50).
        """
        inverse = np.linalg.inv(self.normal)
        deviation = (self.block_gradients - self.block_gradients.mean(axis=0)) @ inverse
        return inverse + deviation.T @ deviation


def _bounds(given: Vehicle) -> tuple[FloatArray, FloatArray]:
    """Return the least and the largest value that a search gives each length, (p,) [m]."""
    mean = _lengths(given)
    least = _LEAST_SHARE * mean
    most = _LARGEST_SHARE * mean
    least[_N:] = 0.0
    most[_N:] = _sizes(given)[_N:]
    return least, most


def _tolerance(given: Vehicle, squared_speed: float, roughness: float) -> FloatArray:
    """Return T (4, 4) [m^2], the covariance of the error of the fit by effects outside the model.

    1 % of each length for the geometry. For side slip on rough ground, 3 % of each length times the
    root of the roughness factor that the filter has learnt (at least 1). For the side slip c a of
    the curves themselves c v^2, by which a length L appears changed where slips are small: in a
    curve of radius R its angle is L / R, and a = v^2 / R. Slips do not change the sum of hitch
    offset, drawbar and trailer: the distance of both receivers shows it, whatever the tyres do.
    """
    lengths = _lengths(given)[:_N]
    compliances = [
        given.compliance_t if name == "wheelbase" else given.compliance_i for name in LENGTHS
    ]
    by_curve = squared_speed * np.array(compliances)
    keep_sum = np.eye(_N)
    keep_sum[1:, 1:] -= 1.0 / 3.0
    variances = max(1.0, roughness) * (_SLIP * lengths) ** 2 + by_curve**2
    return np.diag((_GEOMETRY * lengths) ** 2) + keep_sum @ np.diag(variances) @ keep_sum.T


def _names(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the fields that are fitted: where there is a tool, its effect on the trailer, too."""
    return (*LENGTHS, TURNING) if vehicle.tool_behind else LENGTHS


def _lengths(vehicle: Vehicle) -> FloatArray:
    """Return the lengths that are fitted, (p,) [m]."""
    return np.array([getattr(vehicle, name) for name in _names(vehicle)])


def _sizes(vehicle: Vehicle) -> FloatArray:
    """Return lengths that are large against their errors, (p,) [m].

    That of the turning offset is the tool's distance behind the axle.
    """
    of_tool = [vehicle.tool_behind] if vehicle.tool_behind else []
    return np.append(_lengths(vehicle)[:_N], of_tool)


def _with_lengths(vehicle: Vehicle, lengths: FloatArray) -> Vehicle:
    """Return `vehicle` with other lengths (p,), or with the first of them where fewer are given."""
    names = _names(vehicle)[: len(lengths)]
    return replace(vehicle, **dict(zip(names, lengths.tolist(), strict=True)))
