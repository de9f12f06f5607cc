"""Sensors of the vehicle: readings of the truth with errors, rates and latencies.

GNSS samples are taken at the axle point, as the paper's model takes them ("point"), or at the
antenna above it, which a rolling or pitching vehicle moves. "raw" samples are the position of the
antenna. "corrected" samples are that position less the lever arm, turned by the roll and pitch of
the newest sample of that body's IMU. The heading for that turn is the true one: an error of the
heading would move the corrected point by height x sin(roll) x error, 3 mm at 0.1 rad and 1 deg.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ttempc.jit import cached_njit
from ttempc.layout import SAMPLE
from ttempc.types import FloatArray, Sensor

from ..discretisation import whole_steps
from ..randomness import generator
from ..truth import ANTENNA_COLUMNS, MOTION
from .receivers import NORMALS, advance, new_state, receiver
from .sensor_errors import Correlated, ErrorSource, HeavyTailed, White
from .sensor_specification import ANGLE_RANGE_DEG, ImuSpecification, SensorSpecification

_POSITION: Final = ("x_m", "y_m", "status")
_ATTITUDE: Final = ("yaw_rate_radps", "roll_rad", "pitch_rad")

COMPONENTS: Final[dict[Sensor, tuple[str, ...]]] = {
    Sensor.GNSS_TRACTOR: _POSITION,
    Sensor.GNSS_TRAILER: _POSITION,
    Sensor.STEERING_TRACTOR: ("rad",),
    Sensor.STEERING_TRAILER: ("rad",),
    Sensor.HITCH: ("rad",),
    Sensor.ENCODER: ("mps",),
    Sensor.IMU_TRACTOR: _ATTITUDE,
    Sensor.IMU_TRAILER: _ATTITUDE,
}
"""Components of a sample of each sensor with their units, in the order of `Measurement.value`.

The status of a position is `Measurement.status`.
The log derives its columns from this table: their names, their number and their order.
"""

NUMBER: Final = {sensor: number for number, sensor in enumerate(COMPONENTS)}
"""`SensorIndex` of each sensor."""

_AHEAD: Final = 256  # samples of each sensor whose errors are drawn at once
_ANGLES: Final = {
    Sensor.STEERING_TRACTOR: "delta_t",
    Sensor.STEERING_TRAILER: "delta_i",
    Sensor.HITCH: "beta",
}
_IMUS: Final = {  # bodies in the order of the antennas
    Sensor.IMU_TRACTOR: ("yaw_rate_t", "roll_t", "pitch_t"),
    Sensor.IMU_TRAILER: ("yaw_rate_i", "roll_i", "pitch_i"),
}
_POINTS: Final = {Sensor.GNSS_TRACTOR: ("x_t", "y_t"), Sensor.GNSS_TRAILER: ("x_i", "y_i")}
_TRACTOR: Final = MOTION.index("x_t")  # y_t follows
_TURNS: Final = 360.0 / ANGLE_RANGE_DEG  # of the deviation of an angle sensor in a turn
_YAWS: Final = tuple(map(MOTION.index, ("psi_t", "psi_i")))

_SENSOR: Final = np.dtype(
    [
        ("number", "i8"),  # `SensorIndex`
        ("every", "i8"),  # physics steps from sample to sample
        ("delay", "i8"),  # physics steps from sample to delivery
        ("length", "i8"),  # components
        ("columns", "i8", 3),  # of the components in a row of `TruthBlock`
        ("resolution", "f8", 3),  # of each component
        ("corrects", "i8"),  # body whose attitude corrects the sample; -1: none
        ("antenna", "i8"),  # whose error comes from `receivers.advance`; -1: none
        ("curve", "f8", 3),  # of an angle: offset, largest deviation, phase [rad]
    ]
)

Change = Callable[[FloatArray], FloatArray]
"""Returns what arrives in the place of samples, rows of `SAMPLE`, due physics step, sampling time;
the array is the receiver's own."""


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
        self.specification, self.timestep = specification, timestep
        self.changes: Sequence[Change] = ()
        entries = tuple(self._entries(seed))
        self._sources = [source for _, source in entries]
        self._sensors: NDArray[np.void] = np.array([entry for entry, _ in entries], _SENSOR)
        for sensor in _ANGLES:
            rng, own = generator(seed, f"sensor/{sensor}/curve"), self._sensors["number"]
            offset_deg, phase = (
                specification.angle_offset_deg * rng.uniform(-1.0, 1.0),
                rng.uniform(),
            )
            curve = math.radians(offset_deg), math.radians(specification.bend_deg), math.tau * phase
            self._sensors["curve"][own == NUMBER[sensor]] = curve
        place = specification.place
        self._errors = np.empty((len(entries), _AHEAD, NORMALS if place else 3))
        self._receiver = np.array(astuple(receiver(place)) if place else ())
        self._solutions = new_state()
        self._way = np.full(3, math.nan)  # last position, way since the last epoch [m]
        self._used = np.full(len(entries), _AHEAD)  # errors of each sensor
        self._spare = 0  # moments for which there are errors at least
        self._attitudes = np.zeros((2, 2))  # of the bodies: roll, pitch [rad] as last measured
        self._levers = lever_arms
        self._transit = np.empty((0, SAMPLE + 2))  # samples under way, as for a `Change`
        self._delays = bool(self._sensors["delay"].any())

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
        samples, due = np.empty((most, SAMPLE)), np.empty(most)
        count = _take(
            truths,
            first,
            stride,
            self._sensors,
            self._errors,
            self._used,
            self._attitudes,
            self._levers,
            self._receiver,
            self._solutions,
            self._way,
            samples,
            due,
        )
        samples, due = samples[:count], due[:count]
        if not (self._delays or self.changes):
            return samples, (due - first) / stride
        return self._deliver(samples, due, first, stride, len(truths))

    def _deliver(
        self, samples: FloatArray, due: FloatArray, first: int, stride: int, moments: int
    ) -> tuple[FloatArray, FloatArray]:
        """Return what `sample` does, after changes and latencies."""
        taken = np.column_stack([samples, due, samples[:, 0]])
        for change in self.changes:
            taken = change(taken)
        under_way = np.concatenate([self._transit, taken])
        at = np.maximum(np.ceil((under_way[:, SAMPLE] - first) / stride), 0.0)
        order = np.argsort(at, kind="stable")
        order = order[: np.count_nonzero(at < moments)]
        self._transit = under_way[at >= moments]
        return under_way[order, :SAMPLE], at[order]

    def _draw(self, moments: int) -> None:
        """Draw errors ahead, of each sensor from its own generators."""
        if moments > self._errors.shape[1]:
            self._errors = np.pad(self._errors, ((0, 0), (moments, 0), (0, 0)))
            self._used += moments
        self._spare = size = self._errors.shape[1]
        for source, errors, used in zip(self._sources, self._errors, self._used, strict=True):
            errors[: size - used] = errors[used:].copy()
            drawn = source.errors(int(used))
            errors[size - used :, : drawn.shape[1]] = drawn
        self._used[:] = 0

    def _entries(self, seed: int) -> Iterator[tuple[tuple[object, ...], ErrorSource]]:
        """Yield the sensors; IMUs first: corrected GNSS samples of the same moment need them."""
        of, imu = self.specification, self.specification.imu
        if imu.on:
            for sensor, names in _IMUS.items():
                grid = _imu_units(imu.yaw_rate_resolution_degps, imu.angle_resolution_deg)
                entry = self._entry(sensor, _columns(*names), imu.latency_s, grid)
                yield entry, _imu_error(imu, seed, sensor)
        for body, (sensor, names) in enumerate(_POINTS.items()):
            antenna = ANTENNA_COLUMNS.start + 3 * body
            columns = _columns(*names) if of.gnss_antenna == "point" else (antenna, antenna + 1)
            grid = 2 * (of.gnss_resolution_m,)
            source, drawn = _gnss_error(of, seed, sensor), body if of.place else -1
            corrects = body if of.gnss_antenna == "corrected" else -1
            yield self._entry(sensor, columns, of.gnss_latency_s, grid, corrects, drawn), source
        angle = (
            math.radians(of.angle_sd_deg),
            of.angle_latency_s,
            math.radians(of.angle_resolution_deg),
        )
        speed = (of.encoder_sd_mps, of.encoder_latency_s, of.encoder_resolution_mps)
        encoder = {"wheel": "wheel_speed", "ground": "speed"}[of.encoder_on]
        plain = [*((*pair, angle) for pair in _ANGLES.items()), (Sensor.ENCODER, encoder, speed)]
        for sensor, name, (sd, latency_s, resolution) in plain:
            entry = self._entry(sensor, _columns(name), latency_s, (resolution,))
            yield entry, White(np.array([sd]), generator(seed, f"sensor/{sensor}"))

    def _entry(
        self,
        sensor: Sensor,
        columns: tuple[int, ...],
        latency_s: float,
        resolution: tuple[float, ...],
        *others: int,
    ) -> tuple[object, ...]:
        """Return an entry of `_SENSOR`."""
        period_s, timestep = self.specification.period_s(sensor), self.timestep
        every = whole_steps(period_s, timestep, f"rate of sensor {sensor} ({1.0 / period_s:g} Hz)")
        delay = whole_steps(latency_s, timestep, f"latency of sensor {sensor}", least=0)
        fill = 3 - len(columns)
        grid = (*resolution, *fill * (0.0,))
        columns, size = (*columns, *fill * (0,)), len(columns)
        return (
            NUMBER[sensor],
            every,
            delay,
            size,
            columns,
            grid,
            *(others or (-1, -1)),
            (0.0, 0.0, 0.0),
        )


@cached_njit(error_model="numpy", boundscheck=False)
def _take(
    truths: FloatArray,
    first: int,
    stride: int,
    sensors: NDArray[np.void],
    errors: FloatArray,
    used: NDArray[np.int64],
    attitudes: FloatArray,
    levers: FloatArray,
    receiver: FloatArray,
    solutions: FloatArray,
    way: FloatArray,
    samples: FloatArray,
    due: FloatArray,
) -> int:
    """Take the samples of some moments in their order; return how many.

    The horizontal part of a lever arm in the map is that of R_z(yaw) R_y(pitch) R_x(roll) lever: an
    antenna at height h above its point moves h sin(roll) to the right of it and
    h cos(roll) sin(pitch) ahead.
    """
    count, solved = 0, np.zeros(6)
    for moment in range(len(truths)):
        truth, step = truths[moment], first + moment * stride
        moved = math.hypot(truth[_TRACTOR] - way[0], truth[_TRACTOR + 1] - way[1])
        way[0], way[1] = truth[_TRACTOR], truth[_TRACTOR + 1]
        way[2] = way[2] + moved if moved >= 0.0 else 0.0  # NaN: the first moment
        for k in range(len(sensors)):
            of = sensors[k]
            if step % of.every != 0:
                continue
            row = samples[count]
            row[0], row[1], row[4] = truth[0], of.number, 0.0
            row[3] = 0.0
            for i in range(of.length):
                row[2 + i] = truth[of.columns[i]]
            if of.corrects >= 0:
                roll, pitch = attitudes[of.corrects, 0], attitudes[of.corrects, 1]
                yaw, lever = truth[_YAWS[of.corrects]], levers[of.corrects]
                aside = lever[1] * math.cos(roll) - lever[2] * math.sin(roll)
                up = lever[1] * math.sin(roll) + lever[2] * math.cos(roll)
                ahead = lever[0] * math.cos(pitch) + up * math.sin(pitch)
                row[2] -= ahead * math.cos(yaw) - aside * math.sin(yaw)
                row[3] -= ahead * math.sin(yaw) + aside * math.cos(yaw)
            if of.curve[0] != 0.0 or of.curve[1] != 0.0:
                bend = math.sin(_TURNS * row[2] + of.curve[2])
                row[2] += of.curve[0] + of.curve[1] * bend
            if of.antenna == 0:  # the trailer's sample follows at the same moment
                advance(solutions, receiver, errors[k, used[k]], truth[0], way[2], solved)
                way[2] = 0.0
            if of.antenna >= 0:
                row[4] = solved[4 + of.antenna]
            for i in range(of.length):
                antenna = of.antenna
                row[2 + i] += solved[2 * antenna + i] if antenna >= 0 else errors[k, used[k], i]
                if of.resolution[i] > 0.0:
                    row[2 + i] = of.resolution[i] * round(row[2 + i] / of.resolution[i])
            used[k] += 1
            if of.length == 3:  # an IMU
                attitudes[of.number - 6, 0], attitudes[of.number - 6, 1] = row[3], row[4]
            due[count] = step + of.delay
            count += 1
    return count


def _columns(*names: str) -> tuple[int, ...]:
    """Return the columns of the state in a row of `TruthBlock`."""
    return tuple(map(MOTION.index, names))


def _gnss_error(specification: SensorSpecification, seed: int, sensor: Sensor) -> ErrorSource:
    sd, rng = np.full(2, specification.gnss_sd_m), generator(seed, f"sensor/{sensor}")
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


def _imu_units(yaw_rate_degps: float, angle_deg: float) -> tuple[float, float, float]:
    """Return values of the components of an IMU in their units."""
    return math.radians(yaw_rate_degps), math.radians(angle_deg), math.radians(angle_deg)


def _imu_error(imu: ImuSpecification, seed: int, sensor: Sensor) -> ErrorSource:
    sd = np.array(_imu_units(imu.yaw_rate_sd_degps, imu.angle_sd_deg))
    bias_sd = np.array(_imu_units(imu.yaw_rate_bias_sd_degps, imu.angle_bias_sd_deg))
    bias = bias_sd * generator(seed, f"sensor/{sensor}/bias").standard_normal(3)
    return White(sd, generator(seed, f"sensor/{sensor}"), bias)
