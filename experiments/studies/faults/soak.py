"""Soak: random scenarios with random faults, loaded and driven; counts what must not happen.

    python -m experiments.studies.faults.soak [LOADS [DRIVES [SECONDS [FIRST]]]]
                                                        (default: 10000 1000 30 0)

Draws scenarios from the JSON schema (`experiments/studies/faults/random_scenario.py`). Those that
are loaded have values over the whole range of every key; those that are driven have values near the
defaults and one to three faults, and end after a time [s]. Scenario n of a study has the generator
of the number FIRST + n. 24 simulated hours: `... soak 0 2880 30`.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import resource
import sys
import time
import tomllib
import traceback
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Final

import numpy as np

from ttempc.errors import TtempcError

from ....testbed.errors import TestbedError
from ....testbed.recording.channels import CONTROL, STATE
from ....testbed.recording.record import Recorder
from ...errors import ExperimentError
from ...run.assembly import assemble
from ...run.simulate import drive_into
from ...scenario.scenario import Scenario, ScenarioFile, dump
from ..batch import run_tasks
from .random_scenario import RandomTables
from .study import faulty_commands

LOADS: Final = 10_000
DRIVES: Final = 1000
SECONDS: Final = 30.0
_BLOCK: Final = 250  # scenarios that a task loads
_SHARE_LOADED, _SHARE_DRIVEN = 0.15, 0.04  # of the keys that are drawn
_TRIES: Final = 200  # scenarios that a drive may draw until one can be driven
_REFUSALS: Final = (ExperimentError, TestbedError, TtempcError)


@dataclass(frozen=True, slots=True)
class LoadTask:
    """Scenarios to load, by their numbers."""

    begin: int
    end: int


@dataclass(frozen=True, slots=True)
class LoadResult:
    """What became of them."""

    loaded: int
    refused: int
    defects: tuple[str, ...]  # exceptions, long refusals, files that read back as something else


@dataclass(frozen=True, slots=True)
class DriveTask:
    """A scenario to drive, by its number."""

    number: int
    seconds: float


@dataclass(frozen=True, slots=True)
class DriveResult:
    """What became of it."""

    status: str  # of the run, or "error"
    refused: int  # scenarios drawn before that could not be driven
    defects: tuple[str, ...]  # exceptions, warnings, invalid runs, values that are not finite
    simulated_s: float
    wall_s: float
    process: int
    memory_mb: float  # of the process after the run
    descriptors: int  # open files of the process after the run


def load_block(task: LoadTask) -> LoadResult:
    """Load scenarios; one that loads must be the same after it was written down and read."""
    counts: Counter[str] = Counter()
    defects: list[str] = []
    for number in range(task.begin, task.end):
        tables = RandomTables(np.random.default_rng(number), _SHARE_LOADED, near=False)
        try:
            scenario = tables.scenario()
        except _REFUSALS as refusal:
            counts["refused"] += 1
            if "\n" in str(refusal).strip():
                defects.append(f"load {number}: refusal of several lines: {refusal}")
        except Exception:
            defects.append(f"load {number}: {_last_line()}")
        else:
            counts["loaded"] += 1
            file = ScenarioFile(Path("soak.toml"), tomllib.loads(dump(scenario)))
            if file.scenario() != scenario:
                defects.append(f"load {number}: reads back as another scenario")
    return LoadResult(counts["loaded"], counts["refused"], tuple(defects))


def drive_one(task: DriveTask) -> DriveResult:
    """Draw scenarios until one can be driven, and drive it."""
    begin = time.perf_counter()
    rng = np.random.default_rng((task.number, 1))
    status, refused, simulated_s = "error", 0, 0.0
    defects: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            for _ in range(_TRIES):
                tables = RandomTables(rng, _SHARE_DRIVEN, near=True)
                try:
                    scenario = tables.scenario()
                    faults = {"faults": tables.faults(task.seconds)}
                    content = tomllib.loads(dump(scenario)) | faults
                    scenario = ScenarioFile(Path("soak.toml"), content).scenario()
                    status, simulated_s, faults = _drive(scenario, task)
                    defects += faults
                    break
                except _REFUSALS:
                    refused += 1
        except Exception:
            defects.append(f"drive {task.number}: {_last_line()}")
    defects += [f"drive {task.number}: {item.category.__name__}: {item.message}" for item in caught]
    return DriveResult(
        status=status,
        refused=refused,
        defects=tuple(defects),
        simulated_s=simulated_s,
        wall_s=time.perf_counter() - begin,
        process=os.getpid(),
        memory_mb=_memory_mb(),
        descriptors=len(os.listdir("/proc/self/fd")),
    )


def _drive(scenario: Scenario, task: DriveTask) -> tuple[str, float, list[str]]:
    """Return status, simulated time [s] and defects of a run."""
    assembly = assemble(scenario, task.number)
    ticks = min(round(task.seconds / assembly.guidance.period_s), assembly.ticks)
    recorder = Recorder()
    outcome = drive_into(recorder, replace(assembly, ticks=ticks), prepared=False)
    record = recorder.record()
    defects: list[str] = []
    if outcome.status == "invalid":
        defects.append(f"invalid: {outcome.failure}")
    if not np.isfinite(record[STATE].values).all():
        defects.append("state not finite")
    if count := faulty_commands(record):
        defects.append(f"{count} commands not finite or beyond a limit")
    times_s = record[CONTROL].time_s
    simulated_s = float(times_s[-1]) if len(times_s) else 0.0
    return outcome.status, simulated_s, [f"drive {task.number}: {item}" for item in defects]


def _last_line() -> str:
    """Return type, message and place of the exception that is handled."""
    kind, error, _ = sys.exc_info()
    frames = traceback.extract_tb(error.__traceback__) if error else []
    place = f"{Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else ""
    return f"{kind.__name__ if kind else ''}: {error} ({place})"


def _memory_mb() -> float:
    """Return the resident memory of this process, without what it holds for later use."""
    gc.collect()
    with contextlib.suppress(OSError, AttributeError):  # another C library has no such function
        ctypes.CDLL("libc.so.6").malloc_trim(0)
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def _growth(results: Sequence[DriveResult], value: str) -> float:
    """Return the largest growth of a value in a process, from its second to its last quarter."""
    growth = [0.0]
    for process in {item.process for item in results}:
        values = [getattr(item, value) for item in results if item.process == process]
        quarter = len(values) // 4
        if quarter:
            growth.append(median(values[-quarter:]) - median(values[quarter : 2 * quarter]))
    return max(growth)


def main(
    loads: int = LOADS, drives: int = DRIVES, seconds: float = SECONDS, first: int = 0
) -> list[str]:
    """Load and drive scenarios, print the counts and every defect, and return the defects."""
    blocks = [
        LoadTask(begin, min(begin + _BLOCK, first + loads))
        for begin in range(first, first + loads, _BLOCK)
    ]
    loaded = list(run_tasks(load_block, blocks, "loads"))
    tasks = [DriveTask(number, seconds) for number in range(first, first + drives)]
    driven = list(run_tasks(drive_one, tasks, "drives"))
    statuses = Counter(item.status for item in driven)
    defects = [line for item in (*loaded, *driven) for line in item.defects]
    rows = {
        "scenarios drawn and loaded": sum(item.loaded for item in loaded),
        "scenarios drawn and refused with one line": sum(item.refused for item in loaded),
        "scenarios with faults drawn, but refused": sum(item.refused for item in driven),
        "driven": len(driven),
        **{f"driven: {status}": count for status, count in sorted(statuses.items())},
        "simulated hours": f"{sum(item.simulated_s for item in driven) / 3600.0:.2f}",
        "longest run on the clock [s]": f"{max((item.wall_s for item in driven), default=0.0):.0f}",
        "growth of memory in a process [MB]": f"{_growth(driven, 'memory_mb'):.0f}",
        "growth of open files in a process": f"{_growth(driven, 'descriptors'):.0f}",
        "exceptions, warnings, invalid runs, values not finite, commands beyond limits": len(
            defects
        ),
    }
    print("| | |\n|---|---|")
    for name, value in rows.items():
        print(f"| {name} | {value} |")
    for line in defects:
        print(f"\n{line}")
    return defects


if __name__ == "__main__":
    counts, (loads_, drives_, seconds_, first_) = sys.argv[1:], (LOADS, DRIVES, SECONDS, 0.0)
    given = [float(item) for item in counts] + [loads_, drives_, seconds_, first_][len(counts) :]
    main(int(given[0]), int(given[1]), given[2], int(given[3]))
