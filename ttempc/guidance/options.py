"""Options of a controller: a flat table of values for an options dataclass."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import TypeVar

from ..errors import InvalidTuning
from ..suggestion import did_you_mean

_Options = TypeVar("_Options")


def parse_options(
    kind: type[_Options], values: Mapping[str, object], where: str = "controller.options"
) -> _Options:
    """Return an instance of the options dataclass `kind` with `values` in place of its defaults.

    Lists become tuples, whole numbers become floats where the default is one. The dataclass
    itself checks types and ranges.

    Raises:
        InvalidTuning: an unknown name, a value of another type, or one out of its range; the
            message names the option below `where` and what is allowed.
    """
    defaults = {
        item.name: item.default
        for item in fields(kind)  # pyright: ignore[reportArgumentType] - a dataclass
    }
    for name in values:
        if name not in defaults:
            raise InvalidTuning(
                f"{where}.{name}: unknown, allowed are {', '.join(defaults)}"
                f"{did_you_mean(name, defaults)}"
            )
    entries = {name: _like(defaults[name], value) for name, value in values.items()}
    try:
        return kind(**entries)
    except InvalidTuning as error:
        raise InvalidTuning(f"{where}.{error}") from None


def _like(default: object, value: object) -> object:
    """Return `value` with lists as tuples, and whole numbers as floats where `default` has them."""
    if isinstance(default, tuple) and isinstance(value, list | tuple):
        return tuple(_like(default[0], entry) for entry in value)
    return float(value) if isinstance(default, float) and type(value) is int else value
