"""False alarms of the detectors: drives without faults on every shipped scenario and field trial.

    python -m experiments.studies.faults.false_alarms [DRIVES]          (a field; default: 8)

Drives each field with `ttempc` on reported seeds, which calibration does not use; no two drives
share a seed, so that all of them are independent. An alarm is counted where it begins; one of
`Reaction.GO_ON` that rules out no sensor only reports. One of spinning wheels is no false alarm
where they truly slip. Prints a table for docs/faults.md.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from ttempc.guidance.detection import Alarm, Reaction

from ....testbed.recording.channels import STATE
from ....testbed.recording.record import Record, Recorder
from ...results.statistics import rate
from ...run.assembly import assemble
from ...run.simulate import drive_into
from ...scenario.scenario import Scenario, load, shipped
from ...seeds import report_seeds
from ...trials.definition import trial, trial_files
from ..batch import run_tasks

DRIVES: Final = 8
_OF_SLIP: Final = ("wheels", "motion")
_SLIPS: Final = 0.2  # two thirds of the allowance of `wheels` at 1 m/s
_SPAN_S: Final = 2.0  # before an alarm: a second of the residual, and the sum


@dataclass(frozen=True, slots=True)
class Drive:
    """A drive without faults."""

    field: str  # a key of `fields()`
    seed: int


@dataclass(frozen=True, slots=True)
class Alarms:
    """Alarms that began in a drive, by detector."""

    hours: float  # simulated
    reported: dict[str, int]  # the vehicle went on
    acted: dict[str, int]  # it slowed down, stopped, or did without a sensor
    slipping: dict[str, int]  # the same, while the driven wheels truly slipped


def fields() -> tuple[str, ...]:
    """Return the shipped scenarios and the field trials that have no fault."""
    trials = (name for name in trial_files() if not trial(name).faults)
    return (*shipped(), *(f"trial {name}" for name in trials))


def field_scenario(field: str) -> Scenario:
    """Return the scenario of a field."""
    kind, _, name = field.partition(" ")
    return trial(name) if kind == "trial" else load(field)[1]


def count_alarms(drive: Drive) -> Alarms:
    """Drive without faults and return the alarms that began."""
    assembly = assemble(field_scenario(drive.field), drive.seed)
    guidance, period_s = assembly.guidance, assembly.guidance.period_s
    begun: list[tuple[float, Alarm]] = []
    standing: set[str] = set()

    def observe(k: int) -> None:
        nonlocal standing
        begun.extend(
            (k * period_s, item) for item in guidance.alarms if item.detector not in standing
        )
        standing = {item.detector for item in guidance.alarms}

    recorder = Recorder()
    outcome = drive_into(recorder, assembly, on_tick=observe, prepared=False)
    record = recorder.record()
    counts = Counter[str](), Counter[str](), Counter[str]()
    for time_s, alarm in begun:
        place = int(alarm.reaction is not Reaction.GO_ON or bool(alarm.unused))
        if alarm.detector in _OF_SLIP and _slip(record, time_s) > _SLIPS:
            place = 2
        counts[place][alarm.detector] += 1
    return Alarms(outcome.duration_s / 3600.0, *map(dict, counts))


def _slip(record: Record, time_s: float) -> float:
    """Return the true slip of the driven wheels over the time that the detectors see."""
    state = record[STATE]
    span = (state.time_s > time_s - _SPAN_S) & (state.time_s <= time_s)
    return 1.0 - float(state["v_mps"][span].mean() / state["v_rim_mps"][span].mean())


def main(seeds: Sequence[int]) -> None:
    """Drive all fields, each on its part of the seeds, and print alarms and their rate."""
    names = fields()
    drives = len(seeds) // len(names)
    tasks = [
        Drive(name, seeds[n * drives + k]) for n, name in enumerate(names) for k in range(drives)
    ]
    results = list(run_tasks(count_alarms, tasks, "drives"))
    print("| field | hours | reported only | acted on | acted on, true slip |")
    print("|---|---|---|---|---|")
    for n, name in enumerate(names):
        rows = results[n * drives : (n + 1) * drives]
        kinds = zip(*((row.reported, row.acted, row.slipping) for row in rows), strict=True)
        cells = " | ".join(map(_text, kinds))
        print(f"| {name} | {sum(row.hours for row in rows):.2f} | {cells} |")
    hours = sum(row.hours for row in results)
    reported = sum(sum(row.reported.values()) for row in results)
    acted = sum(sum(row.acted.values()) for row in results)
    both = reported + acted
    for what, count in (("reported only", reported), ("acted on", acted), ("of both kinds", both)):
        of_ten = rate(count, hours / 10.0)
        low, high = of_ten.ends
        print(
            f"\nFalse alarms {what}: {count} in {hours:.1f} h, "
            f"{of_ten.value:.2f} ({low:.2f} to {high:.2f}) in ten hours."
        )


def _text(counts: Sequence[dict[str, int]]) -> str:
    total = sum((Counter(item) for item in counts), Counter[str]())
    return ", ".join(f"{name}: {count}" for name, count in sorted(total.items())) or "-"


if __name__ == "__main__":
    count = int((sys.argv[1:] or [str(DRIVES)])[0])
    main(report_seeds(count * len(fields())))
