"""How does a controller do on every shipped scenario?  Mean and range over seeds.

    python -m experiments.studies.paper_table [CONTROLLER [SEEDS [LAPS]]]      (default: paper 5)

Prints a Markdown table of mean Euclidean errors over SEEDS seeds, from 1; LAPS takes the place of
the scenario's own number of laps. docs/results.md holds what came out.
"""

from __future__ import annotations

import sys

import numpy as np

from ..results.published import COLUMNS
from ..scenario.path import FigureEight
from ..scenario.scenario import load, shipped
from .batch import Job, mean_errors_cm, summaries


def main(controller: str = "paper", seeds: str = "5", laps: str = "") -> None:
    """Run and print."""
    driver = f'controller.name="{controller}"'
    jobs = [
        Job(name, seed, (driver, *_laps(name, laps)))
        for name in shipped()
        for seed in range(1, int(seeds) + 1)
    ]
    finished = list(summaries(jobs))
    print(f"| {controller}: scenario | " + " | ".join(COLUMNS) + " | lost |")
    print("|---" * (len(COLUMNS) + 2) + "|")
    for name in shipped():
        runs = [summary for job, summary in finished if job.scenario == name]
        whole = [run for run in runs if run.status == "completed"]
        errors = np.array([mean_errors_cm(run) for run in whole])  # (runs, 4)
        cells = [
            f"{column.mean():.1f} ({column.min():.1f}-{column.max():.1f})"
            if np.isfinite(column).all()
            else "-"  # a straight path has no curve
            for column in errors.T
        ] or ["-"] * len(COLUMNS)
        print(f"| `{name}` | " + " | ".join(cells) + f" | {len(runs) - len(whole)}/{len(runs)} |")


def _laps(name: str, laps: str) -> tuple[str, ...]:
    """Return the override of the number of laps, where it is asked for and the path has laps."""
    has_laps = isinstance(load(name)[1].path, FigureEight)
    return (f"path.laps={laps}",) if laps and has_laps else ()


if __name__ == "__main__":
    main(*sys.argv[1:])
