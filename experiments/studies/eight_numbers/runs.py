"""Errors of runs, each driven once and kept in a file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np

from proving_ground.testbed.recording.provenance import code_digest
from ttempc.types import FloatArray

from ...errors import SweepRefused
from ...sweep.engine import Engine
from ..batch import StudyRun, mean_errors_cm, run_tasks, simulate_run

Errors: TypeAlias = list[float | None]  # four mean errors [cm]; None where there is none

_LOST: Errors = [None] * 4


class RunStore:
    """Mean errors of runs by scenario, seed and overrides.

    Args:
        file: of one JSON line a run; made where it does not exist.
        engine: drives the runs that the file does not have.

    Raises:
        SweepRefused: the file was written by another version of the code.
    """

    def __init__(self, file: Path, engine: Engine) -> None:
        self._file, self._engine = file, engine
        self._known: dict[str, Errors] = {}
        code = code_digest()
        if not file.exists():
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(json.dumps({"code": code}) + "\n", encoding="utf-8")
        text = file.read_text(encoding="utf-8")
        if not text.endswith("\n"):  # an interrupted study ends within a line
            file.write_text(f"{text}\n", encoding="utf-8")
        head, *lines = text.splitlines()
        if json.loads(head) != {"code": code}:
            raise SweepRefused(f"{file}: was written by another version of the code: remove it")
        for line in lines:
            try:
                entry = json.loads(line)
            except json.JSONDecodeError:  # where the study was interrupted
                continue
            self._known[entry["run"]] = entry["errors"]

    def errors_cm(self, runs: Sequence[StudyRun]) -> FloatArray:
        """Return the mean errors [cm] of runs, (n, 4), in the order of `COLUMNS`.

        NaN in a run that was lost, and where a path has no such part.
        """
        missing = list({_key(run): run for run in runs if _key(run) not in self._known}.values())
        results = run_tasks(_drive, missing, started=self._engine) if missing else iter(())
        with self._file.open("a", encoding="utf-8") as file:
            for run, errors in zip(missing, results, strict=True):
                self._known[_key(run)] = errors
                file.write(json.dumps({"run": _key(run), "errors": errors}) + "\n")
                file.flush()
        return np.array([self._known[_key(run)] for run in runs], dtype=float)


def _key(run: StudyRun) -> str:
    return " ".join((run.scenario, str(run.seed), *run.overrides))


def _drive(run: StudyRun) -> Errors:
    summary = simulate_run(run)
    if summary.status != "completed":
        return _LOST
    return [None if np.isnan(error) else round(error, 4) for error in mean_errors_cm(summary)]
