"""Comparison of estimators, and consistency of the default one.

    python -m experiments.studies.estimators [SCENARIO ...]
    python -m experiments.studies.estimators consistency [SEEDS]

Prints the Markdown tables of docs/estimators.md. The first compares `ttempc-nominal` with `ekf` and
with `nmhe`, one lap with the same seeds. The normalised innovations of `nmhe` are those of its
internal filter. The cost of an update is measured on all cores at a time.

The second drives one lap of every shipped scenario. For each state it gives the mean normalised
estimation error squared (NEES) over all seeds; then normalised innovation squared (NIS),
autocorrelation of the innovations of GNSS, and the mean error of both points.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ttempc.types import State

from ...testbed.recording.channels import ESTIMATE
from ..logs.replay import estimator_of, replay
from ..results.consistency import Consistency, consistency
from ..results.published import COLUMNS
from ..run.simulate import simulate
from ..scenario.scenario import load, shipped
from ..seeds import report_seeds
from .batch import StudyRun, mean_errors_cm, one_lap, run_tasks

SCENARIOS = ("pavement", "grass", "wet-grass", "side-slope", "wet-slope", "patchy")
ESTIMATORS = ("ekf", "nmhe")
SEEDS = report_seeds(2)


@dataclass(frozen=True, slots=True)
class EstimatorFigures:
    """Errors, consistency and cost of the estimator in one run."""

    errors_cm: tuple[float, ...]  # estimated tractor and trailer point, then the table's four
    normalised: float  # mean normalised innovation squared per degree of freedom
    cost_us: float  # median of an update


def estimator_figures(run: StudyRun) -> EstimatorFigures:
    """Drive a run and return the figures of its estimator."""
    summary, record = simulate(*load(run.scenario, run.overrides), run.seed)
    estimation, table = summary.estimation, record[ESTIMATE]
    points = (estimation.tractor.mean_euclidean_m, estimation.trailer.mean_euclidean_m)
    return EstimatorFigures(
        errors_cm=(*(100.0 * (p or np.nan) for p in points), *mean_errors_cm(summary)),
        normalised=float(np.nansum(table["nis"]) / np.nansum(table["nis_dof"])),
        cost_us=summary.timing.estimator_us.median or np.nan,
    )


def main(
    scenarios: tuple[str, ...] = SCENARIOS,
    seeds: tuple[int, ...] = SEEDS,
    path: str = "path.laps=1",
) -> None:
    """Drive all scenarios and print the table; `path` overrides their path."""
    runs = [
        StudyRun(
            scenario,
            seed,
            ('controller.name="ttempc-nominal"', f'controller.estimator="{estimator}"', path),
        )
        for scenario in scenarios
        for estimator in ESTIMATORS
        for seed in seeds
    ]
    figures = run_tasks(estimator_figures, runs)
    heads = ("estimated tractor", "estimated trailer", *COLUMNS, "NIS", "ms")
    print(f"| scenario | estimator | {' | '.join(heads)} |")
    print("|---" * (len(heads) + 2) + "|")
    for scenario in scenarios:
        for estimator in ESTIMATORS:
            own = list(itertools.islice(figures, len(seeds)))
            errors = np.mean([item.errors_cm for item in own], axis=0)
            normalised = [f"{item.normalised:.3f}" for item in own]
            cells = [f"{error:.2f}" for error in errors]
            cells += [
                ", ".join(normalised),
                f"{1e-3 * np.median([item.cost_us for item in own]):.2f}",
            ]
            print(f"| `{scenario}` | `{estimator}` | {' | '.join(cells)} |", flush=True)


def run_consistency(run: StudyRun) -> Consistency:
    """Drive one lap and return the figures of its estimator, replayed from its record."""
    name, scenario = load(run.scenario, run.overrides)
    scenario = one_lap(scenario)
    _, record = simulate(name, scenario, run.seed)
    return consistency(replay(record, estimator_of(scenario)), record)


def print_consistency(
    seeds: Sequence[int] = SEEDS, scenarios: Sequence[str] = (), overrides: tuple[str, ...] = ()
) -> None:
    """Drive all scenarios, by default all that ship, and print the table."""
    names = list(scenarios or shipped())
    runs = [StudyRun(name, seed, overrides) for name in names for seed in seeds]
    figures = run_tasks(run_consistency, runs)
    states = [state.name.lower() for state in State]
    heads = (*states, "NIS", "autocorrelation", "estimated tractor", "estimated trailer, cm")
    print(f"| scenario | {' | '.join(heads)} |")
    print("|---" * (len(heads) + 1) + "|")
    for name in names:
        cells = np.mean([_cells(next(figures)) for _ in seeds], axis=0)
        print(f"| `{name}` | {' | '.join(f'{cell:.2f}' for cell in cells)} |", flush=True)


def _cells(figures: Consistency) -> list[float]:
    """Return the numbers of a row for one run."""
    gnss = [item.autocorrelation for item in figures.sensors if item.name.startswith("gnss")]
    return [
        *(item.nees for item in figures.states),
        figures.nis,
        float(np.mean(gnss)),
        100.0 * figures.tractor_m,
        100.0 * figures.trailer_m,
    ]


if __name__ == "__main__":
    if sys.argv[1:2] == ["consistency"]:
        print_consistency(report_seeds(int(*sys.argv[2:3]) or len(SEEDS)))
    else:
        main(tuple(sys.argv[1:]) or SCENARIOS)
