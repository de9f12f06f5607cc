"""Summary of a run computed from its record."""

from __future__ import annotations

from dataclasses import fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ...testbed.recording.channels import (
    CONTROL,
    CORRIDOR,
    ESTIMATE,
    STATE,
    TIMING,
    TOOL,
    TUBE,
    TYRES,
)
from ...testbed.recording.record import LEARNT, Record
from .containment import containment
from .summary import (
    BodyStatistics,
    CorridorStatistics,
    ErrorStatistics,
    EstimationStatistics,
    ExtremeStatistics,
    ImplementStatistics,
    InputsStatistics,
    InputStatistics,
    MeanError,
    OutsideStatistics,
    RunFacts,
    SlipStatistics,
    Spread,
    Summary,
    TimingStatistics,
    TrackingStatistics,
    TubeHalfWidths,
    TubeStatistics,
)
from .tracking_errors import (
    BODIES,
    BodyError,
    TrackingErrors,
    counted,
    position_fields,
    rows_at_same_time,
    tracking_errors,
)

_AT_BOUND: Final = 1e-9  # [rad] or fraction: a command this close to a limit counts as at it


def summarise(record: Record, facts: RunFacts) -> Summary:
    """Return the summary of a run."""
    times = record[STATE].time_s
    duration_s = round(float(times[-1]), 6) if len(times) else 0.0  # of whole physics steps
    identity = {item.name: getattr(facts, item.name) for item in fields(facts)}
    del identity["wall_s"]
    return Summary(
        **{**identity, "versions": dict(facts.versions)},
        duration_s=duration_s,
        tracking=tracking_statistics(tracking_errors(record)),
        estimation=_estimation(record),
        timing=_timing(record, duration_s, facts.wall_s),
        inputs=input_statistics(record),
        tube=_tube(record),
        corridor=corridor_statistics(record),
        slip=_slip(record),
        extremes=_extremes(record),
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

    return TrackingStatistics(
        straight=over(errors.counted & ~errors.curved),
        curve=over(errors.counted & errors.curved),
        all=over(errors.counted),
    )


def input_statistics(record: Record) -> InputsStatistics:
    """Return saturation, rate and travel of the commands of a whole run."""
    table = record[CONTROL]
    way = np.diff(record[STATE].columns(*position_fields("tractor")), axis=0)
    driven_m = float(np.hypot(*way.T).sum())

    def statistics(name: str) -> InputStatistics:
        command = table[f"{name}_command"]
        at_bound = (command <= table[f"{name}_min"] + _AT_BOUND) | (
            command >= table[f"{name}_max"] - _AT_BOUND
        )
        saturated = at_bound | (table[f"{name}_limited"] > 0.5)
        steps = np.diff(command)
        return InputStatistics(
            saturated_fraction=_mean(saturated),
            rms_rate=_rms(steps / np.diff(table.time_s)),
            travel_per_m=_number(np.abs(steps).sum() / driven_m) if driven_m else None,
        )

    return InputsStatistics(
        delta_t=statistics("delta_t_rad"), delta_i=statistics("delta_i_rad"), hp=statistics("hp")
    )


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
    spreads = {name: _spread(table[name]) for name in table.channel.fields}
    return TimingStatistics(**spreads, real_time_factor=duration_s / wall_s if wall_s else None)


def _spread(cost_us: FloatArray) -> Spread:
    finite = cost_us[np.isfinite(cost_us)]  # a tick without a QP has no QP solve time
    return Spread(
        median=_percentile(finite, 50.0),
        p99=_percentile(finite, 99.0),
        max=_percentile(finite, 100.0),
    )


def _tube(record: Record) -> TubeStatistics | None:
    if not len(record[TUBE]):
        return None
    deviations = containment(record)
    margin = deviations.margin
    if not margin.size:
        return TubeStatistics(None, None, None)
    across = {
        body: float(deviations.half_width[:, column].max())
        for body, column in deviations.ACROSS.items()
    }
    return TubeStatistics(
        _mean(margin >= 0.0), _number(margin.min()), half_width_max_m=TubeHalfWidths(**across)
    )


def corridor_statistics(record: Record) -> CorridorStatistics | None:
    """Return the departure from the corridor after the start-up, None on free ground."""
    table = record.tables.get(CORRIDOR.topic)  # logs of earlier versions have none
    if table is None or not len(table):
        return None
    time_counts = counted(record, table.time_s)

    def outside(point: str) -> OutsideStatistics:
        offset = np.abs(table[f"{point}_m"])
        rows = time_counts & np.isfinite(table["half_width_m"]) & np.isfinite(offset)
        return OutsideStatistics(
            outside_fraction=_mean(offset[rows] > table["half_width_m"][rows]),
            max_m=_percentile(offset[rows], 100.0),
        )

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


def _slip(record: Record) -> SlipStatistics:
    table = record[TYRES]
    rear = np.abs(table.columns("rear_left_slip", "rear_right_slip"))
    angle = np.abs(table.columns("trailer_left_slip_angle_rad", "trailer_right_slip_angle_rad"))
    return SlipStatistics(
        rear_mean=_mean(rear),
        rear_p95=_percentile(rear, 95.0),
        trailer_slip_angle_p95_rad=_percentile(angle, 95.0),
    )


def _extremes(record: Record) -> ExtremeStatistics:
    table = record[STATE]
    tilt = table.columns("roll_t_rad", "pitch_t_rad", "roll_i_rad", "pitch_i_rad")
    fold = table.columns("beta_rad", "delta_i_rad")
    return ExtremeStatistics(
        tilt_rad=_percentile(np.abs(tilt), 100.0), fold_rad=_percentile(np.abs(fold), 100.0)
    )


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
