"""Identification of the actuators' dead times and lags from commands and measured responses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ..jit import cached_njit
from ..sensors import SensorIndex
from ..types import FloatArray, Input, Sensor
from ..vehicle import Vehicle
from .learner import Identification, ParameterChange
from .window import COMMAND, TIME, RecordedTick, Window

_SAME_TIME_S: Final = 1e-9


@cached_njit(nogil=True)
def respond(
    starts: FloatArray,
    commands: FloatArray,
    times: FloatArray,
    dead_time: float,
    lag: float,
    play: float,
    rate: float,
    response: FloatArray,
) -> None:
    """Write the output of an actuator at `times` (n,), increasing [s], into `response` (n,).

    The actuator is at rest at the first of the `commands` (m,), which are held from `starts` (m,)
    [s] on. They arrive after the `dead_time` [s]; a play of half width `play` follows them, a set
    point follows the play at the `rate` limit, and the output follows the set point with the `lag`
    [s]. Exact between commands, and continuous in all parameters.
    """
    now, output, valve, target = starts[0], commands[0], commands[0], commands[0]
    index, last = 0, len(commands) - 1  # of the command that has arrived
    for n in range(len(times)):
        while now < times[n] - _SAME_TIME_S:
            while index < last and starts[index + 1] + dead_time <= now + _SAME_TIME_S:
                index += 1
            end = times[n]
            if index < last:
                end = min(end, starts[index + 1] + dead_time)
            target = min(max(target, commands[index] - play), commands[index] + play)
            way, rest = target - valve, end - now
            if way != 0.0:
                moving = min(rest, abs(way) / rate)  # [s], along a ramp
                if moving > 0.0:
                    slope = math.copysign(rate, way)
                    behind = output - valve + slope * lag  # what fades of the output
                    output = valve + slope * (moving - lag) + behind * math.exp(-moving / lag)
                    valve += slope * moving
                rest -= moving
                if rest > 0.0:
                    valve = target
            if rest > 0.0:
                output = valve + (output - valve) * math.exp(-rest / lag)
            now = end
        response[n] = output


LONGEST_S: Final = 1.2
"""Longest dead time that is identified [s]; the search begins at sixteen places up to it."""

_LEAST_S: Final = 5.0  # of driving
_LEAST_LAGS: Final = (
    10.0  # of driving, in lags of the actuator: an output that lags drifts; assumed
)
_SETTLING_S: Final = 2.0  # of a window: what was sent before it still acts
_CORRELATED_S: Final = 1.0  # over which residuals may be correlated
_COARSE: Final = 4  # samples of which the search for a beginning takes one
_BOUNDS: Final = ((0.0, LONGEST_S), (0.02, 5.0), (0.0, math.radians(4.0)))
_STEPS: Final = (0.01, 0.01, 0.002)  # of the derivatives: [s], [s], [rad]
_MOST_ITERATIONS: Final = 12
# Decrease of the squares, in variances of a sample, below which a search ends: a tenth of a
# standard deviation of white residuals.
_CONVERGED: Final = 1e-2
# Decrease of the squares, in variances of a sample, for which a parameter more is fitted: four
# standard deviations of white residuals.
_WORTH: Final = 16.0
_PROMISING: Final = 0.5  # share of it that a linear forecast must reach; assumed
_DEPENDENT: Final = 1e-20  # squares of a column beside others, relative, that count as none
# A value changes where it differs by three standard deviations and by more than a tenth of a
# control period, which costs nothing to leave, and where it is known to half a period.
_SIGNIFICANT: Final = 3.0
_LEAST_CHANGE_S: Final = 0.02
_LARGEST_SD_S: Final = 0.08

_DEAD_TIME, _LAG, _PLAY = range(3)  # index of each parameter of a fit


@dataclass(frozen=True, slots=True)
class _Actuator:
    sensor: Sensor
    dead_time: str  # field of `Vehicle`
    lag: str  # likewise
    # Likewise: a steering, with gain 1 and play. None: limited before the command is sent; gain,
    # offset and start are fitted beside.
    rate: str | None


_ACTUATORS: Final = (
    _Actuator(Sensor.STEERING_TRACTOR, "dead_time_t", "steering_lag_t", "steering_rate_t"),
    _Actuator(Sensor.STEERING_TRAILER, "dead_time_i", "steering_lag_i", "steering_rate_i"),
    _Actuator(Sensor.ENCODER, "dead_time_hp", "speed_time_constant", None),
)
"""In the order of `Input`."""


@dataclass(frozen=True, slots=True)
class ActuatorFit:
    """Parameters of one actuator that fit its recorded response best."""

    dead_time: float  # [s]
    dead_time_sd: float  # [s], infinite where the commands do not excite the actuator
    lag: float  # [s]; that of the vehicle where the data ask for no other
    lag_sd: float  # [s]; 0 where the lag is that of the vehicle
    play: float  # half width [rad]: overlap of the valve and half the play of the linkage together


def fit_actuator(
    window: Sequence[RecordedTick], vehicle: Vehicle, actuator: Input
) -> ActuatorFit | None:
    """Return dead time, lag and play of least squared residuals; None for less than 5 s or 10 lags.

    The model of `respond` is compared with the samples of a steering angle, its bias fitted beside,
    or with the rim speed, gain, offset and decay of the start fitted beside (Ljung 1999, System
    Identification, ch. 7: output error). Noise of a sensor does not bias it, in a closed loop
    either, since a command answers to earlier samples alone. A play, without which worn valves
    would pass for slow ones, and a lag beside that of the vehicle are fitted only where the squares
    fall by 16 variances of a sample. Standard deviations allow for residuals that are correlated
    over a second (Newey and West 1987).

    The window holds recorded ticks, oldest first. The search starts at the vehicle's lag.
    """
    data = _Response.of(window, vehicle, actuator)
    return None if data is None else data.fit()


class ActuatorIdentifier:
    """Identifies dead times and lags of all actuators; satisfies `Identifier`.

    It is never settled: dead times change as valves wear and oil warms up.
    """

    def identify(self, window: Sequence[RecordedTick], vehicle: Vehicle) -> Identification:
        """Return `vehicle` with the dead times and lags that the window asks for."""
        changes: list[ParameterChange] = []
        for i, actuator in zip(Input, _ACTUATORS, strict=True):
            fit = fit_actuator(window, vehicle, i)
            if fit is None:
                continue
            for name, value, sd in (
                (actuator.dead_time, fit.dead_time, fit.dead_time_sd),
                (actuator.lag, fit.lag, fit.lag_sd),
            ):
                before = getattr(vehicle, name)
                known = sd < _LARGEST_SD_S
                if known and abs(value - before) > max(_SIGNIFICANT * sd, _LEAST_CHANGE_S):
                    changes.append(ParameterChange(name, before, value, sd))
        if not changes:
            return Identification(vehicle)
        values = {change.name: change.after for change in changes}
        return Identification(replace(vehicle, **values), tuple(changes))


@dataclass(frozen=True)
class _Response:
    """Commands of one actuator and the samples of its response."""

    starts: FloatArray  # (m,) of the commands [s], from the first of them
    commands: FloatArray  # (m,)
    times: FloatArray  # (n,) of the samples [s], likewise
    samples: FloatArray  # (n,)
    lag: float  # of the vehicle
    rate: float
    steering: bool

    @classmethod
    def of(
        cls, window: Sequence[RecordedTick], vehicle: Vehicle, input_: Input
    ) -> _Response | None:
        """Return the response in a window; None where it is too short."""
        actuator, flat = _ACTUATORS[input_], Window.of(window)
        commands = flat.ticks[1:, COMMAND][:, input_]
        known = ~np.isnan(commands)
        if not known.any():
            return None
        starts = flat.ticks[:-1, TIME][known]
        begin, end = starts[0], flat.ticks[-1, TIME]
        rows = flat.samples[flat.samples[:, 1] == SensorIndex[actuator.sensor.name]]
        usable = (begin + _SETTLING_S <= rows[:, 0]) & (rows[:, 0] <= end)
        times, samples = rows[usable & np.isfinite(rows[:, 2])][:, [0, 2]].T
        order = np.lexsort((samples, times))
        times, samples = times[order], samples[order]
        again = (np.diff(times) == 0.0) & (np.diff(samples) == 0.0)
        first = np.append(True, ~again)[: len(times)]
        least = max(_LEAST_S, _LEAST_LAGS * getattr(vehicle, actuator.lag))
        if end - begin < least or first.sum() < _LEAST_S:
            return None
        return cls(
            starts=starts - begin,
            commands=commands[known],
            times=times[first] - begin,
            samples=samples[first],
            lag=getattr(vehicle, actuator.lag),
            rate=getattr(vehicle, actuator.rate) if actuator.rate else math.inf,
            steering=actuator.rate is not None,
        )

    def fit(self) -> ActuatorFit:
        """Return the best parameters; each one more than the dead time must be worth it."""
        times, samples = (all_[::_COARSE].copy() for all_ in (self.times, self.samples))
        coarse = replace(self, times=times, samples=samples)
        grid = [np.array([d, self.lag, 0.0]) for d in np.linspace(0.0, LONGEST_S, 16)]
        start = min(grid, key=lambda values: _squares(coarse.residuals(values)))
        best = self._search(start, [_DEAD_TIME])
        for more in (_PLAY, _LAG) if self.steering else (_LAG,):
            if not self._promises(best, more):
                continue
            values = best.values.copy()
            values[_PLAY] = max(values[_PLAY], _STEPS[_PLAY] if more == _PLAY else 0.0)
            trial = self._search(values, [*best.free, more])
            variance = _squares(trial.residuals) / len(self.times)
            if _squares(best.residuals) - _squares(trial.residuals) > _WORTH * variance:
                best = trial
        dead_time, lag, play = best.values.tolist()
        sd = self._deviations(best)
        return ActuatorFit(dead_time, sd[_DEAD_TIME], lag, sd[_LAG], play)

    def residuals(self, values: FloatArray) -> FloatArray:
        """Return the samples less the response, what is fitted beside taken out, (n,)."""
        dead_time, lag, play = values.tolist()
        response = np.empty_like(self.times)
        respond(self.starts, self.commands, self.times, dead_time, lag, play, self.rate, response)
        if self.steering:
            residuals = self.samples - response
            return residuals - residuals.mean()
        residuals, beside = self.samples - self.samples.mean(), list[FloatArray]()
        for column in (np.exp(-self.times / lag), response):  # orthogonal one to the other
            size = _squares(column)
            column = column - column.mean()
            for other in beside:
                column -= (column @ other) * other
            if (left := _squares(column)) > _DEPENDENT * size:
                beside.append(column / math.sqrt(left))
                residuals -= (residuals @ beside[-1]) * beside[-1]
        return residuals

    def _search(self, values: FloatArray, free: list[int]) -> _Search:
        """Return the minimum over the `free` parameters near `values` (3,): Levenberg-Marquardt."""
        residuals, damping = self.residuals(values), 1e-3
        jacobian, squares = self._jacobian(values, free), _squares(residuals)
        for _ in range(_MOST_ITERATIONS):
            normal, gradient = jacobian.T @ jacobian, jacobian.T @ residuals
            damped = normal + damping * np.diag(np.diag(normal)) + 1e-12 * np.eye(len(free))
            trial = values.copy()
            trial[free] -= np.linalg.solve(damped, gradient)
            for i in free:
                trial[i] = min(max(trial[i], _BOUNDS[i][0]), _BOUNDS[i][1])
            step = (trial - values)[free]
            expected = -step @ (2.0 * gradient + normal @ step)
            if expected < _CONVERGED * squares / len(residuals):
                break
            other = self.residuals(trial)
            if (less := _squares(other)) < squares:
                values, residuals, squares, damping = trial, other, less, 0.3 * damping
                jacobian = self._jacobian(values, free)
            else:
                damping *= 10.0
        return _Search(values, free, residuals, jacobian)

    def _promises(self, best: _Search, more: int) -> bool:
        """Whether one parameter more may be worth it: by the linear decrease of the squares."""
        column = self._jacobian(best.values, [more])[:, 0]
        beside = best.jacobian
        if (normal := beside.T @ beside).any():
            column = column - beside @ np.linalg.lstsq(normal, beside.T @ column, rcond=None)[0]
        decrease = float(column @ best.residuals) ** 2
        variance = _squares(best.residuals) / len(self.times)
        return decrease > _PROMISING * _WORTH * variance * _squares(column)

    def _jacobian(self, values: FloatArray, free: list[int]) -> FloatArray:
        """Return the derivatives of the residuals by the `free` parameters, (n, free)."""
        columns = []
        for i in free:
            low, high = values.copy(), values.copy()
            low[i] = max(values[i] - _STEPS[i], _BOUNDS[i][0])
            high[i] = min(values[i] + _STEPS[i], _BOUNDS[i][1])
            difference = self.residuals(high) - self.residuals(low)
            columns.append(difference / (high[i] - low[i]))
        return np.stack(columns, axis=1)

    def _deviations(self, search: _Search) -> list[float]:
        """Return the standard deviation of each parameter, (3,), 0 where it is not free."""
        jacobian, residuals = search.jacobian, search.residuals
        normal = jacobian.T @ jacobian
        if not np.isfinite(normal).all() or np.linalg.cond(normal) > 1.0 / np.finfo(float).eps:
            return [math.inf if i in search.free else 0.0 for i in range(3)]
        scores = jacobian * residuals[:, None]
        lags = round(_CORRELATED_S * (len(self.times) - 1) / (self.times[-1] - self.times[0]))
        spread = scores.T @ scores
        for lag in range(1, lags + 1):
            product = scores[lag:].T @ scores[:-lag]
            spread += (1.0 - lag / (lags + 1)) * (product + product.T)
        inverse = np.linalg.inv(normal)
        white = _squares(residuals) / len(residuals) * inverse
        result = [0.0, 0.0, 0.0]
        for i, robust, plain in zip(
            search.free, np.diag(inverse @ spread @ inverse), np.diag(white), strict=True
        ):
            result[i] = math.sqrt(max(robust, plain))
        return result


@dataclass(frozen=True, slots=True)
class _Search:
    values: FloatArray  # (3,) dead time, lag, play
    free: list[int]  # parameters that were searched
    residuals: FloatArray  # (n,)
    jacobian: FloatArray  # (n, free) of the residuals


def _squares(values: FloatArray) -> float:
    return float(values @ values)
