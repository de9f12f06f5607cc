"""Steps of the learning environment beside the same run without it, and beside its plant alone.

As many environments as cores step in processes of their own (`gymnasium.vector.AsyncVectorEnv`),
with a residual of 0 on `ttempc`. Between blocks of steps each process drives the same run as
`simulate` does, then its plant alone, for as many control periods. Processor time of all processes
counts, that of the caller and of the pipes included, the least of the repeats of each: other
processes of the machine matter little. The steps a second are by the wall clock.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode

from ...testbed.recording.record import Recorder
from ...testbed.simulation.loop import periods, prepare
from ..gym_env.environment import FieldTrial
from ..run.assembly import assemble
from .figure import BenchmarkFigure, Limit

STEPS = 50  # of a block
REPEATS = 8
SEED: Final = 1
OVERRIDES: Final = ("controller.learn=false",)  # learning runs in a thread, in some of the periods

LEAST_RATIO: Final = 0.9


class TimedTrial(FieldTrial):
    """Environment that can drive its run or its plant alone."""

    def processor_s(self) -> float:
        """Return the processor time of this process so far [s]."""
        return time.process_time()

    def drive_run(self, count: int) -> float:
        """Return the processor time [s] of `count` periods of the run, as `simulate` drives it."""
        assembly = assemble(self._scenario, SEED, None, self._parts)
        stages = [stage for stage in assembly.stages if stage is not prepare]
        run = periods(assembly.setup(Recorder()), assembly.ticks, stages, lambda k: None)
        next(run)
        begin = time.process_time()
        for _ in range(count):
            next(run)
        return time.process_time() - begin

    def drive_plant(self, count: int) -> float:
        """Return the processor time [s] of `count` periods of the plant; its state stays as is."""
        plant, steps = self._setup.plant, self._setup.control_steps
        before, command = plant.snapshot(), self._guidance.control_step.command
        begin = time.process_time()
        for _ in range(count):
            plant.advance(command, steps)
        taken = time.process_time() - begin
        plant.restore(before)
        return taken


def _processor_s(trials: AsyncVectorEnv, action: Callable[[], object]) -> float:
    """Return the processor time of an action in all processes [s]."""
    before = time.process_time() + sum(trials.call("processor_s"))
    action()
    return time.process_time() + sum(trials.call("processor_s")) - before


def figures() -> list[BenchmarkFigure]:
    """Return costs of a step and of the same period without the environment, and their ratios."""
    count = os.cpu_count() or 1
    make = partial(TimedTrial, overrides=OVERRIDES, action="residual")
    trials = AsyncVectorEnv([make] * count, autoreset_mode=AutoresetMode.DISABLED)
    actions = np.zeros((count, 3))
    walls: list[float] = []

    def step() -> None:
        begin = time.perf_counter()
        for _ in range(STEPS):
            trials.step(actions)
        walls.append(time.perf_counter() - begin)

    try:
        costs = []
        for _ in range(REPEATS):
            reset = _processor_s(trials, lambda: trials.reset(seed=SEED))
            trials.step(actions)
            alone = [sum(trials.call(name, STEPS)) for name in ("drive_run", "drive_plant")]
            costs.append([reset, _processor_s(trials, step), *alone])
    finally:
        trials.close()
    reset_s, step_s, run_s, plant_s = np.min(costs, axis=0) / count
    return [
        BenchmarkFigure(f"{count} processes, steps a s", count * STEPS / min(walls), ""),
        BenchmarkFigure("step", 1e3 * step_s / STEPS, "ms"),
        BenchmarkFigure("the same period of `simulate`", 1e3 * run_s / STEPS, "ms"),
        BenchmarkFigure("the same period of the plant alone", 1e3 * plant_s / STEPS, "ms"),
        BenchmarkFigure("rate beside `simulate`", run_s / step_s, "", Limit(LEAST_RATIO, True)),
        BenchmarkFigure("rate beside the plant alone", plant_s / step_s, ""),
        BenchmarkFigure("reset", 1e3 * reset_s, "ms"),
    ]
