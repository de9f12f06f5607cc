"""Peak memory of a run of `grass` over its laps.

Every run has a process of its own. The figure of 40 laps is the line through two shorter runs.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

from .figure import BenchmarkFigure, Limit

FEW_LAPS = 2
MANY_LAPS = 8
LAPS: Final = 40

LARGEST_WITH_LOG_MB: Final = 600.0  # `ttempc run`, figures and report included
LARGEST_WITHOUT_LOG_MB: Final = 250.0  # `simulate`

_PEAK: Final = """
from ...experiments.benchmarks.memory import peak_mb
print(peak_mb())
"""
_WITHOUT: Final = """
from ... import load, simulate
simulate(*load("grass", ["path.laps={laps}"]), seed=1)
"""
_WITH: Final = """
from ...experiments.commands.cli import main
main(["run", "grass", "--json", "--set", "path.laps={laps}", "--out", "{folder}/run"])
"""


def peak_mb() -> float:
    """Return the peak memory of this process [MB].

    Where there is /proc, it is read there: `getrusage` of a child begins with the parent's peak.
    """
    status = Path("/proc/self/status")
    if status.exists():
        lines = status.read_text(encoding="utf-8").splitlines()
        return float(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def _peak_of(code: str, laps: int) -> float:
    """Return the peak memory of a process that drives this number of laps [MB]."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", code.format(laps=laps, folder=folder) + _PEAK]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
    return float(done.stdout.splitlines()[-1])


def figures() -> list[BenchmarkFigure]:
    """Return the peaks of short runs and of 40 laps, without and with log."""
    result = []
    for name, code, limit in (
        ("`simulate`", _WITHOUT, LARGEST_WITHOUT_LOG_MB),
        ("`ttempc run`", _WITH, LARGEST_WITH_LOG_MB),
    ):
        few, many = (_peak_of(code, laps) for laps in (FEW_LAPS, MANY_LAPS))
        lap = (many - few) / (MANY_LAPS - FEW_LAPS)
        at_end = few + (LAPS - FEW_LAPS) * lap
        result += [
            BenchmarkFigure(f"{name}, {FEW_LAPS} laps", few, "MB"),
            BenchmarkFigure(f"{name}, {LAPS} laps", at_end, "MB", Limit(limit)),
        ]
    return result
