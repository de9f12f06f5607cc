"""Errors of a learnt policy beside the controller below it and `ttempc`, paired by seed.

    python -m experiments.policy.study [SEEDS]      (default: 3)

Drives a lap of each field with each controller. Prints the Markdown table of docs/howto/gym.md:
mean Euclidean errors of tractor and trailer [cm], and the paired difference of their mean from that
of the controller below the policy, with its 95 % interval.
"""

from __future__ import annotations

import sys
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ..results.statistics import caveat, mean
from ..results.summary import Summary
from ..seeds import report_seeds
from ..studies.batch import StudyRun, lost_count, simulate_runs

FACTORY: Final = "proving_ground.experiments.policy.linear_policy:learnt"
FIELDS: Final = ("wet-slope", "patchy", "grass")
"""The policy that ships was trained on the first two, with other seeds."""
SEEDS: Final = report_seeds(3)
_CONTROLLERS: Final = {"pid": "`pid`", FACTORY: "policy on `pid`", "ttempc": "`ttempc`"}


def main(seeds: tuple[int, ...] = SEEDS, path: str = "path.laps=1") -> None:
    """Drive all runs and print the table; `path` overrides the path of the fields."""
    runs = [
        StudyRun(field, seed, (path, f'controller.name="{controller}"'))
        for field in FIELDS
        for controller in _CONTROLLERS
        for seed in seeds
    ]
    summaries = iter(simulate_runs(runs))
    print("| field | controller | tractor / trailer [cm] | difference [cm] | lost |")
    print("|---|---|---|---|---|")
    for field in FIELDS:
        below: FloatArray | None = None
        for label in _CONTROLLERS.values():
            driven = [next(summaries) for _ in seeds]
            errors = np.array([_errors_cm(summary) for summary in driven])  # (seeds, 2)
            both = errors.mean(axis=1)
            below = both if below is None else below
            change = mean(both - below)
            cells = [f"{errors[:, 0].mean():.1f} / {errors[:, 1].mean():.1f}", ""]
            if below is not both:
                cells[1] = f"{change.value:+.2f} ({change.ends[0]:+.2f} to {change.ends[1]:+.2f})"
            print(f"| `{field}` | {label} | {' | '.join(cells)} | {lost_count(driven)} |")
    print(f"\n{caveat(len(seeds))}".rstrip())


def _errors_cm(summary: Summary) -> list[float]:
    """Return the mean Euclidean errors of tractor and trailer [cm], NaN where there is none."""
    points = summary.tracking.all.tractor, summary.tracking.all.trailer
    values = (point.mean_euclidean_m for point in points)
    return [float("nan") if value is None else 100.0 * value for value in values]


if __name__ == "__main__":
    main(report_seeds(int((sys.argv[1:] or ["3"])[0])))
