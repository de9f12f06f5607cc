"""Summary of a run: schema of `summary.json` and its numbers, computed from a record.

Field names are the keys and carry the units. A number that does not exist, such as
the error on curves of a straight path, is None.
"""

import json
import math
from dataclasses import asdict, dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from ttempc.types import SOLVER_STATUSES, FloatArray

from ...testbed.recording.channels import (
    CONTROL,
    CORRIDOR,
    ESTIMATE,
    LINE,
    REFERENCE,
    SOLVER,
    STATE,
    TIMING,
    TOOL,
    TUBE,
    TYRES,
)
from ...testbed.recording.record import LEARNT, Record
from .passes import pass_spreads, peaks
from .tracking_errors import (
    BODIES,
    BodyError,
    TrackingErrors,
    containment,
    counted,
    position_fields,
    rows_at_same_time,
    tracking_errors,
)

_AT_BOUND: Final = 1e-9  # [rad] or fraction: a command this close to a limit counts as at it
ENTERED_M: Final = 0.1
"""Distance from its line up to which a point counts as having entered it."""
_TURNED: Final = math.radians(2.0)  # heading beside that of the path from which a run has an entry
_ENTRY_M: Final = 30.0  # distance driven that an entry may take

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
    versions: dict[str, str]
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
    passes: BodyStatistics  # on passes, and the last 5 m of the turns before them
    all: BodyStatistics


@dataclass(frozen=True, slots=True)
class PassSpread:
    """Standard deviation of the cross-track error of one point on a pass, median over passes."""

    cross_sd_m: float | None  # of the true error
    seen_cross_sd_m: float | None  # of the error by the machine's own receivers and filter


@dataclass(frozen=True, slots=True)
class PassStatistics:
    """Standard deviations on the passes, as a guided machine in the field reports them."""

    count: int  # passes with errors that count
    tractor: PassSpread
    trailer: PassSpread
    tool: PassSpread | None = None  # None if the run has no implement


@dataclass(frozen=True, slots=True)
class PeakStatistics:
    """Largest absolute cross-track errors where the curvature changes, means over the changes."""

    tractor_m: float | None
    trailer_m: float | None
    tool_m: float | None = None  # None if the run has no implement, or where it is always raised


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
class SolverStatistics:
    """Ticks of a controller that solves a QP, and how they were answered."""

    ticks: int  # control ticks in which a QP was solved
    needed_solver: int  # with an active bound; the others are answered in closed form
    soft: int  # of which a soft bound was active
    rejected: int  # without an accepted solution
    iterations_max: float | None
    primal_residual_max: float | None  # of the accepted ones; None where the solver reports none
    dual_residual_max: float | None


@dataclass(frozen=True, slots=True)
class InputStatistics:
    """Saturation, rate and travel of one input."""

    saturated_fraction: float | None  # of ticks with the command at a limit of size or rate
    beyond_fraction: float | None  # of ticks with the controller's total beyond a bound of size
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


EUCLIDEAN: Final = tuple(  # of the paper's table: head of a column, key, factor
    (f"{where}, {body} [cm]", f"tracking.{where}.{body}.mean_euclidean_m", 100.0)
    for where in ("straight", "curve")
    for body in ("tractor", "trailer")
)
"""Columns of the mean Euclidean errors to the time-based reference, as the paper has them."""
PARTS: Final = tuple(
    (f"{where}, tractor {part} [cm]", f"tracking.{where}.tractor.{key}", 100.0)
    for where in ("straight", "curve")
    for part, key in (("along, mean", "along_mean_m"), ("across, sd", "cross_sd_m"))
)
"""Columns of the parts of the tractor's error along and across the path."""
BEYOND: Final = tuple(
    (f"{words} beyond its bounds [%]", f"inputs.{name}.beyond_fraction", 100.0)
    for words, name in (("front", "delta_t"), ("trailer", "delta_i"), ("hydrostat", "hp"))
)
"""Columns of the ticks in which a controller asks for more than an input has."""


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
    half_width_max_m: TubeHalfWidths | None  # largest half widths across the path [m]


@dataclass(frozen=True, slots=True)
class OutsideStatistics:
    """Departure of one true point from the corridor after start-up, where the corridor holds."""

    outside_fraction: float | None  # share of the time outside the corridor
    max_m: float | None  # largest distance from the path


@dataclass(frozen=True, slots=True)
class CorridorStatistics:
    """Departure from the corridor."""

    tractor: OutsideStatistics
    trailer: OutsideStatistics
    tool: OutsideStatistics | None  # None if the run has no implement
    hitch_outside_fraction: float | None  # of the time; None if the hitch angle is not limited


@dataclass(frozen=True, slots=True)
class OffsetStatistics:
    """Offset of one point from the line as given, across it."""

    rms_m: float | None
    p95_m: float | None  # p95 and max of the absolute offset
    max_m: float | None


@dataclass(frozen=True, slots=True)
class LineStatistics:
    """Offsets of the true points, and of the references, from the line as given."""

    tractor: OffsetStatistics
    trailer: OffsetStatistics
    tool: OffsetStatistics | None  # None if the run has no implement
    tractor_reference: OffsetStatistics  # over the whole run, as smoothing bends it
    trailer_reference: OffsetStatistics  # where the trailer leaves its line


@dataclass(frozen=True, slots=True)
class PointEntry:
    """Entry of one point into its line."""

    # Largest distance on the other side of the line, after the point was farthest from it
    overshoot_m: float | None
    settled_m: float | None  # distance driven until it is within 10 cm for good; None: never


@dataclass(frozen=True, slots=True)
class EntryStatistics:
    """Entry into the line from a start beside it, over the first 30 m driven."""

    tractor: PointEntry
    trailer: PointEntry
    tool: PointEntry | None = None  # None if the run has no implement


@dataclass(frozen=True, slots=True)
class ExtremeStatistics:
    """Largest absolute angles of a whole run, whose limits end a run."""

    tilt_rad: float | None  # roll and pitch of tractor and trailer: roll-over
    fold_rad: float | None  # at both joints of the drawbar: jack-knife


@dataclass(frozen=True, slots=True)
class Summary(RunFacts):
    """All numbers of a run."""

    duration_s: float
    tracking: TrackingStatistics
    passes: PassStatistics
    peaks: PeakStatistics
    estimation: EstimationStatistics
    timing: TimingStatistics
    solver: SolverStatistics | None  # None if the controller solves no QP
    inputs: InputsStatistics
    tube: TubeStatistics | None  # None if the run has no tube
    corridor: CorridorStatistics | None  # None on free ground
    line: LineStatistics | None  # None where the reference is the line itself
    slip: SlipStatistics
    extremes: ExtremeStatistics
    entry: EntryStatistics | None  # None for a start on the path
    implement: ImplementStatistics | None  # None if the run has no implement
    learnt: list[str]  # time and change of model parameters that were learnt

    def to_json(self) -> str:
        """Return the text of `summary.json`. It holds no NaN, which JSON does not define."""
        return json.dumps(asdict(self), indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def summarise(record: Record, facts: RunFacts, wall_s: float | None = None) -> Summary:
    """Return the summary of a run; `wall_s`: time that the simulation took, None where unknown."""
    times = record[STATE].time_s
    duration_s = round(float(times[-1]), 6) if len(times) else 0.0  # of whole physics steps
    errors = tracking_errors(record)
    return Summary(
        **asdict(facts),
        duration_s=duration_s,
        tracking=tracking_statistics(errors),
        passes=pass_statistics(record),
        peaks=peak_statistics(record, errors),
        estimation=_estimation(record),
        timing=_timing(record, duration_s, wall_s),
        solver=solver_statistics(record),
        inputs=input_statistics(record),
        tube=_tube(record),
        corridor=corridor_statistics(record),
        line=line_statistics(record),
        slip=_slip(record),
        extremes=_extremes(record),
        entry=entry_statistics(record, errors),
        implement=_implement(record),
        learnt=[
            f"{event.time_s:.0f} s: {event.text.removeprefix(LEARNT)}"
            for event in record.events
            if event.text.startswith(LEARNT)
        ],
    )


def tracking_statistics(errors: TrackingErrors) -> TrackingStatistics:
    """Return the statistics of tracking errors after the start-up."""

    def over(rows: NDArray[np.bool_]) -> BodyStatistics:
        tool = errors.tool
        return BodyStatistics(
            _error_statistics(errors.tractor.at(rows)),
            _error_statistics(errors.trailer.at(rows)),
            tool and _error_statistics(tool.at(rows & np.isfinite(tool.along_m))),
        )

    counts = errors.counted
    curved = errors.curved
    return TrackingStatistics(
        straight=over(counts & ~curved),
        curve=over(counts & curved),
        passes=over(counts & errors.on_pass),
        all=over(counts),
    )


def pass_statistics(record: Record) -> PassStatistics:
    """Return the standard deviations on the passes of a run."""
    count, spreads = pass_spreads(record)

    def medians(true_m: FloatArray, seen_m: FloatArray) -> PassSpread:
        return PassSpread(_percentile(true_m, 50.0), _percentile(seen_m, 50.0))

    return PassStatistics(count, **{point: medians(*both) for point, both in spreads.items()})


def peak_statistics(record: Record, errors: TrackingErrors) -> PeakStatistics:
    """Return the peaks of the errors where the curvature changes."""
    found = peaks(record, errors)
    return PeakStatistics(**{f"{point}_m": _mean(largest) for point, largest in found.items()})


def input_statistics(record: Record) -> InputsStatistics:
    """Return saturation, rate and travel of the commands of a whole run."""
    table = record[CONTROL]
    steps = np.diff(record[STATE].columns(*position_fields("tractor")), axis=0)
    driven_m = float(np.hypot(*steps.T).sum())

    def statistics(name: str) -> InputStatistics:
        command = table[f"{name}_command"]
        low = table[f"{name}_min"] + _AT_BOUND
        high = table[f"{name}_max"] - _AT_BOUND
        saturated = (command <= low) | (command >= high) | (table[f"{name}_limited"] > 0.5)
        saturated &= table[f"{name}_max"] > table[f"{name}_min"]  # a plain trailer has no steering
        total = table[f"{name}_total"]
        beyond = (total < low - 2.0 * _AT_BOUND) | (total > high + 2.0 * _AT_BOUND)
        steps = np.diff(command)
        travel = _number(np.abs(steps).sum() / driven_m) if driven_m else None
        return InputStatistics(
            _mean(saturated), _mean(beyond), _rms(steps / np.diff(table.time_s)), travel
        )

    return InputsStatistics(*map(statistics, ("delta_t_rad", "delta_i_rad", "hp")))


def _error_statistics(error: BodyError) -> ErrorStatistics:
    euclidean = error.euclidean_m
    return ErrorStatistics(
        mean_euclidean_m=_mean(euclidean),
        rms_m=_rms(euclidean),
        p95_m=_percentile(euclidean, 95.0),
        max_m=_percentile(euclidean, 100.0),
        along_mean_m=_mean(error.along_m),
        along_sd_m=_sd(error.along_m),
        cross_mean_m=_mean(error.cross_m),
        cross_sd_m=_sd(error.cross_m),
        cross_p95_m=_percentile(np.abs(error.cross_m), 95.0),
    )


def _estimation(record: Record) -> EstimationStatistics:
    _, state, estimate = rows_at_same_time(record, STATE, ESTIMATE)

    def mean_error(body: str) -> MeanError:
        fields = position_fields(body)
        error = record[ESTIMATE].columns(*fields)[estimate] - record[STATE].columns(*fields)[state]
        return MeanError(_mean(_since_first(np.hypot(*error.T))))

    return EstimationStatistics(**{body: mean_error(body) for body in BODIES})


def _since_first(samples: FloatArray) -> FloatArray:
    """Return the samples from the first finite one on; an estimator needs its first readings."""
    return samples[np.argmax(np.isfinite(samples)) :] if len(samples) else samples


def _timing(record: Record, duration_s: float, wall_s: float | None) -> TimingStatistics:
    table = record[TIMING]
    spreads = {}
    for name in table.channel.fields:
        known = table[name][np.isfinite(table[name])]  # a tick without a QP has no QP solve time
        spreads[name] = Spread(*(_percentile(known, percent) for percent in (50.0, 99.0, 100.0)))
    return TimingStatistics(**spreads, real_time_factor=duration_s / wall_s if wall_s else None)


def solver_statistics(record: Record) -> SolverStatistics | None:
    """Return how the QPs of a run were answered, None where there were none."""
    table = record[SOLVER]
    status = table["status"]
    has_problem = np.isfinite(status)
    if not has_problem.any():
        return None
    needed = has_problem & (status != SOLVER_STATUSES.index("closed form"))
    accepted = has_problem & (table["accepted"] == 1.0)
    residuals = (table[name][accepted] for name in ("primal_residual", "dual_residual"))
    primal, dual = (values[np.isfinite(values)] for values in residuals)
    return SolverStatistics(
        ticks=int(has_problem.sum()),
        needed_solver=int(needed.sum()),
        soft=int((status == SOLVER_STATUSES.index("solved with soft bounds")).sum()),
        rejected=int((has_problem & ~accepted).sum()),
        iterations_max=_percentile(table["iterations"][has_problem], 100.0),
        primal_residual_max=_percentile(primal, 100.0),
        dual_residual_max=_percentile(dual, 100.0),
    )


def _tube(record: Record) -> TubeStatistics | None:
    if not len(record[TUBE]):
        return None
    deviations = containment(record)
    margin = deviations.margin
    if not margin.size:
        return TubeStatistics(None, None, None)
    largest = deviations.half_width.max(axis=0)
    across = {body: float(largest[column]) for body, column in deviations.ACROSS.items()}
    return TubeStatistics(_mean(margin >= 0.0), _number(margin.min()), TubeHalfWidths(**across))


def corridor_statistics(record: Record) -> CorridorStatistics | None:
    """Return the departure from the corridor after the start-up, None on free ground."""
    table = record.tables.get(CORRIDOR.topic)  # logs of earlier versions have none
    if table is None or not len(table):
        return None
    time_counts = counted(record, table.time_s)

    def outside(point: str) -> OutsideStatistics:
        offset = np.abs(table[f"{point}_m"])
        rows = time_counts & np.isfinite(table["half_width_m"]) & np.isfinite(offset)
        beyond = _mean(offset[rows] > table["half_width_m"][rows])
        return OutsideStatistics(beyond, _percentile(offset[rows], 100.0))

    _, state, rows = rows_at_same_time(record, STATE, CORRIDOR)
    limit = table["hitch_limit_rad"][rows]
    limited = time_counts[rows] & np.isfinite(limit)
    beta = np.abs(record[STATE]["beta_rad"][state])
    return CorridorStatistics(
        tractor=outside("tractor"),
        trailer=outside("trailer"),
        tool=outside("tool") if len(record[TOOL]) else None,
        hitch_outside_fraction=_mean(beta[limited] > limit[limited]),
    )


def line_statistics(record: Record) -> LineStatistics | None:
    """Return the offsets from the line as given, None where the reference is the line itself.

    Those of true points count after the start-up, those of the references over the whole run.
    """
    table = record.tables.get(LINE.topic)
    if table is None or not len(table):
        return None
    time_counts = counted(record, table.time_s)

    def offset(name: str, rows: NDArray[np.bool_]) -> OffsetStatistics:
        offsets = np.abs(table[f"{name}_m"])
        offsets = offsets[rows & np.isfinite(offsets)]
        return OffsetStatistics(
            _rms(offsets), _percentile(offsets, 95.0), _percentile(offsets, 100.0)
        )

    always = np.full(len(table), True)
    return LineStatistics(
        tractor=offset("tractor", time_counts),
        trailer=offset("trailer", time_counts),
        tool=offset("tool", time_counts) if len(record[TOOL]) else None,
        tractor_reference=offset("tractor_reference", always),
        trailer_reference=offset("trailer_reference", always),
    )


def entry_statistics(record: Record, errors: TrackingErrors) -> EntryStatistics | None:
    """Return how the points came into their lines, None for a start within 10 cm and 2 deg."""
    _, state, reference = rows_at_same_time(record, STATE, REFERENCE)
    if not len(state):
        return None
    turned = record[STATE]["psi_t_rad"][state[0]] - record[REFERENCE]["psi_t_rad"][reference[0]]
    turned = math.remainder(turned, 2.0 * math.pi)
    if abs(errors.tractor.cross_m[0]) <= ENTERED_M and abs(turned) < _TURNED:
        return None
    steps = np.diff(record[STATE].columns(*position_fields("tractor"))[state], axis=0)
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(*steps.T))])

    def entry(error: BodyError) -> PointEntry:
        rows = (driven <= _ENTRY_M) & np.isfinite(error.cross_m)  # a raised tool has no error
        cross = error.cross_m[rows]
        at = driven[rows]
        if not cross.size:
            return PointEntry(None, None)
        farthest = int(np.abs(cross).argmax())
        beyond_line = -math.copysign(1.0, cross[farthest]) * cross[farthest:]
        beyond = np.flatnonzero(np.abs(cross) > ENTERED_M)
        entered = int(beyond[-1]) + 1 if beyond.size else 0
        settled_m = float(at[entered]) if entered < len(at) else None
        return PointEntry(max(0.0, float(beyond_line.max())), settled_m)

    return EntryStatistics(**{name: entry(error) for name, error in errors.by_point.items()})


def _slip(record: Record) -> SlipStatistics:
    table = record[TYRES]
    rear = np.abs(table.columns("rear_left_slip", "rear_right_slip"))
    angle = np.abs(table.columns("trailer_left_slip_angle_rad", "trailer_right_slip_angle_rad"))
    return SlipStatistics(_mean(rear), _percentile(rear, 95.0), _percentile(angle, 95.0))


def _extremes(record: Record) -> ExtremeStatistics:
    table = record[STATE]
    tilt = table.columns("roll_t_rad", "pitch_t_rad", "roll_i_rad", "pitch_i_rad")
    fold = table.columns("beta_rad", "delta_i_rad")
    return ExtremeStatistics(*(_percentile(np.abs(each), 100.0) for each in (tilt, fold)))


def _implement(record: Record) -> ImplementStatistics | None:
    table = record[TOOL]
    if not len(table):
        return None
    works = counted(record, table.time_s) & (table["lowered"] == 1.0)
    draft = table["draft_n"][works]
    return ImplementStatistics(
        depth_mean_m=_mean(table["depth_m"][works]),
        draft_mean_n=_mean(draft),
        draft_p95_n=_percentile(draft, 95.0),
        side_p95_n=_percentile(np.abs(table["side_n"][works]), 95.0),
    )


def _mean(samples: FloatArray | NDArray[np.bool_]) -> float | None:
    return _number(np.mean(samples)) if samples.size else None


def _sd(samples: FloatArray) -> float | None:
    return _number(np.std(samples)) if samples.size else None


def _rms(samples: FloatArray) -> float | None:
    return _number(np.sqrt(np.mean(np.square(samples)))) if samples.size else None


def _percentile(samples: FloatArray, percent: float) -> float | None:
    return _number(np.percentile(samples, percent)) if samples.size else None


def _number(value: np.floating) -> float | None:
    """Return the number if it is finite, else None: a missing sample makes a statistic unknown."""
    return float(value) if np.isfinite(value) else None
