"""Random scenarios from the JSON schema: over the whole range of every key, or near its default."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np

from ttempc.guidance.controllers import CONTROLLERS, ESTIMATORS

from ...scenario.scenario import Scenario, read_scenario, shipped
from ...scenario.schema import json_schema

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
        kinds = _schema()["properties"]["faults"]["items"]
        tables = []
        for number in range(int(self.rng.integers(1, _FAULTS + 1))):
            kind = str(self.rng.choice(list(kinds["discriminator"]["mapping"])))
            schema = _resolved({"$ref": kinds["discriminator"]["mapping"][kind]})
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
