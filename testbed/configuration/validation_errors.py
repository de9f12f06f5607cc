"""What the validator says of a file, in the words of the file: one line, one key."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, get_args, get_type_hints

from pydantic import ValidationError


def first_complaint(error: ValidationError, root: type) -> str:
    """Return key, what is allowed there and what was given, in the words of the file.

    Args:
        error: of validating a file.
        root: the dataclass of the whole file.
    """
    complaints = error.errors()
    unknown = (each for each in complaints if each["type"] == "unexpected_keyword_argument")
    first = next(unknown, complaints[0])  # a slip of the pen also leaves a key missing
    keys, tables = _descend(first["loc"], root)
    where = ".".join(keys)
    if first["type"] == "unexpected_keyword_argument":
        allowed = ", ".join(field.name for field in fields(tables[0]))
        return f"{where}: unknown key; allowed here: {allowed}"
    given = first["input"]
    said = "" if isinstance(given, Mapping) else f", got {given!r}"
    if first["type"] == "union_tag_not_found":
        return f"{where}: kind is missing, must be one of {', '.join(_kinds(tables))}{said}"
    return f"{where}: {first['msg'].removeprefix('Value error, ')}{said}"


def _descend(location: Sequence[str | int], root: type) -> tuple[list[str], list[Any]]:
    """Return the keys of the file that lead to a validator's location, and the tables there.

    Where a table may be of several kinds, the validator's locations hold the kind as well, which
    is no key of the file.
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
    """Return the tables that say their kind, by its name."""
    hints = ((table, get_type_hints(table).get("kind")) for table in tables)
    return {get_args(kind)[0]: table for table, kind in hints if kind}
