"""Ablation of `ttempc`: feedforward, MPC, disturbance estimate, robust law.

    python -m experiments.studies.ablations.ablation [SEEDS [SCENARIO ...]]

SEEDS is the number of paired seeds (default 2). The default scenarios are those on which
the parts differ most. Every run is one lap. Prints the Markdown table of docs/ablation.md: mean
Euclidean errors [cm], and the root mean square of the front steering's command rate.
"""

from __future__ import annotations

import itertools
import math
import sys
from functools import partial
from typing import Any, Final

import numpy as np

from ttempc.guidance.controllers import feedforward_controller
from ttempc.guidance.guidance import ControllerFactory
from ttempc.laws.articulated_mpc import articulated_controller
from ttempc.laws.articulated_options import ArticulatedOptions

from ...results.published import COLUMNS
from ...results.summary import Summary
from ...seeds import report_seeds
from ..batch import StudyRun, lost_count, mean_errors_cm, simulate_runs

SCENARIOS: Final = ("grass", "wet-slope", "patchy", "old-valves")


def _variant(**options: Any) -> ControllerFactory:  # noqa: ANN401 - any field of the options
    return partial(articulated_controller, options=ArticulatedOptions(**options))


VARIANTS: Final[dict[str, ControllerFactory]] = {
    "feedforward": feedforward_controller,
    "+ LMPC": _variant(robust=False, disturbances=False),
    "+ LMPC, robust": _variant(disturbances=False),
    "+ LMPC, disturbance (`ttempc-nominal`)": _variant(robust=False),
    "+ LMPC, disturbance, robust (`ttempc`)": _variant(),
    "the same, MPC tightened by the law's authority": _variant(tightening="saturation"),
    "robust in the tube reading": _variant(nominal="tube"),
    "no robust, step weights 1, 1, 0.02": _variant(robust=False, step_weight=(1.0, 1.0, 0.02)),
    "no robust, step weights 0.05, 0.05, 0.1": _variant(
        robust=False, step_weight=(0.05, 0.05, 0.1)
    ),
    "no robust, horizon 12": _variant(robust=False, horizon=12),
}


def main(
    seeds: tuple[int, ...] = report_seeds(2),
    scenarios: tuple[str, ...] = SCENARIOS,
    path: str = "path.laps=1",
) -> None:
    """Drive all variants and print the table; `path` overrides the path of the scenarios."""
    runs = [
        StudyRun(scenario, seed, (path,), factory)
        for scenario in scenarios
        for factory in VARIANTS.values()
        for seed in seeds
    ]
    summaries = iter(simulate_runs(runs))
    print(f"| scenario | parts | {' | '.join(COLUMNS)} | steering rate, deg/s | lost |")
    print("|---" * (len(COLUMNS) + 4) + "|")
    for scenario in scenarios:
        for parts in VARIANTS:
            variant = list(itertools.islice(summaries, len(seeds)))
            errors = np.mean([mean_errors_cm(run) for run in variant], axis=0)
            cells = " | ".join(f"{error:.2f}" for error in errors)
            rate = np.mean([_steering_rate(run) for run in variant])
            lost = f"{lost_count(variant)}/{len(seeds)}"
            print(f"| `{scenario}` | {parts} | {cells} | {rate:.1f} | {lost} |")


def _steering_rate(run: Summary) -> float:
    """Return the root mean square rate of the front steering's command [deg/s]."""
    rate = run.inputs.delta_t.rms_rate
    return math.nan if rate is None else math.degrees(rate)


if __name__ == "__main__":
    main(report_seeds(int((sys.argv[1:] or ["2"])[0])), tuple(sys.argv[2:]) or SCENARIOS)
