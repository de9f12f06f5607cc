"""Half widths that whole laps of `ttempc` keep to, and how many fresh laps keep to them.

    python -m experiments.studies.ablations.coverage [SEED ...]
                                                   (default: 200 reported seeds a field)

The distance of a lap is the largest one of its true tractor and trailer point from the path, after
the first 8 s. 40 laps with fitting seeds give the half widths of a field, in two ways:

- split-conformal prediction (`ttempc.tube.conformal`): the next lap keeps to them with 95 %, a
  theorem for laps that differ in their seed, of any distribution. 99 % would take 123 laps;
- the distance that one lap in 1000 exceeds if largest distances have a Gumbel distribution, the
  limit for maxima of many samples with light tails (Coles 2001, "An introduction to statistical
  modeling of extreme values", theorem 3.1): an extrapolation for each point, which the fresh laps
  test.

The fresh laps have other seeds. A lap that ends early is outside.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from scipy.stats import gumbel_r

from ttempc.types import FloatArray

from ...results.statistics import proportion
from ...seeds import FITTING, report_seeds
from ...tubes.calibration import calibrated_widths
from ..batch import StudyRun, simulate_runs
from .corridor import largest_m

LAPS: Final = 200
CALIBRATION_LAPS: Final = 40
FIELDS: Final = (
    "pavement",
    "grass",
    "wet-grass",
    "side-slope",
    "wet-slope",
    "patchy",
    "furrows",
    "old-valves",
)
JUDGED: Final = (
    "path.laps=1",
    "corridor.half_width_m=1.0",  # the run is compared with it, and `ttempc` is not told
    "controller.options.corridor=false",
)
COVERAGE: Final = 0.95  # of the conformal half widths
MISSED: Final = 1 / 1000  # share of the laps beyond the extrapolated ones, for each point


def distances(field: str, seeds: Sequence[int]) -> FloatArray:
    """Return the largest distances of tractor and trailer point of each lap [m], (n, 2)."""
    runs = simulate_runs([StudyRun(field, seed, JUDGED) for seed in seeds])
    return np.array([largest_m(run) for run in runs])


def extrapolated(distance: FloatArray) -> FloatArray:
    """Return the distances that a share `MISSED` of the laps exceeds [m], (q,).

    Args:
        distance: largest distances of each lap, (n, q); finite.
    """
    return np.array([gumbel_r.ppf(1.0 - MISSED, *gumbel_r.fit(column)) for column in distance.T])


def line(field: str, fitted: FloatArray, fresh: FloatArray) -> str:
    """Return the row of a field.

    Args:
        fitted: largest distances of tractor and trailer point in the fitted laps, (n, 2).
        fresh: those in the fresh laps, (m, 2).
    """
    widths, calibration = calibrated_widths(fitted, COVERAGE)
    cells = [f"`{field}`"]
    for half_width, promise in (
        (widths, f"{100.0 * calibration.coverage:.1f} %"),
        (extrapolated(fitted), ""),
    ):
        inside = proportion(int((fresh <= half_width).all(axis=1).sum()), len(fresh))
        low, high = (100.0 * end for end in inside.ends)
        cells.append(_in_cm(half_width))
        cells += [promise] if promise else []
        cells.append(f"{inside.count} of {inside.total} ({low:.1f} to {high:.1f} %)")
    cells.append(_in_cm(fresh.max(axis=0)))
    enough = len(fresh) >= CALIBRATION_LAPS
    cells.append(_in_cm(calibrated_widths(fresh, COVERAGE)[0]) if enough else "–")
    return f"| {' | '.join(cells)} |"


def _in_cm(distances_m: FloatArray) -> str:
    return " / ".join(f"{100.0 * distance:.1f}" for distance in distances_m)


def main(seeds: Sequence[int] = report_seeds(LAPS)) -> None:
    """Print the table."""
    print("\n".join(head()))
    for field in FIELDS:
        fitted = distances(field, FITTING[:CALIBRATION_LAPS])
        print(line(field, fitted, distances(field, seeds)), flush=True)


def head() -> Iterator[str]:
    """Yield the head of the table; all distances are of tractor / trailer."""
    heads = (
        "field",
        "half widths of 95 % [cm]",
        "promised",
        "fresh laps inside",
        "exceeded once in 1000 laps [cm]",
        "fresh laps inside",
        "largest of them [cm]",
        "half widths of 95 % from the fresh laps [cm]",
    )
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"


if __name__ == "__main__":
    main(tuple(map(int, sys.argv[1:])) or report_seeds(LAPS))
