"""What `ttempc envelope` found, to stand in the report of a sweep."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from proving_ground.testbed.configuration.config_io import validated

from ..errors import InvalidRows
from ..sweep.envelope import QUANTITIES, Envelope, EnvelopeFile, Question
from .format import numbers_text


@dataclass(frozen=True, slots=True)
class Breaking:
    """The breaking points of controllers that were asked the same."""

    label: str  # the quantity with its unit
    asked: str  # the rest of the question in words
    logarithmic: bool
    answers: tuple[Envelope, ...]  # of a controller each
    files: tuple[str, ...]  # that they stand in


def read_breaking(files: Sequence[Path]) -> tuple[Breaking, ...]:
    """Return what files of `ttempc envelope` hold, answers to one question together.

    Raises:
        InvalidRows: a file is none of these.
    """
    found: dict[tuple[str, str], dict[str, tuple[Envelope, str]]] = {}
    for file in files:
        for answer in _read(file).envelopes:
            asked = answer.question
            same = found.setdefault((asked.quantity, _rest(asked)), {})
            same[asked.controller] = answer, file.name
    return tuple(
        Breaking(
            f"{quantity.replace('-', ' ')} [{QUANTITIES[quantity].unit}]",
            rest,
            QUANTITIES[quantity].spacing == "log",
            tuple(answer for answer, _ in answers.values()),
            tuple(dict.fromkeys(name for _, name in answers.values())),
        )
        for (quantity, rest), answers in found.items()
    )


def _rest(asked: Question) -> str:
    """Return all of a question but controller, quantity and where it was looked, in words."""
    limit = asked.limit_m
    return (
        f"{Path(asked.scenario).stem}"
        + (f" with {json.dumps(asked.settings, sort_keys=True)}" if asked.settings else "")
        + f", seeds {numbers_text(asked.seeds)}; a run fails where it is lost"
        + ("" if limit is None else f", or errs by more than {100 * limit:g} cm")
    )


def _read(file: Path) -> EnvelopeFile:
    foreign = f"{file}: is not what `ttempc envelope` writes"
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InvalidRows(f"{file}: cannot be read: {error.strerror}") from None
    except ValueError:
        raise InvalidRows(foreign) from None
    if not isinstance(content, Mapping):
        raise InvalidRows(foreign)
    try:
        return validated(EnvelopeFile, content, InvalidRows)
    except InvalidRows as error:
        raise InvalidRows(f"{foreign}: {error}") from None
