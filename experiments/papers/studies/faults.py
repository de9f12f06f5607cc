"""Faults: what becomes of runs, and false alarms."""

import json
import tomllib
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from scipy.spatial import KDTree

from ttempc.detectors.interface import Alarm, Reaction

from ....testbed.recording.channels import REFERENCE, STATE
from ....testbed.recording.record import REACTION, Record, Recorder
from ...results.statistics import proportion, rate
from ...results.summary import Summary
from ...results.tracking_errors import BODIES
from ...run.assembly import assemble
from ...run.simulate import drive_into
from ...scenario.scenario import shipped
from ...seeds import report_seeds
from ...studies.sweep.row import Row
from ...studies.sweep.study import Study, VariantAxis
from ...studies.sweep.work import SweepJob, run_job
from ...studies.trials.definition import trial, trial_files
from ..markdown import Cell, grouped, groups, label, numbers
from ..table import Table, listed, study, variants

START_S: Final = 25.0
"""Start of a fault [s]: the tractor enters the first circle of the figure eight."""

CASES: Final[dict[str, dict[str, Any]]] = tomllib.loads(
    Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
)
DRIVER: Final = "ttempc"
RIVALS: Final = ("pid", "nmpc-rti")
SEEDS: Final = report_seeds(8)
RESOLUTIONS_DEG: Final = (0.0, 0.01, 0.1, 0.25)
"""Resolutions of the angle sensors; the drives of their faults take turns."""

_OTHERS: Final = 6  # seeds of faults of no angle sensor
_OF_RIVALS: Final = 4  # seeds of a rival, which drives no faults of sensors: detectors are the same
_OF_SENSORS: Final = ("gnss", "antennas", "angle", "gyro", "encoder", "samples", "stamps")
_RESULTS: Final = ("carried on", "degraded", "stopped", "lost")
_STANDS: Final = 0.05  # [m/s]
_OFF_M: Final = 0.5  # from the path, at which a run that was not stopped counts as fooled


def changes(fault: str, start_s: float = START_S) -> tuple[str, ...]:
    """Return the changes of a scenario for a fault of `CASES`, from `start_s` [s] on by default."""
    table = {**CASES[fault], "start_s": CASES[fault].get("start_s", start_s)}
    more = [table.pop("set")] if "set" in table else []
    also = [{**table.pop("also"), "start_s": table["start_s"]}] if "also" in table else []
    keys = (", ".join(f"{key}={value!r}" for key, value in one.items()) for one in (table, *also))
    return (*more, f"faults=[{', '.join(f'{{{one}}}' for one in keys)}]")


def off_the_path(record: Record, start_s: float) -> float:
    """Return the largest distance of both axle points from their paths while they move [m]."""
    state = record[STATE]
    reference = record[REFERENCE]
    worst = 0.0
    rows = (state.time_s >= start_s) & (np.abs(state["v_mps"]) > _STANDS)
    for body in BODIES.values():
        path, places = (
            np.column_stack([table[f"x_{body}_m"], table[f"y_{body}_m"]])
            for table in (reference, state)
        )
        if rows.any():
            worst = max(worst, float(KDTree(path).query(places[rows])[0].max()))
    return worst


def outcome(job: SweepJob, summary: Summary, record: Record) -> dict[str, str | float]:
    """Return what became of a run with a fault.

    Returns:
        `result`, time from the start of the fault to the first reaction [s] (absent: none), and the
        largest distance from the path from its start on [m], see `off_the_path`.
    """
    start_s = job.scenario.faults[0].start_s or 0.0
    reactions = (item.time_s for item in record.events if item.text.startswith(REACTION))
    first_s = next((time_s for time_s in reactions if time_s >= start_s - 2.0), None)
    result: str = summary.status
    if summary.status == "completed":
        result = "carried on" if first_s is None else "degraded"
    row: dict[str, str | float] = {"result": result, "worst_m": off_the_path(record, start_s)}
    if first_s is not None:
        row["noticed_s"] = max(0.0, first_s - start_s)
    return row


def _variants(kinds: Iterable[str]) -> VariantAxis:
    return variants("fault", {fault: changes(fault) for fault in kinds})


def fault_studies() -> dict[str, Study]:
    """Return the studies: `ttempc` with all faults, rivals with faults of no sensor.

    The resolutions of the angle sensors take turns over the seeds of their faults.
    """
    kinds = {fault: table["kind"] for fault, table in CASES.items()}
    angles = [fault for fault, kind in kinds.items() if kind.startswith("angle")]
    sensors = [fault for fault, kind in kinds.items() if kind.startswith(_OF_SENSORS)]
    sensors = [fault for fault in sensors if fault not in angles]
    others = [fault for fault in CASES if fault not in (*angles, *sensors)]

    studies = {}
    for k, resolution in enumerate(RESOLUTIONS_DEG):
        own = (f"sensors.angle_resolution_deg={resolution}",)
        seeds = SEEDS[k :: len(RESOLUTIONS_DEG)]
        studies[f"angles {resolution}"] = study("grass", seeds, own, _variants(angles))
    studies["sensors"] = study("grass", SEEDS[:_OTHERS], (), _variants(sensors))
    studies["others"] = study("grass", SEEDS[:_OTHERS], (), _variants(others))
    rivals = listed("controller", *RIVALS)
    studies["rivals"] = study("grass", SEEDS[:_OF_RIVALS], (), _variants(others), rivals)
    return studies


def fault_tables(runs: pd.DataFrame) -> str:
    """Return a table of outcomes for each controller, its faults in the order of the file."""
    order = {fault: number for number, fault in enumerate(CASES)}
    runs = runs.assign(order=runs["fault"].map(order)).sort_values("order", kind="stable")
    runs = pd.concat([runs[runs["controller"] == name] for name in (DRIVER, *RIVALS)])
    parts = []
    for own in groups(runs, ["controller"]):
        cells = {"fault": label("fault"), **{name: _share(name) for name in _RESULTS}}
        cells["noticed after [s]"] = _spread("noticed_s", 1)
        cells["off the path [m]"] = _spread("worst_m", 2)
        fooled = own[(own["result"] != "stopped") & (own["worst_m"] > _OFF_M)]
        names = ", ".join(f"{name}: {n}" for name, n in Counter(fooled["fault"]).items()) or "none"
        parts += [
            f"`{own['controller'].iloc[0]}`, {len(own)} drives:",
            grouped(own, ["fault"], cells),
            f"Completed or lost, and more than {_OFF_M} m off the path: {names}.",
        ]
    return "\n\n".join(parts)


def _share(result: str) -> Cell:
    def cell(runs: pd.DataFrame) -> str:
        share = proportion(list(runs["result"]).count(result), len(runs))
        low, high = share.ends
        return f"{share.count} ({100 * low:.0f}..{100 * high:.0f} %)" if share.count else "-"

    return cell


def _spread(column: str, digits: int) -> Cell:
    def cell(runs: pd.DataFrame) -> str:
        known = runs[column].dropna()
        form = f"{{:.{digits}f}}, at most {{:.{digits}f}}"
        return form.format(known.median(), known.max()) if len(known) else "-"

    return cell


_DRIVES: Final = 13  # of each field, for the false alarms: more than 20 h
_SLIPS: Final = 0.2  # true slip with which an alarm of spinning wheels is none; two thirds of the
# allowance of `wheels` at 1 m/s
_SPAN_S: Final = 2.0  # before an alarm: a second of the residual, and the sum


def fields() -> dict[str, str]:
    """Return the shipped scenarios and the field trials without a fault, by their labels."""
    trials = {f"trial {name}": str(file) for name, file in trial_files().items()}
    return {
        **{name: name for name in shipped()},
        **{label: file for label, file in trials.items() if not trial(label[6:]).faults},
    }


def alarms(job: SweepJob) -> Row:
    """Drive a run and return the hours driven, and the alarms that began, by kind and detector.

    `reported`: the vehicle went on; `acted`: it slowed down, stopped or did without a sensor;
    `slipping`: an alarm of slip while the wheels truly slipped; `checked`: a stop to look at GNSS.
    """
    assembly = assemble(job.scenario, job.seed)
    recorder = Recorder()
    guidance = assembly.guidance
    period_s = guidance.period_s
    begun: list[tuple[float, Alarm]] = []
    standing: set[str] = set()

    def observe(k: int) -> None:
        nonlocal standing
        begun.extend((k * period_s, one) for one in guidance.alarms if one.detector not in standing)
        standing = {one.detector for one in guidance.alarms}

    ended = drive_into(recorder, assembly, on_tick=observe, prepared=False)
    record = recorder.record()
    counts = {name: Counter[str]() for name in _KINDS}
    for time_s, alarm in begun:
        counts[_kind(alarm, time_s, record)][alarm.detector] += 1
    counts["acted"].update(
        one.detector for one in guidance.alarms if "GNSS drifts by" in one.reason
    )
    texts = {kind: json.dumps(of_kind) for kind, of_kind in counts.items()}
    row = job.row(ended.status, ended.failure, {"hours": ended.duration_s / 3600.0}, None)
    return {**row, **texts}


def _kind(alarm: Alarm, time_s: float, record: Record) -> str:
    """Return the kind of an alarm that began at a time, one of `_KINDS`."""
    if alarm.detector in ("wheels", "motion"):
        state = record[STATE]
        span = (state.time_s > time_s - _SPAN_S) & (state.time_s <= time_s)
        if 1.0 - state["v_mps"][span].mean() / state["v_rim_mps"][span].mean() > _SLIPS:
            return "slipping"
    if alarm.detector == "drift":
        return "checked"
    acted = alarm.reaction is not Reaction.WARN or bool(alarm.unused)
    return "acted" if acted else "reported"


_KINDS: Final = {
    "reported": "reported only",
    "acted": "acted on",
    "slipping": "acted on, true slip",
    "checked": "stops for a check",
}


def alarm_studies(seeds: Sequence[int]) -> dict[str, Study]:
    """Return the drives of each field; no two share a seed, so that all of them are independent."""
    drives = len(seeds) // len(fields())
    return {
        label: study(scenario, seeds[n * drives : (n + 1) * drives])
        for n, (label, scenario) in enumerate(fields().items())
    }


def alarm_table(runs: pd.DataFrame) -> str:
    """Return the alarms of every field, and the rates of false ones in ten hours."""
    cells = {"field": label("study"), "hours": lambda own: f"{own['hours'].sum():.2f}"}
    for kind, head in _KINDS.items():
        cells[head] = lambda own, kind=kind: (
            ", ".join(f"{name}: {n}" for name, n in sorted(_total(own[kind]).items())) or "-"
        )
    lines = [grouped(runs, ["study"], cells)]
    hours = float(numbers(runs, "hours").sum())
    counts = {head: _total(runs[kind]).total() for kind, head in [*_KINDS.items()][:2]}
    for what, count in {**counts, "of both kinds": sum(counts.values())}.items():
        found = rate(count, hours / 10.0)
        low, high = found.ends
        lines.append(
            f"False alarms {what}: {count} in {hours:.1f} h, "
            f"{found.value:.2f} ({low:.2f} to {high:.2f}) in ten hours."
        )
    return "\n\n".join(lines)


def _total(texts: Iterable[str]) -> Counter[str]:
    """Return the sum of the counts by detector of several rows."""
    return sum((Counter(json.loads(text)) for text in texts), Counter[str]())


_STUCK: Final = changes("front steering stuck", 5.0)  # within the time of a regression check
_ALARM_SEEDS: Final = report_seeds(_DRIVES * len(fields()))

TABLES: Final = (
    Table(
        name="faults",
        studies=fault_studies(),
        work=partial(run_job, measure=outcome),
        text=fault_tables,
        checks=tuple(("grass", name, *own) for name in (DRIVER, *RIVALS) for own in ((), _STUCK)),
    ),
    Table(
        name="false-alarms",
        studies=alarm_studies(_ALARM_SEEDS),
        work=alarms,
        text=alarm_table,
        checks=tuple((name, "ttempc") for name in shipped()),
    ),
)
