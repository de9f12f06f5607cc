"""Foresight: what the tractor meets at a place, its trailer meets there some metres later.

The side slip of the trailer is the ground's doing, and its axle passes over the ground that the
tractor has passed. What the tractor met is recorded by the distance along its path, not by time:
the roll that its IMU measures, where there is one, and by how much its motion differs from that of
its disturbances, which are slow. A linear regression, learnt while driving, maps it to the part of
the trailer's side slip that its disturbance does not tell. In the suspension of vehicles this is
known as wheelbase preview (Hac 1992, J. Sound Vib. 159).
"""

from __future__ import annotations

import math
from copy import deepcopy
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np

from ..jit import cached_njit, local, record
from ..layout import ESTIMATE, EXPECTED, SampleColumn
from ..models.augmented_state import MAPPED, VehicleParameter, vehicle_parameters
from ..sensors import SensorIndex
from ..types import Disturbance, FloatArray, State
from ..vehicle import Vehicle
from .field import shown


class Signal(IntEnum):
    """What is recorded of the tractor by distance."""

    ROLL = 0  # [rad] as its IMU measures it; a slip is as a change of it, in rad/m
    SLIP = 1  # [rad] side slip of the motion less that of the estimated disturbance
    STEERING = 2  # [rad] the same of the front steering


_SIGNALS: Final = len(Signal)
_IMU: Final = int(SensorIndex.IMU_TRACTOR)
_CELL_M: Final = 0.1  # between two places of the record: a quarter of a wheel's contact, and less
_TAPS: Final = 5
"""Places of the regression about that of the trailer's axle, behind and ahead of it. Contact
lengths, relaxation of the tyres and lag of the estimate blur and shift the likeness."""
_SPACING_M: Final = 0.3  # between them
_HALF_WIDTH_M: Final = 0.15  # over which a signal is averaged on either side of such a place
_SIZE: Final = _SIGNALS * _TAPS
_REACH_M: Final = 0.8  # of record that the regression needs beyond a place: offset and width
_STEP_M: Final = 0.2  # of the trailer's travel between two corrections of the regression, at least
_PRIOR_SD: Final = (0.1, 0.15, 0.15)
"""Of a coefficient of each signal, whose mean is 0 [m], 1, 1; on tuning seeds."""
_NOISE_SD: Final = 0.02  # of the slip that the motion shows over 0.2 m [rad]; on tuning seeds
_WALK_M: Final = 400.0  # of travel in which the soil may change a coefficient by its prior; assumed
_MEMORY_M: Final = 60.0  # of travel over which forecast and motion are compared
_INDEPENDENT_M: Final = 0.5  # of travel between two errors of a forecast that are independent
_HOLD_M: Final = 2.0  # of travel from which on coefficients make forecasts: their horizon
_DEVIATIONS: Final = 2.0  # by which the slope of slips on forecasts has to be above 0
_WARM_UP_M: Final = 10.0  # of compared travel before the first forecast is given
_BESIDE_M: Final = 0.15  # between the paths of both axles where half of the likeness is left
_LEAST_SPEED: Final = 0.15  # [m/s], forward
_PLACES: Final = 512  # of the ring: 51 m of path
_LONGEST_JUMP_M: Final = 2.0  # between two ticks; the record begins anew after a longer one
_PROJECTIONS: Final = 3  # steps of a search for the place of the trailer's axle

FORESIGHT: Final = np.dtype(
    [
        ("distance", "f8"),  # of the tractor's axle at the last estimate [m]; NaN before the first
        ("time_s", "f8"),  # of that estimate
        ("begin", "f8"),  # distance from which on the record is without a gap [m]
        # Of each signal: place up to which it is known, its value there, its integral up to there
        ("known_to", "f8", _SIGNALS),
        ("value", "f8", _SIGNALS),
        ("integral", "f8", _SIGNALS),
        ("ticks", "f8"),  # estimates since the record began, up to 3
        ("states", "f8", (3, len(State))),  # the last three of them, oldest first
        ("disturbances", "f8", (3, MAPPED)),
        ("places", "f8", 3),  # distances of the tractor's axle, and
        ("trailer_places", "f8", 3),  # of the trailer's, on the path of the tractor
        ("beside", "f8"),  # distance of the trailer's axle from that path now, to the left [m]
        ("slip", "f8"),  # slip beside the disturbance at the last but one place of the trailer
        ("step_begin", "f8"),  # place where the present step of the regression began
        ("step_integral", "f8"),  # of the slip since then
        ("coefficients", "f8", _SIZE),
        ("covariance", "f8", (_SIZE, _SIZE)),
        # Coefficients that forecast: those of 2 to 4 m ago. Slips of neighbouring steps are alike:
        # with coefficients of now the comparison would praise them for what they have just seen
        ("used", "f8", _SIZE),
        ("next_used", "f8", _SIZE),
        ("held_m", "f8"),
        # Means over the memory, per metre: of slip and forecast squared, and of their product
        ("compared_m", "f8"),
        ("slip_power", "f8"),
        ("forecast_power", "f8"),
        ("product", "f8"),
        ("share", "f8"),  # of a forecast that is used, see `_compare`
        ("expected", EXPECTED),  # of the last `ahead`
    ]
)
"""Record of a foresight, without its path."""


_EXPECTED: Final = slice(-EXPECTED.itemsize // 8, None)


class TractorPath(NamedTuple):
    """Rings of what the tractor has passed, a row each `_CELL_M` of its path."""

    integrals: FloatArray  # (`_PLACES`, 3) of each `Signal` over the distance up to the place
    points: FloatArray  # (`_PLACES`, 2) x, y of the axle point [m]


class Foresight:
    """Side slip of the trailer ahead, from what the tractor has met on the same path.

    The regression is a Kalman filter on constant coefficients c, with the prior 0:

        s_i(xi) = sum_n c_n g_n(xi),

    s_i the side slip of the trailer's axle at the place xi beside its slow disturbance, over a step
    of 0.2 m or a tick, whichever is longer, and g the signals of the tractor about that place: mean
    slips, and the slope of the roll. Nothing depends on time: it holds at any speed and period.

    A forecast counts by the share that comparison with the motion has justified (`_compare`), 0
    while there is no likeness; by the distance between the paths of both axles; not at all in
    reverse, near a stop and where the tractor has not been.

    Args:
        vehicle: parameters of the model.
        period_s: control period [s].
        lead_s: time by which the reference of the controller is ahead [s].
    """

    def __init__(self, vehicle: Vehicle, period_s: float, lead_s: float = 0.0) -> None:
        self._period_s = period_s
        self._path = TractorPath(np.zeros((_PLACES, _SIGNALS)), np.zeros((_PLACES, 2)))
        self._state = np.zeros(FORESIGHT.itemsize // 8)
        start = self._state.view(FORESIGHT)[0]
        start["distance"] = math.nan
        start["covariance"] = np.diag(np.repeat(_PRIOR_SD, _TAPS) ** 2)
        self.exchange(vehicle, lead_s)

    def exchange(self, vehicle: Vehicle, lead_s: float) -> None:
        """Learn on with other model parameters and another lead of the controller."""
        self._parameters = vehicle_parameters(vehicle)
        self._lead_s = lead_s

    def warm_up(self) -> None:
        """Compile or load what a tick needs; no later result changes."""
        twin = deepcopy(self)
        twin.observe(np.zeros((0, len(SampleColumn))), np.zeros(ESTIMATE.itemsize // 8), True)
        twin.ahead(0, 1)

    def memory(self) -> tuple[FloatArray, ...]:
        """Return the arrays that are carried from tick to tick, for `restore`."""
        return (self._state, *self._path)

    def restore(self, memory: tuple[FloatArray, ...]) -> None:
        """Go on from a copy of a `memory`."""
        state, integrals, points = memory
        self._state = state.copy()
        self._path = TractorPath(integrals.copy(), points.copy())

    @property
    def confidence(self) -> float:
        """Share of a forecast that is used now, from 0 to 1."""
        return _share(self._state)

    def known(self, k: int) -> float:
        """Return 0: a forecast ends at the tractor, and the reserve is that of a longer horizon.

        With the share that forecasts explain nothing was gained on tuning seeds of a wet slope.
        """
        return 0.0

    @property
    def expected(self) -> FloatArray:
        """Record `EXPECTED` of the last `ahead`, flat."""
        return self._state[_EXPECTED]

    def observe(self, rows: FloatArray, estimate: FloatArray, usable: bool) -> None:
        """Take in the samples (n, `SAMPLE`) of a tick and its record `ESTIMATE`.

        Where a tick is not `usable` the record of the path begins anew; what is learnt stays.
        """
        observe_path(rows, estimate, usable, self._parameters, self._path, self._state)

    def ahead(self, k: int, count: int) -> FloatArray:
        """Return the forecast beside the present disturbances, (count, 3) [rad].

        It is over the periods that begin at the ticks k, k + 1, ... ; of side slip of the trailer
        alone.
        """
        result = np.zeros((count, MAPPED))
        write_ahead(self._period_s, self._lead_s, self._path, self._state, result)
        return result


@cached_njit(error_model="numpy", nogil=True)
def observe_path(
    rows: FloatArray,
    estimate: FloatArray,
    usable: bool,
    parameters: FloatArray,
    path: TractorPath,
    state: FloatArray,
) -> None:
    """Do `Foresight.observe`; `state` is the record `FORESIGHT`."""
    s = record(state, FORESIGHT)
    e = record(estimate, ESTIMATE)
    speed = e.state[State.V]
    usable = usable and math.isfinite(e.state[State.X]) and speed >= _LEAST_SPEED
    travel = 0.5 * (speed + s.states[2, State.V]) * (e.time_s - s.time_s)
    follows = not math.isnan(s.distance) and 0.0 <= travel <= _LONGEST_JUMP_M
    if not usable:
        s.distance = math.nan
        return
    if not follows:
        _begin(rows, estimate, parameters, path, state)
        return

    before = s.distance
    s.distance += travel
    s.time_s = e.time_s
    _shift(estimate, state)
    _record_points(before, estimate, path, state)
    _record_roll(rows, estimate, path, state)
    s.trailer_places[2] = _place_of_trailer(s.trailer_places[1] + travel, estimate, path, state)
    if s.ticks >= 3.0:
        _record_motion(parameters, path, state)


@cached_njit(error_model="numpy", nogil=True)
def _begin(
    rows: FloatArray,
    estimate: FloatArray,
    parameters: FloatArray,
    path: TractorPath,
    state: FloatArray,
) -> None:
    """Begin the record of the path anew at an estimate, at a distance of 0."""
    s = record(state, FORESIGHT)
    e = record(estimate, ESTIMATE)
    s.distance = 0.0
    s.time_s = e.time_s
    s.begin = 0.0
    s.ticks = 0.0
    s.step_begin = math.nan
    s.slip = math.nan
    for signal in range(_SIGNALS):
        s.known_to[signal] = 0.0
        s.value[signal] = 0.0
        s.integral[signal] = 0.0
        path.integrals[0, signal] = 0.0
    for i in range(len(rows)):
        if int(rows[i, SampleColumn.SENSOR]) == _IMU:
            s.value[Signal.ROLL] = rows[i, SampleColumn.SECOND]
    for i in range(2):
        path.points[0, i] = e.state[State.X + i]
    _shift(estimate, state)
    length = parameters[VehicleParameter.HITCH_OFFSET]
    length += parameters[VehicleParameter.DRAWBAR_LENGTH]
    length += parameters[VehicleParameter.TRAILER_LENGTH]
    s.trailer_places[2] = -length


@cached_njit(error_model="numpy", nogil=True)
def _shift(estimate: FloatArray, state: FloatArray) -> None:
    """Let the last three estimates move on by one."""
    s = record(state, FORESIGHT)
    e = record(estimate, ESTIMATE)
    for i in range(2):
        s.places[i] = s.places[i + 1]
        s.trailer_places[i] = s.trailer_places[i + 1]
        for j in range(len(e.state)):
            s.states[i, j] = s.states[i + 1, j]
        for j in range(MAPPED):
            s.disturbances[i, j] = s.disturbances[i + 1, j]
    s.places[2] = s.distance
    for j in range(len(e.state)):
        s.states[2, j] = e.state[j]
    for j in range(MAPPED):
        s.disturbances[2, j] = e.disturbance[j]
    s.ticks = min(s.ticks + 1.0, 3.0)


@cached_njit(error_model="numpy", nogil=True)
def _record_points(
    before: float, estimate: FloatArray, path: TractorPath, state: FloatArray
) -> None:
    """Write the axle point at all places from `before` to the present distance."""
    s = record(state, FORESIGHT)
    e = record(estimate, ESTIMATE)
    cell = math.floor(before / _CELL_M) + 1
    while cell * _CELL_M <= s.distance:
        share = (cell * _CELL_M - before) / (s.distance - before)
        for i in range(2):
            last = s.states[1, State.X + i]
            path.points[cell % _PLACES, i] = last + share * (e.state[State.X + i] - last)
        cell += 1


@cached_njit(error_model="numpy", nogil=True)
def _record_roll(
    rows: FloatArray, estimate: FloatArray, path: TractorPath, state: FloatArray
) -> None:
    """Write the roll of the tractor's IMU up to its last sample."""
    s = record(state, FORESIGHT)
    e = record(estimate, ESTIMATE)
    for i in range(len(rows)):
        if int(rows[i, SampleColumn.SENSOR]) != _IMU:
            continue
        age_s = e.time_s - rows[i, SampleColumn.TIME_S]
        place = s.distance - e.state[State.V] * age_s
        _extend(Signal.ROLL, place, rows[i, SampleColumn.SECOND], path, state)


@cached_njit(error_model="numpy", nogil=True)
def _extend(signal: int, place: float, value: float, path: TractorPath, state: FloatArray) -> None:
    """Write the integral of a signal up to a place ahead, at which it has a value.

    Between two such places a signal is linear.
    """
    s = record(state, FORESIGHT)
    begin = s.known_to[signal]
    span = place - begin
    if not (span > 0.0 and math.isfinite(value)):
        return
    slope = (value - s.value[signal]) / span
    cell = math.floor(begin / _CELL_M) + 1
    while cell * _CELL_M <= place:
        along = cell * _CELL_M - begin
        until = s.integral[signal] + along * (s.value[signal] + 0.5 * slope * along)
        path.integrals[cell % _PLACES, signal] = until
        cell += 1
    s.integral[signal] += 0.5 * span * (s.value[signal] + value)
    s.value[signal] = value
    s.known_to[signal] = place


@cached_njit(error_model="numpy", nogil=True)
def _place_of_trailer(
    guess: float, estimate: FloatArray, path: TractorPath, state: FloatArray
) -> float:
    """Return the place of the trailer's axle on the path of the tractor, and note how far beside.

    Before the path, `guess` is returned.
    """
    s = record(state, FORESIGHT)
    e = record(estimate, ESTIMATE)
    place = guess
    for _ in range(_PROJECTIONS):
        cell = math.floor(place / _CELL_M)
        if (cell - 1) * _CELL_M < s.begin or (cell + 2) * _CELL_M > s.distance:
            return guess
        behind = path.points[(cell - 1) % _PLACES]
        here = path.points[cell % _PLACES]
        ahead = path.points[(cell + 2) % _PLACES]
        dx = ahead[0] - behind[0]
        dy = ahead[1] - behind[1]
        length = math.hypot(dx, dy)
        if length == 0.0:
            return guess
        x = e.trailer_xy[0] - here[0]
        y = e.trailer_xy[1] - here[1]
        place = cell * _CELL_M + (x * dx + y * dy) / length
        s.beside = (dx * y - dy * x) / length
    return place


@cached_njit(error_model="numpy", nogil=True)
def _record_motion(parameters: FloatArray, path: TractorPath, state: FloatArray) -> None:
    """Record what the motion of the last three ticks shows beside the disturbances.

    The part of the tractor goes into its path, that of the trailer corrects the regression.
    """
    s = record(state, FORESIGHT)
    period_s = 0.5 * (s.places[2] - s.places[0]) / s.states[1, State.V]
    raw = local((MAPPED,))
    shown(s.states, period_s, parameters, raw)
    for i in range(MAPPED):
        raw[i] -= s.disturbances[1, i]
    _extend(Signal.SLIP, s.places[1], raw[Disturbance.SLIP_T], path, state)
    _extend(Signal.STEERING, s.places[1], raw[Disturbance.STEERING], path, state)

    slip = raw[Disturbance.SLIP_I]
    travel = s.trailer_places[1] - s.trailer_places[0]
    if math.isnan(s.step_begin) or math.isnan(s.slip) or not math.isfinite(slip):
        s.step_begin = s.trailer_places[1]
        s.step_integral = 0.0
    else:
        s.step_integral += 0.5 * (s.slip + slip) * travel
    s.slip = slip
    span = s.trailer_places[1] - s.step_begin
    if span >= _STEP_M and s.step_begin - _REACH_M >= s.begin:
        _correct(s.step_begin, span, s.step_integral / span, path, state)
    if span >= _STEP_M or span < 0.0:
        s.step_begin = s.trailer_places[1]
        s.step_integral = 0.0


@cached_njit(error_model="numpy", nogil=True)
def _integral(signal: int, at: float, path: TractorPath, state: FloatArray) -> float:
    """Return the integral of a signal up to a place, NaN where it is not known."""
    s = record(state, FORESIGHT)
    cell = math.floor(at / _CELL_M)
    if cell * _CELL_M < s.begin or (cell + 1) * _CELL_M > s.known_to[signal]:
        return math.nan
    if s.distance - at > (_PLACES - 2) * _CELL_M:
        return math.nan
    low = path.integrals[cell % _PLACES, signal]
    high = path.integrals[(cell + 1) % _PLACES, signal]
    return low + (at / _CELL_M - cell) * (high - low)


@cached_njit(error_model="numpy", nogil=True)
def _mean(
    signal: int, middle: float, half_width: float, path: TractorPath, state: FloatArray
) -> float:
    """Return the mean of a signal about a place, NaN where it is not known."""
    before = _integral(signal, middle - half_width, path, state)
    after = _integral(signal, middle + half_width, path, state)
    return (after - before) / (2.0 * half_width)


@cached_njit(error_model="numpy", nogil=True)
def _write_signals(
    begin: float, span: float, path: TractorPath, state: FloatArray, signals: FloatArray
) -> None:
    """Write the signals (15,) about a step of the trailer; 0 of those that are not known."""
    middle = begin + 0.5 * span
    half_width = max(_HALF_WIDTH_M, 0.5 * span)
    for n in range(_TAPS):
        offset = _SPACING_M * (n - 0.5 * (_TAPS - 1))
        lower = _mean(Signal.ROLL, begin + offset, _HALF_WIDTH_M, path, state)
        upper = _mean(Signal.ROLL, begin + span + offset, _HALF_WIDTH_M, path, state)
        signals[n] = (upper - lower) / span
        for signal in range(Signal.SLIP, _SIGNALS):
            at = signal * _TAPS + n
            signals[at] = _mean(signal, middle + offset, half_width, path, state)
    for n in range(_SIZE):
        if math.isnan(signals[n]):
            signals[n] = 0.0


@cached_njit(error_model="numpy", nogil=True)
def _forecast(signals: FloatArray, state: FloatArray) -> float:
    """Return the slip that the coefficients in use make of signals (15,) [rad]."""
    s = record(state, FORESIGHT)
    total = 0.0
    for n in range(_SIZE):
        total += s.used[n] * signals[n]
    return total


@cached_njit(error_model="numpy", nogil=True)
def _correct(begin: float, span: float, slip: float, path: TractorPath, state: FloatArray) -> None:
    """Compare a forecast with the mean slip of a step, and correct the coefficients by it.

    The noise of a mean falls with its length. Coefficients walk, their variance keeps to the prior.
    """
    s = record(state, FORESIGHT)
    signals = local((_SIZE,))
    gain = local((_SIZE,))
    _write_signals(begin, span, path, state, signals)
    _compare(span, slip, _forecast(signals, state), state)

    error = slip
    variance = _NOISE_SD * _NOISE_SD * _STEP_M / span
    for i in range(_SIZE):
        gain[i] = 0.0
        for j in range(_SIZE):
            gain[i] += s.covariance[i, j] * signals[j]
        variance += gain[i] * signals[i]
        error -= s.coefficients[i] * signals[i]
    for i in range(_SIZE):
        s.coefficients[i] += gain[i] * error / variance
        for j in range(_SIZE):
            s.covariance[i, j] -= gain[i] * gain[j] / variance
    for i in range(_SIZE):
        prior = _PRIOR_SD[i // _TAPS] ** 2
        walked = s.covariance[i, i] + prior * span / _WALK_M
        s.covariance[i, i] = min(walked, prior)

    s.held_m += span
    if s.held_m >= _HOLD_M:
        s.held_m = 0.0
        for i in range(_SIZE):
            s.used[i] = s.next_used[i]
            s.next_used[i] = s.coefficients[i]


@cached_njit(error_model="numpy", nogil=True)
def _compare(span: float, slip: float, forecast: float, state: FloatArray) -> None:
    """Take a forecast and the slip that came into the means, and write the share to be expected.

    The slope b of slips on forecasts has the variance (1 - R^2) slip^2 / (n forecast^2) over n
    independent ones. Of a forecast the share b (1 - 4 var(b) / b^2) is used, within [0, 1]. With 1
    in the place of 4 it is that of empirical Bayes (Efron and Morris 1973); with 4 it is 0 up to
    two standard deviations, where the likeness may be chance.
    """
    s = record(state, FORESIGHT)
    weight = span / min(s.compared_m + span, _MEMORY_M)
    s.compared_m = min(s.compared_m + span, _MEMORY_M)
    s.slip_power += weight * (slip * slip - s.slip_power)
    s.forecast_power += weight * (forecast * forecast - s.forecast_power)
    s.product += weight * (slip * forecast - s.product)

    s.share = 0.0
    if s.product > 0.0 and s.compared_m >= _WARM_UP_M:
        explained = s.product * s.product / (s.forecast_power * s.slip_power)
        independent = s.compared_m / _INDEPENDENT_M
        chance = (1.0 - explained) / (independent * explained)
        slope = min(s.product / s.forecast_power, 1.0)
        s.share = slope * max(0.0, 1.0 - _DEVIATIONS * _DEVIATIONS * chance)


@cached_njit(error_model="numpy", nogil=True)
def _share(state: FloatArray) -> float:
    """Return the share of a forecast that is used: less where the trailer's path is another."""
    s = record(state, FORESIGHT)
    if math.isnan(s.distance):
        return 0.0
    beside = s.beside / _BESIDE_M
    return s.share * 2.0 ** (-beside * beside)


@cached_njit(error_model="numpy", nogil=True)
def write_ahead(
    period_s: float, lead_s: float, path: TractorPath, state: FloatArray, result: FloatArray
) -> None:
    """Write `Foresight.ahead` into `result` (count, 3)."""
    s = record(state, FORESIGHT)
    share = _share(state)
    s.expected.slip_i = 0.0
    s.expected.share = share
    if share == 0.0:
        return
    signals = local((_SIZE,))
    speed = s.states[2, State.V]
    span = speed * period_s
    begin = s.trailer_places[2] + speed * lead_s
    for j in range(len(result)):
        if begin + span > s.distance:
            break
        _write_signals(begin, span, path, state, signals)
        result[j, Disturbance.SLIP_I] = share * _forecast(signals, state)
        begin += span
    if len(result):
        s.expected.slip_i = result[0, Disturbance.SLIP_I]
