"""Errors of a controller on every shipped scenario: mean and range over seeds.

    python -m experiments.studies.paper_table [CONTROLLER [SEEDS [LAPS]]]      (default: paper 5)

Prints a Markdown table of mean Euclidean errors over SEEDS seeds, from 1. LAPS replaces the number
of laps of the scenario. docs/results.md has the results.
"""

from __future__ import annotations

import sys

import numpy as np

from ..results.published import COLUMNS
from ..scenario.path import FigureEight
from ..scenario.scenario import load, shipped
from .batch import StudyRun, lost_count, mean_errors_cm, simulate_runs


def main(controller: str = "paper", seeds: str = "5", laps: str = "") -> None:
    """Drive all scenarios and print the table."""
    name_override = f'controller.name="{controller}"'
    runs = [
        StudyRun(name, seed, (name_override, *_laps(name, laps)))
        for name in shipped()
        for seed in range(1, int(seeds) + 1)
    ]
    summaries = simulate_runs(runs)
    print(f"| {controller}: scenario | " + " | ".join(COLUMNS) + " | lost |")
    print("|---" * (len(COLUMNS) + 2) + "|")
    for name in shipped():
        own = [
            summary for run, summary in zip(runs, summaries, strict=True) if run.scenario == name
        ]
        completed = [summary for summary in own if summary.status == "completed"]
        errors = np.array([mean_errors_cm(summary) for summary in completed])  # (runs, 4)
        cells = [
            f"{column.mean():.1f} ({column.min():.1f}-{column.max():.1f})"
            if np.isfinite(column).all()
            else "-"  # a straight path has no curve
            for column in errors.T
        ] or ["-"] * len(COLUMNS)
        print(f"| `{name}` | " + " | ".join(cells) + f" | {lost_count(own)}/{len(own)} |")


def _laps(name: str, laps: str) -> tuple[str, ...]:
    """Return the override of the number of laps, if one is given and the path has laps."""
    has_laps = isinstance(load(name)[1].path, FigureEight)
    return (f"path.laps={laps}",) if laps and has_laps else ()


if __name__ == "__main__":
    main(*sys.argv[1:])
