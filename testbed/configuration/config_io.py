"""Strict reading of configuration files into pydantic dataclasses."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
)

from .validation_errors import format_validation_error

STRICT: Final = ConfigDict(
    extra="forbid", allow_inf_nan=False, strict=True, use_attribute_docstrings=True
)
"""Configuration of every table: no unknown key, no conversion of types, finite numbers only."""

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
AngleDeg = Annotated[float, Field(gt=0, lt=90)]
Fraction = Annotated[float, Field(ge=0, le=1)]

Table = TypeVar("Table")


def _absolute(file: str, info: ValidationInfo) -> str:
    folder: Path | None = (info.context or {}).get("folder")
    return str((folder / file).resolve()) if folder and file else file


def _absolute_unless_name(file: str, info: ValidationInfo) -> str:
    return _absolute(file, info) if Path(file).suffix else file


DataFile = Annotated[str, AfterValidator(_absolute)]
"""Path of a file; `validated` makes it absolute from the folder of the configuration file."""

NameOrFile = Annotated[str, AfterValidator(_absolute_unless_name)]
"""Name of a shipped file, or a `DataFile`. A name has no suffix."""


def read_toml(file: Path, error: type[Exception]) -> dict[str, Any]:
    """Return the content of a TOML file.

    Raises:
        Exception: `error` with one line, if the file is missing or is no TOML.
    """
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as reason:
        raise error(f"{file}: cannot be read as TOML: {reason}") from None


def validated(
    table: type[Table],
    content: Mapping[str, Any],
    error: type[Exception],
    folder: Path | None = None,
) -> Table:
    """Return the content of a file as an instance of the dataclass `table`.

    Args:
        table: pydantic dataclass with the configuration `STRICT`; its fields are the keys.
        content: tables of the file.
        error: type of the error that is raised.
        folder: folder from which the paths of files are made absolute; None leaves them relative.

    Raises:
        Exception: `error` with one line that names the key, the allowed values and the value.
    """
    try:
        # In strict mode, pydantic builds dataclasses from tables of JSON only, not from dicts.
        text = json.dumps(content, default=str)
        return TypeAdapter(table).validate_json(text, context={"folder": folder})
    except ValidationError as reason:
        raise error(format_validation_error(reason, table)) from None
