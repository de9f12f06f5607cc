"""Options of a controller: a flat table of values checked against a dataclass."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from types import UnionType
from typing import Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from ..errors import InvalidTuning

_Options = TypeVar("_Options")


def parse_options(
    kind: type[_Options], values: Mapping[str, object], where: str = "controller.options"
) -> _Options:
    """Return an instance of the options dataclass `kind` with `values` in place of its defaults.

    Lists become tuples, whole numbers become floats where the field is one.

    Raises:
        InvalidTuning: an unknown name, a value of another type, or one out of its range; the
            message names the option below `where` and what is allowed.
    """
    hints = get_type_hints(kind)
    names = [item.name for item in fields(kind)]  # pyright: ignore[reportArgumentType]
    for name in values:
        if name not in names:
            raise InvalidTuning(f"{where}.{name}: unknown, allowed are {', '.join(names)}")
    entries = {
        name: _entry(f"{where}.{name}", value, hints[name]) for name, value in values.items()
    }
    try:
        return kind(**entries)
    except InvalidTuning as error:
        raise InvalidTuning(f"{where}.{error}") from None


def _entry(name: str, value: object, hint: object) -> object:
    """Return `value` as the type `hint`: bool, int, float, str, a Literal, or a tuple of them."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Literal:
        if value in inner and type(value) in {type(item) for item in inner}:
            return value
        raise InvalidTuning(f"{name}: got {value!r}, allowed are {', '.join(map(repr, inner))}")
    if origin in (Union, UnionType):
        return _of_union(name, value, inner)
    if origin is tuple:
        if not isinstance(value, list | tuple):
            raise InvalidTuning(f"{name}: got {value!r}, must be a list")
        if inner[-1] is Ellipsis:
            inner = (inner[0],) * len(value)
        if len(value) != len(inner):
            raise InvalidTuning(f"{name}: got {len(value)} values, must be {len(inner)}")
        return tuple(_entry(name, item, kind) for item, kind in zip(value, inner, strict=True))
    if hint is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if isinstance(hint, type) and type(value) is hint:
        return value
    word = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}
    allowed = word.get(hint, str(hint)) if isinstance(hint, type) else str(hint)
    raise InvalidTuning(f"{name}: got {value!r}, must be {allowed}")


def _of_union(name: str, value: object, kinds: tuple[object, ...]) -> object:
    messages: list[str] = []
    for kind in kinds:
        if kind is type(None):
            if value is None:
                return None
            continue
        try:
            return _entry(name, value, kind)
        except InvalidTuning as error:
            messages.append(str(error))
    raise InvalidTuning(messages[0])
