"""Reference of all keys of a scenario file as a Markdown page, made from its JSON schema."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from ttempc.guidance.controllers import CONTROLLERS, controller_options

from .json_schema import json_schema

_HEAD: Final = "| key | value | unit | default | meaning |\n|---|---|---|---|---|"
_OPTIONS: Final = (
    "Keys of `controller.options`. Their meaning stands in the options class of each controller."
)
_TYPES: Final = {
    "string": "text",
    "number": "number",
    "integer": "whole number",
    "boolean": "`true`, `false`",
    "object": "table",
    "null": "absent",
}

Schema = Mapping[str, Any]


@dataclass
class _Table:
    """A table of the file: its header, what it is, its keys, and the tables in it."""

    header: str
    meaning: str
    rows: list[str] = field(default_factory=list[str])


def scenario_reference() -> str:
    """Return the page: a section for each table, a row for each key, and options by controller."""
    schema = json_schema()
    lines = [
        "# Scenario reference",
        "",
        "Keys of a scenario file, made from its JSON schema (`ttempc list --schema`). An absent key has "
        "its default. A value outside its range and an unknown key are refused in one line that "
        "names them. A table in double brackets may stand several times.",
    ]
    for table in _tables(schema, "", schema["$defs"], repeated=False):
        lines += ["", f"{'##' if '.' not in table.header else '###'} {table.header}", ""]
        lines += [table.meaning.split("\n\n")[0].replace("\n", " "), ""] if table.meaning else []
        lines += [_HEAD, *table.rows]
    lines += [
        "",
        "## Options of the controllers",
        "",
        _OPTIONS,
        "",
        "| option | default |",
        "|---|---|",
    ]
    for name in CONTROLLERS:
        lines += [
            f"| `{name}`: `{key}` | {_default(value)} |"
            for key, value in controller_options(name, {}).items()
        ]
    return "\n".join(lines) + "\n"


def _tables(schema: Schema, path: str, definitions: Schema, *, repeated: bool) -> Iterator[_Table]:
    """Yield the table of `schema` at a dotted path, then the tables inside it."""
    brackets = f"[[{path}]]" if repeated else f"[{path}]"
    kind = schema["properties"].get("kind", {}).get("const")
    title = f"`{brackets}`" if path else "At the top"
    table = _Table(f"{title}, kind `{kind}`" if kind else title, schema.get("description", ""))
    inside: list[tuple[Schema, str, bool]] = []
    for key, value in schema["properties"].items():
        place = f"{path}.{key}" if path else key
        tables, many = _tables_of(value, definitions)
        if not tables or (value.get("anyOf") and not _only_tables(value)):
            table.rows.append(_row(key, value, key in schema.get("required", ())))
        inside += [(found, place, many) for found in tables]
    if table.rows:
        yield table
    for found, place, many in inside:
        yield from _tables(found, place, definitions, repeated=many)


def _tables_of(value: Schema, definitions: Schema) -> tuple[list[Schema], bool]:
    """Return the tables that a value may be, and whether it is a list of them."""
    if "items" in value and isinstance(value["items"], Mapping):
        return _tables_of(value["items"], definitions)[0], True
    if "$ref" in value:
        return [definitions[value["$ref"].rsplit("/", 1)[1]]], False
    choices = [*value.get("oneOf", ()), *value.get("anyOf", ())]
    found = [_tables_of(choice, definitions) for choice in choices]
    return [table for tables, _ in found for table in tables], any(many for _, many in found)


def _only_tables(value: Schema) -> bool:
    """Whether all choices of a value are tables, or its absence."""
    return all(
        "$ref" in choice or "oneOf" in choice or "items" in choice or choice.get("type") == "null"
        for choice in value["anyOf"]
    )


def _row(key: str, value: Schema, required: bool) -> str:
    default = "required" if required else _default(value.get("default"))
    meaning = value.get("description", "").replace("\n", " ").replace("|", "\\|")
    return f"| `{key}` | {_allowed(value)} | {value.get('unit', '')} | {default} | {meaning} |"


def _default(value: object) -> str:
    if value is None:
        return "–"
    return f"`{json.dumps(_rounded(value), ensure_ascii=False)}`"


def _rounded(value: object) -> object:
    """Return a value with its numbers at six digits: an angle of 12 degrees in radians has 16."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]  # pyright: ignore[reportUnknownVariableType]
    return value


def _allowed(value: Schema) -> str:
    """Return type, range and alternatives of a value in words."""
    if "const" in value:
        return f"`{json.dumps(value['const'])}`"
    if "enum" in value:
        return ", ".join(f"`{json.dumps(choice)}`" for choice in value["enum"])
    if choices := [*value.get("anyOf", ()), *value.get("oneOf", ())]:
        words = (_allowed(choice) for choice in choices if choice.get("type") != "null")
        return ", or ".join(dict.fromkeys(words))
    if "$ref" in value:
        return "table"
    if value.get("type") == "array":
        return _allowed_list(value)
    return f"{_TYPES.get(value.get('type', ''), 'any value')}{_range(value)}"


def _allowed_list(value: Schema) -> str:
    if "prefixItems" in value:
        return f"list of {', '.join(_allowed(item) for item in value['prefixItems'])}"
    items = value.get("items")
    return f"list of {_allowed(items)}" if isinstance(items, Mapping) else "list"


def _range(value: Schema) -> str:
    low, high = value.get("minimum"), value.get("maximum")
    above, below = value.get("exclusiveMinimum"), value.get("exclusiveMaximum")
    if low is not None and high is not None:
        return f" {low:g} to {high:g}"
    limits = (
        f"{words} {limit:g}"
        for words, limit in (
            ("at least", low),
            ("above", above),
            ("at most", high),
            ("below", below),
        )
        if limit is not None
    )
    return (
        " " + " and ".join(limits) if any(x is not None for x in (low, above, high, below)) else ""
    )
