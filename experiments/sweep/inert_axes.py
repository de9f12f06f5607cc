"""Inert axes: keys that a study varies and that no run reads.

Two short drives from the same seed that differ in one axis are compared bit for bit: ground,
vehicle, model parameters and outcome. Strict validation refuses keys that do not exist. This check
detects keys that exist without effect, such as the strength of a soil that a map covers.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterator
from typing import Final

import numpy as np

from ttempc.errors import TtempcError
from ttempc.types import FloatArray

from ...testbed.errors import TestbedError
from ...testbed.recording.channels import CHANNELS, MEASUREMENT, TIMING
from ...testbed.recording.record import Recorder
from ...testbed.simulation.loop import drive
from ..errors import ExperimentError
from ..run.assembly import assemble
from ..scenario.scenario import Scenario
from .dimensions import Change
from .plan import SweepPlan
from .study import BY_NAME

_TICKS: Final = 15  # 3 s of driving
_NOT_COMPARED: Final = (TIMING, MEASUREMENT)
_PATH_STEP_M: Final = 0.5
_POINTS: Final = 6  # of a plan, at which an axis is tested


def find_inert_axes(plan: SweepPlan) -> tuple[str, ...]:
    """Return the labels of the axes that change nothing at any tested point."""
    study, inert = plan.study, []
    for axis in study.axis:
        if any(name in BY_NAME for name in axis.names):
            continue
        pairs = list(_pairs(plan, axis.names))
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
    """Return the fingerprint of a point, or the reason why it is refused."""
    try:
        return fingerprint(plan.setting(changes).scenario)
    except (ExperimentError, TestbedError, TtempcError) as error:
        # The pair need not be a point of the plan.
        return str(error)


def fingerprint(scenario: Scenario) -> str:
    """Return a hash of the inputs and the outcome of a short drive."""
    assembly = assemble(scenario, seed=1)
    recorder = Recorder()
    ticks = min(_TICKS, assembly.ticks)
    drive(assembly.setup(recorder), ticks, assembly.stages)
    record, plant = recorder.record(), assembly.plant
    digest = hashlib.sha256()
    arrays: list[FloatArray] = [plant.terrain.heights, plant.soil.rasterised(plant.terrain)]
    arrays += [assembly.reference_path(_PATH_STEP_M)]
    # Measurements are not compared: samples that no filter uses are recorded, too.
    arrays += [record[channel].values for channel in CHANNELS if channel not in _NOT_COMPARED]
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    vehicles = (plant.vehicle, assembly.vehicle, plant.actuators.specification)
    digest.update(repr(scenario.faults).encode())  # refused where it cannot act, later than this
    digest.update(repr((*vehicles, plant.timestep_s, assembly.ticks)).encode())
    return digest.hexdigest()
