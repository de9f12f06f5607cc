"""Outcome of every fault: carried on, degraded, stopped or lost.

    python -m experiments.studies.faults.study [SEEDS [CONTROLLER ...]]
                                                   (default: 16 ttempc pid nmpc-rti)

Drives `grass` with each case of `experiments/studies/faults/cases.py`, until 40 s
after the end of the fault, or after its start if it lasts, and prints a table for each controller;
docs/faults.md has them. The first controller has all seeds, the others a quarter.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from ttempc.types import FloatArray

from ....testbed.recording.channels import CONTROL, STATE
from ....testbed.recording.record import REACTION, Record, Recorder
from ...results.statistics import proportion
from ...results.tracking_errors import tracking_errors
from ...run.assembly import assemble
from ...run.simulate import drive_into
from ...scenario.scenario import load
from ...seeds import report_seeds
from ..batch import run_tasks
from .cases import CASES, overrides

SCENARIO: Final = "grass"
CONTROLLERS: Final = ("ttempc", "pid", "nmpc-rti")
SEEDS: Final = report_seeds(16)
_AFTER_S: Final = 40.0  # of the reference, after the fault
_SHARE: Final = 4  # of the seeds, for rivals: one in four
_ROUNDING: Final = 1e-9  # of a limit
_STOPPED: Final = ": stopped"
_NUMBER: Final = re.compile(r"-?\d+(?:\.\d+)?")

Result = Literal["carried on", "degraded", "stopped", "lost", "invalid"]
RESULTS: Final[tuple[Result, ...]] = ("carried on", "degraded", "stopped", "lost", "invalid")


@dataclass(frozen=True, slots=True)
class Case:
    """A run with a fault."""

    name: str  # in `CASES`
    controller: str
    seed: int


@dataclass(frozen=True, slots=True)
class CaseResult:
    """Numbers of a run with a fault; NaN where there is none."""

    result: Result
    failure: str  # why it did not complete
    noticed_s: float  # from the start of the fault to the first reaction
    worst_m: float  # largest error of tractor or trailer from the start of the fault on
    stop_m: float  # way of the tractor from the decision to stop to its end
    faulty_commands: int  # commands that are not finite or beyond their limits


def drive_case(case: Case) -> CaseResult:
    """Drive a case and return its numbers."""
    changes = [*overrides(case.name), f'controller.name="{case.controller}"']
    scenario = load(SCENARIO, changes)[1]
    assembly = assemble(scenario, case.seed)
    (fault,) = scenario.faults
    start_s = fault.start_s or 0.0
    end_s = start_s + (getattr(fault, "duration_s", None) or 0.0) + _AFTER_S
    ticks = min(round(end_s / assembly.guidance.period_s), assembly.ticks)
    recorder = Recorder()
    outcome = drive_into(recorder, replace(assembly, ticks=ticks), prepared=False)
    record = recorder.record()
    reactions = [
        event
        for event in record.events
        if event.text.startswith(REACTION) and event.time_s >= start_s - 2.0
    ]
    stops = [event.time_s for event in reactions if event.text.endswith(_STOPPED)]
    result: Result = "degraded" if reactions else "carried on"
    if outcome.status != "completed":
        result = outcome.status
    errors = tracking_errors(record)
    since = errors.time_s >= start_s
    worst = max(float(point.euclidean_m[since].max()) for point in (errors.tractor, errors.trailer))
    return CaseResult(
        result=result,
        failure=outcome.failure or "",
        noticed_s=max(0.0, reactions[0].time_s - start_s) if reactions else math.nan,
        worst_m=worst,
        stop_m=_way(record, stops[-1]) if result == "stopped" and stops else math.nan,
        faulty_commands=faulty_commands(record),
    )


def _way(record: Record, since_s: float) -> float:
    """Return the way of the tractor from a time on [m]."""
    state = record[STATE]
    steps = np.diff(state.columns("x_t_m", "y_t_m")[state.time_s >= since_s], axis=0)
    return float(np.hypot(*steps.T).sum())


def faulty_commands(record: Record) -> int:
    """Return the number of commands that are not finite or beyond their limits."""
    table = record[CONTROL]
    within = np.ones(len(table), dtype=bool)
    for name in ("delta_t_rad", "delta_i_rad", "hp"):
        command = table[f"{name}_command"]
        within &= command >= table[f"{name}_min"] - _ROUNDING
        within &= command <= table[f"{name}_max"] + _ROUNDING
    return int((~within).sum())


def main(
    seeds: Sequence[int] = SEEDS,
    controllers: Sequence[str] = CONTROLLERS,
    cases: Sequence[str] = tuple(CASES),
) -> None:
    """Drive all cases and print a table for each controller."""
    drawn = {item: seeds if n == 0 else seeds[::_SHARE] for n, item in enumerate(controllers)}
    tasks = [
        Case(name, item, seed) for item in controllers for name in cases for seed in drawn[item]
    ]
    results = iter(run_tasks(drive_case, tasks, "faults"))
    heads = (*RESULTS[:4], "noticed after [s]", "worst error [m]", "way to the stop [m]")
    for controller in controllers:
        print(f"\n`{controller}`, {len(drawn[controller])} seeds:\n")
        print(f"| fault | {' | '.join(heads)} |\n{'|---' * (1 + len(heads))}|")
        rows = {name: [next(results) for _ in drawn[controller]] for name in cases}
        for name, row in rows.items():
            print(f"| {name} | {' | '.join(_cells(row))} |")
        every = [item for row in rows.values() for item in row]
        print(
            f"\n{sum(item.result == 'invalid' for item in every)} of {len(every)} runs invalid, "
            f"{sum(item.faulty_commands for item in every)} commands not finite or beyond a limit."
        )
        for name, row in rows.items():
            for failure in failures([item.failure for item in row if item.result == "lost"]):
                print(f"\nLost with {name}: {failure}.")


def failures(texts: Sequence[str]) -> list[str]:
    """Return texts that differ in their numbers alone as one, with the range of each number.

    Example:
        >>> failures(["5.1 m from its reference", "6.6 m from its reference", "off the field"])
        ['5.1 to 6.6 m from its reference', 'off the field']
    """
    alike: dict[tuple[str, ...], list[list[str]]] = {}
    for text in texts:
        alike.setdefault(tuple(_NUMBER.split(text)), []).append(_NUMBER.findall(text))
    joined = []
    for (text, *rest), numbers in sorted(alike.items()):
        for of_place, words in zip(zip(*numbers, strict=True), rest, strict=True):
            low, high = min(of_place, key=float), max(of_place, key=float)
            text += (low if low == high else f"{low} to {high}") + words
        joined.append(text)
    return joined


def _cells(row: Sequence[CaseResult]) -> list[str]:
    cells = []
    for result in RESULTS[:4]:
        share = proportion(sum(item.result == result for item in row), len(row))
        low, high = share.ends
        cells.append(f"{share.count} ({100 * low:.0f}..{100 * high:.0f} %)" if share.count else "-")
    return [
        *cells,
        _range([item.noticed_s for item in row], 1),
        _range([item.worst_m for item in row], 2),
        _range([item.stop_m for item in row], 2),
    ]


def _range(values: Sequence[float], digits: int) -> str:
    """Return median and largest of the finite values."""
    finite: FloatArray = np.array([value for value in values if math.isfinite(value)])
    if not len(finite):
        return "-"
    return f"{np.median(finite):.{digits}f}, at most {finite.max():.{digits}f}"


if __name__ == "__main__":
    count, *names = sys.argv[1:] or [str(len(SEEDS))]
    main(report_seeds(int(count)), tuple(names) or CONTROLLERS)
