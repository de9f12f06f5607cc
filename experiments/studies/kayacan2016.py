"""Field on which `paper` comes closest to the published table.

    python -m experiments.studies.kayacan2016 coarse      terrain class and cone index
    python -m experiments.studies.kayacan2016 fine        cone index and slope on class E

One lap, five tuning seeds each: it is a search. Prints the mean errors with their distance to the
published ones: the root mean square of the four relative differences. docs/errata.md has the
results; the best field is the scenario `kayacan2016`.
"""

from __future__ import annotations

import sys
from typing import Final, NamedTuple

import numpy as np

from ..results.published import COLUMNS, compare
from ..seeds import TUNING
from .batch import StudyRun, lost_count, mean_errors_cm, simulate_runs

SEEDS: Final = tuple(TUNING[:5])  # a search: the field is tuned with them


class Field(NamedTuple):
    """A candidate field."""

    iso_class: str
    cone_index_kpa: float
    slope_rad: float

    def overrides(self) -> tuple[str, ...]:
        """Return the field as overrides of a scenario."""
        return (
            f'terrain.iso_class="{self.iso_class}"',
            f"terrain.slope_rad={self.slope_rad}",
            f"soil.cone_index_kpa={self.cone_index_kpa}",
            'controller.name="paper"',
        )


STAGES: Final = {
    "coarse": [
        Field(letter, strength, 0.0)
        for letter in "CDEF"
        for strength in (150.0, 160.0, 170.0, 180.0, 200.0, 300.0, 600.0)
    ],
    "fine": [
        Field("E", strength, slope)
        for slope, strengths in {
            0.0: (152.0, 154.0, 156.0, 158.0),
            0.02: (160.0, 170.0, 180.0),
        }.items()
        for strength in strengths
    ],
}


def main(stage: str, seeds: tuple[int, ...] = SEEDS, path: str = "path.laps=1") -> None:
    """Drive all fields of a stage and print the table; `path` overrides the path of `grass`."""
    fields = STAGES[stage]
    summaries = simulate_runs(
        [StudyRun("grass", seed, (*field.overrides(), path)) for field in fields for seed in seeds]
    )
    print("| class | kPa | slope [rad] | " + " | ".join(COLUMNS) + " | lost | distance |")
    print("|---" * (len(COLUMNS) + 5) + "|")
    for index, field in enumerate(fields):
        runs = summaries[index * len(seeds) : (index + 1) * len(seeds)]
        errors = np.mean([mean_errors_cm(run) for run in runs], axis=0)  # (4,)
        published = np.array([100.0 * item.published_m for item in compare(runs[0])])
        distance = np.sqrt(np.mean((errors / published - 1.0) ** 2))
        cells = " | ".join([*(f"{part}" for part in field), *(f"{error:.1f}" for error in errors)])
        print(f"| {cells} | {lost_count(runs)}/{len(runs)} | {distance:.2f} |")


if __name__ == "__main__":
    main(sys.argv[1])
