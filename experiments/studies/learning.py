"""Tracking with a model of wrong lengths, learnt or not, lap by lap.

    python -m experiments.studies.learning [CONTROLLER]      (default: ttempc)

Prints the mean Euclidean errors of tractor and trailer on straights, then on curves [cm], of the
first lap from 8 s on and of the second, as means over the seeds. docs/learning.md has the table.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ..results.tracking_errors import START_UP_S, tracking_errors
from ..run.assembly import check
from ..run.simulate import simulate
from ..scenario.scenario import load
from ..scenario.vehicle import LENGTH_KEYS
from ..seeds import report_seeds
from .batch import run_tasks

SCENARIO: Final = "grass"
PATH: Final = "path.laps=2"
SEEDS: Final = report_seeds(2)
FACTORS: Final = (  # of wheelbase, hitch offset, drawbar and trailer
    (1.0, 1.0, 1.0, 1.0),
    (1.24, 1.09, 1.2, 0.92),
    (0.7, 0.7, 0.7, 0.7),
    (1.3, 1.3, 1.3, 1.3),
    (1.3, 0.7, 1.3, 0.7),
)
PROBE: Final = ("controller.vehicle.wheelbase_m=1.74", "controller.vehicle.drawbar_m=0.96")


@dataclass(frozen=True, slots=True)
class Case:
    """A run with a model whose lengths are those of the plant times `factors`."""

    controller: str
    seed: int
    factors: tuple[float, ...]
    learn: bool

    def overrides(self) -> list[str]:
        """Return the changes of the scenario."""
        learn = "true" if self.learn else "false"
        own = [PATH, f'controller.name="{self.controller}"', f"controller.learn={learn}"]
        lengths = load(SCENARIO)[1].vehicles().plant_lengths
        factors = zip(lengths.items(), self.factors, strict=True)
        changes = (
            f"controller.vehicle.{LENGTH_KEYS[name]}={length * factor}"
            for (name, length), factor in factors
        )
        return [*own, *changes]


def errors_by_lap(case: Case) -> FloatArray:
    """Return the mean errors [m] of the laps, (2, 4); NaN where the vehicle did not arrive."""
    scenario = load(SCENARIO, case.overrides())[1]
    _, record = simulate(SCENARIO, scenario, case.seed)
    errors = tracking_errors(record)
    lap_s = 0.5 * check(scenario) * scenario.control.period_s
    lap = np.floor(errors.time_s / lap_s)
    return np.array(
        [
            [
                _mean(point.euclidean_m[(lap == n) & (errors.time_s >= START_UP_S) & where])
                for where in (~errors.curved, errors.curved)
                for point in (errors.tractor, errors.trailer)
            ]
            for n in range(2)
        ]
    )


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if len(values) else np.nan


def main(controller: str = "ttempc", seeds: tuple[int, ...] = SEEDS) -> None:
    """Drive all models, with and without learning, and print the table."""
    ways = [(factors, learn) for factors in FACTORS for learn in (False, True)]
    cases = [Case(controller, seed, *way) for way in ways for seed in seeds]
    errors = np.array(list(run_tasks(errors_by_lap, cases))).reshape(len(ways), len(seeds), 2, 4)
    print(f"| model lengths over true ones, {controller} | learnt | first lap | second lap |")
    print("|---" * 4 + "|")
    for (factors, learn), laps in zip(ways, 100.0 * errors.mean(axis=1), strict=True):
        cells = [" / ".join(f"{value:.2f}" for value in lap) for lap in laps]
        model = ", ".join(f"{factor:g}" for factor in factors)
        print(f"| {model} | {'yes' if learn else 'no'} | {cells[0]} | {cells[1]} |")


if __name__ == "__main__":
    main((sys.argv[1:] or ["ttempc"])[0])
