"""Faults: what becomes of runs, and false alarms."""

import math
import tomllib
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from scipy.spatial import KDTree

from ttempc.detectors.interface import Alarm, Reaction

from ....testbed.recording.channels import REFERENCE, STATE
from ....testbed.recording.record import REACTION, Record, Recorder
from ...results.statistics import proportion, rate
from ...results.tracking_errors import BODIES
from ...run.assembly import assemble
from ...run.simulate import drive_into
from ...scenario.scenario import load, shipped
from ...seeds import report_seeds
from ...studies.trials.definition import trial, trial_files
from ..study import Case, Row, Study
from ..tables import Cell, grouped, groups, label, numbers

START_S: Final = 25.0
"""Start of a fault [s]: the tractor enters the first circle of the figure eight."""

CASES: Final[dict[str, dict[str, Any]]] = tomllib.loads(
    Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
)
CONTROLLERS: Final = ("ttempc", "pid", "nmpc-rti")
SEEDS: Final = report_seeds(8)
RESOLUTIONS_DEG: Final = (0.0, 0.01, 0.1, 0.25)
"""Resolutions of the angle sensors; the drives of their faults take turns."""

_OTHERS: Final = 6  # seeds of faults of no angle sensor
_RIVALS: Final = 4  # seeds of a rival, which drives no faults of sensors: detectors are the same
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
    state, reference, worst = record[STATE], record[REFERENCE], 0.0
    rows = (state.time_s >= start_s) & (np.abs(state["v_mps"]) > _STANDS)
    for body in BODIES.values():
        path, places = (
            np.column_stack([table[f"x_{body}_m"], table[f"y_{body}_m"]])
            for table in (reference, state)
        )
        if rows.any():
            worst = max(worst, float(KDTree(path).query(places[rows])[0].max()))
    return worst


def outcome(case: Case) -> Row:
    """Drive to the end of the run.

    Returns:
        `result`, time from the start of the fault to the first reaction [s] (NaN: none), and the
        largest distance from the path from its start on [m], see `off_the_path`.
    """
    scenario = load(case.scenario, case.overrides)[1]
    assembly, recorder = assemble(scenario, case.seed), Recorder()
    start_s = scenario.faults[0].start_s or 0.0
    ended = drive_into(recorder, assembly, prepared=False)
    record = recorder.record()
    begun = (item.time_s for item in record.events if item.text.startswith(REACTION))
    noticed_s = next((time_s for time_s in begun if time_s >= start_s - 2.0), math.nan) - start_s
    held = "carried on" if math.isnan(noticed_s) else "degraded"
    return {
        "result": held if ended.status == "completed" else ended.status,
        "noticed_s": np.maximum(0.0, noticed_s),
        "worst_m": off_the_path(record, start_s),
    }


def fault_cases() -> list[Case]:
    """Return the drives: `ttempc` with all faults, rivals with those of no sensor."""
    cases = []
    for fault, table in CASES.items():
        angle, sensor = (table["kind"].startswith(kinds) for kinds in ("angle", _OF_SENSORS))
        for controller in CONTROLLERS[:1] if sensor else CONTROLLERS:
            seeds = SEEDS[: _RIVALS if controller != CONTROLLERS[0] else None if angle else _OTHERS]
            for n, seed in enumerate(seeds):
                own = [*changes(fault), f'controller.name="{controller}"']
                if angle:
                    own.append(f"sensors.angle_resolution_deg={RESOLUTIONS_DEG[n % 4]}")
                labels = {"controller": controller, "fault": fault}
                cases.append(Case("grass", seed, tuple(own), labels))
    return cases


def fault_tables(runs: pd.DataFrame) -> str:
    """Return a table of outcomes for each controller."""
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


def alarms(case: Case) -> Row:
    """Return the hours driven, and the alarms that began by detector.

    `reported`: the vehicle went on; `acted`: it slowed down, stopped or did without a sensor;
    `slipping`: an alarm of slip while the wheels truly slipped; `checked`: a stop to look at GNSS.
    """
    assembly, recorder = assemble(load(case.scenario)[1], case.seed), Recorder()
    guidance, period_s = assembly.guidance, assembly.guidance.period_s
    begun: list[tuple[float, Alarm]] = []
    standing: set[str] = set()

    def observe(k: int) -> None:
        nonlocal standing
        begun.extend((k * period_s, one) for one in guidance.alarms if one.detector not in standing)
        standing = {one.detector for one in guidance.alarms}

    ended = drive_into(recorder, assembly, on_tick=observe, prepared=False)
    state = recorder.record()[STATE]
    counts: dict[str, Counter[str]] = {name: Counter() for name in _KINDS}
    for time_s, alarm in begun:
        acted = alarm.reaction is not Reaction.WARN or bool(alarm.unused)
        kind = "checked" if alarm.detector == "drift" else "acted" if acted else "reported"
        if alarm.detector in ("wheels", "motion"):
            span = (state.time_s > time_s - _SPAN_S) & (state.time_s <= time_s)
            slip = 1.0 - state["v_mps"][span].mean() / state["v_rim_mps"][span].mean()
            kind = "slipping" if slip > _SLIPS else kind
        counts[kind][alarm.detector] += 1
    counts["acted"].update(
        one.detector for one in guidance.alarms if "GNSS drifts by" in one.reason
    )
    return {"hours": ended.duration_s / 3600.0, **{kind: {**n} for kind, n in counts.items()}}


_KINDS: Final = {
    "reported": "reported only",
    "acted": "acted on",
    "slipping": "acted on, true slip",
    "checked": "stops for a check",
}


def alarm_cases(seeds: Sequence[int]) -> list[Case]:
    """Return the drives; no two share a seed, so that all of them are independent."""
    drives = len(seeds) // len(fields())
    return [
        Case(scenario, seeds[n * drives + k], labels={"field": label})
        for n, (label, scenario) in enumerate(fields().items())
        for k in range(drives)
    ]


def alarm_table(runs: pd.DataFrame) -> str:
    """Return the alarms of every field, and the rates of false ones in ten hours."""
    cells = {"field": label("field"), "hours": lambda own: f"{own['hours'].sum():.2f}"}
    for kind, head in _KINDS.items():
        cells[head] = lambda own, kind=kind: (
            ", ".join(f"{name}: {n}" for name, n in sorted(_total(own[kind]).items())) or "-"
        )
    lines = [grouped(runs, ["field"], cells)]
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


def _total(counts: Iterable[dict[str, int]]) -> Counter[str]:
    return sum((Counter(one) for one in counts), Counter[str]())


_STUCK: Final = changes("front steering stuck", 5.0)  # within the time of a regression check

FAULTS: Final = Study(
    name="faults",
    seeds=SEEDS,
    make=lambda runner: fault_tables(runner.frame(fault_cases(), outcome)),
    checks=tuple(("grass", name, *own) for name in CONTROLLERS for own in ((), _STUCK)),
)
FALSE_ALARMS: Final = Study(
    name="false-alarms",
    seeds=report_seeds(_DRIVES * len(fields())),
    make=lambda runner: alarm_table(runner.frame(alarm_cases(FALSE_ALARMS.seeds), alarms)),
    checks=tuple((name, "ttempc") for name in shipped()),
)
STUDIES: Final = (FAULTS, FALSE_ALARMS)
