"""Map of disturbances by place, from the passes of a reference over its own line."""

from __future__ import annotations

import math
from copy import deepcopy
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidTuning
from ..jit import cached_njit, record
from ..layout import ESTIMATE
from ..models.augmented_state import MAPPED, VehicleParameter, vehicle_parameters
from ..reference.reference import Reference
from ..types import Disturbance, FloatArray, State
from ..vehicle import Vehicle

_BESIDE_M: Final = 0.5  # between a pass and an earlier one on the same line, at most
_TURNED_RAD: Final = 0.2  # between their headings, at most
_SHARE: Final = 0.6  # of the distance between two ticks, ahead or behind, that belongs to the first
_AFTER_M: Final = 10.0  # of driving between both passes, at least
_WEIGHT_M: Final = _BESIDE_M / _TURNED_RAD  # of a heading, relative to a position
_SMOOTH_M: Final = (1.2, 1.2, 0.8)
"""Standard deviation of the Gaussian weights along the path [m]: between the error of a difference
of estimated positions and the length of a patch; of 0.5 to 2 m the best on tuning seeds."""
_REACH_M: Final = 3.0  # beyond which a row has no weight
_SETTLED_S: Final = 3.0  # from the first estimate on, until which nothing is learnt; assumed
_ERROR: Final = (6.4e-5, 6.4e-5, 1.6e-5)
"""Variance of what a pass tells [rad^2], by the truth on tuning seeds: 8, 8 and 4 mrad."""
_CHANGE: Final = (4e-6, 4e-6, 1e-6)  # of the ground from pass to pass; assumed
_LARGEST: Final = 0.25  # of a disturbance that is believed [rad]
_LEAST_SPEED: Final = 0.1  # [m/s] at which the motion shows disturbances
_MISSING_SHARE: Final = 0.1  # of the weights of a place that may be missing, at most

_POSTURE: Final = slice(0, 5)  # columns of `FieldMap.rows`, see there
_DISTANCE: Final = 5
_MEAN: Final = slice(6, 9)
_VARIANCE: Final = slice(9, 12)
_ROW: Final = 12

_STATES: Final = len(State)

MAP_STATE: Final = np.dtype(
    [
        ("next_place", "f8"),  # row of the place that is smoothed next
        ("last_row", "f8"),  # row of the last tick that was observed
        ("unsettled", "f8"),  # ticks that are still left out after the start
        ("states", "f8", (3, _STATES)),  # estimates at the last three ticks, oldest first
        ("known", "f8", 3),  # 1 for each of them that shows the vehicle's motion
        ("count", "f8", MAPPED),  # of all first means of a place
        ("sum", "f8", MAPPED),
        ("sum_of_squares", "f8", MAPPED),
        ("share", "f8", MAPPED),  # of a change between means that is to be expected
    ]
)
"""Record of the state of a map, without its places."""


class Places(NamedTuple):
    """Arrays of a map with a row for each tick of its reference, after those of an earlier map."""

    distance: FloatArray  # (T,) [m]
    place: NDArray[np.int64]  # (T,) row of the place to which a tick belongs
    raw: FloatArray  # (T, 3) disturbances that the motion showed at a tick, NaN where it did not
    mean: FloatArray  # (T, 3) [rad] disturbances of a place
    variance: FloatArray  # (T, 3) [rad^2]; infinite where a place is not known


class FieldMap:
    """Disturbances of the vehicle by place: learnt on every pass, known on the next one.

    A place is a control tick of the reference on its first pass over a line; later ticks belong to
    the nearest place within 0.5 m and 0.2 rad. What a pass shows is the motion of the estimate. Of
    its position, its headings and the equations of `ttempc.models.kinematics.articulated`, the side
    slips of both axles and the error of the front steering angle follow by differences over two
    periods; Gaussian weights along the path, ahead and behind alike, take noise and lag off. Passes
    are fused as a Kalman filter would, with a variance at every place.

    A pass tells a disturbance with an offset of its own (tyres, offsets of sensors), which the
    estimator follows. What the map is asked for is therefore changes from place to place alone,
    and of those what the estimate's map-fixed slips, see `MapDisturbance`, do not change already.

    The state is arrays that a copy copies; the first pass and the ticks before it are not
    different from those without a map.

    Args:
        reference: what is driven, with the parameters of the model.
        period_s: control period [s].
        lead_s: time by which the reference of the controller is ahead [s].
        earlier: `rows` of a map of an earlier drive, which counts as a pass.

    Raises:
        InvalidTuning: `earlier` are no such rows.
    """

    def __init__(
        self,
        reference: Reference,
        period_s: float,
        lead_s: float = 0.0,
        earlier: FloatArray | None = None,
    ) -> None:
        grid = reference.on_grid(period_s, beyond=1)
        known = np.empty((0, _ROW)) if earlier is None else np.array(earlier, dtype=float)
        if known.ndim != 2 or known.shape[1] != _ROW or not np.isfinite(known).all():
            raise InvalidTuning(
                f"learn_field: got an array {known.shape}, must be finite rows (n, {_ROW}) of a map"
            )
        self._first = len(known)  # row of tick 0
        gear = np.sign(grid.state[:, State.V])
        posture = np.column_stack([grid.state[:, : State.PSI_I + 1], gear])
        self._posture = np.concatenate([known[:, _POSTURE], posture])
        before = known[:, _DISTANCE] - known[:, _DISTANCE].max(initial=0.0) - 2.0 * _AFTER_M
        distance = np.concatenate([before, grid.distance_m])
        place = places(self._posture[:, :3], distance)
        count = len(place)
        self._places = Places(
            distance,
            place,
            raw=np.full((count, MAPPED), math.nan),
            mean=np.zeros((count, MAPPED)),
            variance=np.full((count, MAPPED), np.inf),
        )
        self._places.mean[: self._first] = known[:, _MEAN]
        self._places.variance[: self._first] = known[:, _VARIANCE]

        self._state = np.zeros(MAP_STATE.itemsize // 8)
        self._record["next_place"] = self._first
        self._record["last_row"] = self._first - 2
        self._record["unsettled"] = math.ceil(_SETTLED_S / period_s)
        for mean in known[:, _MEAN]:
            gather(mean, self._state)
        self._slope = np.zeros(2)  # (SIDE_X, SIDE_Y) of the last estimate [rad]
        self._period_s = period_s
        self._none = np.zeros(MAPPED)
        self.exchange(reference.vehicle, lead_s)

    def exchange(self, vehicle: Vehicle, lead_s: float) -> None:
        """Learn on with other model parameters and another lead of the controller."""
        self._parameters = vehicle_parameters(vehicle)
        self._lead = round(lead_s / self._period_s)

    def warm_up(self) -> None:
        """Compile or load what a tick needs; no later result changes."""
        twin = deepcopy(self)
        for k in range(3):
            twin.observe(k, np.zeros(ESTIMATE.itemsize // 8), True)

    @property
    def _record(self) -> np.void:
        """View of the state with names; a copy of this object has its own."""
        return self._state.view(MAP_STATE)[0]

    @property
    def rows(self) -> FloatArray:
        """The map (n, 12): x, y [m], both headings [rad], sign of speed, distance [m], (3,) twice.

        These are means [rad] and variances [rad^2] of the disturbances.
        """
        places = self._places
        known = np.isfinite(places.variance).all(axis=1)
        columns = [self._posture, places.distance, places.mean, places.variance]
        return np.column_stack(columns)[known]

    def observe(self, k: int, row: FloatArray, usable: bool) -> None:
        """Take in the record `ESTIMATE` at tick `k` of the reference.

        Where the reference waits, and at ticks that are not `usable`, the pass shows nothing.
        """
        at = k + self._first
        if at < len(self._places.place):
            self._slope[:] = row.view(ESTIMATE)["map_disturbance"][0, :2]
            observe_field(
                at, row, usable, self._period_s, self._parameters, self._places, self._state
            )

    def change(self, k: int) -> FloatArray:
        """Return by how much the disturbances change up to tick k from the tick before, (3,).

        0 where one of both places is not known, and where the reference has waited.
        """
        at = k + self._first
        place = self._places.place
        if at != self._record["last_row"] + 1 or at >= len(place):
            return self._none
        before = place[at - 1]
        now = place[at]
        passed = now < at and before < at - 1  # both places were driven over before
        if not passed or not self._places.variance[[before, now]].max() < math.inf:
            return self._none
        return self._record["share"] * np.subtract(*self._rest([now, before]))

    def known(self, k: int) -> float:
        """Return the share of the variance of the trailer's side slip that is known at tick k."""
        row = min(k + self._first + self._lead, len(self._places.place) - 1)
        place = self._places.place[row]
        if place >= row or math.isinf(self._places.variance[place, Disturbance.SLIP_I]):
            return 0.0
        return float(self._record["share"][Disturbance.SLIP_I])

    def _rest(self, place: NDArray[np.int64] | list[int]) -> FloatArray:
        """Return the means of places (n,) without what the slope of the estimate does, (n, 3)."""
        rest = self._places.mean[place]
        gear = self._posture[place, -1]
        x, y = self._slope
        for i, column in enumerate((State.PSI_T, State.PSI_I)):
            heading = self._posture[place, column]
            rest[:, i] -= gear * (y * np.cos(heading) - x * np.sin(heading))
        return rest

    def ahead(self, k: int, count: int) -> FloatArray:
        """Return the changes from tick k to ticks k, k + 1, ... k + count - 1, (count, 3).

        From the first place on that is not known nothing changes.
        """
        rows = np.arange(count) + (k + self._first + self._lead)
        rows = np.minimum(rows, len(self._places.place) - 1)
        place = self._places.place[rows]
        unknown = (place >= rows) | np.isinf(self._places.variance[place]).any(axis=1)
        values = self._rest(place)
        if unknown.any():
            last = int(np.argmax(unknown))
            values[last:] = values[max(last - 1, 0)]
        return self._record["share"] * (values - values[0])


def places(posture: FloatArray, distance: FloatArray) -> NDArray[np.int64]:
    """Return the place of every tick (T,): the first tick at which the reference was there.

    `posture` (T, 3) are x, y [m] and heading [rad] of the tractor, `distance` (T,) is what it has
    driven [m].
    """
    from scipy.spatial import KDTree  # takes a while to load, and most drives need no map

    # Pairs of ticks near each other in position and heading
    x, y, heading = posture.T
    turned_x = _WEIGHT_M * np.cos(heading)
    turned_y = _WEIGHT_M * np.sin(heading)
    points = np.column_stack([x, y, turned_x, turned_y])
    place = np.arange(len(points))
    first, later = KDTree(points).query_pairs(_BESIDE_M, output_type="ndarray").T

    # Those of different passes whose distance is across the path
    gap = points[later] - points[first]
    along = gap[:, 0] * np.cos(heading[first]) + gap[:, 1] * np.sin(heading[first])
    step = np.gradient(distance)[first]
    apart = (distance[later] - distance[first] > _AFTER_M) & (np.abs(along) <= _SHARE * step)
    first = first[apart]
    later = later[apart]
    if not len(first):
        return place

    # Of the places of a tick, one of the earliest pass
    earliest = np.full(len(points), len(points))
    np.minimum.at(earliest, later, first)
    same_pass = distance[first] - distance[earliest[later]] < _AFTER_M
    place[later[same_pass]] = first[same_pass]
    return place


@cached_njit(error_model="numpy", nogil=True)
def observe_field(
    at: int,
    row: FloatArray,
    usable: bool,
    period_s: float,
    parameters: FloatArray,
    places: Places,
    state: FloatArray,
) -> None:
    """Do `FieldMap.observe` at a row of `places`; `state` is the record `MAP_STATE`."""
    e = record(row, ESTIMATE)
    s = record(state, MAP_STATE)
    newest = len(s.known) - 1
    if at != s.last_row + 1:  # the reference waits, or ticks were left out
        s.known[:] = 0.0
    if at == s.last_row:
        return
    s.last_row = at
    if s.unsettled > 0:
        s.unsettled -= 1
        usable = False

    # The last three estimates move on by one
    for i in range(newest):
        s.known[i] = s.known[i + 1]
        for j in range(_STATES):
            s.states[i, j] = s.states[i + 1, j]
    s.known[newest] = 1.0 if usable and math.isfinite(e.state[0]) else 0.0
    for j in range(_STATES):
        s.states[newest, j] = e.state[j]
    if s.known[0] * s.known[1] * s.known[2] != 0.0:
        shown(s.states, period_s, parameters, places.raw[at - 1])

    # Places whose neighbours ahead are all passed
    next_place = int(s.next_place)
    while places.distance[at] - places.distance[next_place] > _REACH_M:
        _fuse(next_place, places, state)
        next_place += 1
    s.next_place = next_place


@cached_njit(error_model="numpy", nogil=True)
def shown(states: FloatArray, period_s: float, parameters: FloatArray, raw: FloatArray) -> None:
    """Write the disturbances (3,) that the motion over two periods shows, NaN at low speed.

    `states` (3, 7) are those at the begin, in the middle and at the end, see `State`. The equations
    of `ttempc.models.kinematics.articulated` are solved for the side slips and the steering.
    """
    begin = states[0]
    middle = states[1]
    end = states[2]
    v = middle[State.V]
    if abs(v) < _LEAST_SPEED:
        raw[:] = math.nan
        return
    span_s = 2.0 * period_s
    dx = end[State.X] - begin[State.X]
    dy = end[State.Y] - begin[State.Y]
    yaw_t = _turn(end[State.PSI_T] - begin[State.PSI_T]) / span_s
    yaw_i = _turn(end[State.PSI_I] - begin[State.PSI_I]) / span_s
    rate_i = (end[State.DELTA_I] - begin[State.DELTA_I]) / span_s

    a = parameters[VehicleParameter.HITCH_OFFSET]
    d = parameters[VehicleParameter.DRAWBAR_LENGTH]
    length_i = parameters[VehicleParameter.TRAILER_LENGTH]
    length_i = length_i + parameters[VehicleParameter.TRAILER_TURNING_OFFSET]
    psi_t = middle[State.PSI_T]
    lam = psi_t - middle[State.PSI_I]
    cos_i = math.cos(middle[State.DELTA_I])
    slip_t = (dy * math.cos(psi_t) - dx * math.sin(psi_t)) / (v * span_s)
    across = yaw_i * (length_i + d * cos_i) + a * yaw_t * math.cos(lam) + d * rate_i * cos_i
    turned_by = math.atan(yaw_t * parameters[VehicleParameter.WHEELBASE] / v)
    raw[Disturbance.SLIP_T] = slip_t
    raw[Disturbance.SLIP_I] = math.sin(lam) + slip_t * math.cos(lam) - across / v
    raw[Disturbance.STEERING] = turned_by - middle[State.DELTA_T]


@cached_njit(error_model="numpy", nogil=True)
def _turn(angle: float) -> float:
    """Return an angle modulo a turn [rad]."""
    return angle - math.tau * round(angle / math.tau)


@cached_njit(error_model="numpy", nogil=True)
def _fuse(at: int, places: Places, state: FloatArray) -> None:
    """Smooth what the pass showed at a row, and fuse it with what earlier passes have shown.

    Where more than a tenth of the weights is missing the pass tells nothing.
    """
    place = places.place[at]
    first = False
    for i in range(MAPPED):
        value = _smoothed(at, i, places)
        if math.isnan(value):
            return
        value = min(max(value, -_LARGEST), _LARGEST)
        if places.variance[place, i] == math.inf:
            places.mean[place, i] = value
            places.variance[place, i] = _ERROR[i]
            first = True
        else:  # a step of a Kalman filter
            prior = places.variance[place, i] + _CHANGE[i]
            gain = prior / (prior + _ERROR[i])
            places.mean[place, i] += gain * (value - places.mean[place, i])
            places.variance[place, i] = (1.0 - gain) * prior
    if first:
        gather(places.mean[place], state)


@cached_njit(error_model="numpy", nogil=True)
def _smoothed(at: int, i: int, places: Places) -> float:
    """Return the Gaussian mean of the i-th disturbance about a row, NaN where too much is missing.

    Rows before it are summed first, from the nearest on, then the row itself and those after it.
    """
    total = 0.0
    weights = 0.0
    lost = 0.0
    for step in range(-1, 2, 2):
        j = at if step > 0 else at - 1
        while 0 <= j < len(places.raw):
            distance = places.distance[j] - places.distance[at]
            if abs(distance) > _REACH_M:
                break
            along = distance / _SMOOTH_M[i]
            weight = math.exp(-0.5 * along * along)
            if math.isnan(places.raw[j, i]):
                lost += weight
            else:
                weights += weight
                total += weight * places.raw[j, i]
            j += step
    if weights == 0.0 or lost > _MISSING_SHARE * (weights + lost):
        return math.nan
    return total / weights


@cached_njit(error_model="numpy", nogil=True)
def gather(mean: FloatArray, state: FloatArray) -> None:
    """Add the first mean (3,) of a place to the sums of a `MAP_STATE`, and write the shares.

    Of all means the variance V is that of the ground and of the error R: the share 1 - R / V of a
    change is to be expected (Efron and Morris 1973, empirical Bayes), 0 where V is below R.
    """
    s = record(state, MAP_STATE)
    for i in range(MAPPED):
        s.count[i] += 1.0
        s.sum[i] += mean[i]
        s.sum_of_squares[i] += mean[i] * mean[i]
        average = s.sum[i] / s.count[i]
        variance = s.sum_of_squares[i] / s.count[i] - average * average
        s.share[i] = max(0.0, 1.0 - _ERROR[i] / variance) if variance > 0.0 else 0.0
