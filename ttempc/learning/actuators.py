"""Identification of the actuators' dead times and lags from commands and measured responses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from ..jit import cached_njit
from ..layout import SampleColumn
from ..sensors import ROW_OF
from ..types import FloatArray, Input, Sensor
from ..vehicle import Vehicle
from .learner import Identification, ParameterChange
from .window import COMMAND, TIME, RecordedTick, Window

_SAME_TIME_S: Final = 1e-9


class ActuatorModel(NamedTuple):
    """Parameters of the model of an actuator."""

    dead_time: float  # [s]
    lag: float  # [s]
    backlash: float  # half width, in the unit of the command
    rate: float  # limit of the set point's rate, in that unit a second


@cached_njit(nogil=True)
def respond(
    starts: FloatArray,
    commands: FloatArray,
    times: FloatArray,
    model: ActuatorModel,
    response: FloatArray,
) -> None:
    """Write the output of an actuator at `times` (n,), increasing [s], into `response` (n,).

    The actuator is at rest at the first of the `commands` (m,), each of which is constant from its
    time in `starts` (m,) [s] on. Commands arrive after the dead time. A target follows them through
    the backlash, a set point follows the target at the rate limit, and the output follows the set
    point with the lag. Exact between commands, and continuous in all parameters.
    """
    now = starts[0]
    output = commands[0]
    set_point = commands[0]
    target = commands[0]
    index = 0  # of the command that has arrived
    last = len(commands) - 1
    for n in range(len(times)):
        while now < times[n] - _SAME_TIME_S:
            while index < last and starts[index + 1] + model.dead_time <= now + _SAME_TIME_S:
                index += 1
            end = times[n]
            if index < last:
                end = min(end, starts[index + 1] + model.dead_time)
            lowest = commands[index] - model.backlash
            highest = commands[index] + model.backlash
            target = min(max(target, lowest), highest)
            set_point, output = _move(set_point, output, target, end - now, model)
            now = end
        response[n] = output


@cached_njit(nogil=True)
def _move(
    set_point: float, output: float, target: float, span_s: float, model: ActuatorModel
) -> tuple[float, float]:
    """Return set point and output after a span in which the target is constant.

    The set point runs along a ramp until it is at the target. With the lag tau and the slope r of
    the ramp, output - set point + r tau fades as exp(-t / tau) meanwhile.
    """
    lag = model.lag
    distance = target - set_point
    rest_s = span_s
    if distance != 0.0:
        moving_s = min(rest_s, abs(distance) / model.rate)
        if moving_s > 0.0:
            slope = math.copysign(model.rate, distance)
            fading = output - set_point + slope * lag
            output = set_point + slope * (moving_s - lag) + fading * math.exp(-moving_s / lag)
            set_point += slope * moving_s
        rest_s -= moving_s
        if rest_s > 0.0:
            set_point = target
    if rest_s > 0.0:
        output = set_point + (output - set_point) * math.exp(-rest_s / lag)
    return set_point, output


LONGEST_S: Final = 1.2
"""Longest dead time that is identified [s]; the search begins at sixteen places up to it."""

_LEAST_S: Final = 5.0  # of driving that a fit needs
_LEAST_LAGS: Final = 10.0  # of driving, in lags of the actuator: its output drifts; assumed
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
_DEPENDENT: Final = 1e-20  # share of the squares of a column that counts as none
# A value changes where it differs by three standard deviations and by more than a tenth of a
# control period, which costs nothing to leave, and where it is known to half a period.
_SIGNIFICANT: Final = 3.0
_LEAST_CHANGE_S: Final = 0.02
_LARGEST_SD_S: Final = 0.08

# Index of each parameter of a fit
_DEAD_TIME: Final = 0
_LAG: Final = 1
_BACKLASH: Final = 2


@dataclass(frozen=True, slots=True)
class _Actuator:
    """Sensor of an actuator's output, and its parameters as fields of `Vehicle`."""

    sensor: Sensor
    dead_time: str
    lag: str
    # Of a steering, with gain 1 and backlash. None where the rate is limited before the command is
    # sent: then gain, offset and decay of the start are fitted as well.
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
    backlash: float  # half width [rad]: overlap of the valve and half the linkage's backlash


def fit_actuator(
    window: Sequence[RecordedTick], vehicle: Vehicle, actuator: Input
) -> ActuatorFit | None:
    """Return dead time, lag and backlash of least squared residuals.

    None for less than 5 s or 10 lags of driving. The model of `respond` is compared with the
    samples of a steering angle, of which the mean residual is fitted too, or with the wheel speed,
    of which gain, offset and decay of the start are fitted too (Ljung 1999, System Identification,
    ch. 7: output error). Noise of a sensor does not bias the fit, in a closed loop either, since a
    command answers to earlier samples alone. A backlash, without which worn valves would pass for
    slow ones, and another lag than the vehicle's are fitted only where the squares fall by 16
    variances of a sample. Standard deviations allow for residuals that are correlated over a second
    (Newey and West 1987).

    The window holds recorded ticks, oldest first. The search starts at the vehicle's lag.
    """
    data = _Response.of(window, vehicle, actuator)
    return None if data is None else data.fit()


class ActuatorIdentifier:
    """Identifies dead times and lags of all actuators; satisfies `Identifier`.

    It is never settled: dead times change as valves wear and oil warms up. A dead time of the
    hydrostat at the end of its range counts as none: its gain is fitted too, and a load that came
    and went has passed for one of 1.2 s (`work-eight` without IMUs, seed 12367).
    """

    def identify(self, window: Sequence[RecordedTick], vehicle: Vehicle) -> Identification:
        """Return `vehicle` with the dead times and lags that the window asks for."""
        changes: list[ParameterChange] = []
        for i, actuator in zip(Input, _ACTUATORS, strict=True):
            fit = fit_actuator(window, vehicle, i)
            if fit is None or (i is Input.HP and fit.dead_time >= LONGEST_S):
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
    times: FloatArray  # (n,) of the samples [s], from the first command
    samples: FloatArray  # (n,)
    lag: float  # of the vehicle, with which the search begins
    rate: float
    steering: bool

    @classmethod
    def of(
        cls, window: Sequence[RecordedTick], vehicle: Vehicle, input_: Input
    ) -> _Response | None:
        """Return the response in a window; None where it is too short."""
        actuator = _ACTUATORS[input_]
        flat = Window.of(window)
        commands = flat.ticks[1:, COMMAND][:, input_]
        known = ~np.isnan(commands)
        if not known.any():
            return None
        starts = flat.ticks[:-1, TIME][known]
        begin = starts[0]
        end = flat.ticks[-1, TIME]

        # Samples of the output by time, each once
        own = flat.samples[:, SampleColumn.SENSOR] == ROW_OF[actuator.sensor].index
        times = flat.samples[own, SampleColumn.TIME_S]
        samples = flat.samples[own, SampleColumn.FIRST]
        usable = (begin + _SETTLING_S <= times) & (times <= end) & np.isfinite(samples)
        times = times[usable]
        samples = samples[usable]
        order = np.lexsort((samples, times))
        times = times[order]
        samples = samples[order]
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
        coarse = replace(
            self, times=self.times[::_COARSE].copy(), samples=self.samples[::_COARSE].copy()
        )
        grid = [np.array([d, self.lag, 0.0]) for d in np.linspace(0.0, LONGEST_S, 16)]
        start = min(grid, key=lambda values: _squares(coarse.residuals(values)))
        best = self._search(start, [_DEAD_TIME])
        for more in (_BACKLASH, _LAG) if self.steering else (_LAG,):
            if not self._promises(best, more):
                continue
            values = best.values.copy()
            if more == _BACKLASH:
                values[_BACKLASH] = max(values[_BACKLASH], _STEPS[_BACKLASH])
            trial = self._search(values, [*best.fitted, more])
            variance = _squares(trial.residuals) / len(self.times)
            if _squares(best.residuals) - _squares(trial.residuals) > _WORTH * variance:
                best = trial
        dead_time, lag, backlash = best.values.tolist()
        sd = self._deviations(best)
        return ActuatorFit(dead_time, sd[_DEAD_TIME], lag, sd[_LAG], backlash)

    def residuals(self, values: FloatArray) -> FloatArray:
        """Return the samples less the response, less what is fitted too, (n,)."""
        dead_time, lag, backlash = values.tolist()
        model = ActuatorModel(dead_time, lag, backlash, self.rate)
        response = np.empty_like(self.times)
        respond(self.starts, self.commands, self.times, model, response)
        if self.steering:
            residuals = self.samples - response
            return residuals - residuals.mean()

        # Offset, decay of the start and gain: columns that are made orthogonal one to the other
        residuals = self.samples - self.samples.mean()
        orthogonal: list[FloatArray] = []
        for column in (np.exp(-self.times / lag), response):
            size = _squares(column)
            column = column - column.mean()
            for other in orthogonal:
                column -= (column @ other) * other
            left = _squares(column)
            if left > _DEPENDENT * size:
                unit = column / math.sqrt(left)
                orthogonal.append(unit)
                residuals -= (residuals @ unit) * unit
        return residuals

    def _search(self, values: FloatArray, fitted: list[int]) -> _Search:
        """Return the minimum over the `fitted` parameters near `values` (3,).

        The method is that of Levenberg and Marquardt.
        """
        damping = 1e-3
        residuals = self.residuals(values)
        squares = _squares(residuals)
        jacobian = self._jacobian(values, fitted)
        for _ in range(_MOST_ITERATIONS):
            normal = jacobian.T @ jacobian
            gradient = jacobian.T @ residuals
            damped = normal + damping * np.diag(np.diag(normal)) + 1e-12 * np.eye(len(fitted))
            trial = values.copy()
            trial[fitted] -= np.linalg.solve(damped, gradient)
            for i in fitted:
                least, most = _BOUNDS[i]
                trial[i] = min(max(trial[i], least), most)
            step = (trial - values)[fitted]
            expected = -step @ (2.0 * gradient + normal @ step)
            if expected < _CONVERGED * squares / len(residuals):
                break
            trial_residuals = self.residuals(trial)
            trial_squares = _squares(trial_residuals)
            if trial_squares < squares:
                values = trial
                residuals = trial_residuals
                squares = trial_squares
                damping *= 0.3
                jacobian = self._jacobian(values, fitted)
            else:
                damping *= 10.0
        return _Search(values, fitted, residuals, jacobian)

    def _promises(self, best: _Search, more: int) -> bool:
        """Whether one parameter more may be worth it: by the linear decrease of the squares."""
        column = self._jacobian(best.values, [more])[:, 0]
        others = best.jacobian
        normal = others.T @ others
        if normal.any():
            column = column - others @ np.linalg.lstsq(normal, others.T @ column, rcond=None)[0]
        decrease = float(column @ best.residuals) ** 2
        variance = _squares(best.residuals) / len(self.times)
        return decrease > _PROMISING * _WORTH * variance * _squares(column)

    def _jacobian(self, values: FloatArray, fitted: list[int]) -> FloatArray:
        """Return the derivatives of the residuals by the `fitted` parameters, (n, fitted)."""
        columns = []
        for i in fitted:
            least, most = _BOUNDS[i]
            low = values.copy()
            low[i] = max(values[i] - _STEPS[i], least)
            high = values.copy()
            high[i] = min(values[i] + _STEPS[i], most)
            difference = self.residuals(high) - self.residuals(low)
            columns.append(difference / (high[i] - low[i]))
        return np.stack(columns, axis=1)

    def _deviations(self, search: _Search) -> list[float]:
        """Return the standard deviation of each parameter, (3,), 0 where it is not fitted."""
        jacobian = search.jacobian
        residuals = search.residuals
        normal = jacobian.T @ jacobian
        if not np.isfinite(normal).all() or np.linalg.cond(normal) > 1.0 / np.finfo(float).eps:
            return [math.inf if i in search.fitted else 0.0 for i in range(3)]
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
            search.fitted, np.diag(inverse @ spread @ inverse), np.diag(white), strict=True
        ):
            result[i] = math.sqrt(max(robust, plain))
        return result


@dataclass(frozen=True, slots=True)
class _Search:
    """Minimum of a search."""

    values: FloatArray  # (3,) dead time, lag, backlash
    fitted: list[int]  # parameters that were searched
    residuals: FloatArray  # (n,)
    jacobian: FloatArray  # (n, fitted) of the residuals


def _squares(values: FloatArray) -> float:
    return float(values @ values)
