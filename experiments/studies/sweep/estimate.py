"""Estimate of the time of a sweep, from a short drive of its first run."""

import math
import time
from dataclasses import dataclass, replace
from typing import Final

from ....testbed.recording.record import Recorder
from ...run.assembly import assemble
from ...run.simulate import drive_into
from .plan import SweepPlan

MOST_UNTOLD: Final = 100
"""Runs of a sweep that begins without an estimate: to measure takes as long as some runs."""
_DRIVEN_S: Final = 20.0


@dataclass(frozen=True, slots=True)
class Cost:
    """Processor time of a run on this machine."""

    set_up_s: float  # before its first tick
    simulated_s_per_s: float

    def hours(self, runs: int, simulated_s: float, workers: int) -> float:
        """Return how long runs take on workers that have a core each [h]."""
        busy_s = runs * self.set_up_s + simulated_s / self.simulated_s_per_s
        return busy_s / workers / 3600.0


def measure(plan: SweepPlan) -> Cost:
    """Return the cost of the first run of a plan, from its set-up and its first 20 s.

    Raises:
        Exception: what the run raises; a controller of a user's can raise anything.
    """
    planned = plan[next(plan.runs())]
    scenario = planned.setting.scenario
    most_ticks = math.ceil(_DRIVEN_S / scenario.control.period_s)
    cost = Cost(0.0, 1.0)
    for _ in range(2):  # the first of a process loads its kernels
        begin = time.process_time()
        assembly = assemble(scenario, planned.seed)
        assembly = replace(assembly, ticks=min(assembly.ticks, most_ticks))
        ready = time.process_time()
        outcome = drive_into(Recorder(), assembly, prepared=False)
        driven = time.process_time()
        cost = Cost(ready - begin, outcome.duration_s / (driven - ready))
    return cost


def format_time(plan: SweepPlan, workers: int) -> str:
    """Return in words how long a sweep takes, or that its first run raises an error."""
    extent = plan.extent()
    try:
        cost = measure(plan)
    except Exception as error:  # it will be the failure in the row of that run
        return f"unknown: the first run raises {type(error).__name__}"
    hours = cost.hours(extent.runs, extent.simulated_s, workers)
    length = f"{hours:.1f} h" if hours >= 1.0 else f"{60.0 * hours:.1f} min"
    return (
        f"about {length} on {workers} cores, all to the end: {cost.set_up_s:.2f} s of set-up a "
        f"run, {cost.simulated_s_per_s:.0f} simulated s a s and core"
    )
