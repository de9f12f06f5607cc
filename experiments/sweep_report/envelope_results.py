"""Results of `ttempc search limit` for the report of a sweep."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...testbed.configuration.config_io import validated
from ..errors import InvalidRows
from ..search.limit import Envelope, EnvelopeFile, Question
from .format import format_numbers


@dataclass(frozen=True, slots=True)
class EnvelopeResults:
    """Envelopes of several controllers, searched with the same settings."""

    label: str  # the quantity with its unit
    settings: str  # scenario, seeds and criterion of failure as text
    logarithmic: bool
    envelopes: tuple[Envelope, ...]  # one per controller
    files: tuple[str, ...]  # names of their files


def read_envelopes(files: Sequence[Path]) -> tuple[EnvelopeResults, ...]:
    """Return the content of files of `ttempc search limit`, grouped by equal settings.

    Raises:
        InvalidRows: a file is not one of these.
    """
    groups: dict[tuple[str, str], dict[str, tuple[Envelope, str]]] = {}
    for file in files:
        for envelope in _read(file).envelopes:
            question = envelope.question
            group = groups.setdefault((question.label, _settings(question)), {})
            group[question.controller] = envelope, file.name
    return tuple(
        EnvelopeResults(
            label.replace("-", " "),
            settings,
            next(iter(group.values()))[0].question.parameter.spacing == "log",
            tuple(envelope for envelope, _ in group.values()),
            tuple(dict.fromkeys(name for _, name in group.values())),
        )
        for (label, settings), group in groups.items()
    )


def _settings(question: Question) -> str:
    """Return scenario, seeds and criterion of failure as text."""
    limit = question.limit_m
    return (
        f"{Path(question.scenario).stem}"
        + (f" with {json.dumps(question.settings, sort_keys=True)}" if question.settings else "")
        + f", seeds {format_numbers(question.seeds)}; a run fails where it does not complete"
        + ("" if limit is None else f", or errs by more than {100 * limit:g} cm")
    )


def _read(file: Path) -> EnvelopeFile:
    foreign = f"{file}: is not what `ttempc search limit` writes"
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InvalidRows(f"{file}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError):
        raise InvalidRows(foreign) from None
    if not isinstance(content, Mapping):
        raise InvalidRows(foreign)
    try:
        return validated(EnvelopeFile, content, InvalidRows)
    except InvalidRows as error:
        raise InvalidRows(f"{foreign}: {error}") from None
