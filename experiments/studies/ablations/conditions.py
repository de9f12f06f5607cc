"""Conditions outside the tuning of a controller: speeds, radii, soft soil, rough ground.

    python -m experiments.studies.ablations.conditions [SEEDS [CONTROLLER]]      (default: 2 ttempc)

Changes one setting of `grass` at a time and drives one lap with SEEDS paired seeds. Prints
the Markdown table of docs/ablation.md: mean Euclidean errors [cm].
"""

from __future__ import annotations

import sys
from typing import Final

import numpy as np

from ...results.published import COLUMNS
from ...seeds import report_seeds
from ..batch import StudyRun, lost_count, mean_errors_cm, simulate_runs

CHANGES: Final[dict[str, tuple[str, ...]]] = {
    "`grass` as it is": (),
    "0.5 m/s": ("path.speed_mps=0.5",),
    "1.3 m/s": ("path.speed_mps=1.3",),
    "R = 6 m": ("path.radius_m=6.0",),
    "R = 20 m": (
        "path.radius_m=20.0",
        "path.centre_distance_m=60.0",
        "terrain.size_x_m=130.0",
        "terrain.size_y_m=70.0",
    ),
    "150 kPa": ("soil.cone_index_kpa=150.0",),
    "class F": ('terrain.iso_class="F"',),
}


def main(
    seeds: tuple[int, ...] = report_seeds(2),
    controller: str = "ttempc",
    path: str = "path.laps=1",
) -> None:
    """Drive all conditions and print the table; `path` overrides the path of `grass`."""
    fixed = (f'controller.name="{controller}"', path)
    runs = [
        StudyRun("grass", seed, (*change, *fixed)) for change in CHANGES.values() for seed in seeds
    ]
    summaries = simulate_runs(runs)
    print(f"| {controller} | {' | '.join(COLUMNS)} | lost |")
    print("|---" * (len(COLUMNS) + 2) + "|")
    for index, name in enumerate(CHANGES):
        condition = summaries[index * len(seeds) : (index + 1) * len(seeds)]
        errors = np.mean([mean_errors_cm(run) for run in condition], axis=0)
        cells = " | ".join(f"{error:.1f}" for error in errors)
        print(f"| {name} | {cells} | {lost_count(condition)}/{len(seeds)} |")


if __name__ == "__main__":
    main(report_seeds(int((sys.argv[1:] or ["2"])[0])), (sys.argv[2:] or ["ttempc"])[0])
