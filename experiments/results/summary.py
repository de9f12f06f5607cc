"""Schema of `summary.json`. Field names are its keys and carry the units.

A number that does not exist, such as the error on curves of a straight path, is None.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Final, Literal

Status = Literal["completed", "stopped", "lost", "invalid", "ended early", "torn"]
"""How a run ended. The last two are of a log alone: it does not say how, or it is not whole."""


@dataclass(frozen=True, slots=True)
class RunFacts:
    """Identity and outcome of a run, which its record does not hold."""

    run_id: str
    scenario: str
    controller: str
    seed: int
    status: Status
    failure: str | None  # reason for early termination, in one line
    wall_s: float | None  # wall-clock time of the simulation, without reports; None: unknown
    versions: Mapping[str, str]
    log: str | None  # the log's path relative to the run's folder


@dataclass(frozen=True, slots=True)
class ErrorStatistics:
    """Tracking error of one point."""

    mean_euclidean_m: float | None
    rms_m: float | None  # rms, p95 and max of the Euclidean error
    p95_m: float | None
    max_m: float | None
    along_mean_m: float | None
    along_sd_m: float | None
    cross_mean_m: float | None
    cross_sd_m: float | None
    cross_p95_m: float | None  # of the absolute cross-track error


@dataclass(frozen=True, slots=True)
class BodyStatistics:
    """Tracking errors of both axle points, and of the tool point while it is lowered."""

    tractor: ErrorStatistics
    trailer: ErrorStatistics
    tool: ErrorStatistics | None = None  # None if the run has no implement

    @property
    def by_point(self) -> dict[str, ErrorStatistics]:
        """Statistics by the name of their point, the working point first and the tractor last.

        The working point is the tool where there is an implement, else the trailer's axle point.
        """
        points = {"tool": self.tool, "trailer": self.trailer, "tractor": self.tractor}
        return {name: error for name, error in points.items() if error is not None}


@dataclass(frozen=True, slots=True)
class TrackingStatistics:
    """Tracking errors by shape of the reference, see `tracking_errors.counted`."""

    straight: BodyStatistics
    curve: BodyStatistics
    all: BodyStatistics

    @property
    def headline(self) -> ErrorStatistics:
        """Errors of the working point on the whole path: its cross-track p95 and sd are told."""
        return next(iter(self.all.by_point.values()))


@dataclass(frozen=True, slots=True)
class MeanError:
    """Mean error of an estimated point."""

    mean_euclidean_m: float | None


@dataclass(frozen=True, slots=True)
class EstimationStatistics:
    """Errors of the estimate from the first estimate on, start-up included."""

    tractor: MeanError
    trailer: MeanError


@dataclass(frozen=True, slots=True)
class Spread:
    """Median, 99th percentile and maximum of a cost."""

    median: float | None
    p99: float | None
    max: float | None


@dataclass(frozen=True, slots=True)
class TimingStatistics:
    """Wall-clock cost of the parts of a control period."""

    estimator_us: Spread
    control_step_us: Spread
    qp_solve_us: Spread
    plant_step_us: Spread
    real_time_factor: float | None  # simulated time over wall-clock time


@dataclass(frozen=True, slots=True)
class InputStatistics:
    """Saturation, rate and travel of one input."""

    saturated_fraction: float | None  # of ticks with the command at a limit of size or rate
    rms_rate: float | None  # of the command, in its unit per second
    travel_per_m: float | None  # total change of the command over the distance driven


@dataclass(frozen=True, slots=True)
class InputsStatistics:
    """Saturation, rate and travel of the inputs."""

    delta_t: InputStatistics
    delta_i: InputStatistics
    hp: InputStatistics


ACTUATOR_USE: Final = (  # head of a column, key of the summary, factor from the key's unit
    ("front steering [deg/m]", "inputs.delta_t.travel_per_m", math.degrees(1.0)),
    ("trailer steering [deg/m]", "inputs.delta_i.travel_per_m", math.degrees(1.0)),
    ("hydrostat [%/m]", "inputs.hp.travel_per_m", 100.0),
    ("hydrostat at limits [%]", "inputs.hp.saturated_fraction", 100.0),
)
"""Columns on the use of the actuators in comparisons of controllers."""


@dataclass(frozen=True, slots=True)
class SlipStatistics:
    """Absolute slip of the driven wheels and absolute slip angle of the trailer's wheels."""

    rear_mean: float | None
    rear_p95: float | None
    trailer_slip_angle_p95_rad: float | None


@dataclass(frozen=True, slots=True)
class ImplementStatistics:
    """Depth and forces of a lowered implement after start-up."""

    depth_mean_m: float | None
    draft_mean_n: float | None
    draft_p95_n: float | None
    side_p95_n: float | None  # of the absolute side force


@dataclass(frozen=True, slots=True)
class TubeHalfWidths:
    """Largest half widths of a tube across the path [m]."""

    tractor: float
    trailer: float


@dataclass(frozen=True, slots=True)
class TubeStatistics:
    """Containment of both true axle points in the controller's tube after start-up.

    The margin is 1 minus the largest normalised deviation: 1 at the centre of the tube, 0 on its
    boundary, below 0 outside.
    """

    contained_fraction: float | None  # of the control ticks
    margin_min: float | None
    half_width_max_m: TubeHalfWidths | None  # across the path


@dataclass(frozen=True, slots=True)
class OutsideStatistics:
    """Departure of one true point from the corridor after start-up, where the corridor holds."""

    outside_fraction: float | None  # of the time
    max_m: float | None  # largest distance from the path


@dataclass(frozen=True, slots=True)
class CorridorStatistics:
    """Departure from the corridor."""

    tractor: OutsideStatistics
    trailer: OutsideStatistics
    tool: OutsideStatistics | None  # None if the run has no implement
    hitch_outside_fraction: float | None  # of the time; None if the hitch angle is not limited


@dataclass(frozen=True, slots=True)
class ExtremeStatistics:
    """Largest absolute angles of a whole run, whose limits end a run."""

    tilt_rad: float | None  # roll and pitch of tractor and trailer: roll-over
    fold_rad: float | None  # at both joints of the drawbar: jack-knife


@dataclass(frozen=True, slots=True)
class Summary:
    """All numbers of a run."""

    run_id: str
    scenario: str
    controller: str
    seed: int
    status: Status
    failure: str | None
    duration_s: float
    versions: dict[str, str]
    tracking: TrackingStatistics
    estimation: EstimationStatistics
    timing: TimingStatistics
    inputs: InputsStatistics
    tube: TubeStatistics | None  # None if the run has no tube
    corridor: CorridorStatistics | None  # None on free ground
    slip: SlipStatistics
    extremes: ExtremeStatistics
    implement: ImplementStatistics | None  # None if the run has no implement
    learnt: list[str]  # time and change of model parameters that were learnt
    log: str | None

    def to_json(self) -> str:
        """Return the text of `summary.json`. It holds no NaN, which JSON does not define."""
        return json.dumps(asdict(self), indent=2, allow_nan=False, ensure_ascii=False) + "\n"
