"""What a plan will take: time from a few seconds of each controller, disk from its size."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import Final

from proving_ground.testbed.recording.record import Recorder
from proving_ground.testbed.simulation.loop import drive

from ..results.tracking import START_UP_S
from ..run.assembly import CONTROL_PERIOD_S, assemble
from .engine import cores
from .plan import Extent, Plan, Setting

_TICKS: Final = round(START_UP_S / CONTROL_PERIOD_S)
_ROW_BYTES: Final = 3500  # of one axis, measured
_LOG_BYTES_PER_S: Final = 26_000  # measured
_SHOWN: Final = 12  # values of an axis


@dataclass(frozen=True, slots=True)
class Estimate:
    """What the runs of a plan take, if none is lost."""

    core_s: float
    rows_bytes: int
    logs_bytes: int  # of all logs that may be there at a time


def estimate(plan: Plan, extent: Extent) -> Estimate:
    """Drive the first seconds of each controller's first run and extrapolate."""
    settings: dict[str, Setting] = {}
    for driver in range(plan.drivers):
        setting = plan.setting(plan.changed(0, driver))
        settings.setdefault(setting.scenario.controller.name, setting)
    costs = [_cost(setting) for setting in settings.values()]
    start_s, per_s = (sum(parts) / len(costs) for parts in zip(*costs, strict=True))
    log_bytes = _LOG_BYTES_PER_S * extent.simulated_s / extent.runs
    logs = {"none": 0, "worst": plan.study.worst}.get(plan.study.keep, extent.runs)
    return Estimate(
        core_s=start_s * extent.runs + per_s * extent.simulated_s,
        rows_bytes=_ROW_BYTES * extent.runs,
        logs_bytes=round(log_bytes * logs),
    )


def _cost(setting: Setting) -> tuple[float, float]:
    """Return seconds until a run begins, and seconds a simulated second."""
    assemble(setting.scenario, seed=1).rig(Recorder())  # what is loaded once a process
    begin = perf_counter()
    assembly = assemble(setting.scenario, seed=1)
    rig = assembly.rig(Recorder())
    ticks = min(_TICKS, assembly.ticks)
    start = perf_counter()
    drive(rig, ticks)
    return start - begin, (perf_counter() - start) / (ticks * CONTROL_PERIOD_S)


def described(plan: Plan, extent: Extent, estimate: Estimate, workers: int | None) -> str:
    """Return plan, size and estimate as lines of text."""
    study = plan.study
    at_once = max(1, cores() if workers is None else workers)
    lines = [f"{plan.name}: {study.description}".rstrip(": "), f"scenario  {study.scenario}"]
    for axis in study.axis:
        lines.append(f"axis      {axis.label}: {', '.join(_shown(plan, axis.names))}")
    lines += [
        f"seeds     {', '.join(map(str, study.drawn_with))}",
        f"runs      {extent.runs}: {extent.points} points, {len(study.drawn_with)} seeds, "
        f"{plan.drivers} controllers ({', '.join(extent.controllers)})",
        f"time      about {_time(estimate.core_s / at_once)} on {at_once} cores of this machine, "
        f"{_time(extent.simulated_s)} simulated",
        f"disk      about {_size(estimate.rows_bytes)} rows, "
        + (f"up to {_size(estimate.logs_bytes)} logs" if estimate.logs_bytes else "no logs"),
    ]
    return "\n".join(lines)


def _shown(plan: Plan, names: tuple[str, ...]) -> list[str]:
    """Return the values of an axis, the middle ones left out where they are many."""
    seen: dict[str, None] = {}
    for point in range(plan.points):
        for driver in range(plan.drivers):
            changes = plan.changed(point, driver)
            values = dict.fromkeys(_text(changes[name]) for name in names)
            seen.setdefault(" & ".join(values))
    shown = [*seen]
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
