"""Drives with faults that are drawn anew from a seed, by the classes of `faults.toml`."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from ttempc.guidance.controllers import make_controller
from ttempc.reference.reference import Reference
from ttempc.types import Command, ControlStep, Estimate
from ttempc.vehicle import Vehicle

from ...testbed.faults.kinds import KINDS
from ...testbed.randomness import generator
from ..studies.sweep.study import Study, VariantAxis

_DECLARED: Final[dict[str, Any]] = tomllib.loads(
    Path(__file__).with_name("faults.toml").read_text(encoding="utf-8")
)
FIELDS: Final[dict[str, dict[str, Any]]] = _DECLARED["fields"]
"""Scenarios that are driven, with their ground: flat, slope or tool."""
SENSORS: Final[dict[str, dict[str, Any]]] = _DECLARED["sensors"]
"""Changes of the sensors, by name."""
CAUSES: Final[dict[str, list[str]]] = _DECLARED["causes"]
CLASSES: Final[dict[str, dict[str, Any]]] = _DECLARED["classes"]

WATCH_S: Final = 70.0
"""Time from the start of a fault to the end of its drive, where a class has none of its own."""
_FIRST_START_S: Final = 20.0  # the filter has settled
_LAST_START_S: Final = 55.0  # at 1 m/s the tractor is then in the second circle of the figure eight
_OF_A_SEED: Final = 10  # drives that share ground and noise at most: of different classes
_MARK: Final = " | "  # between the parts of the label of a drive


class Drive(NamedTuple):
    """A drive with a fault."""

    of: str  # class
    sensors: str
    field: str
    changes: Mapping[str, Any]  # of the scenario, by dotted key


class Label(NamedTuple):
    """Parts of the label of a drive, by which its row is known."""

    of: str
    sensors: str
    number: str

    def __str__(self) -> str:
        return _MARK.join(self)

    @classmethod
    def read(cls, text: str) -> Label:
        """Return the parts of a label."""
        return cls(*text.split(_MARK))


def strata(count: int, rng: np.random.Generator) -> list[float]:
    """Return `count` numbers in 0..1, one in each of as many equal parts, in random order."""
    return ((rng.permutation(count) + rng.random(count)) / count).tolist()


def drawn(range_or_list: Any, share: float) -> Any:  # noqa: ANN401 - any value of a fault
    """Return the value of a declaration at a share in 0..1, the value itself if it is one."""
    if isinstance(range_or_list, list):
        return range_or_list[int(share * len(range_or_list))]
    if not isinstance(range_or_list, dict):
        return range_or_list
    low = range_or_list["low"]
    high = range_or_list["high"]
    value = low * (high / low) ** share if low > 0.0 else low + share * (high - low)
    return float(f"{value:.4g}")


def drives_of(name: str, seed: int, only: float = 1.0) -> Iterator[Drive]:
    """Yield the drives of a class; `only` is the share of them that is wanted."""
    table = CLASSES[name]
    count = max(1, round(only * table["drives"]))
    rng = generator(seed, f"faults {name}")
    sensors = strata(count, rng)
    fields = strata(count, rng)
    starts = strata(count, rng)
    faults = [
        {key: (value, strata(count, rng)) for key, value in fault.items()}
        for fault in table.get("faults", [])
    ]
    settings = {key: (value, strata(count, rng)) for key, value in table.get("set", {}).items()}

    for k in range(count):
        start_s = round(_FIRST_START_S + starts[k] * (_LAST_START_S - _FIRST_START_S), 1)
        field = drawn([*FIELDS], fields[k])
        sensor = drawn(table.get("sensors", [*SENSORS]), sensors[k])
        changes = {
            **FIELDS[field].get("set", {}),
            **SENSORS[sensor],
            **{key: drawn(value, shares[k]) for key, (value, shares) in settings.items()},
        }
        if faults:
            changes["faults"] = [_fault(fault, k, start_s) for fault in faults]
        else:
            changes["controller.options.start_s"] = start_s
        yield Drive(name, sensor, field, changes)


def _fault(
    declared: Mapping[str, tuple[Any, Sequence[float]]], k: int, start_s: float
) -> dict[str, Any]:
    """Return the fault of drive k; keys that belong to another of its kinds are left out."""
    table = {key: drawn(value, shares[k]) for key, (value, shares) in declared.items()}
    known = KINDS[table["kind"]].__dataclass_fields__
    return {"start_s": start_s, **{key: value for key, value in table.items() if key in known}}


def studies(seed: int, only: float = 1.0) -> dict[str, Study]:
    """Return the studies of all drives of a seed: each has a field, and a seed of its own.

    Args:
        seed: of the draws, and of the ground and noise of the first study.
        only: share of the drives that is wanted.
    """
    of_field: dict[str, list[Drive]] = {field: [] for field in FIELDS}
    for name in CLASSES:
        for drive in drives_of(name, seed, only):
            of_field[drive.field].append(drive)
    made: dict[str, Study] = {}
    for field, drives in of_field.items():
        blocks = math.ceil(len(drives) / _OF_A_SEED)
        for block in range(blocks):
            own = seed + len(made)
            made[f"{field} {own}"] = Study(
                scenario=field, seeds=(own,), axis=(_axis(drives[block::blocks]),)
            )
    return made


def _axis(drives: Sequence[Drive]) -> VariantAxis:
    values = {
        str(Label(drive.of, drive.sensors, str(number))): nested(drive.changes)
        for number, drive in enumerate(drives)
    }
    return VariantAxis(kind="variants", name="drive", values=values)


def nested(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return changes by dotted keys as tables in tables."""
    tables: dict[str, Any] = {}
    for key, value in changes.items():
        *above, last = key.split(".")
        table = tables
        for name in above:
            table = table.setdefault(name, {})
        table[last] = value
    return tables


@dataclass
class FailingController:
    """PID laws whose answers are NaN from a time on."""

    vehicle: Vehicle
    reference: Reference
    period_s: float
    start_s: float = 0.0

    def __post_init__(self) -> None:
        self._inner = make_controller("pid", self.vehicle, self.reference, self.period_s)

    def step(self, estimate: Estimate, k: int) -> ControlStep | Command:
        """Return the command of the laws, or NaN."""
        if k * self.period_s < self.start_s:
            return self._inner.step(estimate, k)
        return Command(math.nan, math.nan, math.nan)
