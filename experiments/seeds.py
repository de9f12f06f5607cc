"""Seeds by purpose: those that a design was tuned or fitted with are never reported on.

Seeds determine terrain and noise. Figures on seeds that a gain, a noise parameter or a tube was
chosen with would favour that choice.
"""

from typing import Final

TUNING: Final = range(1, 101)
"""Tuning by hand, the filter's noise parameters, the hydrostat of `kayacan2016`, tests."""

FITTING: Final = range(1001, 1101)
"""Laps that tubes are fitted to and held-out laps of a fit."""

FIRST: Final = 201
"""First seed of reported runs."""

TRIALS: Final = range(3301, 3311)
"""Public seeds of the benchmark, version 3; no design, limit or weight was chosen on them."""

CHECKS: Final = range(3311, 3321)
"""Seeds of a second set of runs of the benchmark: whether it gives the same verdicts."""

TUNED_FIELDS: Final = {
    "filter": (
        "pavement",
        "grass",
        "wet-grass",
        "side-slope",
        "wet-slope",
        "patchy",
        "farm",
        "furrows",
        "old-valves",
    ),
    "tube": ("grass",),
    "half widths over speed": ("rows",),
    "field": ("kayacan2016",),
}
"""Scenarios whose tuning seeds were used, by what was tuned; `field`: a parameter of it was."""


def report_seeds(count: int) -> tuple[int, ...]:
    """Return the first seeds of reported runs.

    >>> report_seeds(3)
    (201, 202, 203)
    """
    return tuple(range(FIRST, FIRST + count))
