"""Files that people write: strict tables, and one line that says what is wrong where."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from .validation_errors import first_complaint

STRICT: Final = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
AngleDeg = Annotated[float, Field(gt=0, lt=90)]

Table = TypeVar("Table")


def read_toml(file: Path, error: type[Exception]) -> dict[str, Any]:
    """Return the content of a TOML file; an unreadable one is an `error` of one line."""
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as reason:
        raise error(f"{file}: cannot be read as TOML: {reason}") from None


def validated(
    table: type[Table],
    content: Mapping[str, Any],
    error: type[Exception],
) -> Table:
    """Return the content of a file as the dataclass `table`, made with `STRICT`.

    Args:
        table: a pydantic dataclass whose fields are the keys of the file.
        content: what the file says.
        error: raised with one line: key, what is allowed there and what was given.
    """
    try:
        # By way of JSON, because only there does the strict mode take tables for dataclasses.
        return TypeAdapter(table).validate_json(json.dumps(content, default=str))
    except ValidationError as reason:
        raise error(first_complaint(reason, table)) from None
