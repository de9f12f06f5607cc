"""Frozen scenarios of the benchmark, their identifier, and the regression check of their plant."""

import functools
import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from ttempc.reference.reference import ReferenceSample
from ttempc.types import Command, State

from ....testbed.configuration.resources import resource
from ....testbed.foreign_files import json_table, read_bounded
from ....testbed.recording.channels import CORRIDOR, MEASUREMENT, STATE, TOOL
from ....testbed.recording.provenance import code_digest
from ....testbed.recording.record import Recorder
from ....testbed.simulation import loop
from ....testbed.simulation.setup import TickContext
from ...run.assembly import assemble
from ...scenario.path import Headland
from ...scenario.scenario import Scenario, read_scenario
from ..oracle.drives import Part

VERSION: Final = "v3"
"""Version of the benchmark; other scenarios, seeds or scores are another version."""

# Simulated time of a check: forward it covers a straight, half a circle and the first faults; in
# reverse, where the law does not hold the trailer, rounding errors must not grow.
_FORWARD_S: Final = 40.0
_REVERSE_S: Final = 10.0
_TOLERANCE: Final = 1e-6  # between processors; a change of a constant changes more
_SEED: Final = 1
_NOT_COUNTED: Final = ("description", "plant")
_NOT_DRIVEN: Final = tuple(
    getattr(loop, name)
    for name in ("prepare", "estimate", "control", "log_control", "log_timing", "terminate")
)


def trial_files() -> dict[str, Path]:
    """Return the scenario files of the benchmark by name."""
    return {file.stem: file for file in sorted(folder().glob("*.toml"))}


def trial(name: str) -> Scenario:
    """Return a scenario of the benchmark, with the default controller."""
    return read_scenario(str(trial_files()[name])).scenario()


def frozen_checks() -> dict[str, tuple[float, ...]]:
    """Return the frozen results of `plant_check` by scenario."""
    content = json_table(read_bounded(folder() / "plant.json"))
    return {name: tuple(values) for name, values in content.items()}


def is_scored(name: str) -> bool:
    """Return whether a trial counts in the score; of the others counts what comes home."""
    return not trial(name).faults


def scored_part(scenario: Scenario) -> Part:
    """Return the part of a run that is scored.

    On a headland these are the passes and the last 5 m of the turns before them: inside a turn the
    tool is up, and the errors of tractor and trailer are a trade of one against the other.
    """
    return "passes" if isinstance(scenario.path, Headland) else "all"


@functools.cache
def oracle_errors() -> dict[str, dict[str, float]]:
    """Return the oracle's p95 of the working point [m] by trial and public seed.

    They are made by the study `oracle` of `experiments.papers`. A trial without an entry has no
    score.
    """
    return json_table(read_bounded(folder() / "oracle.json"))


def oracle_error(name: str) -> float | None:
    """Return the oracle's mean error over the seeds of a trial [m], None where there is none.

    It is one number for all seeds, hidden ones included: it gives a score its unit, and the ratio
    of two scores does not depend on it.
    """
    by_seed = oracle_errors().get(name)
    if not by_seed:
        return None
    return math.fsum(by_seed.values()) / len(by_seed)


def identifier_of(
    contents: Mapping[str, Mapping[str, Any]], checks: Mapping[str, tuple[float, ...]]
) -> str:
    """Return version and hash of scenario files, results of their checks, and oracle errors.

    Descriptions do not count. Defaults, vehicle and plant count by the results of the checks: a new
    key that is off by default changes neither, nor does one that keeps a default of the version.
    """
    trials = {
        name: {key: value for key, value in content.items() if key not in _NOT_COUNTED}
        for name, content in contents.items()
    }
    text = json.dumps([trials, {**checks}, oracle_errors()], sort_keys=True)
    return f"{VERSION}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def identifier(differing: tuple[str, ...] = ()) -> str:
    """Return the identifier of scores.

    Args:
        differing: scenarios on which the plant of this code differs from the frozen one. The
            identifier then has the digest of the code, so that runs compare within one code only.
    """
    contents = {name: read_scenario(str(file)).content for name, file in trial_files().items()}
    frozen = identifier_of(contents, frozen_checks())
    return f"{frozen}+{code_digest()}" if differing else frozen


def plant_check(name: str) -> tuple[float, ...]:
    """Drive a scenario by a fixed law and return means and last values of its channels.

    The commands follow from the true state, so that neither estimator nor controllers matter.
    Channels: reference of the whole path, true state, samples of the sensors, tool and corridor;
    numbers that do not exist are left out.
    """
    changes = {"controller": {"name": "feedforward"}}
    assembly = assemble(read_scenario(str(trial_files()[name])).scenario(changes), _SEED)
    period_s = assembly.guidance.period_s
    recorder = Recorder()
    setup = assembly.setup(recorder)
    tick = TickContext(setup)
    grid = assembly.reference.on_grid(period_s)
    stages = [stage for stage in assembly.stages if stage not in _NOT_DRIVEN]
    duration_s = _REVERSE_S if assembly.vehicle.reverse else _FORWARD_S
    for k in range(min(round(duration_s / period_s), assembly.ticks)):
        tick.k = tick.reference_tick = k
        tick.command = fixed_law(grid, k, tick)
        for stage in stages:
            stage(setup, tick)
    record = recorder.record()
    channels = (
        record[channel].columns(*channel.fields) for channel in (STATE, MEASUREMENT, TOOL, CORRIDOR)
    )
    values: list[float] = []
    for table in (grid.state, grid.trailer_xy, grid.inputs, *channels):
        for column in table.T:
            numbers = column[np.isfinite(column)]
            values += [float(numbers.mean()), float(numbers[-1])] if len(numbers) else []
    return tuple(values)


def fixed_law(grid: ReferenceSample, k: int, tick: TickContext) -> Command:
    """Return the inputs of the reference and, forward, a turn back to it by the true state.

    A law of its own: a change of a controller must not change the checks.
    """
    truth = tick.now
    state = grid.state[k]
    delta_t, delta_i, hp = grid.inputs[k].tolist()
    if state[State.V] > 0.0:
        yaw = float(state[State.PSI_T])
        x = truth.tractor.x - state[State.X]
        y = truth.tractor.y - state[State.Y]
        left = y * math.cos(yaw) - x * math.sin(yaw)
        ahead = x * math.cos(yaw) + y * math.sin(yaw)
        delta_t += math.remainder(yaw - truth.tractor.yaw, math.tau) - math.atan(0.5 * left)
        hp -= 0.3 * ahead
    return Command(max(-0.5, min(0.5, delta_t)), delta_i, max(-1.0, min(1.0, hp)))


def differing(
    results: Mapping[str, tuple[float, ...]], frozen: Mapping[str, tuple[float, ...]]
) -> tuple[str, ...]:
    """Return the scenarios whose checks differ by more than rounding of another processor."""

    def same(name: str) -> bool:
        one = results.get(name, ())
        other = frozen.get(name, ())
        return len(one) == len(other) and np.allclose(one, other, rtol=_TOLERANCE, atol=_TOLERANCE)

    return tuple(name for name in sorted({*results, *frozen}) if not same(name))


def folder() -> Path:
    """Return the folder of the scenarios, frozen checks and oracle errors."""
    return resource("proving_ground.experiments.studies.trials", VERSION)
