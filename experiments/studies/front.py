"""Front of error against hydrostat travel: controllers, each with several weights of the hydrostat.

    python -m experiments.studies.front [SEEDS]      (default: 2)

Drives one lap of each scenario with SEEDS paired seeds. Prints the Markdown table of
docs/ablation.md: mean Euclidean error of both points, and the use of the actuators.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from ..figures import png
from ..figures.style import blank, dress, series
from ..results.summary import ACTUATOR_USE, Summary
from ..seeds import report_seeds
from ..sweep.row import figures
from .batch import StudyRun, lost_count, simulate_runs

SCENARIOS: Final = ("grass", "patchy")
_STEERING: Final = {"ttempc": "0.3,0.1", "lqr": "1.0,1.0"}  # step weights, as in their options
_WEIGHTS: Final[dict[str, tuple[float | None, ...]]] = {  # None: no such option
    "ttempc": (0.01, 0.03, 0.1, 0.3, 1.0, 10.0),
    "lqr": (0.1, 1.0, 10.0),
    "nmpc-rti": (None,),
    "ttempc-tube": (None,),
    "pid": (None,),
}
_POINTS: Final = tuple(f"tracking.all.{body}.mean_euclidean_m" for body in ("tractor", "trailer"))
_TRAVEL: Final = "inputs.hp.travel_per_m"
FILE: Final = "front.png"


@dataclass(frozen=True, slots=True)
class FrontPoint:
    """Runs of a controller with one weight of the hydrostat's steps on one scenario."""

    scenario: str
    controller: str
    weight: float | None  # of the hydrostat's steps; None: the controller's own
    runs: Sequence[Summary]

    @property
    def error_cm(self) -> float:
        """Mean error of both points [cm], NaN if a run was lost."""
        return 100.0 * float(np.mean([self.mean(name) for name in _POINTS]))

    def mean(self, name: str) -> float:
        """Return the mean of a number of the summary, NaN if a run was lost."""
        values = [figures(run)[name] for run in self.runs]
        lost = lost_count(self.runs) > 0
        return float("nan") if lost else float(np.mean(np.array(values, dtype=float)))


def front(seeds: Sequence[int], path: str = "path.laps=1") -> list[FrontPoint]:
    """Drive all controllers with all their weights; `path` overrides the path of the scenarios."""
    plan = [
        (scenario, controller, weight)
        for scenario in SCENARIOS
        for controller, weights in _WEIGHTS.items()
        for weight in weights
    ]
    runs = [
        StudyRun(scenario, seed, (path, *_overrides(controller, weight)))
        for scenario, controller, weight in plan
        for seed in seeds
    ]
    summaries = iter(simulate_runs(runs))
    return [FrontPoint(*item, list(itertools.islice(summaries, len(seeds)))) for item in plan]


def main(
    seeds: tuple[int, ...] = report_seeds(2),
    folder: Path | None = None,
    path: str = "path.laps=1",
) -> None:
    """Print the table, and write the figure to a folder if one is given."""
    points = front(seeds, path)
    heads = ("scenario", "controller", "hydrostat weight", "error [cm]")
    heads = (*heads, *(head for head, _, _ in ACTUATOR_USE), "lost")
    print(f"| {' | '.join(heads)} |")
    print("|---" * len(heads) + "|")
    for point in points:
        use = (f"{factor * point.mean(name):.1f}" for _, name, factor in ACTUATOR_USE)
        weight = "–" if point.weight is None else f"{point.weight:g}"
        lost = f"{lost_count(point.runs)}/{len(point.runs)}"
        cells = (f"`{point.scenario}`", f"`{point.controller}`", weight, f"{point.error_cm:.2f}")
        print(f"| {' | '.join((*cells, *use, lost))} |")
    if folder:
        (folder / FILE).write_bytes(_figure(points))


def _overrides(controller: str, weight: float | None) -> tuple[str, ...]:
    name = f'controller.name="{controller}"'
    if weight is None:
        return (name,)
    return (name, f"controller.options.step_weight=[{_STEERING[controller]},{weight}]")


def _figure(points: Sequence[FrontPoint]) -> bytes:
    """Return the error over the travel of the hydrostat, a panel per scenario."""
    figure = blank(3.4)
    panels = figure.subplots(1, len(SCENARIOS), squeeze=False)[0]
    for axes, scenario in zip(panels, SCENARIOS, strict=True):
        for number, controller in enumerate(_WEIGHTS):
            own = [p for p in points if (p.scenario, p.controller) == (scenario, controller)]
            travel = [100.0 * point.mean(_TRAVEL) for point in own]
            axes.plot(travel, [p.error_cm for p in own], **series(number), label=controller)
        dress(axes, "hydrostat travel [%/m]", "mean error of both points [cm]", scenario)
        axes.set_xlim(left=0.0)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
    return png(figure)


if __name__ == "__main__":
    main(report_seeds(int((sys.argv[1:] or ["2"])[0])))
