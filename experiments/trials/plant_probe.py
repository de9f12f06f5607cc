"""Short runs of the plant alone: does this code simulate the vehicle of the field trials?

The commands follow from the true state by a fixed law, so that neither estimator nor controllers
matter. `python -m experiments.trials.plant_probe` prints the results of all trials, for a new
version of the trials.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from ttempc.reference.reference import ReferenceSample
from ttempc.types import Command, State

from ...testbed.recording.channels import CORRIDOR, MEASUREMENT, STATE, TOOL
from ...testbed.recording.record import Recorder
from ...testbed.simulation import loop
from ...testbed.simulation.setup import Stage, TickContext
from ..run.assembly import Assembly, assemble
from ..scenario.scenario import read_scenario
from .definition import trial_files

FORWARD_S: Final = 40.0
"""Simulated time of a probe: it covers a straight, half a circle and the first faults."""

REVERSE_S: Final = 10.0
"""The same in reverse, where the law does not hold the trailer: rounding errors must not grow."""

_TOLERANCE: Final = 1e-6  # between processors; a change of a constant changes more
_SEED: Final = 1
_NOT_DRIVEN: Final = ("prepare", "estimate", "log_control", "log_timing", "terminate")


def probe(name: str) -> tuple[float, ...]:
    """Drive the probe of a trial and return the means and the last values of its channels.

    Channels: reference of the whole path, true state, samples of the sensors, tool and corridor;
    numbers that do not exist are left out.
    """
    changes = {"controller": {"name": "feedforward"}}
    scenario = read_scenario(str(trial_files()[name])).scenario(changes)
    assembly = assemble(scenario, _SEED)
    vehicle, period_s = assembly.vehicle, assembly.guidance.period_s
    recorder = Recorder()
    setup, tick = assembly.setup(recorder), TickContext()
    tick.truths = [(0, setup.plant.truth())]
    grid = assembly.reference.on_grid(period_s)
    stages = _stages(assembly)
    duration_s = REVERSE_S if vehicle.reverse else FORWARD_S
    for k in range(min(round(duration_s / period_s), assembly.ticks)):
        tick.k = tick.reference_tick = k
        tick.command = fixed_law(grid, k, tick)
        for stage in stages:
            stage(setup, tick)
    record = recorder.record()
    channels = (record[channel].values for channel in (STATE, MEASUREMENT, TOOL, CORRIDOR))
    values: list[float] = []
    for table in (grid.state, grid.trailer_xy, grid.inputs, *channels):
        for column in table.T:
            numbers = column[np.isfinite(column)]
            values += [float(numbers.mean()), float(numbers[-1])] if len(numbers) else []
    return tuple(values)


def fixed_law(grid: ReferenceSample, k: int, tick: TickContext) -> Command:
    """Return the inputs of the reference and, forward, a turn back to it by the true state.

    A law of its own: a change of a controller must not change the probes.
    """
    truth, state = tick.now, grid.state[k]
    delta_t, delta_i, hp = grid.inputs[k].tolist()
    if state[State.V] > 0.0:
        yaw = float(state[State.PSI_T])
        x, y = truth.tractor.x - state[State.X], truth.tractor.y - state[State.Y]
        left = y * math.cos(yaw) - x * math.sin(yaw)
        ahead = x * math.cos(yaw) + y * math.sin(yaw)
        delta_t += math.remainder(yaw - truth.tractor.yaw, math.tau) - math.atan(0.5 * left)
        hp -= 0.3 * ahead
    return Command(max(-0.5, min(0.5, delta_t)), delta_i, max(-1.0, min(1.0, hp)))


def differing(
    results: Mapping[str, tuple[float, ...]], frozen: Mapping[str, tuple[float, ...]]
) -> tuple[str, ...]:
    """Return the trials whose probes differ by more than rounding of another processor."""

    def same(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
        return len(one) == len(other) and np.allclose(one, other, rtol=_TOLERANCE, atol=_TOLERANCE)

    names = {*results, *frozen}
    return tuple(
        name for name in sorted(names) if not same(results.get(name, ()), frozen.get(name, ()))
    )


def _stages(assembly: Assembly) -> list[Stage]:
    """Return the stages of sensors and plant, those of the faults among them."""
    skipped = [getattr(loop, name) for name in (*_NOT_DRIVEN, "control")]
    return [stage for stage in assembly.stages if stage not in skipped]


if __name__ == "__main__":
    print(json.dumps({name: probe(name) for name in trial_files()}, indent=1))
