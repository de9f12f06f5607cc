"""Which estimator is better, and what does it cost?  The filter against the moving horizon.

    python -m experiments.studies.estimators [SCENARIO ...]

Prints the Markdown table of docs/estimators.md: `ttempc-nominal` fed by `ekf` and by `nmhe`, the
same seeds to both, one lap. The normalised innovations of `nmhe` are those of the filter within.
"""

from __future__ import annotations

import os
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from proving_ground.testbed.recording.channels import ESTIMATE

from ..results.published import COLUMNS
from ..run.simulate import simulate
from ..scenario.scenario import load
from .batch import mean_errors_cm

SCENARIOS = ("pavement", "grass", "wet-grass", "side-slope", "wet-slope", "patchy")
ESTIMATORS = ("ekf", "nmhe")
SEEDS = (1, 2)


@dataclass(frozen=True, slots=True)
class Row:
    """What one run says of its estimator."""

    errors_cm: tuple[float, ...]  # estimated tractor and trailer point, then the table's four
    normalised: float  # mean normalised innovation squared a degree of freedom
    cost_us: float  # median of an update


def row(job: tuple[str, str, int]) -> Row:
    """Run scenario, estimator and seed."""
    scenario, estimator, seed = job
    overrides = [
        'controller.name="ttempc-nominal"',
        f'controller.estimator="{estimator}"',
        "path.laps=1",
    ]
    summary, record = simulate(*load(scenario, overrides), seed)
    estimation, table = summary.estimation, record[ESTIMATE]
    points = (estimation.tractor.mean_euclidean_m, estimation.trailer.mean_euclidean_m)
    return Row(
        errors_cm=(*(100.0 * (p or np.nan) for p in points), *mean_errors_cm(summary)),
        normalised=float(np.nansum(table["nis"]) / np.nansum(table["nis_dof"])),
        cost_us=summary.timing.estimator_us.median or np.nan,
    )


def main(scenarios: tuple[str, ...]) -> None:
    """Run and print."""
    jobs = [(s, e, seed) for s in scenarios for e in ESTIMATORS for seed in SEEDS]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        rows = dict(zip(jobs, tqdm(pool.map(row, jobs), total=len(jobs)), strict=True))
    heads = ("estimated tractor", "estimated trailer", *COLUMNS, "NIS", "ms")
    print(f"| scenario | estimator | {' | '.join(heads)} |")
    print("|---" * (len(heads) + 2) + "|")
    for scenario in scenarios:
        for estimator in ESTIMATORS:
            runs = [rows[scenario, estimator, seed] for seed in SEEDS]
            errors = np.mean([run.errors_cm for run in runs], axis=0)
            normalised = [f"{run.normalised:.3f}" for run in runs]
            cells = [f"{error:.2f}" for error in errors]
            cells += [", ".join(normalised), f"{1e-3 * np.median([r.cost_us for r in runs]):.2f}"]
            print(f"| `{scenario}` | `{estimator}` | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main(tuple(sys.argv[1:]) or SCENARIOS)
