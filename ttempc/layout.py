"""Records that compiled calls of a control tick hand to each other.

A record is a flat array of float64 (`SIZE` of its type entries) that kernels view as a structured
one, `row.view(TYPE)[0]`: handing over a plain array costs a tenth of handing over a record. Views
with names and words, `Estimate` and `Diagnostics`, are made where somebody looks.
"""

import math
from array import array
from collections.abc import Iterator, Sequence
from enum import IntEnum
from typing import Final, overload

import numpy as np

from .errors import InvalidSamples
from .types import Estimate, FloatArray, Innovation, Measurement, Sensor

SAMPLE: Final = 5
"""Entries of a sample: time [s], `SensorIndex`, three components; 0 where it has fewer of them.

The third one of a position is its `Measurement.status`."""

FLOAT: Final = 2.0
"""`Measurement.status` of a position without integer ambiguities."""

_LENGTHS: Final = dict.fromkeys(Sensor, 1) | {
    Sensor.GNSS_TRACTOR: 2,
    Sensor.GNSS_TRAILER: 2,
    Sensor.IMU_TRACTOR: 3,
    Sensor.IMU_TRAILER: 3,
}
_SENSORS: Final = tuple(_LENGTHS.items())  # in the order of `Sensor` and of `SensorIndex`
_FILL: Final = (0.0, 0.0)
_KINDS: Final = {
    sensor: (i, length, _FILL[: 3 - length]) for i, (sensor, length) in enumerate(_SENSORS)
}
_WRONG: Final = (np.nan, np.nan, np.nan)  # a value that no estimator takes


def sample_rows(samples: Sequence[Measurement] | FloatArray) -> FloatArray:
    """Return the rows (n, `SAMPLE`) of samples, in their order.

    Samples of unknown sensors are left out. A value with another number of components than those
    of its sensor becomes NaN. Samples may be given as such rows, which are checked.

    Raises:
        InvalidSamples: rows of another shape, or with a number that is none of `SensorIndex`; a
            sample whose time or value are no numbers, or whose sensor is no name.
    """
    if isinstance(samples, np.ndarray):
        if samples.dtype.kind not in "fiu" or samples.ndim != 2 or samples.shape[1] != SAMPLE:
            raise InvalidSamples(
                f"samples: got {samples.dtype} of shape {samples.shape}, must be numbers of shape "
                f"(n, {SAMPLE})"
            )
        given = np.ascontiguousarray(samples, float)
        sensor = given[:, 1]
        known = (sensor >= 0.0) & (sensor < len(_SENSORS)) & (sensor == np.floor(sensor))
        if not known.all():
            raise InvalidSamples(
                f"samples: sensor {sensor[~known][0]:g} in row {int(np.argmin(known))}, must be a "
                f"whole number from 0 to {len(_SENSORS) - 1}"
            )
        return given
    rows = array("d")  # which takes numbers only
    try:
        for sample in samples:
            if sample.sensor in _KINDS:
                kind, length, fill = _KINDS[sample.sensor]
                fill = (sample.status,) if length == 2 else fill
                value = (*sample.value, *fill) if len(sample.value) == length else _WRONG
                rows.extend((sample.time_s, kind, *value))
            elif not isinstance(sample.sensor, str):
                raise TypeError(f"sensor is {type(sample.sensor).__name__}")
    except (AttributeError, OverflowError, TypeError, ValueError) as error:
        must = "must be a sequence of Measurement(time_s, sensor, (value, ...))"
        raise InvalidSamples(f"measurements: {error}; {must}") from None
    return np.array(rows).reshape(-1, SAMPLE)


def measurements_of(rows: FloatArray) -> list[Measurement]:
    """Return the samples of rows (n, `SAMPLE`), in their order: views for parts of a user."""
    samples = []
    for time_s, kind, *value in rows.tolist():
        sensor, length = _SENSORS[int(kind)]
        status = int(value[2]) if length == 2 else 0
        samples.append(Measurement(time_s, sensor, tuple(value[:length]), status))
    return samples


ESTIMATE: Final = np.dtype(
    [
        ("time_s", "f8"),
        ("state", "f8", 7),  # see `State`
        ("trailer_xy", "f8", 2),
        ("hitch_angle", "f8"),
        ("disturbance", "f8", 5),  # see `Disturbance`
        ("map_disturbance", "f8", 4),  # see `MapDisturbance`
        ("noise_factors", "f8", 3),  # NaN where the estimator learns none
        ("covariance", "f8", (7, 7)),
        ("nis", "f8"),  # sum of the normalised squared innovations of this tick's samples
        ("nis_dof", "f8"),  # and its degrees of freedom
        ("position_seen", "f8"),  # 1 where a GNSS sample was accepted at this tick
    ]
)

INNOVATION: Final = 7
"""Entries of an innovation: `SensorIndex`, normalised square, dimension (0 where there is none of
this sample), 1 if accepted, the two whitened entries and the logarithm of the determinant, NaN
where they are not known; see `Innovation`."""


class Innovations(Sequence[Innovation]):
    """Rows (n, `INNOVATION`) as innovations, which are made when someone looks."""

    __slots__ = ("rows",)

    def __init__(self, rows: FloatArray) -> None:
        self.rows = rows[rows[:, 2] > 0.0]

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
        item = (normalised, int(dimension), accepted == 1.0, known, log_determinant)
        return Innovation(_SENSORS[int(index)][0], *item)


def innovation_rows(innovations: Sequence[Innovation]) -> FloatArray:
    """Return the rows (n, `INNOVATION`) of innovations, those of unknown sensors left out."""
    if isinstance(innovations, Innovations):
        return innovations.rows
    known = [item for item in innovations if item.sensor in _KINDS]
    rows = np.full((len(known), INNOVATION), math.nan)
    for row, item in zip(rows, known, strict=True):
        row[0] = _KINDS[item.sensor][0]
        row[1:4] = item.normalised_squared, item.dimension, item.accepted
        row[4 : 4 + len(item.whitened)], row[6] = item.whitened, item.log_determinant
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
    """Columns of the body error z_e, the first ones of `TICK.tracking`.

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
    ]
)
"""Record of a tick of control; `Diagnostics` is a view of it."""


def new_tick() -> FloatArray:
    """Return a record `TICK` of no tick."""
    return np.zeros(TICK.itemsize // 8)


_NO_FACTORS: Final = np.full(3, np.nan)
_GNSS: Final = frozenset({Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER})


def estimate_row(estimate: Estimate) -> FloatArray:
    """Return the record `ESTIMATE` of an estimate, as of an estimator of a user."""
    row = np.empty(ESTIMATE.itemsize // 8)
    record = row.view(ESTIMATE)[0]
    record["time_s"], record["hitch_angle"] = estimate.time_s, estimate.hitch_angle
    for name in ("state", "trailer_xy", "disturbance", "map_disturbance", "covariance"):
        record[name] = getattr(estimate, name)
    factors = estimate.noise_factors
    record["noise_factors"] = _NO_FACTORS if factors is None else factors
    numbers = innovation_rows(estimate.innovations)[:, :4].tolist()
    # A sample that the filter could not weigh, such as one that is not finite, has no innovation.
    record["nis"] = sum([square for _, square, _, _ in numbers if math.isfinite(square)])
    record["nis_dof"] = sum([count for _, square, count, _ in numbers if math.isfinite(square)])
    # The receivers are the first sensors.
    record["position_seen"] = bool([1 for sensor, _, _, passed in numbers if passed and sensor < 2])
    return row
