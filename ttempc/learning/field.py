"""Map of disturbances by place, from the passes of a reference over its own line."""

from __future__ import annotations

import math
from copy import deepcopy
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidTuning
from ..jit import cached_njit, record
from ..layout import ESTIMATE
from ..models.augmented_state import MAPPED, VehicleParameter, vehicle_parameters
from ..reference.reference import Reference
from ..types import FloatArray, State
from ..vehicle import Vehicle

_BESIDE_M: Final = 0.5  # between a pass and an earlier one on the same line
_TURNED_RAD: Final = 0.2  # between their headings
_SHARE: Final = 0.6  # of the way between two ticks, ahead or behind, that belongs to the first
_AFTER_M: Final = 10.0  # of driving at least between both
_WEIGHT_M: Final = _BESIDE_M / _TURNED_RAD  # of a heading beside a position
_SMOOTH_M: Final = (1.2, 1.2, 0.8)
"""Standard deviation of the Gaussian weights along the path [m]: between the error of a difference
of estimated positions and the length of a patch; of 0.5 to 2 m the best on tuning seeds."""
_REACH_M: Final = 3.0  # of the weights
_SETTLED_S: Final = 3.0  # from the first estimate on, until which nothing is learnt; assumed
_ERROR: Final = (6.4e-5, 6.4e-5, 1.6e-5)
"""Variance of what a pass tells [rad^2], by the truth on tuning seeds: 8, 8 and 4 mrad."""
_CHANGE: Final = (4e-6, 4e-6, 1e-6)  # of the ground from pass to pass; assumed
_LARGEST: Final = 0.25  # [rad]

_ROW: Final = 12  # of `FieldMap.rows`
_SEEN: Final = 8  # of an estimate: x, y, psi_t, psi_i, delta_t, delta_i, v, and 1 if it is known


class FieldMap:
    """Disturbances of the vehicle by place: learnt on every pass, known on the next one.

    A place is a control tick of the reference on its first pass over a line; later ticks belong to
    the nearest place within 0.5 m and 0.2 rad. What a pass shows is the motion of the estimate. Of
    its position, its headings and the equations of `ttempc.models.kinematics.articulated`, the side
    slips of both axles and the angle beside the front steering follow by differences over two
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
        self._first = len(known)  # of the arrays, place of tick 0
        before = known[:, 5] - known[:, 5].max(initial=0.0) - 2.0 * _AFTER_M
        gear = np.sign(grid.state[:, State.V])
        posture = np.column_stack([grid.state[:, : State.PSI_I + 1], gear])
        self._posture = np.concatenate([known[:, :5], posture])
        self._distance = np.concatenate([before, grid.distance_m])
        self._place = places(self._posture[:, :3], self._distance)
        count = len(self._place)
        self._mean, self._variance = np.zeros((count, MAPPED)), np.full((count, MAPPED), np.inf)
        self._mean[: self._first], self._variance[: self._first] = known[:, 6:9], known[:, 9:]
        self._raw = np.full((count, MAPPED), math.nan)
        # number, sum and sum of squares of all first means, and the share of them that is true
        self._spread = np.zeros((4, MAPPED))
        for mean in known[:, 6:9]:
            gather(mean, self._spread)
        self._seen = np.zeros((3, _SEEN))
        self._slope = np.zeros(2)  # (SIDE_X, SIDE_Y) of the last estimate [rad]
        # next place to smooth, last one observed, ticks to leave out
        settled = math.ceil(_SETTLED_S / period_s)
        self._ticks = np.array([self._first, self._first - 2, settled])
        self._period_s, self._none = period_s, np.zeros(MAPPED)
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
    def rows(self) -> FloatArray:
        """The map (n, 12): x, y [m], both headings [rad], sign of speed, distance [m], (3,) twice.

        These are means [rad] and variances [rad^2] of the disturbances.
        """
        known = np.isfinite(self._variance).all(axis=1)
        parts = self._posture, self._distance[:, None], self._mean, self._variance
        return np.concatenate(parts, axis=1)[known]

    def observe(self, k: int, row: FloatArray, usable: bool) -> None:
        """Take in the record `ESTIMATE` at tick `k` of the reference.

        Where the reference waits, and at ticks that are not `usable`, the pass shows nothing.
        """
        if (k := k + self._first) < len(self._place):
            self._slope[:] = row.view(ESTIMATE)["map_disturbance"][0, :2]
            observe_field(
                k,
                row,
                usable,
                self._period_s,
                self._parameters,
                self._distance,
                self._place,
                self._seen,
                self._ticks,
                self._raw,
                self._mean,
                self._variance,
                self._spread,
            )

    def change(self, k: int) -> FloatArray:
        """Return by how much the disturbances change up to tick k from the tick before, (3,).

        0 where one of both places is not known, and where the reference has waited.
        """
        k += self._first
        if k != self._ticks[1] + 1 or k >= len(self._place):
            return self._none
        before, now = self._place[k - 1], self._place[k]
        known = now < k and before < k - 1 and self._variance[[before, now]].max() < math.inf
        return self._spread[3] * np.subtract(*self._rest([now, before])) if known else self._none

    def _rest(self, place: NDArray[np.int64] | list[int]) -> FloatArray:
        """Return the means of places (n,) without what the slope of the estimate does, (n, 3)."""
        rest = self._mean[place]
        for i, column in enumerate((State.PSI_T, State.PSI_I)):
            heading, gear = self._posture[place, column], self._posture[place, -1]
            x, y = self._slope
            rest[:, i] -= gear * (y * np.cos(heading) - x * np.sin(heading))
        return rest

    def ahead(self, k: int, count: int) -> FloatArray:
        """Return the changes from tick k to ticks k, k + 1, ... k + count - 1, (count, 3).

        From the first place on that is not known nothing changes.
        """
        ticks = np.arange(count) + (k + self._first + self._lead)
        ticks = np.minimum(ticks, len(self._place) - 1)
        place = self._place[ticks]
        unknown = (place >= ticks) | np.isinf(self._variance[place]).any(axis=1)
        values = self._rest(place)
        if unknown.any():
            last = int(np.argmax(unknown))
            values[last:] = values[max(last - 1, 0)]
        return self._spread[3] * (values - values[0])


def places(pose: FloatArray, distance: FloatArray) -> NDArray[np.int64]:
    """Return the place of every tick (T,): the first tick at which the reference was there.

    `pose` (T, 3) are x, y [m] and heading [rad] of the tractor, `distance` (T,) is what it drives.
    """
    from scipy.spatial import KDTree  # takes a while to load, and most drives need no map

    x, y, heading = pose.T
    turned = _WEIGHT_M * np.cos(heading), _WEIGHT_M * np.sin(heading)
    points = np.column_stack([x, y, *turned])
    place = np.arange(len(points))
    first, later = KDTree(points).query_pairs(_BESIDE_M, output_type="ndarray").T
    gap = points[later] - points[first]
    along = gap[:, 0] * np.cos(heading[first]) + gap[:, 1] * np.sin(heading[first])
    step = np.gradient(distance)[first]
    apart = (distance[later] - distance[first] > _AFTER_M) & (np.abs(along) <= _SHARE * step)
    first, later = first[apart], later[apart]
    if not len(first):
        return place
    earliest = np.full(len(points), len(points))
    np.minimum.at(earliest, later, first)
    same = distance[first] - distance[earliest[later]] < _AFTER_M  # the earliest pass
    first, later = first[same], later[same]
    place[later] = first
    return place


@cached_njit(error_model="numpy", nogil=True)
def observe_field(
    k: int,
    row: FloatArray,
    usable: bool,
    period_s: float,
    parameters: FloatArray,
    distance: FloatArray,
    place: NDArray[np.int64],
    seen: FloatArray,
    ticks: NDArray[np.int64],
    raw: FloatArray,
    mean: FloatArray,
    variance: FloatArray,
    spread: FloatArray,
) -> None:
    """Do `FieldMap.observe`; the last six arrays are the state of a map."""
    e = record(row, ESTIMATE)
    if k == ticks[1]:  # the reference waits
        seen[:, _SEEN - 1] = 0.0
        return
    if k != ticks[1] + 1:
        seen[:, _SEEN - 1] = 0.0
    ticks[1] = k
    if ticks[2] > 0:
        ticks[2] -= 1
        usable = False
    for i in range(2):
        for j in range(_SEEN):
            seen[i, j] = seen[i + 1, j]
    now = seen[2]
    for i in range(7):
        now[i] = e.state[i]
    now[_SEEN - 1] = 1.0 if usable and math.isfinite(e.state[0]) else 0.0
    if seen[0, _SEEN - 1] * seen[1, _SEEN - 1] * seen[2, _SEEN - 1] != 0.0:
        shown(seen, period_s, parameters, raw[k - 1])
    while distance[k] - distance[ticks[0]] > _REACH_M:
        _fuse(ticks[0], distance, int(place[ticks[0]]), raw, mean, variance, spread)
        ticks[0] += 1


@cached_njit(error_model="numpy", nogil=True)
def shown(seen: FloatArray, period_s: float, parameters: FloatArray, raw: FloatArray) -> None:
    """Write the disturbances (3,) that the motion over two periods shows, NaN at low speed."""
    a, d = parameters[VehicleParameter.HITCH_OFFSET], parameters[VehicleParameter.DRAWBAR_LENGTH]
    length_i = parameters[VehicleParameter.TRAILER_LENGTH]
    length_i += parameters[VehicleParameter.TRAILER_TURNING_OFFSET]
    span_s = 2.0 * period_s
    psi_t, psi_i = seen[1, State.PSI_T], seen[1, State.PSI_I]
    delta_i, v = seen[1, State.DELTA_I], seen[1, State.V]
    if abs(v) < 0.1:
        raw[:] = math.nan
        return
    dx, dy = seen[2, 0] - seen[0, 0], seen[2, 1] - seen[0, 1]
    yaw_t = seen[2, State.PSI_T] - seen[0, State.PSI_T]
    yaw_t = (yaw_t - math.tau * round(yaw_t / math.tau)) / span_s
    yaw_i = seen[2, State.PSI_I] - seen[0, State.PSI_I]
    yaw_i = (yaw_i - math.tau * round(yaw_i / math.tau)) / span_s
    rate_i = (seen[2, State.DELTA_I] - seen[0, State.DELTA_I]) / span_s
    lam, cos_i = psi_t - psi_i, math.cos(delta_i)
    slip_t = (dy * math.cos(psi_t) - dx * math.sin(psi_t)) / (v * span_s)
    across = yaw_i * (length_i + d * cos_i) + a * yaw_t * math.cos(lam) + d * rate_i * cos_i
    raw[0] = slip_t
    raw[1] = math.sin(lam) + slip_t * math.cos(lam) - across / v
    raw[2] = math.atan(yaw_t * parameters[VehicleParameter.WHEELBASE] / v) - seen[1, State.DELTA_T]


@cached_njit(error_model="numpy", nogil=True)
def _fuse(
    k: int,
    distance: FloatArray,
    place: int,
    raw: FloatArray,
    mean: FloatArray,
    variance: FloatArray,
    spread: FloatArray,
) -> None:
    """Smooth what the pass showed at tick `k`, and fuse it with what earlier ones have told.

    Where more than a tenth of the weights is missing the pass tells nothing.
    """
    first = False
    for i in range(MAPPED):
        total = weights = lost = 0.0
        for way in range(-1, 2, 2):
            j = k if way > 0 else k - 1
            while 0 <= j < len(raw) and abs(distance[j] - distance[k]) <= _REACH_M:
                along = (distance[j] - distance[k]) / _SMOOTH_M[i]
                weight = math.exp(-0.5 * along * along)
                if math.isnan(raw[j, i]):
                    lost += weight
                else:
                    weights, total = weights + weight, total + weight * raw[j, i]
                j += way
        if weights == 0.0 or lost > 0.1 * (weights + lost):
            return
        value = min(max(total / weights, -_LARGEST), _LARGEST)
        if variance[place, i] == math.inf:
            mean[place, i], variance[place, i] = value, _ERROR[i]
            first = True
        else:
            prior = variance[place, i] + _CHANGE[i]
            gain = prior / (prior + _ERROR[i])
            mean[place, i] += gain * (value - mean[place, i])
            variance[place, i] = (1.0 - gain) * prior
    if first:
        gather(mean[place], spread)


@cached_njit(error_model="numpy", nogil=True)
def gather(mean: FloatArray, spread: FloatArray) -> None:
    """Add the mean (3,) of a place to `spread` (4, 3).

    Of all means the variance V is that of the ground and of the error R: the share 1 - R / V of a
    change is to be expected (Efron and Morris 1973, empirical Bayes), 0 where V is below R.
    """
    for i in range(MAPPED):
        spread[0, i] += 1.0
        spread[1, i] += mean[i]
        spread[2, i] += mean[i] * mean[i]
        average = spread[1, i] / spread[0, i]
        total = spread[2, i] / spread[0, i] - average * average
        spread[3, i] = max(0.0, 1.0 - _ERROR[i] / total) if total > 0.0 else 0.0
