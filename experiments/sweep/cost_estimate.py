"""Estimate of a plan's cost: time from a few seconds of each controller, disk from its size."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import Final

from ...testbed.recording.record import Recorder
from ...testbed.simulation.loop import drive
from ..results.tracking_errors import START_UP_S
from ..run.assembly import assemble
from .engine import cores
from .plan import PlanExtent, Setting, SweepPlan

_ROW_BYTES: Final = 3500  # of one axis, measured
_LOG_BYTES_PER_S: Final = 26_000  # measured
_SHOWN: Final = 12  # values of an axis


@dataclass(frozen=True, slots=True)
class SweepCost:
    """Time and disk space that the runs of a plan take if none terminates early."""

    core_s: float
    rows_bytes: int
    logs_bytes: int  # of all logs that can exist at a time


def estimate_cost(plan: SweepPlan, extent: PlanExtent) -> SweepCost:
    """Drive the first seconds of one run of each controller and extrapolate."""
    settings: dict[str, Setting] = {}
    for controller in range(plan.controller_count):
        accepted = (p for p in range(plan.points) if (p, controller) not in plan.refusals)
        setting = plan.setting(plan.changes(next(accepted), controller))
        settings.setdefault(setting.scenario.controller.name, setting)
    costs = [_cost(setting) for setting in settings.values()]
    start_s, per_s = (sum(parts) / len(costs) for parts in zip(*costs, strict=True))
    log_bytes = _LOG_BYTES_PER_S * extent.simulated_s / extent.runs
    logs = {"none": 0, "worst": plan.study.worst}.get(plan.study.keep, extent.runs)
    return SweepCost(
        core_s=start_s * extent.runs + per_s * extent.simulated_s,
        rows_bytes=_ROW_BYTES * extent.runs,
        logs_bytes=round(log_bytes * logs),
    )


def _cost(setting: Setting) -> tuple[float, float]:
    """Return the time until a run starts [s] and the time per simulated second [s/s]."""
    assemble(setting.scenario, seed=1).setup(Recorder())  # loads what is loaded once per process
    begin = perf_counter()
    assembly = assemble(setting.scenario, seed=1)
    setup = assembly.setup(Recorder())
    period_s = assembly.guidance.period_s
    ticks = min(round(START_UP_S / period_s), assembly.ticks)
    start = perf_counter()
    drive(setup, ticks, assembly.stages)
    return start - begin, (perf_counter() - start) / (ticks * period_s)


def format_plan(plan: SweepPlan, extent: PlanExtent, cost: SweepCost, workers: int | None) -> str:
    """Return plan, size and cost as lines of text."""
    study = plan.study
    at_once = max(1, cores() if workers is None else workers)
    lines = [f"{plan.name}: {study.description}".rstrip(": "), f"scenario  {study.scenario}"]
    for axis in study.axis:
        lines.append(f"axis      {axis.label}: {', '.join(_shown(plan, axis.names))}")
    lines += [
        f"seeds     {', '.join(map(str, study.point_seeds))}",
        f"runs      {extent.runs}: {extent.points} points, {len(study.point_seeds)} seeds, "
        f"{plan.controller_count} controllers ({', '.join(extent.controllers)})",
        f"time      about {_time(cost.core_s / at_once)} on {at_once} cores of this machine, "
        f"{_time(extent.simulated_s)} simulated",
        f"disk      about {_size(cost.rows_bytes)} rows, "
        + (f"up to {_size(cost.logs_bytes)} logs" if cost.logs_bytes else "no logs"),
    ]
    return "\n".join(lines)


def _shown(plan: SweepPlan, names: tuple[str, ...]) -> list[str]:
    """Return the values of an axis; of many, the first and the last."""
    texts: dict[str, None] = {}
    for point in range(plan.points):
        for controller in range(plan.controller_count):
            changes = plan.changes(point, controller)
            values = dict.fromkeys(_text(changes[name]) for name in names)
            texts.setdefault(" & ".join(values))
    shown = [*texts]
    if len(shown) <= _SHOWN:
        return shown
    few = _SHOWN // 4
    return [*shown[:few], f"... {len(shown) - 2 * few} more ...", *shown[-few:]]


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _time(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


def _size(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count < 1e9 else f"{count / 1e9:.1f} GB"
