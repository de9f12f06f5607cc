"""What does each part of `ttempc` bring?  Feedforward, MPC, disturbance estimate, robust law.

    python -m experiments.studies.ablation [SEEDS [SCENARIO ...]]

SEEDS is how many paired seeds, from 1 (default 2); by default the fields where the parts differ
most. One lap each. Prints the Markdown table of docs/ablation.md: mean Euclidean errors in cm, and
the root mean square of the front steering's command rate, which is what stiffness costs.
"""

from __future__ import annotations

import math
import sys
from functools import partial
from typing import Any, Final

import numpy as np

from ttempc.guidance.controllers import feedforward_controller
from ttempc.guidance.guidance import ControllerFactory
from ttempc.laws.articulated_mpc import articulated_controller
from ttempc.laws.articulated_options import ArticulatedOptions

from ..results.published import COLUMNS
from ..results.summary import Summary
from ..run.simulate import simulate
from ..scenario.scenario import load
from .batch import mean_errors_cm

SCENARIOS: Final = ("grass", "wet-slope", "patchy", "old-valves")


def _variant(**options: Any) -> ControllerFactory:  # noqa: ANN401 - any field of the options
    return partial(articulated_controller, options=ArticulatedOptions(**options))


VARIANTS: Final[dict[str, ControllerFactory]] = {
    "feedforward": feedforward_controller,
    "+ LMPC": _variant(robust=False, disturbances=False),
    "+ LMPC, robust": _variant(disturbances=False),
    "+ LMPC, disturbance (`ttempc-nominal`)": _variant(robust=False),
    "+ LMPC, disturbance, robust (`ttempc`)": _variant(),
    "the same, MPC tightened by the law's authority": _variant(tightened=True),
    "robust in the tube reading": _variant(nominal="tube"),
    "no robust, step weights 1, 1, 1": _variant(robust=False, step_weight=(1.0, 1.0, 1.0)),
    "no robust, step weights 0.05, 0.05, 0.02": _variant(
        robust=False, step_weight=(0.05, 0.05, 0.02)
    ),
    "no robust, horizon 12": _variant(robust=False, horizon=12),
}


def main(seeds: int, scenarios: tuple[str, ...]) -> None:
    """Run and print."""
    print(f"| scenario | parts | {' | '.join(COLUMNS)} | steering rate, deg/s | lost |")
    print("|---" * (len(COLUMNS) + 4) + "|")
    for scenario in scenarios:
        name, content = load(scenario, ["path.laps=1"])
        for parts, factory in VARIANTS.items():
            runs = [simulate(name, content, seed, factory)[0] for seed in range(1, seeds + 1)]
            errors = np.mean([mean_errors_cm(run) for run in runs], axis=0)
            lost = sum(run.status != "completed" for run in runs)
            cells = " | ".join(f"{error:.2f}" for error in errors)
            rate = np.mean([_steering_rate(run) for run in runs])
            print(f"| `{name}` | {parts} | {cells} | {rate:.1f} | {lost}/{seeds} |", flush=True)


def _steering_rate(run: Summary) -> float:
    """Return the root mean square rate of the front steering's command [deg/s]."""
    rate = run.inputs.delta_t.rms_rate
    return math.nan if rate is None else math.degrees(rate)


if __name__ == "__main__":
    main(int((sys.argv[1:] or ["2"])[0]), tuple(sys.argv[2:]) or SCENARIOS)
