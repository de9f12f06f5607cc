"""Values at which controllers break: soil strength, slope, dead time.

    python -m experiments.studies.failures.breaking_points [SEEDS]      (default: 3)

Prints the Markdown table of docs/results.md: the last value at which the vehicle completes one lap
of `grass` and the first at which it is lost, in at least half of the seeds.
"""

from __future__ import annotations

import sys
from typing import Final

from ...scenario.scenario import parse_overrides
from ...search.limit import Limit, Question, find_limit
from ...search.quantities import QUANTITIES
from ...seeds import report_seeds
from ...sweep.engine import engine
from ..batch import run_tasks

CONTROLLERS: Final = ("ttempc", "pid", "paper")
TOLERANCES: Final = {"cone-index": 10.0, "slope": 0.01, "delay": 0.05}


def search(question: Question) -> Limit:
    """Return the answer to a question, found in this process."""
    with engine(workers=0) as here:
        return find_limit(question, here)


def main(seeds: tuple[int, ...] = report_seeds(3), path: str = "path.laps=1") -> None:
    """Search all values and print the table; `path` overrides the path of `grass`."""
    questions = [
        Question(
            scenario="grass",
            controller=controller,
            quantity=quantity,
            parameter=QUANTITIES[quantity],
            tolerance=tolerance,
            limit_m=None,
            seeds=seeds,
            settings=parse_overrides([path]),
        )
        for quantity, tolerance in TOLERANCES.items()
        for controller in CONTROLLERS
    ]
    found = iter(run_tasks(search, questions))
    print("| quantity | " + " | ".join(f"`{name}`" for name in CONTROLLERS) + " |")
    print("|---" * (1 + len(CONTROLLERS)) + "|")
    for quantity in TOLERANCES:
        cells = " | ".join(_text(next(found)) for _ in CONTROLLERS)
        print(f"| {quantity.replace('-', ' ')} [{QUANTITIES[quantity].unit}] | {cells} |")


def _text(result: Limit) -> str:
    if result.outcome != "found":
        return f"{result.outcome} from {result.probes[0].value:g} to {result.probes[-1].value:g}"
    note = "" if result.monotone else ", not monotone"
    return f"{result.holds_at:.3g}, {result.fails_at:.3g}{note}"


if __name__ == "__main__":
    main(report_seeds(int((sys.argv[1:] or ["3"])[0])))
