"""Limits of the detectors of slow drifts, from the largest statistics of drives without one."""

import math
from time import perf_counter
from typing import Final

import numpy as np
import pandas as pd

from ttempc.detectors.drift import BIN_ENDS_S
from ttempc.detectors.kernel import DETECTORS
from ttempc.detectors.table import DetectorIndex
from ttempc.types import FloatArray

from ....testbed.recording.record import Recorder
from ...run.assembly import assemble
from ...run.simulate import drive_into
from ...studies.sweep.row import Row, no_figures
from ...studies.sweep.work import SweepJob
from ..markdown import markdown, numbers
from ..table import Table, listed, study, variants

_SEEDS: Final = range(601, 604)
_FIELDS: Final = (
    "grass",
    "pavement",
    "farm",
    "grass-field",
    "wet-grass",
    "wet-slope",
    "side-slope",
    "rows",
    "furrows",
    "patchy",
    "soft-passes",
    "cultivate",
    "kayacan2016",
    "plain-trailer",
    "work-eight",
    "work-passes",
    "work-reverse",
    "work-slope",
    "fast-eight",
    "fast-passes",
    "fast-slope",
)
_SENSORS: Final = {
    "velocity, IMU": ('sensors.gnss_velocity="doppler"', "sensors.imu.on=true"),
    "neither": (
        'sensors.gnss_velocity="none"',
        "sensors.imu.on=false",
        'sensors.gnss_antenna="point"',  # the field's antennas need an IMU
    ),
}
_PER_HOUR: Final = 1.0  # false alarms at the first limit
_EULER: Final = 0.5772156649  # mean of the standard Gumbel distribution

_RATIOS: Final = tuple(f"ratio_{n}" for n in range(len(BIN_ENDS_S)))
_VELOCITY: Final = "ratio_velocity"


def drive(job: SweepJob) -> Row:
    """Drive without a fault; the row has the largest statistics, those of the drift by bins."""
    start = perf_counter()
    assembly = assemble(job.scenario, job.seed)
    guidance = assembly.guidance
    largest = np.zeros(len(_RATIOS) + 1)

    def compare(_: int) -> None:
        memory = guidance.state.detectors.record.view(DETECTORS)[0]
        velocity = memory["board"]["statistic"][DetectorIndex.VELOCITY]
        np.maximum(largest, [*memory["drift"]["scaled"], velocity], out=largest)

    outcome = drive_into(Recorder(), assembly, on_tick=compare, prepared=False)
    row = job.row(outcome.status, outcome.failure, no_figures(), perf_counter() - start)
    hours = guidance.tick * job.scenario.control.period_s / 3600.0
    return {**row, "hours": hours, **dict(zip((*_RATIOS, _VELOCITY), largest, strict=True))}


def gumbel_limit(largest: FloatArray, probability: float) -> float:
    """Return what the largest value of a drive exceeds with a probability.

    A Gumbel distribution of scale s has the mean m + 0.5772 s and the standard deviation
    pi s / sqrt(6); both are taken from the values (n,).
    """
    scale = float(np.std(largest)) * math.sqrt(6.0) / math.pi
    mode = float(np.mean(largest)) - _EULER * scale
    return mode - scale * math.log(-math.log1p(-probability))


def joint_limits(largest: FloatArray, probability: float) -> FloatArray:
    """Return limits (bins,) of which a drive exceeds any with a probability.

    The limits of single bins are exceeded alike often; all are then scaled by one factor.

    Args:
        largest: values of drives and bins, (n, bins).
        probability: for a drive to exceed a limit.
    """
    single = np.array([gumbel_limit(column, probability) for column in largest.T])
    return single * gumbel_limit((largest / single).max(axis=1), probability)


def _text(runs: pd.DataFrame) -> str:
    """Return a line for each set of sensors: drives, hours, limits, and what was largest."""
    ends = [f"to {end:g} s" if math.isfinite(end) else "above" for end in BIN_ENDS_S]
    lines: list[list[str]] = []
    for sensors in _SENSORS:
        own = runs[(runs["sensors"] == sensors) & (runs["status"] == "completed")]
        hours = numbers(own, "hours")
        probability = _PER_HOUR * float(np.mean(hours))
        drift = np.column_stack([numbers(own, name) for name in _RATIOS])
        limits = joint_limits(drift, probability)
        shown = [f"{limit:.1f}" for limit in limits]
        closest = float((drift / limits).max())
        velocity = numbers(own, _VELOCITY)
        of_velocity = f"{gumbel_limit(velocity, probability):.1f}" if velocity.any() else "-"
        lines.append(
            [sensors, f"{len(own)}", f"{hours.sum():.1f}", *shown, f"{closest:.2f}", of_velocity]
        )
    heads = ["sensors", "drives", "hours", *ends, "largest, of its limit", "velocity"]
    return markdown(heads, lines)


TABLES: Final = (
    Table(
        name="drift-limits",
        studies={
            "drift-limits": study(
                "grass",
                _SEEDS,
                (),
                listed("scenario", *_FIELDS),
                variants("sensors", _SENSORS),
            )
        },
        work=drive,
        text=_text,
    ),
)
