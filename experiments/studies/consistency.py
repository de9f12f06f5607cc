"""Consistency of the default filter on every shipped field.

    python -m experiments.studies.consistency [FIRST_SEED [SEEDS]]

Prints the Markdown table of docs/estimators.md: one lap with the default controller; for each state
the mean normalised estimation error squared (NEES) over all seeds; then normalised innovation
squared (NIS), autocorrelation of the innovations of GNSS, and mean error of both points.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ttempc.types import State

from ..logs.replay import estimator_of, replay
from ..results.consistency import Consistency, consistency
from ..run.simulate import simulate
from ..scenario.path import FigureEight
from ..scenario.scenario import load, shipped
from .batch import StudyRun, run_tasks

_GNSS = ("gnss_tractor", "gnss_trailer")


def run_consistency(run: StudyRun) -> Consistency:
    """Drive one lap and return the figures of its estimator, replayed from its record."""
    name, scenario = load(run.scenario, run.overrides)
    if isinstance(scenario.path, FigureEight):
        scenario = replace(scenario, path=replace(scenario.path, laps=1))
    _, record = simulate(name, scenario, run.seed)
    return consistency(replay(record, estimator_of(scenario)), record)


def main(
    seeds: Sequence[int] = (1, 2), scenarios: Sequence[str] = (), overrides: tuple[str, ...] = ()
) -> None:
    """Drive all scenarios, by default all that ship, and print the table."""
    names = list(scenarios or shipped())
    runs = [StudyRun(name, seed, overrides) for name in names for seed in seeds]
    figures = run_tasks(run_consistency, runs)
    states = [state.name.lower() for state in State]
    heads = (*states, "NIS", "autocorrelation", "estimated tractor", "estimated trailer, cm")
    print(f"| scenario | {' | '.join(heads)} |")
    print("|---" * (len(heads) + 1) + "|")
    for name in names:
        cells = np.mean([_cells(next(figures)) for _ in seeds], axis=0)
        print(f"| `{name}` | {' | '.join(f'{cell:.2f}' for cell in cells)} |", flush=True)


def _cells(figures: Consistency) -> list[float]:
    """Return the numbers of a row for one run."""
    gnss = [item.autocorrelation for item in figures.sensors if item.name in _GNSS]
    return [
        *(item.nees for item in figures.states),
        figures.nis,
        float(np.mean(gnss)),
        100.0 * figures.tractor_m,
        100.0 * figures.trailer_m,
    ]


if __name__ == "__main__":
    given = [int(text) for text in sys.argv[1:]]
    first, count = (*given, *(1, 2)[len(given) :])
    main(range(first, first + count))
