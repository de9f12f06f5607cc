"""The flat channels of a run: which numbers go into memory and log, under which names.

One table for all that record, log, metrics, figures and readers share. A row has one number per
field; the time of a row is the simulated time at which it was true. Units stand in the names. A
number that does not exist in a row is NaN.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from ..truth import WHEELS


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic and the names of its numbers, with the words that explain it in the log."""

    topic: str
    about: str
    fields: tuple[str, ...]


_INPUTS: Final = ("delta_t_rad", "delta_i_rad", "hp")
_POSES: Final = ("x_t_m", "y_t_m", "psi_t_rad", "x_i_m", "y_i_m", "psi_i_rad")

STATE: Final = Channel(
    "/state",
    "truth: axle centres, attitudes (pitch nose down, roll left side up), joints, speeds, and what "
    "reaches the servos behind dead time, dead band and play",
    (
        *_POSES,
        *("z_t_m", "pitch_t_rad", "roll_t_rad", "z_i_m", "pitch_i_rad", "roll_i_rad"),
        *("psi_d_rad", "beta_rad", *_INPUTS),
        *("v_mps", "v_lateral_mps", "yaw_rate_t_radps", "yaw_rate_i_radps", "v_rim_mps"),
        *(f"{name}_set_point" for name in _INPUTS),
    ),
)
REFERENCE: Final = Channel(
    "/reference",
    "where both axle centres should be at this time, and the inputs that keep them there",
    (*_POSES, "v_mps", "curvature_per_m", "beta_rad", *_INPUTS),
)
MEASUREMENT: Final = Channel(
    "/measurement",
    "what the sensors delivered at this time, taken earlier by their latency; NaN where a sensor "
    "gave no sample",
    (
        *("gnss_tractor_x_m", "gnss_tractor_y_m", "gnss_trailer_x_m", "gnss_trailer_y_m"),
        *("steering_tractor_rad", "steering_trailer_rad", "hitch_rad", "encoder_mps"),
        *("imu_tractor_yaw_rate_radps", "imu_tractor_roll_rad", "imu_tractor_pitch_rad"),
        *("imu_trailer_yaw_rate_radps", "imu_trailer_roll_rad", "imu_trailer_pitch_rad"),
    ),
)
ESTIMATE: Final = Channel(
    "/estimate",
    "the estimate that the controller acts on, its standard deviations, the disturbances that "
    "last and the part of them that stays with the field, and the normalised innovation squared of "
    "the samples taken in at this tick with their degrees of freedom",
    (
        *(*_POSES, "delta_t_rad", "delta_i_rad", "v_mps", "beta_rad"),
        *("sd_x_t_m", "sd_y_t_m", "sd_psi_t_rad", "sd_psi_i_rad"),
        *("sd_delta_t_rad", "sd_delta_i_rad", "sd_v_mps"),
        *("slip_t_rad", "slip_i_rad", "steering_rad", "drive_mps2", "wheel_slip"),
        *("side_x_rad", "side_y_rad", "climb_x", "climb_y"),
        *("nis", "nis_dof"),
    ),
)
CONTROL: Final = Channel(
    "/control",
    "the command, the actions it is the sum of before limits, and the vehicle's bounds",
    tuple(
        f"{name}_{part}"
        for name in _INPUTS
        for part in (
            *("feedforward", "feedback", "robust", "total", "command"),
            *("min", "max", "limited"),
        )
    ),
)
TRACKING: Final = Channel(
    "/tracking",
    "what the controller believes: tracking error z_e in the vehicles' frames and modelling "
    "error z_m of the robust action",
    (
        *("x_t_e_m", "y_t_e_m", "psi_t_e_rad", "x_i_e_m", "y_i_e_m", "psi_i_e_rad", "v_e_mps"),
        *("x_t_m_m", "y_t_m_m", "x_i_m_m", "y_i_m_m"),
    ),
)
_WITHIN: Final = (
    *("x_t_e_m", "y_t_e_m", "psi_t_e_rad", "psi_i_e_rad", "delta_t_e_rad", "delta_i_e_rad"),
    *("v_e_mps", "x_i_e_m", "y_i_e_m"),
)
TUBE: Final = Channel(
    "/tube",
    "the tube of a controller that keeps to one or watches one: 1 where the estimate's deviation "
    "from the nominal error is inside, its margin (1 in the middle, 0 on the boundary), the "
    "nominal error and the half width about it in which the true one lies, in the frames of the "
    "reference",
    (
        *("inside", "margin"),
        *(f"{name}_nominal" for name in _WITHIN),
        *(f"{name}_half_width" for name in _WITHIN),
    ),
)
SOLVER: Final = Channel(
    "/mpc/info",
    "the QP of this tick: 1 where accepted, iterations, residuals; 1 where a fallback drove",
    ("accepted", "iterations", "primal_residual", "dual_residual", "fallback"),
)
TIMING: Final = Channel(
    "/timing",
    "wall-clock cost of this control period (the only channel that differs between equal runs)",
    ("estimator_us", "control_step_us", "qp_solve_us", "plant_step_us"),
)
TYRES: Final = Channel(
    "/tyres",
    "load, slip, forces and ground of every wheel",
    tuple(
        f"{wheel}_{part}"
        for wheel in WHEELS
        for part in (
            *("load_n", "slip", "slip_angle_rad", "force_long_n", "force_lat_n"),
            *("cone_index_kpa", "ground_m"),
        )
    ),
)

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
)
