"""Cost of two laps of `grass` relative to a bare `mj_step` of the same vehicle.

The bare step is the one of `physics_loop`: without contacts and wheel forces, called from Python.
Runs without and with a log alternate with blocks of bare steps. Processor time counts, the fastest
of the repeats for every stage, so that other processes matter little. The time of the log includes
opening and closing; compilation and assembly are left out of all.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ...testbed.recording.record import Recorder, Tee
from ...testbed.simulation.loop import (
    advance,
    control,
    estimate,
    prepare,
    sense,
    terminate,
)
from ...testbed.simulation.setup import SimulationSetup, Stage, TickContext
from ...testbed.vehicle.vehicle import PlantVehicle
from ..run.assembly import assemble
from ..run.simulate import describe, drive_into, open_log
from ..scenario.scenario import load
from . import physics_loop
from .figure import BenchmarkFigure, Limit

SCENARIO: Final = "grass"
OVERRIDES: tuple[str, ...] = ()
REPEATS = 3
SEED: Final = 1

LARGEST_WITHOUT_LOG: Final = 1.75  # times a bare `mj_step`
LARGEST_WITH_LOG: Final = 2.2
LARGEST_ESTIMATOR_MS: Final = 0.12  # a tick
LARGEST_LOG_MB: Final = 30.0

_STAGES: Final[dict[str, Stage]] = {
    "sensors": sense,
    "estimator": estimate,
    "control step": control,
    "physics": advance,
    "termination": terminate,
}


@dataclass(frozen=True, slots=True)
class Drive:
    """Processor time of one run."""

    vehicle: PlantVehicle
    stages_s: dict[Stage, FloatArray]  # of every tick, (ticks,)
    steps: int  # of physics in a tick
    timestep_s: float
    log_s: float  # to open and to close the log
    log_mb: float

    @property
    def step_s(self) -> float:
        """Return the time of the run for each step of physics."""
        ticks = len(next(iter(self.stages_s.values())))
        spent = sum(float(times.sum()) for times in self.stages_s.values())
        return (self.log_s + spent) / (ticks * self.steps)


class _StageClock:
    """Stages that measure their processor time, that of every thread included."""

    def __init__(self, stages: Sequence[Stage]) -> None:
        self.times: dict[Stage, list[int]] = {stage: [] for stage in stages}
        self.stages = tuple(map(self._timed, stages))

    def _timed(self, stage: Stage) -> Stage:
        times = self.times[stage]

        def timed(setup: SimulationSetup, tick: TickContext) -> None:
            begin = time.process_time_ns()
            stage(setup, tick)
            times.append(time.process_time_ns() - begin)

        return timed

    def seconds(self) -> dict[Stage, FloatArray]:
        """Return the times of every tick without the reading of the clock."""
        readings = [time.process_time_ns() for _ in range(20_001)]
        reading = (readings[-1] - readings[0]) / (len(readings) - 1)
        return {stage: 1e-9 * (np.array(times) - reading) for stage, times in self.times.items()}


def _drive(logged: bool) -> Drive:
    name, scenario = load(SCENARIO, list(OVERRIDES))
    assembly = assemble(scenario, SEED)
    clock = _StageClock([stage for stage in assembly.stages if stage is not prepare])
    timed = replace(assembly, stages=clock.stages)
    recorder = Recorder()
    begin = time.process_time_ns()
    log_ns, log_mb = 0, 0.0
    if logged:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "log.mcap"
            metadata = describe(name, scenario, SEED, assembly)
            with open_log(file, scenario, assembly, assembly.plant.scenery, metadata) as log:
                log_ns = time.process_time_ns() - begin
                drive_into(Tee(recorder, log), timed, prepared=False)
                begin = time.process_time_ns()
            log_ns += time.process_time_ns() - begin
            log_mb = 1e-6 * file.stat().st_size
    else:
        drive_into(recorder, timed, prepared=False)
    plant = assembly.plant
    steps = round(assembly.guidance.period_s / plant.timestep_s)
    return Drive(plant.vehicle, clock.seconds(), steps, plant.timestep_s, 1e-9 * log_ns, log_mb)


def figures() -> list[BenchmarkFigure]:
    """Return ratios to the bare step, and the stages of the run without a log."""
    drives: dict[bool, list[Drive]] = {False: [], True: []}
    steps_s = []
    for _ in range(REPEATS):
        for logged, own in drives.items():
            own.append(_drive(logged))
        steps_s.append(physics_loop.measure(drives[False][0].vehicle)[:2])
    soil_s, bare_s = np.min(steps_s, axis=0).tolist()
    plain, with_log = (min(own, key=lambda drive: drive.step_s) for own in drives.values())

    def ratio(name: str, step_s: float, limit: float) -> BenchmarkFigure:
        return BenchmarkFigure(f"{name} / bare step", step_s / bare_s, "", Limit(limit))

    def stage_ms(stage: Stage) -> float:
        return 1e3 * float(np.median(np.min([d.stages_s[stage] for d in drives[False]], axis=0)))

    result = [
        BenchmarkFigure("bare `mj_step`", 1e6 * bare_s, "us"),
        ratio("physics on soil", soil_s, physics_loop.LARGEST_RATIO),
        ratio("loop without log", plain.step_s, LARGEST_WITHOUT_LOG),
        ratio("loop with log", with_log.step_s, LARGEST_WITH_LOG),
        BenchmarkFigure("loop without log, simulated s a s", plain.timestep_s / plain.step_s, ""),
        BenchmarkFigure("log", with_log.log_mb, "MB", Limit(LARGEST_LOG_MB)),
    ]
    for name, stage in _STAGES.items():
        limit = Limit(LARGEST_ESTIMATOR_MS) if stage is estimate else None
        result.append(BenchmarkFigure(f"- {name}, a tick", stage_ms(stage), "ms", limit))
    return result
