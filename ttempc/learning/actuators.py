"""Identification of the actuators' dead times and lags from commands and measured responses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from ..jit import cached_njit
from ..types import FloatArray, Input, Sensor
from ..vehicle import Vehicle
from .learner import Identification, ParameterChange
from .window import RecordedTick

_LONGEST_STEP_S: Final = 0.02  # a seventh of the shortest lag of the paper's vehicle
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
    [s]. Steps of the integration end where a command arrives, so that the output is continuous in
    all parameters.
    """
    now, output, valve, target = starts[0], commands[0], commands[0], commands[0]
    index, last = 0, len(commands) - 1  # of the command that has arrived
    for n in range(len(times)):
        while now < times[n] - _SAME_TIME_S:
            end = min(times[n], now + _LONGEST_STEP_S)
            while index < last and starts[index + 1] + dead_time <= now + _SAME_TIME_S:
                index += 1
            if index < last:
                end = min(end, starts[index + 1] + dead_time)
            step = end - now
            target = min(max(target, commands[index] - play), commands[index] + play)
            before, way = valve, target - valve
            moving = min(step, abs(way) / rate)  # [s], at the rate limit
            valve = target if moving < step else before + math.copysign(rate * step, way)
            mean = valve + 0.5 * (before - valve) * moving / step
            output = mean + (output - mean) * math.exp(-step / lag)
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
_BOUNDS: Final = ((0.0, LONGEST_S), (0.02, 5.0), (0.0, math.radians(4.0)))
_STEPS: Final = (0.01, 0.01, 0.002)  # of the derivatives: [s], [s], [rad]
_MOST_ITERATIONS: Final = 12
_CONVERGED: Final = 1e-6  # relative decrease of the squares that ends a search
# Decrease of the squares, in variances of a sample, for which a parameter more is fitted: four
# standard deviations of white residuals.
_WORTH: Final = 16.0
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
        actuator = _ACTUATORS[input_]
        sent = [
            (before.time_s, float(tick.command.as_array()[input_]))
            for before, tick in pairwise(window)
            if tick.command is not None
        ]
        if not sent:
            return None
        begin, end = sent[0][0], window[-1].time_s
        measured = sorted(
            {
                (sample.time_s - begin, sample.value[0])
                for tick in window
                for sample in tick.samples
                if sample.sensor is actuator.sensor
                and math.isfinite(sample.value[0])
                and begin + _SETTLING_S <= sample.time_s <= end
            }
        )
        least = max(_LEAST_S, _LEAST_LAGS * getattr(vehicle, actuator.lag))
        if end - begin < least or len(measured) < _LEAST_S:
            return None
        starts, commands = np.array(sent).T
        times, samples = np.array(measured).T
        return cls(
            starts=starts - begin,
            commands=np.ascontiguousarray(commands),
            times=np.ascontiguousarray(times),
            samples=np.ascontiguousarray(samples),
            lag=getattr(vehicle, actuator.lag),
            rate=getattr(vehicle, actuator.rate) if actuator.rate else math.inf,
            steering=actuator.rate is not None,
        )

    def fit(self) -> ActuatorFit:
        """Return the best parameters; each one more than the dead time must be worth it."""
        grid = [np.array([d, self.lag, 0.0]) for d in np.linspace(0.0, LONGEST_S, 16)]
        start = min(grid, key=lambda values: float((self._residuals(values) ** 2).sum()))
        best = self._search(start, [_DEAD_TIME])
        for more in (_PLAY, _LAG) if self.steering else (_LAG,):
            values = best.values.copy()
            values[_PLAY] = max(values[_PLAY], _STEPS[_PLAY] if more == _PLAY else 0.0)
            trial = self._search(values, [*best.free, more])
            variance = trial.squares / len(self.times)
            if best.squares - trial.squares > _WORTH * variance:
                best = trial
        dead_time, lag, play = best.values.tolist()
        sd = self._deviations(best)
        return ActuatorFit(dead_time, sd[_DEAD_TIME], lag, sd[_LAG], play)

    def _residuals(self, values: FloatArray) -> FloatArray:
        """Return the samples less the response, what is fitted beside taken out, (n,)."""
        dead_time, lag, play = values.tolist()
        response = np.empty_like(self.times)
        respond(self.starts, self.commands, self.times, dead_time, lag, play, self.rate, response)
        if self.steering:
            residuals = self.samples - response
            return residuals - residuals.mean()
        decay = np.exp(-self.times / lag)
        beside = np.stack([response, np.ones_like(response), decay], axis=1)
        return self.samples - beside @ np.linalg.lstsq(beside, self.samples, rcond=None)[0]

    def _search(self, values: FloatArray, free: list[int]) -> _Search:
        """Return the minimum over the `free` parameters near `values` (3,): Levenberg-Marquardt."""
        residuals, damping = self._residuals(values), 1e-3
        squares = float(residuals @ residuals)
        for _ in range(_MOST_ITERATIONS):
            jacobian = self._jacobian(values, free)
            normal = jacobian.T @ jacobian
            damped = normal + damping * np.diag(np.diag(normal)) + 1e-12 * np.eye(len(free))
            trial = values.copy()
            trial[free] -= np.linalg.solve(damped, jacobian.T @ residuals)
            for i in free:
                trial[i] = min(max(trial[i], _BOUNDS[i][0]), _BOUNDS[i][1])
            other = self._residuals(trial)
            change = squares - float(other @ other)
            damping *= 0.3 if change > 0.0 else 10.0
            if change > 0.0:
                values, residuals, squares = trial, other, squares - change
            if abs(change) < _CONVERGED * squares:
                break
        return _Search(values, free, squares)

    def _jacobian(self, values: FloatArray, free: list[int]) -> FloatArray:
        """Return the derivatives of the residuals by the `free` parameters, (n, free)."""
        columns = []
        for i in free:
            low, high = values.copy(), values.copy()
            low[i] = max(values[i] - _STEPS[i], _BOUNDS[i][0])
            high[i] = min(values[i] + _STEPS[i], _BOUNDS[i][1])
            difference = self._residuals(high) - self._residuals(low)
            columns.append(difference / (high[i] - low[i]))
        return np.stack(columns, axis=1)

    def _deviations(self, search: _Search) -> list[float]:
        """Return the standard deviation of each parameter, (3,), 0 where it is not free."""
        jacobian, residuals = (
            self._jacobian(search.values, search.free),
            self._residuals(search.values),
        )
        normal = jacobian.T @ jacobian
        scores = jacobian * residuals[:, None]
        lags = round(_CORRELATED_S * (len(self.times) - 1) / (self.times[-1] - self.times[0]))
        spread = scores.T @ scores
        for lag in range(1, lags + 1):
            product = scores[lag:].T @ scores[:-lag]
            spread += (1.0 - lag / (lags + 1)) * (product + product.T)
        result = [0.0, 0.0, 0.0]
        if not np.isfinite(normal).all() or np.linalg.cond(normal) > 1.0 / np.finfo(float).eps:
            return [math.inf if i in search.free else 0.0 for i in range(3)]
        inverse = np.linalg.inv(normal)
        white = float(residuals @ residuals) / len(residuals) * inverse
        for i, robust, plain in zip(
            search.free, np.diag(inverse @ spread @ inverse), np.diag(white), strict=True
        ):
            result[i] = math.sqrt(max(robust, plain))
        return result


@dataclass(frozen=True, slots=True)
class _Search:
    values: FloatArray  # (3,) dead time, lag, play
    free: list[int]  # parameters that were searched
    squares: float  # sum of squared residuals
