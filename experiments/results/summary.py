"""The numbers of a run, `summary.json`: every field is a key of it, every unit stands in a name.

A number that does not exist, such as the error on curves of a straight path, is None.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Literal

Status = Literal["completed", "lost", "invalid"]


@dataclass(frozen=True, slots=True)
class RunFacts:
    """What the numbers of a record cannot say of a run."""

    run_id: str
    scenario: str
    controller: str
    seed: int
    status: Status
    failure: str | None  # why the run did not complete, in one line
    wall_s: float  # wall-clock time that the run took, without reports
    versions: Mapping[str, str]
    log: str | None  # the log's path relative to the run's folder


@dataclass(frozen=True, slots=True)
class ErrorStatistics:
    """Tracking error of one axle point."""

    mean_euclidean_m: float | None
    rms_m: float | None  # of the Euclidean error, as the two below
    p95_m: float | None
    max_m: float | None
    along_mean_m: float | None
    along_sd_m: float | None
    cross_mean_m: float | None
    cross_sd_m: float | None
    cross_p95_m: float | None  # of the unsigned cross-track error, as ISO 12188-2 has it


@dataclass(frozen=True, slots=True)
class BodyStatistics:
    """Tracking errors of both axle points."""

    tractor: ErrorStatistics
    trailer: ErrorStatistics


@dataclass(frozen=True, slots=True)
class TrackingStatistics:
    """Tracking errors after start-up by the shape of the reference."""

    straight: BodyStatistics
    curve: BodyStatistics
    all: BodyStatistics


@dataclass(frozen=True, slots=True)
class MeanError:
    """Mean error of an estimated point."""

    mean_euclidean_m: float | None


@dataclass(frozen=True, slots=True)
class EstimationStatistics:
    """Errors of the estimate from its first on, start-up included."""

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
    """How hard one input was used."""

    saturated_fraction: float | None  # of ticks where a limit changed the command or it is at one
    rms_rate: float | None  # of the command, in its unit a second


@dataclass(frozen=True, slots=True)
class InputsStatistics:
    """How hard the inputs were used."""

    delta_t: InputStatistics
    delta_i: InputStatistics
    hp: InputStatistics


@dataclass(frozen=True, slots=True)
class SlipStatistics:
    """Unsigned slip of the driven wheels and slip angle of the trailer's."""

    rear_mean: float | None
    rear_p95: float | None
    trailer_slip_angle_p95_rad: float | None


@dataclass(frozen=True, slots=True)
class TubeStatistics:
    """How well the truth kept to the controller's tube after start-up, by both axle points.

    The margin is 1 in the middle of the tube, 0 on its boundary and below 0 outside.
    """

    contained_fraction: float | None  # of the control ticks
    margin_min: float | None


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
    tube: TubeStatistics | None  # None where the controller keeps to no tube
    slip: SlipStatistics
    log: str | None

    def to_json(self) -> str:
        """Return the text of `summary.json`; it holds no NaN, which JSON does not know."""
        return json.dumps(asdict(self), indent=2, allow_nan=False, ensure_ascii=False) + "\n"
