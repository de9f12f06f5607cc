"""Limits of the tracking error: its parts by noise, estimation, ground and control.

    python -m experiments.studies.ablations.limits [SEEDS [SCENARIO ...]]      (default: 2, all)

Drives one lap of every field with `ttempc` in four ways (`VARIANTS`) under the same seeds, and
prints the Markdown tables of docs/limits.md: root mean square errors [cm], and the parts of the
mean square error [%] that lie between the variants.
"""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ....testbed.recording.channels import ESTIMATE, STATE
from ....testbed.recording.record import Record
from ....testbed.sensing.sensor_specification import SensorSpecification
from ...results.tracking_errors import BODIES, START_UP_S, position_fields, rows_at_same_time
from ...run.simulate import simulate
from ...scenario.controller import TRUTH, NoiseSettings
from ...scenario.scenario import Scenario, load, shipped
from ...seeds import report_seeds
from ..batch import one_lap, run_tasks

CONTROLLER: Final = "ttempc"


def _as_it_is(scenario: Scenario) -> Scenario:
    return scenario


def _clean(scenario: Scenario) -> Scenario:
    """Return the scenario with the paper's sensors, undelayed at the axle points, without noise."""
    sensors = SensorSpecification(gnss_sd_m=0.0, angle_sd_deg=0.0, encoder_sd_mps=0.0)
    controller = replace(scenario.controller, noise=NoiseSettings().filled(sensors))
    return replace(scenario, sensors=sensors, controller=controller)


def _truth(scenario: Scenario) -> Scenario:
    return replace(scenario, controller=replace(scenario.controller, estimator=TRUTH))


def _level(scenario: Scenario) -> Scenario:
    """Return the scenario with `truth` on level, smooth ground of the same soil."""
    scenario = _truth(scenario)
    level = replace(scenario.terrain, iso_class="flat", slope_rad=0.0, height_map="", features=())
    return replace(scenario, terrain=level)


VARIANTS: Final[dict[str, Callable[[Scenario], Scenario]]] = {
    "as it is": _as_it_is,
    "clean sensors": _clean,
    "`truth`": _truth,
    "`truth`, smooth level ground": _level,
}
"""Each leaves out one source of error more than the one before."""

PARTS: Final = ("sensor noise", "filter's model", "ground", "soil and control")
"""Parts of the mean square error: differences of neighbouring variants, and the last variant."""


@dataclass(frozen=True, slots=True)
class LimitRun:
    """A run of the study."""

    field: str
    seed: int
    variant: str  # key of `VARIANTS`
    overrides: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class MeanSquares:
    """Mean square errors [m^2] of a run, NaN where it was lost; (2,), tractor and trailer."""

    tracking: tuple[float, ...]
    estimation: tuple[float, ...]


def mean_squares(run: LimitRun) -> MeanSquares:
    """Drive a run and return its mean square errors."""
    controller = f'controller.name="{CONTROLLER}"'
    name, scenario = load(run.field, (controller, *run.overrides))
    summary, record = simulate(name, VARIANTS[run.variant](one_lap(scenario)), run.seed)
    points = (getattr(summary.tracking.all, body) for body in BODIES)
    lost = summary.status != "completed"
    return MeanSquares(
        tuple(math.nan if lost else (point.rms_m or math.nan) ** 2 for point in points),
        tuple(_estimation_error(record, body) for body in BODIES),
    )


def _estimation_error(record: Record, body: str) -> float:
    """Return the mean square distance of an estimated point to the true one [m^2]."""
    time_s, state, estimate = rows_at_same_time(record, STATE, ESTIMATE)
    fields = position_fields(body)
    error = record[ESTIMATE].columns(*fields)[estimate] - record[STATE].columns(*fields)[state]
    return float(np.mean(np.sum(error[time_s >= START_UP_S] ** 2, axis=1)))


def parts(tracking: FloatArray) -> FloatArray:
    """Return the parts of the mean square error in the order of `PARTS`.

    Args:
        tracking: mean squares by variant, (4, ...). A part is negative where leaving out its
            source makes the error larger.

    Returns:
        (4, ...), their sum is the first variant's.
    """
    return tracking - np.concatenate([tracking[1:], np.zeros_like(tracking[:1])])


def main(
    seeds: Sequence[int] = report_seeds(2),
    fields: Sequence[str] = (),
    overrides: tuple[str, ...] = (),
) -> None:
    """Drive all fields, by default all that ship, and print the tables."""
    names = list(fields or shipped())
    runs = [
        LimitRun(field, seed, variant, overrides)
        for field in names
        for variant in VARIANTS
        for seed in seeds
    ]
    results = run_tasks(mean_squares, runs)
    errors = [["tractor / trailer [cm]", *VARIANTS, "estimation error"]]
    shares = [["share of the mean square error [%]", *PARTS, "noise followed"]]
    for field in names:
        own = [list(itertools.islice(results, len(seeds))) for _ in VARIANTS]
        tracking = np.array([np.mean([run.tracking for run in group], axis=0) for group in own])
        estimation = np.mean([run.estimation for run in own[0]], axis=0)  # (2,), as it is
        errors.append(_row(field, 100.0 * np.sqrt([*tracking, estimation]), "{:.2f}"))
        followed = tracking[0] - tracking[2] - estimation
        split = 100.0 * np.array([*parts(tracking), followed]) / tracking[0]
        shares.append(_row(field, np.round(split) + 0.0, "{:.0f}"))  # + 0.0: no "-0"
    for lines in (errors, shares):
        head, *body = (f"| {' | '.join(cells)} |" for cells in lines)
        print("\n".join([head, "|---" * len(lines[0]) + "|", *body]), end="\n\n")


def _row(field: str, values: FloatArray, form: str) -> list[str]:
    """Return the cells of a line from pairs of tractor and trailer, (n, 2)."""
    pairs = [["lost" if math.isnan(x) else form.format(x) for x in pair] for pair in values]
    return [f"`{field}`", *(" / ".join(pair) for pair in pairs)]


if __name__ == "__main__":
    main(report_seeds(int((sys.argv[1:] or ["2"])[0])), sys.argv[2:])
