"""How does a controller do on every shipped scenario?  Mean and range over five seeds.

    python -m experiments.studies.paper_table [CONTROLLER]      (default: paper)

Prints a Markdown table of mean Euclidean errors; docs/results.md holds the one for `paper`.
"""

from __future__ import annotations

import sys

import numpy as np

from experiments.batch import Job, mean_errors_cm, summaries
from experiments.published import COLUMNS
from experiments.scenario import shipped

SEEDS = (1, 2, 3, 4, 5)


def main(controller: str = "paper") -> None:
    """Run and print."""
    override = (f'controller.name="{controller}"',)
    jobs = [Job(name, seed, override) for name in shipped() for seed in SEEDS]
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


if __name__ == "__main__":
    main(*sys.argv[1:])
