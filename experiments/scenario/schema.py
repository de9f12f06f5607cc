"""JSON schema of a scenario, and the reference of its keys made from it."""

import json
from collections.abc import Iterator, Mapping
from typing import Any, Final

from pydantic import TypeAdapter

from ttempc.guidance.controllers import CONTROLLERS, controller_options

from .path import FigureEight
from .scenario import Scenario

Schema = Mapping[str, Any]

# Units by the last words of a key; the longest suffix that fits counts.
_UNITS: Final = {
    **{unit: unit for unit in ("m", "s", "deg", "rad", "kg")},
    **{"kpa": "kPa", "hz": "Hz", "mps": "m/s", "mps2": "m/s^2", "degps": "deg/s"},
    **{"per_s": "1/s", "per_rad": "1/rad"},
}
_TYPES: Final = {
    "string": "text",
    "number": "number",
    "integer": "whole number",
    "boolean": "`true`, `false`",
    "object": "table",
    "null": "absent",
}
_HEAD: Final = "| key | value | unit | default | meaning |\n|---|---|---|---|---|"
_INTRODUCTION: Final = """\
# Scenario reference

Keys of a scenario file, made from its JSON schema (`ttempc list --schema`). An absent key has its \
default. A value outside its range and an unknown key are refused in one line that names them. A \
table in double brackets may stand several times."""
_OPTIONS: Final = """
## Options of the controllers

Keys of `controller.options`. Their meaning stands in the options class of each controller.

| option | default |
|---|---|"""


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of a scenario file (draft 2020-12).

    A key with a unit in its name has `unit`. Without a key `kind`, a path is a figure eight.
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


def scenario_reference() -> str:
    """Return the page: a section for each table, a row for each key, and options by controller."""
    schema = json_schema()
    lines = [_INTRODUCTION]
    for header, meaning, rows in _tables(schema, "", schema["$defs"], repeated=False):
        lines += ["", f"{'##' if '.' not in header else '###'} {header}", ""]
        lines += [meaning.split("\n\n")[0].replace("\n", " "), ""] if meaning else []
        lines += [_HEAD, *rows]
    lines.append(_OPTIONS)
    for name in CONTROLLERS:
        options = controller_options(name, {}).items()
        lines += [f"| `{name}`: `{key}` | {_default(value)} |" for key, value in options]
    return "\n".join(lines) + "\n"


def _tables(
    schema: Schema, path: str, definitions: Schema, *, repeated: bool
) -> Iterator[tuple[str, str, list[str]]]:
    brackets = f"[[{path}]]" if repeated else f"[{path}]"
    kind = schema["properties"].get("kind", {}).get("const")
    title = f"`{brackets}`" if path else "At the top"
    rows: list[str] = []
    inside: list[tuple[Schema, str, bool]] = []
    for key, value in schema["properties"].items():
        tables, many = _tables_of(value, definitions)
        if not tables or (value.get("anyOf") and not _only_tables(value)):
            rows.append(_row(key, value, key in schema.get("required", ())))
        inside += [(found, f"{path}.{key}" if path else key, many) for found in tables]
    if rows:
        yield f"{title}, kind `{kind}`" if kind else title, schema.get("description", ""), rows
    for found, place, many in inside:
        yield from _tables(found, place, definitions, repeated=many)


def _tables_of(value: Schema, definitions: Schema) -> tuple[list[Schema], bool]:
    if "items" in value and isinstance(value["items"], Mapping):
        return _tables_of(value["items"], definitions)[0], True
    if "$ref" in value:
        return [definitions[value["$ref"].rsplit("/", 1)[1]]], False
    found = [_tables_of(choice, definitions) for choice in _choices(value)]
    return [table for tables, _ in found for table in tables], any(many for _, many in found)


def _choices(value: Schema) -> list[Schema]:
    return [*value.get("anyOf", ()), *value.get("oneOf", ())]


def _only_tables(value: Schema) -> bool:
    return all(
        {"$ref", "oneOf", "items"} & choice.keys() or choice.get("type") == "null"
        for choice in value["anyOf"]
    )


def _row(key: str, value: Schema, required: bool) -> str:
    default = "required" if required else _default(value.get("default"))
    meaning = value.get("description", "").replace("\n", " ").replace("|", "\\|")
    return f"| `{key}` | {_allowed(value)} | {value.get('unit', '')} | {default} | {meaning} |"


def _default(value: object) -> str:
    """Return a default as text, numbers at six digits: 12 degrees in radians have 16."""
    if value is None:
        return "–"
    if isinstance(value, list | tuple):
        items = (_default(item).strip("`") for item in value)  # pyright: ignore[reportUnknownVariableType]
        return f"`[{', '.join(items)}]`"
    value = float(f"{value:.6g}") if isinstance(value, float) else value
    return f"`{json.dumps(value, ensure_ascii=False)}`"


def _allowed(value: Schema) -> str:
    if "const" in value:
        return f"`{json.dumps(value['const'])}`"
    if "enum" in value:
        return ", ".join(f"`{json.dumps(choice)}`" for choice in value["enum"])
    if choices := _choices(value):
        words = (_allowed(choice) for choice in choices if choice.get("type") != "null")
        return ", or ".join(dict.fromkeys(words))
    if "$ref" in value:
        return "table"
    if value.get("type") == "array":
        items = value.get("prefixItems") or ([value["items"]] if value.get("items") else [])
        return f"list of {', '.join(map(_allowed, items))}" if items else "list"
    return f"{_TYPES.get(value.get('type', ''), 'any value')}{_range(value)}"


def _range(value: Schema) -> str:
    low = value.get("minimum")
    high = value.get("maximum")
    if low is not None and high is not None:
        return f" {low:g} to {high:g}"
    words = {
        "at least": low,
        "above": value.get("exclusiveMinimum"),
        "at most": high,
        "below": value.get("exclusiveMaximum"),
    }
    limits = [f"{word} {limit:g}" for word, limit in words.items() if limit is not None]
    return f" {' and '.join(limits)}" if limits else ""
