"""False alarms: hours of drives without a fault, on every shipped field."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable
from typing import Final

import pandas as pd

from ttempc.detectors.interface import Reaction

from ....testbed.recording.channels import STATE
from ....testbed.recording.record import Record
from ...results.statistics import rate
from ...scenario.scenario import shipped
from ...studies.sweep.row import Row
from ...studies.sweep.study import Study
from ...studies.sweep.work import SweepJob
from ...studies.trials.definition import trial, trial_files
from ..alarms import Begun, drive_and_list
from ..fault_draws import SENSORS, nested
from ..markdown import Cell, grouped, label, numbers
from ..table import Table, study

SEED: Final = 4001
"""First seed of the published drives."""

_DRIVES: Final = 11  # of each field: 2 h of all fields together
_SLIPS: Final = 0.2  # true slip with which an alarm of spinning wheels is none; two thirds of the
# allowance of `wheels` at 1 m/s
_SPAN_S: Final = 2.0  # before an alarm: a second of the residual, and the sum
_KINDS: Final = {
    "reported": "reported only",
    "unused": "sensor left out",
    "slowed": "slowed down",
    "stopped": "stopped",
    "slipping": "acted on, true slip",
}
_FALSE: Final = ("reported", "unused", "slowed", "stopped")
_SETS: Final = {"as shipped": 1.0, "IMU": 0.2, "neither": 0.2}  # sensors: share of the drives


def fields() -> dict[str, str]:
    """Return the shipped scenarios and the field trials without a fault, by their labels."""
    trials = {f"trial {name}": str(file) for name, file in trial_files().items()}
    return {
        **{name: name for name in shipped()},
        **{label: file for label, file in trials.items() if not trial(label[6:]).faults},
    }


def drive_healthy(job: SweepJob) -> Row:
    """Drive a run and return the hours driven, and the alarms that began, by kind and detector."""
    ended, record, begun = drive_and_list(job)
    counts = {name: Counter[str]() for name in _KINDS}
    for one in begun:
        counts[_kind(one, record)][one.cause] += 1
    texts = {kind: json.dumps(of_kind) for kind, of_kind in counts.items()}
    row = job.row(ended.status, ended.failure, {"hours": ended.duration_s / 3600.0}, None)
    return {**row, **texts}


def _kind(one: Begun, record: Record) -> str:
    """Return the kind of an alarm that began, one of `_KINDS`."""
    if one.cause in ("wheels", "motion"):
        state = record[STATE]
        span = (state.time_s > one.time_s - _SPAN_S) & (state.time_s <= one.time_s)
        if 1.0 - state["v_mps"][span].mean() / state["v_rim_mps"][span].mean() > _SLIPS:
            return "slipping"
    if one.reaction >= Reaction.STOP_ON_PATH:
        return "stopped"
    if one.reaction is Reaction.SLOW:
        return "slowed"
    return "unused" if one.acts else "reported"


def healthy_studies(seed: int) -> dict[str, Study]:
    """Return the drives of each field and set of sensors; no two share a seed."""
    made: dict[str, Study] = {}
    for sensors, part in _SETS.items():
        for name, scenario in fields().items():
            count = round(part * _DRIVES)
            own = study(scenario, range(seed, seed + count))
            if sensors in SENSORS:
                own = Study(scenario=scenario, seeds=own.seeds, set=nested(SENSORS[sensors]))
            made[f"{name}, {sensors}"] = own
            seed += count
    return made


def alarm_table(runs: pd.DataFrame) -> str:
    """Return the alarms of every field with its own sensors, and the rates by sensors."""
    parts = runs["study"].str.rsplit(", ", n=1, expand=True)
    runs = runs.assign(field=parts[0], sensors=parts[1])
    own = runs[runs["sensors"] == "as shipped"]
    cells: dict[str, Cell] = {"field": label("field"), "hours": _hours}
    cells |= {head: _causes(kind) for kind, head in _KINDS.items()}
    by_sensors: dict[str, Cell] = {"sensors": label("sensors"), "hours": _hours}
    by_sensors |= {f"{_KINDS[kind]}, an hour": _an_hour(kind) for kind in _FALSE}
    by_sensors |= {_KINDS[kind]: _causes(kind) for kind in ("slowed", "stopped")}
    return "\n\n".join([grouped(own, ["field"], cells), grouped(runs, ["sensors"], by_sensors)])


def _hours(own: pd.DataFrame) -> str:
    return f"{numbers(own, 'hours').sum():.2f}"


def _causes(kind: str) -> Cell:
    def cell(own: pd.DataFrame) -> str:
        return ", ".join(f"{name}: {n}" for name, n in sorted(_total(own[kind]).items())) or "-"

    return cell


def _an_hour(kind: str) -> Cell:
    def cell(own: pd.DataFrame) -> str:
        found = rate(_total(own[kind]).total(), float(numbers(own, "hours").sum()))
        low, high = found.ends
        return f"{found.value:.2f} ({low:.2f} to {high:.2f})"

    return cell


def _total(texts: Iterable[str]) -> Counter[str]:
    """Return the sum of the counts by detector of several rows."""
    return sum((Counter(json.loads(text)) for text in texts), Counter[str]())


def drawn_table(seed: int) -> Table:
    """Return the table of drives whose seeds begin with one."""
    return Table(
        name="false-alarms",
        studies=healthy_studies(seed),
        work=drive_healthy,
        text=alarm_table,
        checks=tuple((name, "ttempc") for name in shipped()),
        seed=seed,
        anew=drawn_table,
    )


TABLES: Final = (drawn_table(SEED),)
