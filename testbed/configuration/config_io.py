"""Strict reading of configuration files into pydantic dataclasses, and its messages."""

import json
import math
import re
import tomllib
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar, get_args, get_type_hints

from pydantic import AfterValidator, ConfigDict, Field, TypeAdapter, ValidationError, ValidationInfo
from pydantic_core import ErrorDetails

from ttempc.suggestion import did_you_mean

from ..foreign_files import read_bounded

STRICT: Final = ConfigDict(
    extra="forbid", allow_inf_nan=False, strict=True, use_attribute_docstrings=True
)
"""Configuration of every table: no unknown key, no conversion of types, finite numbers only."""

# Ranges of keys by their quantity: wide enough for any machine and field, narrow enough that no
# computation overflows. A key with a range of its own says so where it is declared.
Positive = Annotated[float, Field(gt=0, le=1e6)]
NotNegative = Annotated[float, Field(ge=0, le=1e6)]
Signed = Annotated[float, Field(ge=-1e6, le=1e6)]
LengthM = Annotated[float, Field(ge=1e-3, le=10_000)]
PlaceM = Annotated[float, Field(ge=-10_000, le=10_000)]
SpeedMps = Annotated[float, Field(ge=0.01, le=50)]
DurationS = Annotated[float, Field(ge=1e-3, le=10_000)]
RateHz = Annotated[float, Field(ge=0.01, le=10_000)]
BearingDeg = Annotated[float, Field(ge=-360, le=360)]
MassKg = Annotated[float, Field(ge=0, le=100_000)]
StrengthKpa = Annotated[float, Field(ge=1, le=100_000)]
AngleDeg = Annotated[float, Field(gt=0, lt=90)]
Fraction = Annotated[float, Field(ge=0, le=1)]

_MOST_BYTES: Final = 4 * 2**20  # of a file; those that ship have 4,000
_MOST_LEVELS: Final = 20  # of tables and lists inside each other
_MOST_CHARACTERS: Final = 10_000  # in a text of a file
# magnitudes of numbers; the ranges of most keys are narrower
_SMALLEST: Final = 1e-12
_LARGEST: Final = 1e12
_MOST_SHOWN: Final = 300  # characters of a wrong value
# Of a key that allows several forms, as pydantic names them in the location of an error
_FORM: Final = re.compile(r"bool|int|float|str|none|(constrained-|list\[|tuple\[|dict\[).*")
Table = TypeVar("Table")


def _absolute(file: str, info: ValidationInfo) -> str:
    folder: Path | None = (info.context or {}).get("folder")
    return str((folder / file).resolve()) if folder and file else file


def _absolute_unless_name(file: str, info: ValidationInfo) -> str:
    return _absolute(file, info) if Path(file).suffix else file


_FILE: Final = Field(json_schema_extra={"format": "path"})
DataFile = Annotated[str, AfterValidator(_absolute), _FILE]
"""Path of a file; `validated` makes it absolute from the folder of the configuration file."""

NameOrFile = Annotated[str, AfterValidator(_absolute_unless_name), _FILE]
"""Name of a shipped file, or a `DataFile`. A name has no suffix."""


def read_toml(file: Path, error: type[Exception]) -> dict[str, Any]:
    """Return the content of a TOML file.

    Raises:
        Exception: `error` with one line, if the file is missing, too large or no TOML.
    """
    return parse_toml(toml_text(file, error), error, str(file))


def toml_text(file: Path, error: type[Exception]) -> str:
    """Return the text of a TOML file.

    Raises:
        Exception: `error` with one line, if the file is missing, too large or no text.
    """
    try:
        data = read_bounded(file, _MOST_BYTES)
        if data.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
            raise error(f"{file}: cannot be read as TOML: is UTF-16, save it as UTF-8")
        return data.decode("utf-8-sig")  # Windows programs write a mark
    except OSError as reason:
        raise error(f"{file}: cannot be read as TOML: {reason.strerror}") from None
    except UnicodeDecodeError as reason:
        raise error(f"{file}: cannot be read as TOML: {reason}") from None


def parse_toml(text: str, error: type[Exception], where: str) -> dict[str, Any]:
    """Return the content of a text in TOML.

    Raises:
        Exception: `error` with one line that starts with `where`.
    """
    try:
        content = tomllib.loads(text)
        _check_values(content)
    except ValueError as reason:  # of tomllib, or of a whole number with too many digits
        raise error(f"{where}: cannot be read as TOML: {reason}") from None
    except RecursionError:
        raise error(f"{where}: cannot be read as TOML: nested too deeply") from None
    return content


def _check_values(value: object, where: str = "", level: int = 0) -> None:
    """Refuse what no key allows, before anything computes with it; `where` is its key."""
    if level > _MOST_LEVELS:
        raise ValueError(f"tables and lists nested more than {_MOST_LEVELS} deep")
    if isinstance(value, str) and ("\0" in value or len(value) > _MOST_CHARACTERS):
        raise ValueError(f"{where}: must be text without NUL, {_MOST_CHARACTERS} characters")
    if isinstance(value, int) and abs(value) >= 2**63:
        raise ValueError(f"{where}: must be a whole number of 64 bits")
    # NaN and infinities have a message of their own, which names the allowed range.
    size = abs(value) if isinstance(value, float) and value and math.isfinite(value) else 1.0
    if not _SMALLEST <= size <= _LARGEST:
        raise ValueError(f"{where}: got {value}, must be {_SMALLEST:g} to {_LARGEST:g} in size")
    items = value.items() if isinstance(value, Mapping) else ()
    for key, item in enumerate(value) if isinstance(value, list) else items:
        _check_values(item, f"{where}.{key}".lstrip("."), level + 1)


def validated(
    table: type[Table],
    content: Mapping[str, Any],
    error: type[Exception],
    folder: Path | None = None,
) -> Table:
    """Return the content of a file as an instance of the pydantic dataclass `table`.

    `folder` is the one from which the paths of files are made absolute; None leaves them relative.

    Raises:
        Exception: `error` with one line that names the key, the allowed values and the value.
    """
    try:
        # In strict mode, pydantic builds dataclasses from tables of JSON only, not from dicts.
        text = json.dumps(content, default=str)
        return TypeAdapter(table).validate_json(text, context={"folder": folder})
    except ValidationError as reason:
        raise error(format_validation_error(reason, table)) from None


def format_validation_error(error: ValidationError, root: type) -> str:
    """Format a pydantic error as one line that names the TOML key.

    An unknown key is reported before any other error: a misspelt key also leaves one missing.
    `root` is the dataclass of the whole file.
    """
    details = error.errors()
    unknown = (each for each in details if each["type"] == "unexpected_keyword_argument")
    first = next(unknown, _closest(details))
    keys, tables = _descend(first["loc"], root)
    where = ".".join(keys)
    if first["type"] == "unexpected_keyword_argument":
        names = [field.name for field in fields(tables[0])]
        meant = did_you_mean(keys[-1], names)
        return f"{where}: unknown key; allowed here: {', '.join(names)}{meant}"
    value = first["input"]
    given = "" if isinstance(value, Mapping) else f", got {_shown(value)}"
    if first["type"] == "union_tag_not_found":
        return f"{where}: kind is missing, must be one of {', '.join(_kinds(tables))}{given}"
    return f"{where}: {first['msg'].removeprefix('Value error, ')}{given}"


def _closest(details: Sequence[ErrorDetails]) -> ErrorDetails:
    """Return, of the errors of the first key, that of the allowed form that was nearly met.

    A key that allows several forms has an error of each: a form is nearly met where the error is
    deeper in it, or not of its kind.
    """
    key = _without_forms(details[0]["loc"])
    own = [each for each in details if _without_forms(each["loc"])[: len(key)] == key]
    return min(own, key=lambda each: (-len(each["loc"]), each["type"].endswith("_type")))


def _without_forms(location: Sequence[str | int]) -> list[str | int]:
    """Return a location without the forms of a key, which pydantic puts behind it."""
    is_form = [isinstance(part, str) and bool(_FORM.fullmatch(part)) for part in location]
    return [part for part, form in zip(location, is_form, strict=True) if not form]


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]}…"


def _descend(location: Sequence[str | int], root: type) -> tuple[list[str], list[Any]]:
    """Return the keys of a pydantic error location and the dataclasses of its table.

    A location inside a discriminated union also holds the kind, which is no key of the file.
    """
    keys: list[str] = []
    tables: list[Any] = [root]
    for part in _without_forms(location):
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
    if is_dataclass(hint):
        return [hint]
    return [table for part in get_args(hint) for table in _tables(part)]


def _kinds(tables: Sequence[Any]) -> dict[str, Any]:
    """Return the dataclasses that have a field `kind`, by the value of that field."""
    hints = ((table, get_type_hints(table).get("kind")) for table in tables)
    return {name: table for table, kind in hints for name in get_args(kind)}
