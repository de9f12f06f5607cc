"""Axes that change nothing: keys that a study varies and none of its runs reads.

Two short drives that differ in one axis alone, from the same seed, are compared bit for bit: what
they drive on, what they drive, what the controller believes, and what came out. Strict validation
has refused keys that do not exist; this finds those that exist and do nothing where they are, such
as the strength of a soil below a map that covers it.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterator
from typing import Final

import numpy as np

from proving_ground.testbed.recording.channels import CHANNELS, MEASUREMENT, TIMING
from proving_ground.testbed.recording.record import Recorder
from proving_ground.testbed.simulation.loop import drive
from ttempc.types import FloatArray

from ..errors import ExperimentError
from ..run.assembly import assemble
from ..scenario.scenario import Scenario
from .dimensions import Change
from .plan import Plan
from .study import BY_NAME

_TICKS: Final = 15  # 3 s of driving
_NOT_COMPARED: Final = (TIMING, MEASUREMENT)
_PATH_STEP_M: Final = 0.5
_PLACES: Final = 6  # points of a plan at which an axis is tried


def unread(plan: Plan) -> tuple[str, ...]:
    """Return the axes, as the study names them, that changed nothing wherever they were tried."""
    study, found = plan.study, []
    for axis in study.axis:
        if any(name in BY_NAME for name in axis.names):
            continue
        pairs = list(_pairs(plan, axis.names))
        if pairs and all(_print(plan, one) == _print(plan, other) for one, other in pairs):
            found.append(axis.label)
    return tuple(found)


def _pairs(plan: Plan, names: tuple[str, ...]) -> Iterator[tuple[Change, Change]]:
    """Yield pairs of points that differ in these keys alone, from all over the plan."""
    points = np.unique(np.linspace(0, plan.points - 1, _PLACES).round().astype(int)).tolist()
    for number, point in enumerate(points):
        here = plan.changed(point, number % plan.drivers)
        for away in itertools.chain(points, range(plan.points)):
            there = plan.changed(away)
            if any(there[name] != here[name] for name in names):
                yield here, {**here, **{name: there[name] for name in names}}
                break


def _print(plan: Plan, changes: Change) -> str:
    try:
        return fingerprint(plan.setting(changes).scenario)
    except ExperimentError as error:  # the pair need not be a point of the plan; it is read
        return str(error)


def fingerprint(scenario: Scenario) -> str:
    """Return a hash of all that a short drive follows from, and of what it did."""
    assembly = assemble(scenario, seed=1)
    recorder = Recorder()
    drive(assembly.setup(recorder), min(_TICKS, assembly.ticks))
    record, plant = recorder.record(), assembly.plant
    digest = hashlib.sha256()
    arrays: list[FloatArray] = [plant.terrain.heights, plant.soil.rasterised(plant.terrain)]
    arrays += [assembly.reference_path(_PATH_STEP_M)]
    # Samples that nobody weighs are on record, too: what is read of them shows in the estimate.
    arrays += [record[channel].values for channel in CHANNELS if channel not in _NOT_COMPARED]
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    vehicles = (plant.vehicle, assembly.vehicle, plant.actuators.specification)
    digest.update(repr((*vehicles, plant.timestep_s, assembly.ticks)).encode())
    return digest.hexdigest()
