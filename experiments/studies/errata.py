"""Effect of each correction of the paper's equations, one at a time.

    python -m experiments.studies.errata

Prints the Markdown table of docs/errata.md: mean Euclidean errors of `paper` with one reading
changed, on `pavement`, where the plant is closest to the kinematic model (one lap, three seeds).
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ttempc.baselines.paper import PaperOptions, paper_controller
from ttempc.guidance.guidance import ControllerFactory

from ..results.published import COLUMNS
from ..seeds import report_seeds
from .batch import StudyRun, lost_count, mean_errors_cm, simulate_runs

SEEDS = report_seeds(3)


def _reading(**changes: Any) -> ControllerFactory:  # noqa: ANN401 - any field of PaperOptions
    return partial(paper_controller, options=PaperOptions(**changes))


READINGS = {
    "`paper`": _reading(),
    "1: hitch sign by geometry": _reading(hitch_sign=-1),
    "2: hitch angle of the reference": _reading(hitch_angle="reference"),
    "3: feedforward by geometry": _reading(feedforward="geometry"),
    "1 and 3": _reading(hitch_sign=-1, feedforward="geometry"),
    "1, 2 and 3": _reading(hitch_sign=-1, hitch_angle="reference", feedforward="geometry"),
    "4 as printed": _reading(trailer_error_frame="tractor"),
    "5: exact trailer speed": _reading(trailer_speed="exact"),
    "6 as printed": _reading(robust_sign=1),
    "7 as printed": _reading(hp_full_scale=100),
    "8: the tube's own nominal": _reading(nominal="tube"),
    "6 as printed, with 8: `paper-printed-sign`": _reading(robust_sign=1, nominal="tube"),
    "robust action off": _reading(robust=False),
}


def main(seeds: tuple[int, ...] = SEEDS, path: str = "path.laps=1") -> None:
    """Drive all readings and print the table; `path` overrides the path of `pavement`."""
    summaries = simulate_runs(
        [
            StudyRun("pavement", seed, (path,), factory)
            for factory in READINGS.values()
            for seed in seeds
        ]
    )
    print(f"| reading | {' | '.join(COLUMNS)} | lost |")
    print("|---" * (len(COLUMNS) + 2) + "|")
    for index, reading in enumerate(READINGS):
        runs = summaries[index * len(seeds) : (index + 1) * len(seeds)]
        errors = np.mean([mean_errors_cm(run) for run in runs], axis=0)
        cells = " | ".join(f"{error:.1f}" for error in errors)
        print(f"| {reading} | {cells} | {lost_count(runs)}/{len(runs)} |")


if __name__ == "__main__":
    main()
