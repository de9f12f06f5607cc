"""Comparison of estimators: the filter and the moving horizon.

    python -m experiments.studies.estimators [SCENARIO ...]

Prints the Markdown table of docs/estimators.md: `ttempc-nominal` with `ekf` and with `nmhe`, one
lap with the same seeds. The normalised innovations of `nmhe` are those of its internal filter. The
cost of an update is measured on all cores at a time.
"""

from __future__ import annotations

import itertools
import sys
from dataclasses import dataclass

import numpy as np

from proving_ground.testbed.recording.channels import ESTIMATE

from ..results.published import COLUMNS
from ..run.simulate import simulate
from ..scenario.scenario import load
from ..seeds import report_seeds
from .batch import StudyRun, mean_errors_cm, run_tasks

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


if __name__ == "__main__":
    main(tuple(sys.argv[1:]) or SCENARIOS)
