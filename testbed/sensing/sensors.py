"""Sensors of the vehicle: readings of the truth with errors, rates and latencies.

GNSS samples are taken at the axle point, as the paper's model takes them ("point"), or at the
antenna above it, which a rolling or pitching vehicle moves. "raw" samples are the position of the
antenna. "corrected" samples are that position less the lever arm, turned by the roll and pitch of
the newest sample of that body's IMU. The heading for that turn is the true one: an error of the
heading would move the corrected point by height x sin(roll) x error, 3 mm at 0.1 rad and 1 deg.

The velocity of a receiver is that of the point whose position it delivers; of "corrected" positions
it is that of the axle point. It comes from the satellites, not from the positions, and so a fault
of the positions leaves it alone, unless the receiver derives it from them.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ttempc.jit import cached_njit, record
from ttempc.layout import SAMPLE, SampleColumn
from ttempc.sensors import ROW_OF, SENSORS, SensorKind, sensors_of_kind
from ttempc.types import FloatArray, Sensor

from ..discretisation import whole_steps
from ..randomness import generator
from ..truth import ANTENNA_COLUMNS, MOTION
from .receivers import EPOCH, EPOCH_SIZE, NORMALS, advance, new_state, receiver
from .sensor_errors import Correlated, ErrorSource, HeavyTailed, Wandering, White
from .sensor_specification import (
    ANGLE_RANGE_DEG,
    ImuSpecification,
    PlainSensor,
    SensorSpecification,
)

COMPONENTS: Final[dict[Sensor, tuple[str, ...]]] = {
    row.sensor: (*row.components, "status") if row.kind is SensorKind.POSITION else row.components
    for row in SENSORS
}
"""Components of a sample of each sensor with their units, in the order of `Measurement.value`.

The status of a position is `Measurement.status`.
The log derives its columns from this table: their names, their number and their order.
"""

NUMBER: Final = {row.sensor: int(row.index) for row in SENSORS}
"""`SensorIndex` of each sensor."""

_AHEAD: Final = 256  # samples of each sensor whose errors are drawn at once
_ENTRIES: Final = 3  # of a sample, at most
_DERIVED_S: Final = 4.0  # of the positions from which a receiver derives its velocity; assumed
_NO_SD: Final = np.zeros(1)
_NONE: Final = -1  # for a body or an antenna that a sensor does not use
_BODIES: Final = ("t", "i")  # ending of names in `MOTION`, in the order of the antennas
_TURNS: Final = 360.0 / ANGLE_RANGE_DEG  # of the deviation of an angle sensor in a turn

# Columns in a row of `TruthBlock`
_TIME: Final = MOTION.index("time_s")
_X: Final = MOTION.index("x_t")
_Y: Final = MOTION.index("y_t")
_YAWS: Final = tuple(MOTION.index(f"psi_{body}") for body in _BODIES)

_SENSOR: Final = np.dtype(
    [
        ("index", "i8"),  # number of the sensor, see `SensorIndex`
        ("every", "i8"),  # physics steps from sample to sample
        ("delay", "i8"),  # physics steps from sample to delivery
        ("length", "i8"),  # number of components of a sample
        ("columns", "i8", _ENTRIES),  # of the components in a row of `TruthBlock`
        ("resolution", "f8", _ENTRIES),  # of each component; 0: not quantised
        ("attitude_of", "i8"),  # body whose attitude an IMU measures, or `_NONE`
        ("corrected_by", "i8"),  # body whose attitude corrects the sample, or `_NONE`
        ("antenna", "i8"),  # whose error comes from `receivers.advance`, or `_NONE`
        ("velocity_of", "i8"),  # body whose receiver gives a velocity, or `_NONE`
        ("is_mean", "i8"),  # whether that is the mean since the last sample
        ("stated_sd", "f8"),  # that the receiver states of its velocity [m/s]
        ("offset", "f8"),  # of an angle sensor [rad]
        ("nonlinearity", "f8"),  # its largest deviation from a straight line [rad]
        ("phase", "f8"),  # of that deviation [rad]
    ]
)
"""Settings of one sensor, as a flat row of numbers."""

_ORDINARY: Final = {
    "attitude_of": _NONE,
    "corrected_by": _NONE,
    "antenna": _NONE,
    "velocity_of": _NONE,
    "is_mean": 0,
    "stated_sd": 0.0,
    "offset": 0.0,
    "nonlinearity": 0.0,
    "phase": 0.0,
}
"""Fields of a `_SENSOR` whose errors are its noise alone."""

_TRAVEL: Final = np.dtype(
    [
        ("x", "f8"),  # [m] last position of the tractor point, NaN before the first moment
        ("y", "f8"),
        ("distance", "f8"),  # [m] since the last epoch of the receivers
    ]
)


_TRACK: Final = np.dtype(
    [
        ("moment", "f8", 3),  # time [s] and place [m] of the last moment, NaN: none yet
        ("sample", "f8", 3),  # time and place of the last sample of the velocity
    ]
)
"""Places of a receiver from which its velocity follows."""


class _Suite(NamedTuple):
    """Settings and state of all sensors, for the compiled part."""

    sensors: FloatArray  # settings of each sensor, a row `_SENSOR`
    errors: FloatArray  # (sensors, samples ahead, entries) drawn errors
    used: NDArray[np.int64]  # (sensors,) errors that are used up
    attitudes: FloatArray  # (2, 2) of the bodies: roll, pitch [rad] as last measured
    levers: FloatArray  # (2, 3) [m] from axle points to antennas, frames of the bodies
    receivers: FloatArray  # record `RECEIVER`; empty where the errors are of no place
    solutions: FloatArray  # record `STATE` of the receivers
    travel: FloatArray  # of the tractor point, a record `_TRAVEL`
    tracks: FloatArray  # (2, ...) of the receivers, rows `_TRACK`


Change = Callable[[FloatArray], FloatArray]
"""Returns what arrives instead of samples: rows of `SAMPLE` entries, due physics step, sampling
time; the array is the receiver's own."""


class SensorSuite:
    """All sensors of the vehicle, sampled on a common count of physics steps.

    A change, such as a fault, replaces samples between sensor and delivery (`changes`).

    Args:
        specification: rates, errors and latencies.
        timestep: physics step [s]; every period and latency must be a whole number of them.
        seed: seed of the run.
        lever_arms: from tractor and trailer point to their antennas, (2, 3) [m], bodies' frames.

    Raises:
        InvalidPlant: a rate or a latency that no whole number of physics steps gives.
    """

    def __init__(
        self, specification: SensorSpecification, timestep: float, seed: int, lever_arms: FloatArray
    ) -> None:
        self.specification = specification
        self.timestep = timestep
        self.changes: Sequence[Change] = ()
        entries = tuple(self._entries(seed))
        self._sources = [source for _, source in entries]
        self._sensors: NDArray[np.void] = np.array([entry for entry, _ in entries], _SENSOR)
        self._draw_angle_errors(seed)
        place = specification.place
        width = NORMALS if place else _ENTRIES
        self._suite = _Suite(
            sensors=self._sensors.view(float).reshape(len(entries), -1),
            errors=np.empty((len(entries), _AHEAD, width)),
            used=np.full(len(entries), _AHEAD),
            attitudes=np.zeros((len(_BODIES), 2)),
            levers=lever_arms,
            receivers=np.array(astuple(receiver(place)) if place else ()),
            solutions=new_state(),
            travel=np.full(_TRAVEL.itemsize // 8, math.nan),
            tracks=np.full((len(_BODIES), _TRACK.itemsize // 8), math.nan),
        )
        self._spare = 0  # moments for which there are errors at least
        self._transit = np.empty((0, SAMPLE + 2))  # samples under way, as for a `Change`
        self._delays = bool(self._sensors["delay"].any())
        # Velocities from positions follow them through every change
        derives = specification.gnss_velocity == "positions"
        self._derived = DerivedVelocities() if derives else None

    def _draw_angle_errors(self, seed: int) -> None:
        """Draw offset and nonlinearity of every angle sensor, once a run."""
        for sensor in sensors_of_kind(SensorKind.ANGLE):
            rng = generator(seed, f"sensor/{sensor}/curve")
            own = self._sensors["index"] == NUMBER[sensor]
            offset_deg = self.specification.angle_offset_deg * rng.uniform(-1.0, 1.0)
            self._sensors["offset"][own] = math.radians(offset_deg)
            nonlinearity = math.radians(self.specification.nonlinearity_deg)
            self._sensors["nonlinearity"][own] = nonlinearity
            self._sensors["phase"][own] = math.tau * rng.uniform()

    @property
    def every(self) -> int:
        """Physics steps between two moments at which any sensor samples or delivers."""
        # a delay of 0 leaves the greatest common divisor as it is
        return math.gcd(*self._sensors["every"].tolist(), *self._sensors["delay"].tolist())

    def sample(self, truths: FloatArray, first: int, stride: int) -> tuple[FloatArray, FloatArray]:
        """Sample the sensors at every moment at which they are due; return what is delivered.

        A sample bears the time at which it was taken, whatever its latency.

        Args:
            truths: rows of `TruthBlock` (n, TRUTH_SIZE), in the order of time, none left out.
            first: physics step of the first one.
            stride: physics steps from one to the next.

        Returns:
            rows of `ttempc.layout.SAMPLE` entries in the order of delivery, (m, SAMPLE), and the
            number of the moment at which each is delivered, (m,).
        """
        if self._spare < len(truths):
            self._draw(len(truths))
        self._spare -= len(truths)
        most = len(truths) * len(self._sensors)
        samples = np.empty((most, SAMPLE))
        due = np.empty(most)
        count = _take(truths, first, stride, self._suite, samples, due)
        samples = samples[:count]
        due = due[:count]
        if not (self._delays or self.changes or self._derived):
            return samples, (due - first) / stride
        return self._deliver(samples, due, first, stride, len(truths))

    def _deliver(
        self, samples: FloatArray, due: FloatArray, first: int, stride: int, moments: int
    ) -> tuple[FloatArray, FloatArray]:
        """Return what `sample` does, after changes and latencies."""
        taken = np.column_stack([samples, due, samples[:, 0]])
        for change in self.changes:
            taken = change(taken)
        if self._derived:
            taken = self._derived(taken)
        under_way = np.concatenate([self._transit, taken])
        at = np.maximum(np.ceil((under_way[:, SAMPLE] - first) / stride), 0.0)
        order = np.argsort(at, kind="stable")
        order = order[: np.count_nonzero(at < moments)]
        self._transit = under_way[at >= moments]
        return under_way[order, :SAMPLE], at[order]

    def _draw(self, moments: int) -> None:
        """Draw errors ahead, of each sensor from its own generators."""
        errors = self._suite.errors
        if moments > errors.shape[1]:
            errors = np.pad(errors, ((0, 0), (moments, 0), (0, 0)))
            self._suite = self._suite._replace(errors=errors, used=self._suite.used + moments)
        self._spare = size = errors.shape[1]
        for source, own, used in zip(self._sources, errors, self._suite.used, strict=True):
            own[: size - used] = own[used:].copy()
            drawn = source.errors(int(used))
            own[size - used :, : drawn.shape[1]] = drawn
        self._suite.used[:] = 0

    def _entries(self, seed: int) -> Iterator[tuple[tuple[object, ...], ErrorSource]]:
        """Yield the sensors; IMUs first: corrected GNSS samples of the same moment need them."""
        specification = self.specification
        if specification.imu.on:
            for sensor in sensors_of_kind(SensorKind.INERTIAL):
                yield self._imu(sensor), _imu_error(specification.imu, seed, sensor)
        for sensor in sensors_of_kind(SensorKind.POSITION):
            yield self._gnss(sensor), _gnss_error(specification, seed, sensor)
        if specification.gnss_velocity != "none":
            for sensor in sensors_of_kind(SensorKind.VELOCITY):
                yield self._velocity(sensor), _velocity_error(specification, seed, sensor)
        if specification.gnss_status:
            for sensor in sensors_of_kind(SensorKind.RECEIVER):
                # A receiver without a warning says zeros
                rng = generator(seed, f"sensor/{sensor}")
                yield self._entry(sensor, (), specification.gnss_latency_s, ()), White(_NO_SD, rng)
        for sensor, plain in specification.plain_sensors.items():
            source = White(np.array([plain.sd]), generator(seed, f"sensor/{sensor}"))
            yield self._plain(sensor, plain), source

    def _imu(self, sensor: Sensor) -> tuple[object, ...]:
        """Return the `_SENSOR` of an IMU."""
        imu = self.specification.imu
        body = ROW_OF[sensor].body
        ending = _BODIES[body]
        columns = _columns(f"yaw_rate_{ending}", f"roll_{ending}", f"pitch_{ending}")
        resolution = _imu_units(imu.yaw_rate_resolution_degps, imu.angle_resolution_deg)
        return self._entry(sensor, columns, imu.latency_s, resolution, attitude_of=body)

    def _gnss(self, sensor: Sensor) -> tuple[object, ...]:
        """Return the `_SENSOR` of a receiver."""
        of = self.specification
        body = ROW_OF[sensor].body
        antenna = ANTENNA_COLUMNS.start + 3 * body
        columns = (
            self._receiver_columns(body) if of.gnss_antenna == "point" else (antenna, antenna + 1)
        )
        return self._entry(
            sensor,
            columns,
            of.gnss_latency_s,
            (of.gnss_resolution_m, of.gnss_resolution_m),
            corrected_by=body if of.gnss_antenna == "corrected" else _NONE,
            antenna=body if of.place else _NONE,
        )

    def _velocity(self, sensor: Sensor) -> tuple[object, ...]:
        """Return the `_SENSOR` of the velocity of a receiver."""
        of = self.specification
        body = ROW_OF[sensor].body
        columns = self._receiver_columns(body)
        unquantised = len(columns) * (0.0,)
        stated_sd = math.hypot(of.gnss_velocity_sd_mps, of.gnss_velocity_wander_mps)
        return self._entry(
            sensor,
            columns,
            of.gnss_latency_s,
            unquantised,
            velocity_of=body,
            is_mean=of.gnss_velocity == "carrier",
            stated_sd=stated_sd,
        )

    def _receiver_columns(self, body: int) -> tuple[int, ...]:
        """Return the columns of the point whose position the receiver of a body delivers."""
        if self.specification.gnss_antenna == "raw":
            antenna = ANTENNA_COLUMNS.start + 3 * body
            return antenna, antenna + 1
        return _columns(f"x_{_BODIES[body]}", f"y_{_BODIES[body]}")

    def _plain(self, sensor: Sensor, plain: PlainSensor) -> tuple[object, ...]:
        """Return the `_SENSOR` of a sensor of one number."""
        return self._entry(sensor, _columns(plain.truth), plain.latency_s, (plain.resolution,))

    def _entry(
        self,
        sensor: Sensor,
        columns: tuple[int, ...],
        latency_s: float,
        resolution: tuple[float, ...],
        **special: float,
    ) -> tuple[object, ...]:
        """Return a `_SENSOR` without errors of an angle; `special` has further fields by name."""
        period_s = self.specification.period_s(sensor)
        rate = f"rate of sensor {sensor} ({1.0 / period_s:g} Hz)"
        fill = _ENTRIES - len(columns)
        given = {
            "index": NUMBER[sensor],
            "every": whole_steps(period_s, self.timestep, rate),
            "delay": whole_steps(latency_s, self.timestep, f"latency of sensor {sensor}", least=0),
            "length": len(columns),
            "columns": (*columns, *fill * (0,)),
            "resolution": (*resolution, *fill * (0.0,)),
        }
        fields = {**_ORDINARY, **special, **given}
        return tuple(fields[str(name)] for name in _SENSOR.names or ())


@cached_njit(error_model="numpy", boundscheck=False)
def _take(
    truths: FloatArray,
    first: int,
    stride: int,
    suite: _Suite,
    samples: FloatArray,
    due: FloatArray,
) -> int:
    """Take the samples of some moments in their order; return how many.

    Written are the rows of `samples` and the physics step at which each is `due`.
    """
    travel = record(suite.travel, _TRAVEL)
    epoch = np.zeros(EPOCH_SIZE)
    count = 0
    for moment in range(len(truths)):
        truth = truths[moment]
        step = first + moment * stride
        moved = math.hypot(truth[_X] - travel.x, truth[_Y] - travel.y)
        travel.x = truth[_X]
        travel.y = truth[_Y]
        # Before the first moment there is no position: then `moved` is NaN
        travel.distance = travel.distance + moved if moved >= 0.0 else 0.0
        before = count
        for k in range(len(suite.sensors)):
            of = record(suite.sensors[k], _SENSOR)
            # A velocity needs an earlier place: there is none at the first moment
            known = of.velocity_of < 0 or suite.tracks[max(of.velocity_of, 0), 0] < truth[_TIME]
            if step % of.every == 0 and known:
                _sample(truth, suite, k, epoch, samples[count])
                due[count] = step + of.delay
                count += 1
        if count > before:  # what is recorded between the samples changes no velocity
            _note_places(truth, suite)
    return count


@cached_njit(error_model="numpy", boundscheck=False)
def _note_places(truth: FloatArray, suite: _Suite) -> None:
    """Keep the places of this moment from which the next velocities follow."""
    for k in range(len(suite.sensors)):
        of = record(suite.sensors[k], _SENSOR)
        if of.velocity_of >= 0:
            moment = record(suite.tracks[of.velocity_of], _TRACK).moment
            _write_place(truth, of.columns, moment)


@cached_njit(error_model="numpy", boundscheck=False)
def _write_place(truth: FloatArray, columns: NDArray[np.int64], place: FloatArray) -> None:
    """Write time and place of a receiver, (3,)."""
    place[0] = truth[_TIME]
    place[1] = truth[columns[0]]
    place[2] = truth[columns[1]]


@cached_njit(error_model="numpy", boundscheck=False)
def _sample(truth: FloatArray, suite: _Suite, k: int, epoch: FloatArray, row: FloatArray) -> None:
    """Write a sample of the k-th sensor; `epoch` is the newest `EPOCH` of the receivers."""
    of = record(suite.sensors[k], _SENSOR)
    row[SampleColumn.TIME_S] = truth[_TIME]
    row[SampleColumn.SENSOR] = of.index
    for column in range(SampleColumn.FIRST, SAMPLE):
        row[column] = 0.0
    for i in range(of.length):
        row[SampleColumn.FIRST + i] = truth[of.columns[i]]
    if of.velocity_of >= 0:
        _difference(truth, suite, k, row)
    if of.corrected_by >= 0:
        _correct_lever(truth, suite, of.corrected_by, row)
    if of.offset != 0.0 or of.nonlinearity != 0.0:
        curve = math.sin(_TURNS * row[SampleColumn.FIRST] + of.phase)
        row[SampleColumn.FIRST] += of.offset + of.nonlinearity * curve

    # Errors: those of the receivers come from one process, which the tractor's antenna advances;
    # the trailer's sample follows at the same moment
    drawn = suite.errors[k, suite.used[k]]
    suite.used[k] += 1
    solved = record(epoch, EPOCH)
    if of.antenna == 0:
        travel = record(suite.travel, _TRAVEL)
        advance(suite.solutions, suite.receivers, drawn, truth[_TIME], travel.distance, epoch)
        travel.distance = 0.0
    if of.antenna >= 0:
        row[SampleColumn.THIRD] = solved.status[of.antenna]
    for i in range(of.length):
        column = SampleColumn.FIRST + i
        row[column] += solved.error[of.antenna, i] if of.antenna >= 0 else drawn[i]
        if of.resolution[i] > 0.0:
            row[column] = of.resolution[i] * round(row[column] / of.resolution[i])

    if of.attitude_of >= 0:
        suite.attitudes[of.attitude_of, 0] = row[SampleColumn.SECOND]
        suite.attitudes[of.attitude_of, 1] = row[SampleColumn.THIRD]


@cached_njit(error_model="numpy", boundscheck=False)
def _difference(truth: FloatArray, suite: _Suite, k: int, row: FloatArray) -> None:
    """Write the velocity of a receiver since the last moment, or since its last sample."""
    of = record(suite.sensors[k], _SENSOR)
    track = record(suite.tracks[of.velocity_of], _TRACK)
    since = track.moment
    if of.is_mean and not math.isnan(track.sample[0]):
        since = track.sample
    span_s = truth[_TIME] - since[0]
    row[SampleColumn.FIRST] = (truth[of.columns[0]] - since[1]) / span_s
    row[SampleColumn.SECOND] = (truth[of.columns[1]] - since[2]) / span_s
    row[SampleColumn.THIRD] = of.stated_sd
    _write_place(truth, of.columns, track.sample)


@cached_njit(error_model="numpy", boundscheck=False)
def _correct_lever(truth: FloatArray, suite: _Suite, body: int, row: FloatArray) -> None:
    """Move a sample from the antenna to the axle point by the measured roll and pitch of a body.

    The horizontal part of a lever arm in the map is that of R_z(yaw) R_y(pitch) R_x(roll) lever: an
    antenna at height h above its point moves h sin(roll) to the right of it and
    h cos(roll) sin(pitch) ahead.
    """
    roll = suite.attitudes[body, 0]
    pitch = suite.attitudes[body, 1]
    forward = suite.levers[body, 0]
    left = suite.levers[body, 1]
    height = suite.levers[body, 2]
    yaw = truth[_YAWS[body]]
    aside = left * math.cos(roll) - height * math.sin(roll)
    up = left * math.sin(roll) + height * math.cos(roll)
    ahead = forward * math.cos(pitch) + up * math.sin(pitch)
    row[SampleColumn.FIRST] -= ahead * math.cos(yaw) - aside * math.sin(yaw)
    row[SampleColumn.SECOND] -= ahead * math.sin(yaw) + aside * math.cos(yaw)


def _columns(*names: str) -> tuple[int, ...]:
    """Return the columns of the state in a row of `TruthBlock`."""
    return tuple(map(MOTION.index, names))


def _gnss_error(specification: SensorSpecification, seed: int, sensor: Sensor) -> ErrorSource:
    """Return the errors of a receiver."""
    sd = np.full(2, specification.gnss_sd_m)
    rng = generator(seed, f"sensor/{sensor}")
    match specification.gnss_error:
        case "white":
            return White(sd, rng)
        case "correlated":
            return Correlated(
                sd,
                specification.gnss_white_share,
                specification.gnss_correlation_time_s,
                1.0 / specification.gnss_rate_hz,
                rng,
                generator(seed, f"sensor/{sensor}/slow"),
            )
        case "non-gaussian":
            return HeavyTailed(sd, rng)
        case _:  # a place: the tractor's drive both receivers
            return White(np.ones(NORMALS), rng)


class DerivedVelocities:
    """Velocities that a receiver derives from its positions, as a `Change` after all others.

    A velocity is the mean of four seconds of the positions as they are delivered, at first the true
    one of a receiver that has run before. It is smooth, 0 where the position is held, and says
    nothing that the position does not say.
    """

    def __init__(self) -> None:
        self._positions: dict[int, list[tuple[float, float, float]]] = {}  # by body: t, x, y

    def __call__(self, samples: FloatArray) -> FloatArray:
        """Return the samples with derived velocities."""
        for row in samples:
            sensor = SENSORS[int(row[SampleColumn.SENSOR])]
            known = self._positions.setdefault(int(sensor.body), [])
            time_s, x, y = row[[SampleColumn.TIME_S, SampleColumn.FIRST, SampleColumn.SECOND]]
            if sensor.kind is SensorKind.POSITION:
                known.append((float(time_s), float(x), float(y)))
                while known[-1][0] - known[0][0] > _DERIVED_S:
                    known.pop(0)
            is_full = len(known) > 1 and known[-1][0] - known[0][0] > 0.9 * _DERIVED_S
            if sensor.kind is SensorKind.VELOCITY and is_full:
                row[SampleColumn.FIRST : SampleColumn.THIRD] = self._slope(known)
        return samples

    @staticmethod
    def _slope(known: list[tuple[float, float, float]]) -> tuple[float, float]:
        """Return the velocity from the first to the last position."""
        span_s = known[-1][0] - known[0][0]
        return (known[-1][1] - known[0][1]) / span_s, (known[-1][2] - known[0][2]) / span_s


def _velocity_error(specification: SensorSpecification, seed: int, sensor: Sensor) -> ErrorSource:
    """Return the errors of the velocity of a receiver; derived ones have those of positions."""
    measured = float(specification.gnss_velocity != "positions")
    return Wandering(
        np.full(2, measured * specification.gnss_velocity_sd_mps),
        np.full(2, measured * specification.gnss_velocity_wander_mps),
        specification.gnss_velocity_wander_s,
        specification.period_s(sensor),
        generator(seed, f"sensor/{sensor}"),
        generator(seed, "sensor/velocity/wander"),
    )


def _imu_units(yaw_rate_degps: float, angle_deg: float) -> tuple[float, float, float]:
    """Return values of the components of an IMU in their units."""
    return math.radians(yaw_rate_degps), math.radians(angle_deg), math.radians(angle_deg)


def _imu_error(imu: ImuSpecification, seed: int, sensor: Sensor) -> ErrorSource:
    """Return the errors of an IMU, whose biases are drawn here."""
    sd = np.array(_imu_units(imu.yaw_rate_sd_degps, imu.angle_sd_deg))
    bias_sd = np.array(_imu_units(imu.yaw_rate_bias_sd_degps, imu.angle_bias_sd_deg))
    bias = bias_sd * generator(seed, f"sensor/{sensor}/bias").standard_normal(3)
    return White(sd, generator(seed, f"sensor/{sensor}"), bias)
