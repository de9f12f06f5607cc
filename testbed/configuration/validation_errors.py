"""Messages of validation errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, Final, get_args, get_type_hints

from pydantic import ValidationError

from ttempc.suggestion import did_you_mean

_MOST_SHOWN: Final = 300  # characters of a wrong value


def format_validation_error(error: ValidationError, root: type) -> str:
    """Format a pydantic error as one line that names the TOML key.

    An unknown key is reported before any other error: a misspelt key also leaves one missing.

    Args:
        error: error of the validation of a file.
        root: dataclass of the whole file.

    Returns:
        Key, allowed values and given value.
    """
    details = error.errors()
    unknown = (each for each in details if each["type"] == "unexpected_keyword_argument")
    first = next(unknown, details[0])
    keys, tables = _descend(first["loc"], root)
    where = ".".join(keys)
    if first["type"] == "unexpected_keyword_argument":
        names = [field.name for field in fields(tables[0])]
        meant = did_you_mean(keys[-1], names) or _elsewhere(keys[-1], root)
        return f"{where}: unknown key; allowed here: {', '.join(names)}{meant}"
    value = first["input"]
    given = "" if isinstance(value, Mapping) else f", got {_shown(value)}"
    if first["type"] == "union_tag_not_found":
        return f"{where}: kind is missing, must be one of {', '.join(_kinds(tables))}{given}"
    return f"{where}: {first['msg'].removeprefix('Value error, ')}{given}"


def _elsewhere(key: str, root: type) -> str:
    """Return the end of a message that names a key as it is called in another table of a file."""
    level: list[tuple[tuple[str, ...], Any]] = [((), root)]
    seen = {root}
    while level:  # the least deep first
        places = [(*keys, field.name) for keys, table in level for field in fields(table)]
        for place in places:
            if place[-1] == key:
                return f" (did you mean {'.'.join(place)}?)"
        below = [
            ((*keys, name), table)
            for keys, parent in level
            for name, hint in get_type_hints(parent).items()
            for table in _tables(hint)
        ]
        level = [(keys, table) for keys, table in below if table not in seen]
        seen |= {table for _, table in level}
    return ""


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]}…"


def _descend(location: Sequence[str | int], root: type) -> tuple[list[str], list[Any]]:
    """Return the keys of a pydantic error location and the dataclasses of its table.

    A location inside a discriminated union also holds the kind, which is no key of the file.
    """
    keys: list[str] = []
    tables: list[Any] = [root]
    for part in location:
        kinds = _kinds(tables)
        if isinstance(part, str) and part in kinds and len(kinds) > 1:
            tables = [kinds[part]]
            continue
        keys.append(str(part))
        if isinstance(part, str):
            below = _tables(get_type_hints(tables[0]).get(part))
            tables = below or tables
    return keys, tables


def _tables(hint: Any) -> list[Any]:  # noqa: ANN401 - any type
    """Return the dataclasses that a field of this type may hold, alone or in a list."""
    if is_dataclass(hint):
        return [hint]
    return [table for part in get_args(hint) for table in _tables(part)]


def _kinds(tables: Sequence[Any]) -> dict[str, Any]:
    """Return the dataclasses that have a field `kind`, by the value of that field."""
    hints = ((table, get_type_hints(table).get("kind")) for table in tables)
    return {name: table for table, kind in hints for name in get_args(kind)}
