"""Code that a file names runs only if the user names it, too, or says so."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ..errors import InvalidScenario
from ..scenario.scenario import Scenario
from .user_code import is_user_code


def refuse_untrusted(
    file: Path, parts: Iterable[tuple[str, str]], changes: Mapping[str, Any]
) -> None:
    """Refuse a file that names code which the user's own changes do not name.

    Args:
        file: of the scenario, for the message.
        parts: key and name of each part, as from `named_parts`.
        changes: tables that the user gave on the command line.

    Raises:
        InvalidScenario: with the name of the code, and what allows it.
    """
    own = set(_texts(changes))
    for key, name in parts:
        if is_user_code(name) and name not in own:
            raise InvalidScenario(
                f"{file}: {key} = {name!r} is code that this file asks to run; if you trust it, "
                "give --trust, or name it yourself with --controller or --set"
            )


def named_parts(scenario: Scenario) -> list[tuple[str, str]]:
    """Return key and name of every part of a scenario that may be a user's code."""
    settings = scenario.controller
    parts = [("controller.name", settings.name), ("controller.estimator", settings.estimator)]
    return parts + [("stages.make", stage.make) for stage in scenario.stages]


def _texts(value: object) -> Iterator[str]:
    """Yield every text in nested tables and lists."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for item in value.values():
            yield from _texts(item)
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _texts(item)
