"""Processor time from the start of a process: help, import, end of the first control period.

Each is the least of several processes, with compiled kernels on disk. On an idle machine it is the
wall time: a start uses one thread and waits for nothing.
"""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from typing import Final

import numpy as np

from ...testbed.simulation.setup import SimulationSetup, Stage, TickContext
from .figure import BenchmarkFigure, Limit

REPEATS = 5

LARGEST_HELP_S: Final = 0.3
LARGEST_FIRST_STEP_S: Final = 2.0

_COMMAND: Final = ("-m", "proving_ground.experiments.commands.cli")
_STAGE: Final = f"stages=[{{make='{__name__}:first_tick_printer', after='advance'}}]"


def first_tick_printer(generator: np.random.Generator) -> Stage:
    """Return a stage that prints the processor time of the process and ends it."""

    def stage(setup: SimulationSetup, tick: TickContext) -> None:
        print(time.process_time(), flush=True)
        os.kill(os.getpid(), signal.SIGKILL)  # without the time of an orderly end

    return stage


def _process(*arguments: str) -> float:
    """Return the least processor time of several Python processes [s]."""

    def spent() -> float:
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    times = [spent()]
    for _ in range(REPEATS):
        subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
        times.append(spent())
    return min(after - before for before, after in pairwise(times))


def _first_tick() -> float:
    """Return the processor time of `ttempc run` to the end of its first control period [s]."""
    with tempfile.TemporaryDirectory() as folder:
        run = ("run", "grass", "--trust", "--out", f"{folder}/run", "--set", _STAGE)
        command = [sys.executable, *_COMMAND, *run]
        done = subprocess.run(command, check=False, capture_output=True, text=True)
    return float(done.stdout.split()[0])


def figures() -> list[BenchmarkFigure]:
    """Return the processor times of all starts."""
    # The first of them may compile kernels.
    first = min(_first_tick() for _ in range(1 + REPEATS))
    helped = _process(*_COMMAND, "--help")
    imported = _process("-c", "from ttempc import Guidance")
    limit = Limit(LARGEST_FIRST_STEP_S)
    return [
        BenchmarkFigure("`ttempc --help`", helped, "s", Limit(LARGEST_HELP_S)),
        BenchmarkFigure("`from ttempc import Guidance`", imported, "s"),
        BenchmarkFigure("`ttempc run`, end of the first control period", first, "s", limit),
    ]
