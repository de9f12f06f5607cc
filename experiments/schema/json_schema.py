"""JSON schema of a scenario."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

from pydantic import TypeAdapter

from ..scenario.path import FigureEight
from ..scenario.scenario import Scenario

# Units by the last words of a key; the longest suffix that fits counts.
_UNITS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "m": "m",
        "s": "s",
        "deg": "deg",
        "rad": "rad",
        "kg": "kg",
        "kpa": "kPa",
        "hz": "Hz",
        "mps": "m/s",
        "mps2": "m/s^2",
        "degps": "deg/s",
        "per_s": "1/s",
        "per_rad": "1/rad",
    }
)


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of a scenario file (draft 2020-12).

    Each key has its type, range, default value and description, and with a unit in its name also
    `unit`. A table with a key `kind` is a choice between the tables of all kinds; `kind` may be
    absent from the table of a figure eight only.
    """
    schema = TypeAdapter(Scenario).json_schema()
    for name, table in schema["$defs"].items():
        properties = table.get("properties", {})
        if "kind" in properties and name != FigureEight.__name__:
            table["required"] = ["kind", *table.get("required", ())]
    for table in (schema, *schema["$defs"].values()):
        for key, value in table.get("properties", {}).items():
            if unit := unit_of(key):
                value["unit"] = unit
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def unit_of(key: str) -> str | None:
    """Return the unit in the name of a key, None for a key without a unit."""
    words = key.split("_")
    for count in (2, 1):
        if len(words) > count and (unit := _UNITS.get("_".join(words[-count:]))):
            return unit
    return None
