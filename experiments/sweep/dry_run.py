"""Dry run of a plan: its size, an estimate of time."""

from __future__ import annotations

import itertools
from time import perf_counter
from typing import Final

import numpy as np

from ...testbed.recording.record import Recorder
from ...testbed.simulation.loop import drive
from ..results.tracking_errors import START_UP_S
from ..run.assembly import assemble
from ..scenario.scenario import Scenario
from .engine import cores
from .plan import SweepPlan

_SHOWN: Final = 12  # values of an axis


def format_plan(plan: SweepPlan, workers: int | None) -> str:
    """Return plan, size and estimated cost as lines of text; drive a little for the latter."""
    study, extent = plan.study, plan.extent()
    at_once = max(1, cores() if workers is None else workers)
    start_s, per_s = _cost(plan)
    total_s = (start_s * extent.runs + per_s * extent.simulated_s) / at_once
    return "\n".join(
        [
            f"{plan.name}: {study.description}".rstrip(": "),
            f"scenario  {study.scenario}",
            *(
                f"axis      {axis.label}: {', '.join(_values(plan, axis.names))}"
                for axis in study.axis
            ),
            f"seeds     {', '.join(map(str, study.point_seeds))}",
            f"runs      {extent.runs}: {extent.points} points, {len(study.point_seeds)} seeds, "
            f"{plan.controller_count} controllers ({', '.join(extent.controllers)})",
            f"time      about {_time(total_s)} on {at_once} cores of this machine, "
            f"{_time(extent.simulated_s)} simulated",
        ]
    )


def _cost(plan: SweepPlan) -> tuple[float, float]:
    """Return the time until a run starts [s] and that per simulated second, means of controllers.

    The first seconds of one run of each controller are driven.
    """
    scenarios: dict[str, Scenario] = {}
    for run in plan.runs():
        scenario = plan[run].setting.scenario
        scenarios.setdefault(scenario.controller.name, scenario)
        if len(scenarios) == len(plan.extent().controllers):
            break
    costs = []
    for scenario in scenarios.values():
        assemble(scenario, seed=1).setup(Recorder())  # loads what is loaded once per process
        begin = perf_counter()
        assembly = assemble(scenario, seed=1)
        setup = assembly.setup(Recorder())
        period_s = assembly.guidance.period_s
        ticks = min(round(START_UP_S / period_s), assembly.ticks)
        start = perf_counter()
        drive(setup, ticks, assembly.stages)
        costs.append((start - begin, (perf_counter() - start) / (ticks * period_s)))
    start_s, per_s = np.mean(costs, axis=0).tolist()
    return start_s, per_s


def _values(plan: SweepPlan, names: tuple[str, ...]) -> str:
    """Return the values of an axis; of many, the first ones."""
    places = itertools.product(range(plan.points), range(plan.controller_count))
    changes = (plan.changes(*place) for place in places)
    texts = (" & ".join(dict.fromkeys(str(change[name]) for name in names)) for change in changes)
    shown = [*dict.fromkeys(texts)]
    return ", ".join(shown[:_SHOWN]) + (f", {len(shown) - _SHOWN} more" * (len(shown) > _SHOWN))


def _time(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"
