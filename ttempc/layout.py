"""Records that compiled calls of a control tick hand to each other.

A record is a flat array of float64 (`SIZE` of its type entries) that kernels view as a structured
one, `row.view(TYPE)[0]`: handing over a plain array costs a tenth of handing over a record. Rows of
which there are many, samples and innovations, are arrays (n, columns) with an enumeration of their
columns. Views with names and words, `Estimate` and `Diagnostics`, are made where somebody looks.
"""

import math
from array import array
from collections.abc import Iterator, Sequence
from enum import IntEnum
from typing import Final, overload

import numpy as np

from .errors import InvalidSamples
from .sensors import (
    RECEIVER_OF_BODY,
    ROW_OF,
    SENSOR_COUNT,
    SENSORS,
    SensorKind,
    sensors_of_kind,
)
from .types import Estimate, FloatArray, Innovation, Measurement


class SampleColumn(IntEnum):
    """Columns of a row that is a sample of a sensor."""

    TIME_S = 0  # at which the sample was taken
    SENSOR = 1  # number of the sensor, see `SensorIndex`
    # Entries of the sample in the order of `SensorRow.components`, 0 where it has fewer of them.
    # The third one of a position is its `Measurement.status`.
    FIRST = 2
    SECOND = 3
    THIRD = 4


SAMPLE: Final = len(SampleColumn)
"""Number of columns of a sample."""

FLOAT: Final = 2.0
"""`Measurement.status` of a position without integer ambiguities."""

_FILL: Final = (0.0, 0.0)  # entries that a sample of one number does not have
_WRONG: Final = (np.nan, np.nan, np.nan)  # a value that no estimator takes
_FORMATS: Final = {
    row.sensor: (row.index, row.length, row.kind is SensorKind.POSITION, _FILL[: 3 - row.length])
    for row in SENSORS
}
"""Of each sensor: index, entries of a sample, whether it has a status, and what fills its row."""


def sample_rows(samples: Sequence[Measurement] | FloatArray) -> FloatArray:
    """Return the rows (n, `SAMPLE`) of samples, in their order.

    Samples of unknown sensors are left out. A value with another number of components than its
    sensor has becomes NaN. `Measurement.receiver` is a row of its own behind that of the position.
    Samples may be given as such rows, which are checked.

    Raises:
        InvalidSamples: rows of another shape, or with a number that is none of `SensorIndex`; a
            sample whose time or value are no numbers, or whose sensor is no name.
    """
    if isinstance(samples, np.ndarray):
        return _checked_rows(samples)
    rows = array("d")  # which takes numbers only
    try:
        for sample in samples:
            if sample.sensor in _FORMATS:
                index, length, has_status, fill = _FORMATS[sample.sensor]
                if has_status:
                    fill = (sample.status,)
                value = (*sample.value, *fill) if len(sample.value) == length else _WRONG
                rows.extend((sample.time_s, index, *value))
                if has_status and sample.receiver is not None:
                    of_receiver = RECEIVER_OF_BODY[ROW_OF[sample.sensor].body]
                    rows.extend((sample.time_s, of_receiver, *sample.receiver.value))
            elif not isinstance(sample.sensor, str):
                raise TypeError(f"sensor is {type(sample.sensor).__name__}")
    except (AttributeError, OverflowError, TypeError, ValueError) as error:
        must = "must be a sequence of Measurement(time_s, sensor, (value, ...))"
        raise InvalidSamples(f"measurements: {error}; {must}") from None
    return np.array(rows).reshape(-1, SAMPLE)


def _checked_rows(samples: np.ndarray) -> FloatArray:
    """Return rows of samples as contiguous numbers.

    Raises:
        InvalidSamples: rows of another shape, or with a number that is none of `SensorIndex`.
    """
    if samples.dtype.kind not in "fiu" or samples.ndim != 2 or samples.shape[1] != SAMPLE:
        raise InvalidSamples(
            f"samples: got {samples.dtype} of shape {samples.shape}, must be numbers of shape "
            f"(n, {SAMPLE})"
        )
    rows = np.ascontiguousarray(samples, float)
    sensor = rows[:, SampleColumn.SENSOR]
    known = (sensor >= 0.0) & (sensor < SENSOR_COUNT) & (sensor == np.floor(sensor))
    if not known.all():
        raise InvalidSamples(
            f"samples: sensor {sensor[~known][0]:g} in row {int(np.argmin(known))}, must be a "
            f"whole number from 0 to {SENSOR_COUNT - 1}"
        )
    return rows


def measurements_of(rows: FloatArray) -> list[Measurement]:
    """Return the samples of rows (n, `SAMPLE`), in their order: views for parts of a user."""
    samples = []
    for time_s, index, *value in rows.tolist():
        row = SENSORS[int(index)]
        status = int(value[row.length]) if row.kind is SensorKind.POSITION else 0
        samples.append(Measurement(time_s, row.sensor, tuple(value[: row.length]), status))
    return samples


ESTIMATE: Final = np.dtype(
    [
        ("time_s", "f8"),
        ("state", "f8", 7),  # in the order of `State`
        ("trailer_xy", "f8", 2),
        ("hitch_angle", "f8"),
        ("disturbance", "f8", 5),  # in the order of `Disturbance`
        ("map_disturbance", "f8", 4),  # in the order of `MapDisturbance`
        ("noise_factors", "f8", 3),  # NaN where the estimator learns none
        ("covariance", "f8", (7, 7)),
        ("nis", "f8"),  # sum of the normalised squared innovations of this tick's samples
        ("nis_dof", "f8"),  # degrees of freedom of `nis`
        ("position_seen", "f8"),  # 1 where a GNSS sample was accepted at this tick
    ]
)


class InnovationColumn(IntEnum):
    """Columns of a row that is the innovation of a sample, see `Innovation`."""

    SENSOR = 0  # number of the sensor, see `SensorIndex`
    NORMALISED_SQUARED = 1  # infinite where the filter could not compare the sample
    DIMENSION = 2  # 0 where there is no innovation of this sample
    ACCEPTED = 3  # 1 if the filter used the sample
    WHITENED_FIRST = 4  # entries of the whitened innovation, NaN where they are not known
    WHITENED_SECOND = 5
    LOG_DETERMINANT = 6  # of the innovation's covariance, NaN where it is not known


INNOVATION: Final = len(InnovationColumn)
"""Number of columns of an innovation."""


class Innovations(Sequence[Innovation]):
    """Rows (n, `INNOVATION`) as innovations, which are made when someone looks."""

    __slots__ = ("rows",)

    def __init__(self, rows: FloatArray) -> None:
        self.rows = rows[rows[:, InnovationColumn.DIMENSION] > 0.0]

    def __len__(self) -> int:
        return len(self.rows)

    @overload
    def __getitem__(self, index: int) -> Innovation: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Innovation, ...]: ...
    def __getitem__(self, index: int | slice) -> Innovation | tuple[Innovation, ...]:
        if isinstance(index, slice):
            return tuple(map(self._innovation, self.rows[index].tolist()))
        return self._innovation(self.rows[index].tolist())

    def __iter__(self) -> Iterator[Innovation]:
        return map(self._innovation, self.rows.tolist())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and tuple(self) == tuple(other)

    __hash__ = None  # type: ignore[assignment]

    @staticmethod
    def _innovation(row: list[float]) -> Innovation:
        index, normalised, dimension, accepted, first, second, log_determinant = row
        known = () if math.isnan(first) else (first, second)[: int(dimension)]
        return Innovation(
            sensor=SENSORS[int(index)].sensor,
            normalised_squared=normalised,
            dimension=int(dimension),
            accepted=accepted == 1.0,
            whitened=known,
            log_determinant=log_determinant,
        )


def innovation_rows(innovations: Sequence[Innovation]) -> FloatArray:
    """Return the rows (n, `INNOVATION`) of innovations; unknown sensors are left out."""
    if isinstance(innovations, Innovations):
        return innovations.rows
    known = [item for item in innovations if item.sensor in ROW_OF]
    rows = np.full((len(known), INNOVATION), math.nan)
    for row, item in zip(rows, known, strict=True):
        row[InnovationColumn.SENSOR] = ROW_OF[item.sensor].index
        row[InnovationColumn.NORMALISED_SQUARED] = item.normalised_squared
        row[InnovationColumn.DIMENSION] = item.dimension
        row[InnovationColumn.ACCEPTED] = item.accepted
        whitened = row[InnovationColumn.WHITENED_FIRST : InnovationColumn.LOG_DETERMINANT]
        whitened[: len(item.whitened)] = item.whitened
        row[InnovationColumn.LOG_DETERMINANT] = item.log_determinant
    return rows


def estimate_view(row: FloatArray, innovations: Sequence[Innovation] = ()) -> Estimate:
    """Return the `Estimate` of a flat `ESTIMATE`; it shares its arrays."""
    e = row.view(ESTIMATE)[0]
    factors = e["noise_factors"]
    return Estimate(
        time_s=float(e["time_s"]),
        state=e["state"],
        covariance=e["covariance"],
        trailer_xy=e["trailer_xy"],
        hitch_angle=float(e["hitch_angle"]),
        disturbance=e["disturbance"],
        innovations=innovations,
        map_disturbance=e["map_disturbance"],
        noise_factors=None if math.isnan(factors[0]) else factors,
    )


class AlarmColumn(IntEnum):
    """Columns of a row that is the alarm of a detector."""

    REACTION = 0  # `ttempc.detectors.interface.Reaction`, -1 where there is no alarm
    FIRST = 1  # numbers of which the detector makes its reason in words, those of the alarm's begin
    SECOND = 2
    THIRD = 3


ALARM: Final = len(AlarmColumn)
"""Number of columns of an alarm."""


class ControlColumn(IntEnum):
    """Columns of an input in `TICK.control`."""

    FEEDFORWARD = 0
    FEEDBACK = 1
    ROBUST = 2
    SUM = 3  # of these three actions
    COMMAND = 4
    LOWER = 5  # smallest and
    UPPER = 6  # largest command
    LIMITED = 7  # 1 where a limit acts


class BodyError(IntEnum):
    """Columns of the body error, the first ones of `TICK.tracking`.

    It is the reference in the frames of the vehicle's bodies: distances ahead and to the left of
    each axle point, and yaw. The laws have an error of their own, in the frame of the reference.
    """

    X_T = 0  # [m] ahead of the tractor point
    Y_T = 1  # [m] to its left
    PSI_T = 2  # [rad]
    X_I = 3  # [m] ahead of the trailer point
    Y_I = 4  # [m] to its left
    PSI_I = 5  # [rad]
    V = 6  # [m/s]


SOLVER: Final = np.dtype(
    [
        ("accepted", "f8"),  # 1 where the result was accepted
        ("iterations", "f8"),
        ("primal_residual", "f8"),
        ("dual_residual", "f8"),
        ("status", "f8"),  # index of `ttempc.types.SOLVER_STATUSES`
    ]
)
"""Record of the QP of a tick, see `SolverReport`; NaN where the controller solves none."""

EXPECTED: Final = np.dtype(
    [
        ("slip_i", "f8"),  # of the trailer in this period, beside its disturbance [rad]
        ("share", "f8"),  # of forecasts that is used
    ]
)
"""Record of the foresight of a tick, see `ttempc.learning.foresight`; NaN where there is none."""

TICK: Final = np.dtype(
    [
        ("control", "f8", (3, len(ControlColumn))),  # of each input
        ("tracking", "f8", len(BodyError) + 4),  # body error, then z_m (4); NaN: none
        ("tube", "f8", 20),  # see `TubeReport`; NaN: none
        ("solver", SOLVER),
        ("fallback", "f8"),  # whether the supervisor or another law than the controller's own acts
        ("law", "f8"),  # why another law than the controller's own acted, a code of its own
        ("leaves_corridor", "f8"),
        ("mode", "f8"),  # of the supervisor, see `ttempc.guidance.safety`
        ("reason", "f8"),  # of a mode or of half speed, see there
        ("jump_m", "f8"),  # of the error; 0: none
        ("cut", "f8", 3),  # what is wrong with a user's command, see there
        ("sample", "f8"),  # of the reference to which the errors are
        ("stopping", "f8"),
        ("waits", "f8"),  # whether the reference stays at this tick
        ("hurries", "f8"),  # whether it leaves one out
        ("expected", EXPECTED),
    ]
)
"""Record of a tick of control; `Diagnostics` is a view of it."""


def new_tick() -> FloatArray:
    """Return a record `TICK` of no tick."""
    return np.zeros(TICK.itemsize // 8)


_NO_FACTORS: Final = np.full(3, np.nan)
_GNSS: Final = frozenset(sensors_of_kind(SensorKind.POSITION))


def estimate_row(estimate: Estimate) -> FloatArray:
    """Return the record `ESTIMATE` of an estimate, as of an estimator of a user."""
    row = np.empty(ESTIMATE.itemsize // 8)
    record = row.view(ESTIMATE)[0]
    record["time_s"] = estimate.time_s
    record["hitch_angle"] = estimate.hitch_angle
    for name in ("state", "trailer_xy", "disturbance", "map_disturbance", "covariance"):
        record[name] = getattr(estimate, name)
    factors = estimate.noise_factors
    record["noise_factors"] = _NO_FACTORS if factors is None else factors

    # A sample that the filter could not compare, such as one that is not finite, counts for neither
    # sum: its square is infinite.
    known = [item for item in estimate.innovations if item.sensor in ROW_OF]
    compared = [item for item in known if math.isfinite(item.normalised_squared)]
    record["nis"] = 0.0
    for item in compared:  # in the order of the filter's kernel; sum() rounds otherwise
        record["nis"] += item.normalised_squared
    record["nis_dof"] = sum([item.dimension for item in compared])
    record["position_seen"] = any(item.accepted and item.sensor in _GNSS for item in known)
    return row
