"""Flat channels of a run: topics, names of their numbers and their units.

Record, log, metrics, figures and readers share this table. A row has one number per field; the time
of a row is the simulated time at which it was true. Units are part of the names, see `unit_of`. A
number that does not exist in a row is NaN.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from ttempc.types import Sensor

from ..sensing.sensors import COMPONENTS
from ..truth import WHEELS


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic, its description in the log, and the names of its numbers."""

    topic: str
    about: str
    fields: tuple[str, ...]


_INPUTS: Final = ("delta_t_rad", "delta_i_rad", "hp")
_POSES: Final = ("x_t_m", "y_t_m", "psi_t_rad", "x_i_m", "y_i_m", "psi_i_rad")
_ATTITUDES: Final = ("z_t_m", "pitch_t_rad", "roll_t_rad", "z_i_m", "pitch_i_rad", "roll_i_rad")
_SPEEDS: Final = (
    "v_mps",
    "v_lateral_mps",
    "yaw_rate_t_radps",
    "yaw_rate_i_radps",
    "v_rim_mps",
)


_SAMPLES: Final = {sensor: (*parts, "time_s") for sensor, parts in COMPONENTS.items()}


def _sensor_columns() -> dict[Sensor, slice]:
    """Return the columns of each sensor in `MEASUREMENT`: its components, then the sample time."""
    columns, first = {}, 0
    for sensor, parts in _SAMPLES.items():
        columns[sensor] = slice(first, first + len(parts))
        first += len(parts)
    return columns


STATE: Final = Channel(
    "/state",
    "truth: axle centres, attitudes (pitch nose down, roll left side up), joints, speeds, and the "
    "set points of the servos behind dead time, dead band and play",
    (
        *_POSES,
        *_ATTITUDES,
        "psi_d_rad",
        "beta_rad",
        *_INPUTS,
        *_SPEEDS,
        *(f"{name}_set_point" for name in _INPUTS),
    ),
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
MEASUREMENT_COLUMNS: Final = _sensor_columns()
ESTIMATE: Final = Channel(
    "/estimate",
    "the estimate that the controller acts on, its standard deviations, the persistent "
    "disturbances in the vehicle's frame and those in the map frame, and the normalised innovation "
    "squared of the samples used at this tick with their degrees of freedom",
    (
        *_POSES,
        "delta_t_rad",
        "delta_i_rad",
        "v_mps",
        "beta_rad",
        "sd_x_t_m",
        "sd_y_t_m",
        "sd_psi_t_rad",
        "sd_psi_i_rad",
        "sd_delta_t_rad",
        "sd_delta_i_rad",
        "sd_v_mps",
        "slip_t_rad",
        "slip_i_rad",
        "steering_rad",
        "drive_mps2",
        "wheel_slip",
        "side_x_rad",
        "side_y_rad",
        "climb_x",
        "climb_y",
        "nis",
        "nis_dof",
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
        "x_t_e_m",
        "y_t_e_m",
        "psi_t_e_rad",
        "x_i_e_m",
        "y_i_e_m",
        "psi_i_e_rad",
        "v_e_mps",
        "x_t_m_m",
        "y_t_m_m",
        "x_i_m_m",
        "y_i_m_m",
    ),
)
_TUBE_ERRORS: Final = (
    "x_t_e_m",
    "y_t_e_m",
    "psi_t_e_rad",
    "psi_i_e_rad",
    "delta_t_e_rad",
    "delta_i_e_rad",
    "v_e_mps",
    "x_i_e_m",
    "y_i_e_m",
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
SOLVER: Final = Channel(
    "/mpc/info",
    "the QP of this tick: 1 where accepted, iterations, residuals; 1 in a fallback",
    ("accepted", "iterations", "primal_residual", "dual_residual", "fallback"),
)
TIMING: Final = Channel(
    "/timing",
    "wall-clock cost of this control period (the only channel that differs between equal runs)",
    ("estimator_us", "control_step_us", "qp_solve_us", "plant_step_us"),
)
_WHEEL_QUANTITIES: Final = (
    "load_n",
    "slip",
    "slip_angle_rad",
    "force_long_n",
    "force_lat_n",
    "cone_index_kpa",
    "ground_m",
)
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
        "x_m",
        "y_m",
        "x_reference_m",
        "y_reference_m",
        "depth_m",
        "depth_left_m",
        "depth_right_m",
        "draft_n",
        "side_n",
        "lowered",
        "distance_m",
    ),
)
CORRIDOR: Final = Channel(
    "/corridor",
    "corridor about the path: its half width at the tractor point (NaN: free ground), offsets of "
    "the true points to the left of their paths (tool: NaN where it is raised), limit of |beta|",
    ("half_width_m", "tractor_m", "trailer_m", "tool_m", "hitch_limit_rad"),
)

_POINT_ERRORS: Final = ("along_m", "cross_m", "euclidean_m", "heading_rad")
ERROR: Final = Channel(
    "/error",
    "true tracking error of both axle points: state minus reference of the same time, ahead of and "
    "to the left of the reference",
    tuple(f"{body}_{part}" for body in ("tractor", "trailer") for part in _POINT_ERRORS),
)
"""Channel of logs and viewers: a record computes it from `/state` and `/reference`."""

CHANNELS: Final = (
    STATE,
    REFERENCE,
    MEASUREMENT,
    ESTIMATE,
    CONTROL,
    TRACKING,
    TUBE,
    SOLVER,
    TIMING,
    TYRES,
    TOOL,
    CORRIDOR,
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
