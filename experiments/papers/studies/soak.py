"""Soak: random scenarios from the JSON schema with random faults, loaded and driven.

Those that are loaded have values over the whole range of every key; those that are driven have
values near the defaults and one to three faults, and end after a time. What must not happen is
counted, and named with the number of the scenario: `drive_one((NUMBER, SECONDS))` repeats it.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import math
import os
import resource
import time
import tomllib
import traceback
import warnings
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from ttempc.errors import TtempcError
from ttempc.guidance.controllers import CONTROLLERS, ESTIMATORS

from ....testbed.errors import TestbedError
from ....testbed.recording.channels import CONTROL, STATE
from ....testbed.recording.record import Recorder
from ...errors import ExperimentError
from ...run.assembly import assemble
from ...run.simulate import drive_into
from ...scenario.scenario import Scenario, ScenarioFile, dump, read_scenario, shipped
from ...scenario.schema import json_schema
from ..cells import groups, numbers
from ..runner import Runner
from ..study import Row, Study
from ..tables import markdown
from .faults import faulty_commands

LOADS: Final = 10_000
DRIVES: Final = 1000
SECONDS: Final = 30.0
_BLOCK: Final = 250  # scenarios that a task loads
_SHARE_LOADED, _SHARE_DRIVEN = 0.15, 0.04  # of the keys that are drawn
_TRIES: Final = 200  # scenarios that a drive may draw until one can be driven
_REFUSALS: Final = (ExperimentError, TestbedError, TtempcError)

_NAMES: Final = {"controller.name": tuple(CONTROLLERS), "controller.estimator": tuple(ESTIMATORS)}
# Code and texts of a user; a fault has start_s instead of at_m; wall clocks do not repeat.
_LEFT_OUT: Final = frozenset({"stages", "description", "name", "at_m", "realtime", "step_limit_s"})
_NEAR: Final = 0.4  # largest logarithm of a factor on a default
_USUAL: Final = (0.01, 10.0)  # magnitudes near a default of 0, or without a default
_LEAST: Final = 1e-6  # magnitude over the whole range
_FAULTS: Final = 3

Schema = Mapping[str, Any]


@cache
def _schema() -> Schema:
    return json_schema()


@dataclass(frozen=True, slots=True)
class RandomTables:
    """Draws tables of a scenario.

    Args:
        rng: draws.
        share: of the keys that are given.
        near: values lie near their defaults, so that most scenarios can be driven; otherwise they
            lie anywhere in their ranges.
    """

    rng: np.random.Generator
    share: float
    near: bool

    def scenario(self) -> Scenario:
        """Return a shipped scenario with keys drawn anew.

        Raises:
            InvalidScenario, InvalidPlant, InvalidTuning: the keys do not fit together.
        """
        name = str(self.rng.choice(shipped()))
        return read_scenario(name).scenario(self._table(_schema(), ""), changed_by="random")

    def faults(self, seconds: float) -> list[dict[str, Any]]:
        """Return one to three tables of faults that begin within a time [s]."""
        kinds = _schema()["properties"]["faults"]["items"]["discriminator"]["mapping"]
        tables = []
        for number in range(int(self.rng.integers(1, _FAULTS + 1))):
            kind = str(self.rng.choice(list(kinds)))
            schema = _resolved({"$ref": kinds[kind]})
            fault = self._table(schema, "faults")
            fault |= {"kind": kind, "name": f"fault-{number}"}
            fault["start_s"] = float(self.rng.uniform(0.0, seconds))
            if "duration_s" in schema["properties"] and self.rng.random() < 0.5:
                fault["duration_s"] = float(self.rng.uniform(0.5, seconds))
            tables.append(fault)
        return tables

    def _table(self, schema: Schema, path: str) -> dict[str, Any]:
        required = schema.get("required", ())
        table: dict[str, Any] = {}
        for key, value in schema["properties"].items():
            place = f"{path}.{key}" if path else key
            drawn = key in required or self.rng.random() < self.share
            below = "$ref" in value or "oneOf" in value
            if key in _LEFT_OUT or not (drawn or (below and self.rng.random() < 0.5)):
                continue
            content = self._value(value, place)
            if content is not None:
                table[key] = content
        return table

    def _value(self, schema: Schema, place: str) -> Any:  # noqa: ANN401 - any TOML value
        schema = _resolved(schema)
        for choice in ("anyOf", "oneOf"):
            if choice in schema:
                options = [item for item in schema[choice] if item.get("type") != "null"]
                picked = options[int(self.rng.integers(len(options)))]
                return self._value({**picked, "default": schema.get("default")}, place)
        if "const" in schema:
            return schema["const"]
        if "enum" in schema:
            return str(self.rng.choice(schema["enum"]))
        match schema.get("type"):
            case "object" if "properties" in schema:
                return self._table(schema, place)
            case "array" if isinstance(schema.get("items"), Mapping):
                values = [self._value(schema["items"], place) for _ in range(self.rng.integers(3))]
                return [value for value in values if value is not None]
            case "boolean":
                return bool(self.rng.random() < 0.5)
            case "integer":
                return round(self._number(schema))
            case "number":
                return self._number(schema)
            case "string" if place in _NAMES:
                return str(self.rng.choice(_NAMES[place]))
            case _:  # names of files, and tables of any keys
                return None

    def _number(self, schema: Schema) -> float:
        low = float(schema.get("minimum", schema.get("exclusiveMinimum", -1e6)))
        high = float(schema.get("maximum", schema.get("exclusiveMaximum", 1e6)))
        default = schema.get("default")
        if self.near and default:
            value = float(default) * math.exp(self.rng.uniform(-_NEAR, _NEAR))
        else:
            least, most = _USUAL if self.near else (_LEAST, max(abs(low), abs(high)))
            value = math.exp(self.rng.uniform(math.log(least), math.log(most)))
            if low < 0.0 and self.rng.random() < 0.5:
                value = -value
        return min(max(value, low), high)


def _resolved(schema: Schema) -> Schema:
    """Return a schema with its reference replaced by what it refers to; other keys are kept."""
    if "$ref" not in schema:
        return schema
    target = _schema()["$defs"][schema["$ref"].rpartition("/")[2]]
    return {**target, **{key: value for key, value in schema.items() if key != "$ref"}}


def load_block(block: range) -> tuple[int, int, list[str]]:
    """Load the scenarios of these numbers.

    Returns:
        How many were loaded and refused, and defects: exceptions, refusals of several lines, files
        that read back as something else.
    """
    loaded, defects = 0, list[str]()
    for number in block:
        tables = RandomTables(np.random.default_rng(number), _SHARE_LOADED, near=False)
        try:
            scenario = tables.scenario()
        except _REFUSALS as refusal:
            if "\n" in str(refusal).strip():
                defects.append(f"load {number}: refusal of several lines: {refusal}")
        except Exception:
            defects.append(f"load {number}: {_last_line()}")
        else:
            loaded += 1
            file = ScenarioFile(Path("soak.toml"), tomllib.loads(dump(scenario)))
            if file.scenario() != scenario:
                defects.append(f"load {number}: reads back as another scenario")
    return loaded, len(block) - loaded, defects


def drive_one(task: tuple[int, float]) -> Row:
    """Draw scenarios with the generator of a number until one can be driven, for a time [s].

    Returns:
        `status` of the run, or "error"; `refused` scenarios drawn before; `defects`: exceptions,
        warnings, invalid runs, values that are not finite; memory and open files of the process
        after the run.
    """
    number, seconds = task
    begin, rng = time.perf_counter(), np.random.default_rng((number, 1))
    status, refused, simulated_s, defects = "error", 0, 0.0, list[str]()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            for _ in range(_TRIES):
                tables = RandomTables(rng, _SHARE_DRIVEN, near=True)
                try:
                    scenario = tables.scenario()
                    content = tomllib.loads(dump(scenario)) | {"faults": tables.faults(seconds)}
                    scenario = ScenarioFile(Path("soak.toml"), content).scenario()
                    status, simulated_s, defects = _drive(scenario, number, seconds)
                    break
                except _REFUSALS:
                    refused += 1
        except Exception:
            defects.append(_last_line())
    defects += [f"{item.category.__name__}: {item.message}" for item in caught]
    return {
        "status": status,
        "refused": refused,
        "defects": [f"drive {number}: {defect}" for defect in defects],
        "simulated_s": simulated_s,
        "wall_s": time.perf_counter() - begin,
        "process": os.getpid(),
        "memory_mb": _memory_mb(),
        "descriptors": len(os.listdir("/proc/self/fd")),
    }


def _drive(scenario: Scenario, seed: int, seconds: float) -> tuple[str, float, list[str]]:
    """Return status, simulated time [s] and defects of a run."""
    assembly, recorder = assemble(scenario, seed), Recorder()
    ticks = min(round(seconds / assembly.guidance.period_s), assembly.ticks)
    outcome = drive_into(recorder, replace(assembly, ticks=ticks), prepared=False)
    record = recorder.record()
    defects = [f"invalid: {outcome.failure}"] if outcome.status == "invalid" else []
    if not np.isfinite(record[STATE].values).all():
        defects.append("state not finite")
    if count := faulty_commands(record):
        defects.append(f"{count} commands not finite or beyond a limit")
    return outcome.status, float(record[CONTROL].time_s.max(initial=0.0)), defects


def _last_line() -> str:
    """Return type, message and place of the exception that is handled."""
    lines = traceback.format_exc(limit=-1).strip().splitlines()
    return f"{lines[-1]} ({lines[1].strip()})"


def _memory_mb() -> float:
    """Return the resident memory of this process, without what it holds for later use."""
    gc.collect()
    with contextlib.suppress(OSError, AttributeError):  # another C library has no such function
        ctypes.CDLL("libc.so.6").malloc_trim(0)
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def _growth(driven: pd.DataFrame, column: str) -> float:
    """Return the largest growth of a value in a process, from its second to its last quarter."""
    growth = [0.0]
    for own in groups(driven, ["process"]):
        values = numbers(own, column)
        if quarter := len(values) // 4:
            last, second = values[-quarter:], values[quarter : 2 * quarter]
            growth.append(float(np.median(last) - np.median(second)))
    return max(growth)


def soak(runner: Runner, loads: int = LOADS, drives: int = DRIVES) -> str:
    """Return the counts of what became of loads and drives, and every defect."""
    blocks = [range(begin, min(begin + _BLOCK, loads)) for begin in range(0, loads, _BLOCK)]
    loaded = runner.map(load_block, blocks)
    tasks = [(number, SECONDS) for number in range(drives)]
    driven = pd.DataFrame([*runner.map(drive_one, tasks)])
    defects = [line for own in (*(own for *_, own in loaded), *driven["defects"]) for line in own]
    rows = {
        "scenarios drawn and loaded": sum(count for count, _, _ in loaded),
        "scenarios drawn and refused with one line": sum(count for _, count, _ in loaded),
        "scenarios with faults drawn, but refused": driven["refused"].sum(),
        "driven": len(driven),
        **{f"driven: {name}": n for name, n in sorted(Counter(driven["status"]).items())},
        "simulated hours": f"{driven['simulated_s'].sum() / 3600.0:.2f}",
        "longest run on the clock [s]": f"{driven['wall_s'].max():.0f}",
        "growth of memory in a process [MB]": f"{_growth(driven, 'memory_mb'):.0f}",
        "growth of open files in a process": f"{_growth(driven, 'descriptors'):.0f}",
        "exceptions, warnings, invalid runs, values not finite, commands beyond limits": len(
            defects
        ),
    }
    table = markdown(["", ""], [[name, str(value)] for name, value in rows.items()])
    return "\n\n".join([table, *defects])


STUDIES: Final = (Study(name="soak", make=soak, minutes=22.0),)
