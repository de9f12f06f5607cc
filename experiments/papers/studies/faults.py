"""Faults drawn anew from a seed: how many are noticed before the vehicle is off its path."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

import numpy as np
import pandas as pd
from scipy.spatial import KDTree

from ttempc.types import FloatArray

from ....testbed.recording.channels import REFERENCE, STATE
from ....testbed.recording.record import Record
from ...results.statistics import proportion
from ...results.tracking_errors import BODIES
from ...scenario.scenario import Scenario
from ...studies.sweep.row import Row
from ...studies.sweep.work import SweepJob
from ..alarms import Begun, drive_and_list
from ..fault_draws import CAUSES, CLASSES, FIELDS, WATCH_S, Label, studies
from ..markdown import groups, markdown, numbers
from ..table import Table

SEED: Final = 3001
"""Seed of the published drives; `--seed` draws others."""

OFF_M: Final = 0.5
"""Distance off the path before which a fault is to be noticed [m]."""

# A drive without a fault has the same bits with any detectors: these have others where a limit or a
# detector of common errors changes. They are noticed within the 20 s of a check
_CHECKED: Final = (
    "{kind='gnss_stairs', start_s=13.0, rise_m=0.1, every_s=2.0}",
    "{kind='gnss_drift', start_s=13.0, rate_mps=0.1, direction_deg=90.0}",
    "{kind='gnss_drift', start_s=13.0, rate_mps=0.1, receiver='trailer'}",
)
_STANDS: Final = 0.05  # [m/s]
_PATH_STEP_M: Final = 0.02
_TOGETHER_S: Final = 1.0  # in which alarms count as one; assumed
_NEVER: Final = np.inf  # time of a reaction that did not come


def distance_off(record: Record) -> tuple[FloatArray, FloatArray]:
    """Return the times at which the vehicle moves and its distances off the path, (n,) each.

    The distance is the larger one of both axle points. Units are s and m.
    """
    state = record[STATE]
    reference = record[REFERENCE]
    moves = np.abs(state["v_mps"]) > _STANDS
    off = np.zeros(np.count_nonzero(moves))
    for body in BODIES.values():
        path = _dense(reference.columns(f"x_{body}_m", f"y_{body}_m"))
        places = state.columns(f"x_{body}_m", f"y_{body}_m")[moves]
        if len(places):
            off = np.maximum(off, KDTree(path).query(places)[0])
    return state.time_s[moves], off


def _dense(path: FloatArray) -> FloatArray:
    """Return points every 2 cm between those of a path, (m, 2) [m].

    A reference that leaves ticks out, after a vehicle that does not stop, has gaps.
    """
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    even = np.arange(0.0, length[-1], _PATH_STEP_M)
    return np.column_stack([np.interp(even, length, axis) for axis in path.T])


def start_of(scenario: Scenario) -> float:
    """Return the time at which the fault of a drive begins [s]."""
    if scenario.faults:
        return scenario.faults[0].start_s or 0.0
    return float(scenario.controller.options["start_s"])  # type: ignore[arg-type]


def drive_fault(job: SweepJob) -> Row:
    """Drive a run with a fault and return when and as what it was noticed, and how far off.

    `off_at_notice_m` and `worst_m` are largest distances off the path from the start of the fault
    to the first act, see `first_act`, and to the end.
    """
    label = Label.read(str(job.axes["drive"]))
    table = CLASSES[label.of]
    start_s = start_of(job.scenario)
    ended, record, begun = drive_and_list(job, start_s + table.get("watch_s", WATCH_S))

    first = first_act(begun, start_s)
    noticed_s = first.time_s if first else _NEVER
    time_s, off = distance_off(record)
    since = time_s >= start_s
    before = since & (time_s <= noticed_s)
    row = job.row(ended.status, ended.failure, {"hours": ended.duration_s / 3600.0}, None)
    return {
        **row,
        "noticed_s": noticed_s - start_s if first else None,
        "cause": first.cause if first else "",
        "named": is_named(begun, noticed_s, CAUSES[table["causes"]]),
        "off_at_notice_m": float(off[before].max(initial=0.0)),
        "worst_m": float(off[since].max(initial=0.0)),
    }


def first_act(begun: Sequence[Begun], start_s: float) -> Begun | None:
    """Return what began first from a time on and changed the drive; mere reports do not count."""
    return next((one for one in begun if one.acts and one.time_s >= start_s), None)


def is_named(begun: Sequence[Begun], noticed_s: float, causes: Sequence[str]) -> bool:
    """Return whether an act within a second of the first names one of the causes."""
    first = [
        one.cause
        for one in begun
        if one.acts and noticed_s <= one.time_s <= noticed_s + _TOGETHER_S
    ]
    return any(part in cause for cause in first for part in causes)


def _with_labels(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the rows with the parts of their labels, and what counts, as columns."""
    labels = [Label.read(text) for text in runs["drive"]]
    known = runs["noticed_s"].notna()
    return runs.assign(
        of=[label.of for label in labels],
        sensors=[label.sensors for label in labels],
        ground=[FIELDS[name]["ground"] for name in runs["scenario"]],
        noticed=known,
        early=known & (runs["off_at_notice_m"] <= OFF_M),
        held=~known & (runs["worst_m"] <= OFF_M),
        fooled=(runs["status"] != "stopped") & (runs["worst_m"] > OFF_M),
    )


def share(count: int, total: int) -> str:
    """Return a share in per cent with its interval after Clopper and Pearson."""
    if not total:
        return "-"
    found = proportion(count, total)
    low, high = (100.0 * end for end in found.ends)
    return f"{100.0 * found.value:.0f} % ({low:.0f} to {high:.0f})"


_HEADS: Final = (
    "class",
    "drives",
    f"noticed before {OFF_M} m off",
    f"unnoticed, never {OFF_M} m off",
    "cause right, of the noticed",
    "noticed after [s]",
    "off the path [m]",
    f"not stopped, {OFF_M} m off",
)


def _line(name: str, own: pd.DataFrame) -> list[str]:
    """Return the cells of a class."""
    after_s = numbers(own[own["noticed"]], "noticed_s")
    worst_m = numbers(own, "worst_m")
    total = len(own)
    return [
        name,
        str(total),
        share(int(own["early"].sum()), total),
        str(int(own["held"].sum())),
        share(int(own[own["noticed"]]["named"].sum()), int(own["noticed"].sum())),
        f"{np.median(after_s):.1f}, at most {after_s.max():.1f}" if len(after_s) else "-",
        f"{np.median(worst_m):.2f}, at most {worst_m.max():.2f}",
        str(int(own["fooled"].sum())),
    ]


GOALS: Final = {
    "drift of 1 cm/s": 1.0,
    "drift of 2 cm/s": 0.5,
    "drift of 5 cm/s": 0.3,
    "stairs": 0.5,
}
"""Distance off the path before which a common drift is to be noticed with GNSS velocity [m]."""

_SENSOR_ROWS: Final = (
    ("GNSS velocity, any field", ("velocity, IMU", "velocity"), ("flat", "slope", "tool")),
    ("IMU, no velocity: flat", ("IMU",), ("flat",)),
    ("IMU, no velocity: slopes, tool", ("IMU",), ("slope", "tool")),
    ("neither: flat", ("neither",), ("flat",)),
    ("neither: slopes, tool", ("neither",), ("slope", "tool")),
)


def _goals(runs: pd.DataFrame) -> str:
    """Return the table of common drifts by sensors."""
    heads = ("sensors", *(f"{name}, before {off:g} m" for name, off in GOALS.items()))
    lines = []
    for label, sensors, grounds in _SENSOR_ROWS:
        rows = runs[runs["sensors"].isin(sensors) & runs["ground"].isin(grounds)]
        cells = [label]
        for name, off_m in GOALS.items():
            own = rows[rows["of"] == name]
            early = own["noticed"] & (own["off_at_notice_m"] <= off_m)
            cells.append(f"{share(int(early.sum()), len(own))} of {len(own)}")
        lines.append(cells)
    return markdown(heads, lines)


def fault_tables(runs: pd.DataFrame) -> str:
    """Return the shares by class, and those of common drifts by sensors."""
    runs = _with_labels(runs)
    order = {name: number for number, name in enumerate(CLASSES)}
    runs = runs.assign(order=runs["of"].map(order)).sort_values("order", kind="stable")
    lines = [_line(str(own["of"].iloc[0]), own) for own in groups(runs, ["of"])]
    lines.append(_line("all", runs))
    wrong = runs[runs["noticed"] & ~runs["named"].astype(bool)]
    named = Counter(zip(wrong["of"], wrong["cause"], strict=True))
    said = "; ".join(f"{of} as *{cause}*: {count}" for (of, cause), count in named.items())
    return "\n\n".join(
        [
            markdown(_HEADS, lines),
            f"Noticed under the name of another cause: {said or 'none'}.",
            _goals(runs),
        ]
    )


def drawn_table(seed: int) -> Table:
    """Return the table of the drives that a seed draws."""
    return Table(
        name="faults",
        studies=studies(seed),
        work=drive_fault,
        text=fault_tables,
        checks=(
            *((field, "ttempc") for field in FIELDS),
            *(("grass", "ttempc", f"faults=[{fault}]") for fault in _CHECKED),
        ),
        seed=seed,
        anew=drawn_table,
    )


TABLES: Final = (drawn_table(SEED),)
