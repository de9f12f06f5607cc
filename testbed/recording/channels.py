"""Channels of a run: topics, names and units of their numbers, and their rows.

Loop, record, log, metrics, figures and readers share this table. A row has one number per field;
its time is the simulated time at which it was true. Units are part of the names, see `unit_of`. A
number that does not exist in a row is NaN. Further topics hold what viewers draw.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ttempc.jit import cached_njit
from ttempc.layout import ESTIMATE as ESTIMATE_TYPE
from ttempc.layout import TICK
from ttempc.types import FloatArray, Sensor

from ..sensing.sensors import COMPONENTS
from ..truth import WHEELS

NAN: Final = float("nan")

TRANSFORMS_TOPIC: Final = "/tf"
TRACTOR_TOPIC: Final = "/tractor/pose"
TRAILER_TOPIC: Final = "/trailer/pose"
DRIVEN_TOPIC: Final = "/tractor/path"  # so far, every few seconds, later less often
DRIVEN_TRAILER_TOPIC: Final = "/trailer/path"
REFERENCE_PATH_TOPIC: Final = "/reference/path"  # once, at the start of the run
PREDICTED_PATH_TOPIC: Final = "/mpc/predicted_path"  # of the tractor point, every control tick
PREDICTED_TRAILER_PATH_TOPIC: Final = "/mpc/predicted_path_trailer"
GNSS_TOPIC: Final = "/gnss/tractor"  # position as the receiver delivers it
GNSS_TRAILER_TOPIC: Final = "/gnss/trailer"
SCENE_TOPIC: Final = "/scene"  # once: ground and vehicle, the vehicle fixed to its frames
EVENT_TOPIC: Final = "/log"


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic, its description in the log, and the names of its numbers."""

    topic: str
    about: str
    fields: tuple[str, ...]


_INPUTS: Final = ("delta_t_rad", "delta_i_rad", "hp")
_POSES: Final = ("x_t_m", "y_t_m", "psi_t_rad", "x_i_m", "y_i_m", "psi_i_rad")
_BEYOND: Final = (  # fields of the state beyond the poses
    *("z_t_m", "pitch_t_rad", "roll_t_rad", "z_i_m", "pitch_i_rad", "roll_i_rad", "psi_d_rad"),
    *("beta_rad", "delta_t_rad", "delta_i_rad", "hp", "v_mps", "v_lateral_mps"),
    *("yaw_rate_t_radps", "yaw_rate_i_radps", "v_rim_mps"),
)
_SAMPLES: Final = {sensor: (*parts, "time_s") for sensor, parts in COMPONENTS.items()}


STATE: Final = Channel(
    "/state",
    "truth: axle centres, attitudes (pitch nose down, roll left side up), joints, speeds, and the "
    "set points of the servos behind dead time, dead band and backlash",
    (
        *_POSES,
        *_BEYOND,
        *(f"{name}_set_point" for name in _INPUTS),
    ),  # the numbers of `MOTION` without the time
)
REFERENCE: Final = Channel(
    "/reference",
    "reference poses of both axle centres at this time, and the inputs that follow them",
    (*_POSES, "v_mps", "curvature_per_m", "beta_rad", *_INPUTS),
)
MEASUREMENT: Final = Channel(
    "/measurement",
    "samples that the sensors delivered at this time, each with the time at which it was taken; "
    "NaN where a sensor delivered none",
    tuple(f"{sensor}_{part}" for sensor, parts in _SAMPLES.items() for part in parts),
)
_SAMPLE_ENDS: Final = np.cumsum([len(parts) for parts in _SAMPLES.values()]).tolist()
MEASUREMENT_COLUMNS: Final[dict[Sensor, slice]] = {
    sensor: slice(end - len(parts), end)
    for (sensor, parts), end in zip(_SAMPLES.items(), _SAMPLE_ENDS, strict=True)
}
"""Columns of each sensor in `MEASUREMENT`: its components, then the sample time."""
ESTIMATE: Final = Channel(
    "/estimate",
    "the estimate that the controller acts on, its standard deviations, the persistent "
    "disturbances in the vehicle's frame and those in the map frame, and the normalised innovation "
    "squared of the samples used at this tick with their degrees of freedom",
    (
        *_POSES,
        *("delta_t_rad", "delta_i_rad", "v_mps", "beta_rad"),
        *("sd_x_t_m", "sd_y_t_m", "sd_psi_t_rad", "sd_psi_i_rad"),
        *("sd_delta_t_rad", "sd_delta_i_rad", "sd_v_mps"),
        *("slip_t_rad", "slip_i_rad", "steering_rad", "drive_mps2", "wheel_slip"),
        *("side_x_rad", "side_y_rad", "climb_x", "climb_y"),
        *("nis", "nis_dof"),
    ),
)
_ACTIONS: Final = ("feedforward", "feedback", "robust", "total", "command", "min", "max", "limited")
CONTROL: Final = Channel(
    "/control",
    "the command, the actions whose sum it is before limits, and the vehicle's bounds",
    tuple(f"{name}_{part}" for name in _INPUTS for part in _ACTIONS),
)
TRACKING: Final = Channel(
    "/tracking",
    "the controller's tracking error z_e in the vehicles' frames and modelling error z_m of the "
    "robust action",
    (
        *("x_t_e_m", "y_t_e_m", "psi_t_e_rad", "x_i_e_m", "y_i_e_m", "psi_i_e_rad", "v_e_mps"),
        *("x_t_m_m", "y_t_m_m", "x_i_m_m", "y_i_m_m"),
    ),
)
_TUBE_ERRORS: Final = (
    *("x_t_e_m", "y_t_e_m", "psi_t_e_rad", "psi_i_e_rad", "delta_t_e_rad", "delta_i_e_rad"),
    *("v_e_mps", "x_i_e_m", "y_i_e_m"),
)
TUBE: Final = Channel(
    "/tube",
    "the tube that a controller keeps or monitors: 1 where the estimate's deviation from the "
    "nominal error is inside, its margin (1 in the middle, 0 on the boundary), the nominal error "
    "and the half width about it in which the true one lies, in the frames of the reference",
    (
        "inside",
        "margin",
        *(f"{name}_nominal" for name in _TUBE_ERRORS),
        *(f"{name}_half_width" for name in _TUBE_ERRORS),
    ),
)
FORESIGHT: Final = Channel(
    "/foresight",
    "side slip of the trailer that is foretold for this period beside its disturbance, and the "
    "share of forecasts that is used: 0 where what the tractor met does not tell",
    ("slip_i_rad", "share"),
)
SOLVER: Final = Channel(
    "/mpc/info",
    "the QP of this tick: 1 where accepted, iterations, residuals, status (0: closed form, no "
    "solver needed; 1: solved; 2: solved with soft bounds; above: why not); 1 in a fallback",
    ("accepted", "iterations", "primal_residual", "dual_residual", "status", "fallback"),
)
TIMING: Final = Channel(
    "/timing",
    "wall-clock cost of this control period (the only channel that differs between equal runs)",
    ("estimator_us", "control_step_us", "qp_solve_us", "plant_step_us"),
)
_WHEEL_QUANTITIES: Final = (
    *("load_n", "slip", "slip_angle_rad", "force_long_n", "force_lat_n"),
    *("cone_index_kpa", "ground_m"),
)  # in the order of `Wheels`
TYRES: Final = Channel(
    "/tyres",
    "load, slip, forces and ground of every wheel",
    tuple(f"{wheel}_{quantity}" for wheel in WHEELS for quantity in _WHEEL_QUANTITIES),
)
TOOL: Final = Channel(
    "/tool",
    "implement on the trailer: its tool point and the reference of that point, depth (mean, "
    "outermost points), forces on the trailer, lift (1 lowered, 0 raised), distance driven",
    (
        *("x_m", "y_m", "x_reference_m", "y_reference_m"),
        *("depth_m", "depth_left_m", "depth_right_m"),
        *("draft_n", "side_n", "lowered", "distance_m"),
    ),
)
CORRIDOR: Final = Channel(
    "/corridor",
    "corridor about the path: its half width at the tractor point (NaN: free ground), offsets of "
    "the true points to the left of their paths (tool: NaN where it is raised), limit of |beta|",
    ("half_width_m", "tractor_m", "trailer_m", "tool_m", "hitch_limit_rad"),
)
LINE: Final = Channel(
    "/line",
    "offsets to the left of the line as given, of the true points (tool: NaN where it is raised) "
    "and of the references of both axle points",
    ("tractor_m", "trailer_m", "tool_m", "tractor_reference_m", "trailer_reference_m"),
)
"""Where the reference is not that line: of a path file, and of a trailer that leaves its line."""

_POINT_ERRORS: Final = ("along_m", "cross_m", "euclidean_m", "heading_rad")
ERROR: Final = Channel(
    "/error",
    "true tracking error of both axle points: state minus reference of the same time, ahead of and "
    "to the left of the reference",
    tuple(f"{body}_{part}" for body in ("tractor", "trailer") for part in _POINT_ERRORS),
)
"""Channel of logs and viewers: a record computes it from `/state` and `/reference`."""

CHANNELS: Final = (
    *(STATE, REFERENCE, MEASUREMENT, ESTIMATE, CONTROL, TRACKING, TUBE, FORESIGHT),
    *(SOLVER, TIMING, TYRES, TOOL, CORRIDOR, LINE),
)

_UNITS: Final = {
    "m": "m",
    "rad": "rad",
    "s": "s",
    "us": "µs",
    "n": "N",
    "kpa": "kPa",
    "mps": "m/s",
    "mps2": "m/s²",
    "radps": "rad/s",
}


def unit_of(field: str) -> str:
    """Return the unit of a field of a channel from its name, "1" for a number without one.

    It is the last of the words of the name that is a unit: "x_t_m", "delta_t_rad_command".
    """
    words = field.split("_")
    if words[-2:] == ["per", "m"]:
        return "1/m"
    return next((_UNITS[word] for word in reversed(words) if word in _UNITS), "1")


def tool_rows(tools: FloatArray, references: FloatArray) -> FloatArray:
    """Return the rows of `TOOL`, (n, fields).

    The reference of a tool point lies as far behind the trailer's as the point behind the trailer
    point.

    Args:
        tools: as in `TruthBlock`.
        references: rows of `REFERENCE` at the same moments.
    """
    x, y, _, behind, lowered, distance = tools[:, :6].T
    x_i, y_i, yaw = references[:, 3:6].T  # the trailer's part of `_POSES`
    depth, draft, side = np.split(tools[:, 6:], 3, axis=1)
    columns = (x, y, x_i - behind * np.cos(yaw), y_i - behind * np.sin(yaw), depth.mean(axis=1))
    forces = draft.sum(axis=1), side.sum(axis=1)
    return np.column_stack([*columns, depth[:, -1], depth[:, 0], *forces, lowered, distance])


def measurement_rows(
    samples: FloatArray, at: FloatArray, times: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return times and rows of `MEASUREMENT` of samples, (n,) and (n, fields).

    A row holds one sample of a sensor: there are more rows than one of a moment at which a sensor
    delivers several samples.

    Args:
        samples: rows of `ttempc.layout.SAMPLE` entries in the order of delivery.
        at: numbers of the moments at which they are delivered, ascending.
        times: of the moments [s].
    """
    rows = np.empty((len(samples), len(MEASUREMENT.fields)))
    row_times = np.empty(len(samples))
    rows.fill(NAN)
    used = _spread(samples, at, times, _COLUMNS, row_times, rows)
    return row_times[:used], rows[:used]


_COLUMNS: Final = np.array([(each.start, each.stop - 1) for each in MEASUREMENT_COLUMNS.values()])


@cached_njit(error_model="numpy", boundscheck=False)
def _spread(
    samples: FloatArray,
    at: FloatArray,
    times: FloatArray,
    columns: NDArray[np.int64],
    row_times: FloatArray,
    rows: FloatArray,
) -> int:
    """Fill rows that are NaN and their times; return how many are used."""
    first = 0  # row in which the present moment begins
    used = 0  # number of rows so far
    for n in range(len(samples)):
        if n and at[n] != at[n - 1]:
            first = used
        begin, stamp = columns[int(samples[n, 1])]
        row = first
        while row < used and not math.isnan(rows[row, stamp]):
            row += 1
        if row == used:
            row_times[row] = times[int(at[n])]
            used += 1
        for k in range(begin, stamp):
            rows[row, k] = samples[n, 2 + k - begin]
        rows[row, stamp] = samples[n, 0]
    return used


def _places(record: np.dtype[np.void]) -> dict[str, int]:
    """Return the place of the first number of each field of a record of doubles."""
    return {str(name): item[1] // 8 for name, item in (record.fields or {}).items()}


_PLACES: Final = _places(ESTIMATE_TYPE)
_FROM_ESTIMATE: Final = np.array(
    [
        *range(_PLACES["state"], _PLACES["state"] + 3),
        *range(_PLACES["trailer_xy"], _PLACES["trailer_xy"] + 2),
        *range(_PLACES["state"] + 3, _PLACES["state"] + 7),
        _PLACES["hitch_angle"],
        *range(_PLACES["covariance"], _PLACES["covariance"] + 49, 8),  # diagonal of the covariance
        *range(
            _PLACES["disturbance"], _PLACES["disturbance"] + 9
        ),  # in the vehicle's frame, then in the map's
        _PLACES["nis"],
        _PLACES["nis_dof"],
    ]
)
_SDS: Final = slice(10, 17)


def estimate_row(record: FloatArray) -> FloatArray:
    """Return the row of `ESTIMATE` of a record `ttempc.layout.ESTIMATE`."""
    row = record[_FROM_ESTIMATE]
    row[_SDS] = np.sqrt(row[_SDS])
    return row


def _columns(name: str, channel: Channel) -> slice:
    begin = _places(TICK)[name]
    return slice(begin, begin + len(channel.fields))


CONTROL_COLUMNS: Final = _columns("control", CONTROL)
"""Place of the row of `CONTROL` in a record `ttempc.layout.TICK`, which has it as it is logged."""
TRACKING_COLUMNS: Final = _columns("tracking", TRACKING)
TUBE_COLUMNS: Final = _columns("tube", TUBE)
FORESIGHT_COLUMNS: Final = _columns("expected", FORESIGHT)
SOLVER_COLUMNS: Final = _columns("solver", SOLVER)
"""The record of the solver and `TICK.fallback`, which follows it."""


def in_frame(error: FloatArray, heading: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return errors along and across references, each (n,) [m], positive ahead and to the left.

    Args:
        error: position minus reference, (n, 2) [m] map frame.
        heading: of the references, (n,) [rad].
    """
    dx, dy = error.T
    cos = np.cos(heading)
    sin = np.sin(heading)
    return cos * dx + sin * dy, cos * dy - sin * dx


def error_rows(state: FloatArray, reference: FloatArray) -> FloatArray:
    """Return the rows of `ERROR` (n, fields) from rows of state and reference.

    Args:
        state: rows of `STATE`, (n, fields).
        reference: rows of `REFERENCE` of the same times, (n, fields).
    """
    columns = []
    with np.errstate(invalid="ignore"):  # a row that is not finite has errors that are NaN
        for names in (_POSES[:3], _POSES[3:]):
            at = state[:, [STATE.fields.index(name) for name in names]]
            due = reference[:, [REFERENCE.fields.index(name) for name in names]]
            along, cross = in_frame(at[:, :2] - due[:, :2], due[:, 2])
            turned = at[:, 2] - due[:, 2]
            heading = np.arctan2(np.sin(turned), np.cos(turned))
            columns += [along, cross, np.hypot(along, cross), heading]
    return np.column_stack(columns)
