"""Dry run of a plan: its size, an estimate of time and disk, and axes that change nothing."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterator
from time import perf_counter
from typing import Final

import numpy as np

from ttempc.errors import TtempcError
from ttempc.types import FloatArray

from ...testbed.errors import TestbedError
from ...testbed.recording.channels import CHANNELS, MEASUREMENT, TIMING
from ...testbed.recording.record import Recorder
from ...testbed.simulation.loop import drive
from ..errors import ExperimentError
from ..results.tracking_errors import START_UP_S
from ..run.assembly import assemble
from ..scenario.scenario import Scenario
from .engine import cores
from .plan import SweepPlan
from .study import BY_NAME, Change

_ROW_BYTES: Final = 3500  # of one axis, measured
_LOG_BYTES_PER_S: Final = 26_000  # measured
_SHOWN: Final = 12  # values of an axis
_TICKS: Final = 15  # 3 s of driving
_NOT_COMPARED: Final = (TIMING, MEASUREMENT)
_PATH_STEP_M: Final = 0.5
_POINTS: Final = 6  # of a plan, at which an axis is tested


def format_plan(plan: SweepPlan, workers: int | None) -> str:
    """Return plan, size and estimated cost as lines of text; drive a little for the latter."""
    study, extent = plan.study, plan.extent()
    at_once = max(1, cores() if workers is None else workers)
    start_s, per_s = _cost(plan)
    total_s = (start_s * extent.runs + per_s * extent.simulated_s) / at_once
    logs = "no logs"
    if study.keep != "none":
        logs = f"up to {_LOG_BYTES_PER_S * extent.simulated_s / 1e6:.1f} MB logs"
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
            f"disk      about {_ROW_BYTES * extent.runs / 1e6:.1f} MB rows, {logs}",
        ]
    )


def _cost(plan: SweepPlan) -> tuple[float, float]:
    """Return the time until a run starts [s] and that per simulated second, means of controllers.

    The first seconds of one run of each controller are driven.
    """
    scenarios: dict[str, Scenario] = {}
    for controller in range(plan.controller_count):
        accepted = (p for p in range(plan.points) if (p, controller) not in plan.refusals)
        scenario = plan.setting(plan.changes(next(accepted), controller)).scenario
        scenarios.setdefault(scenario.controller.name, scenario)
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
    """Return the values of an axis; of many, the first and the last."""
    texts: dict[str, None] = {}
    for place in itertools.product(range(plan.points), range(plan.controller_count)):
        changes = plan.changes(*place)
        values = (changes[name] for name in names)
        each = (f"{value:g}" if isinstance(value, float) else str(value) for value in values)
        texts.setdefault(" & ".join(dict.fromkeys(each)))
    shown, few = [*texts], _SHOWN // 4
    if len(shown) > _SHOWN:
        shown[few:-few] = [f"... {len(shown) - 2 * few} more ..."]
    return ", ".join(shown)


def _time(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


def find_inert_axes(plan: SweepPlan) -> tuple[str, ...]:
    """Return the labels of the axes that no run reads, as far as tested.

    Two short drives from the same seed that differ in one axis are compared bit for bit: ground,
    vehicle, model parameters and outcome. Validation refuses keys that do not exist; this detects
    keys without effect, such as the strength of a soil that a map covers.
    """
    inert = []
    for axis in plan.study.axis:
        pairs = [] if {*axis.names} & {*BY_NAME} else [*_pairs(plan, axis.names)]
        if pairs and all(_outcome(plan, one) == _outcome(plan, other) for one, other in pairs):
            inert.append(axis.label)
    return tuple(inert)


def _pairs(plan: SweepPlan, names: tuple[str, ...]) -> Iterator[tuple[Change, Change]]:
    """Yield pairs of points that differ in these keys alone, spread over the plan."""
    points = np.unique(np.linspace(0, plan.points - 1, _POINTS).round().astype(int)).tolist()
    for number, point in enumerate(points):
        changes = plan.changes(point, number % plan.controller_count)
        for other_point in itertools.chain(points, range(plan.points)):
            other = plan.changes(other_point)
            if any(other[name] != changes[name] for name in names):
                yield changes, {**changes, **{name: other[name] for name in names}}
                break


def _outcome(plan: SweepPlan, changes: Change) -> str:
    """Return the hash of a short drive at a point, or the reason why it is refused."""
    try:
        return _hash(plan.setting(changes).scenario)
    except (ExperimentError, TestbedError, TtempcError) as error:
        return str(error)  # the pair need not be a point of the plan


def _hash(scenario: Scenario) -> str:
    """Return a hash of the inputs and the outcome of a short drive."""
    assembly = assemble(scenario, seed=1)
    recorder = Recorder()
    drive(assembly.setup(recorder), min(_TICKS, assembly.ticks), assembly.stages)
    record, plant = recorder.record(), assembly.plant
    arrays: list[FloatArray] = [plant.terrain.heights, plant.soil.rasterised(plant.terrain)]
    arrays.append(assembly.reference_path(_PATH_STEP_M))
    # Measurements are not compared: samples that no filter uses are recorded, too.
    arrays += [record[channel].values for channel in CHANNELS if channel not in _NOT_COMPARED]
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    vehicles = (plant.vehicle, assembly.vehicle, plant.actuators.specification)
    digest.update(repr(scenario.faults).encode())  # refused where it cannot act, later than this
    digest.update(repr((*vehicles, plant.timestep_s, assembly.ticks)).encode())
    return digest.hexdigest()
