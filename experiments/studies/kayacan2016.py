"""On which field does `paper` come closest to the published table?

    python -m experiments.studies.kayacan2016

Runs `paper` over terrain class and cone index, five seeds each, and prints the mean errors with
their distance to the published ones: the root mean square of the four relative differences.
docs/errata.md holds what came out; the best field is the scenario `kayacan2016`.
"""

from __future__ import annotations

import numpy as np

from experiments.batch import Job, mean_errors_cm, summaries
from experiments.published import COLUMNS, compare

CLASSES = ("C", "D", "E", "F")
CONE_INDICES_KPA = (150.0, 160.0, 170.0, 180.0, 200.0, 300.0, 600.0)
SEEDS = (1, 2, 3, 4, 5)


def main() -> None:
    """Run and print."""
    fields = [(letter, strength) for letter in CLASSES for strength in CONE_INDICES_KPA]
    jobs = [
        Job(
            "grass",
            seed,
            (f'terrain.iso_class="{letter}"', f"soil.cone_index_kpa={strength}"),
        )
        for letter, strength in fields
        for seed in SEEDS
    ]
    finished = [summary for _, summary in summaries(jobs)]
    print("| class | kPa | " + " | ".join(COLUMNS) + " | lost | distance |")
    print("|---" * (len(COLUMNS) + 4) + "|")
    for index, (letter, strength) in enumerate(fields):
        runs = finished[index * len(SEEDS) : (index + 1) * len(SEEDS)]
        whole = [run for run in runs if run.status == "completed"]
        lost = f"{len(runs) - len(whole)}/{len(runs)}"
        if not whole:
            print(f"| {letter} | {strength:g} |" + " - |" * len(COLUMNS) + f" {lost} | - |")
            continue
        errors = np.mean([mean_errors_cm(run) for run in whole], axis=0)  # (4,)
        published = np.array([100.0 * item.published_m for item in compare(whole[0])])
        distance = np.sqrt(np.mean((errors / published - 1.0) ** 2))
        cells = " | ".join(f"{error:.1f}" for error in errors)
        print(f"| {letter} | {strength:g} | {cells} | {lost} | {distance:.2f} |")


if __name__ == "__main__":
    main()
