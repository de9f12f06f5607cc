"""What `ttempc envelope` found, to stand in the report of a sweep."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from experiments.errors import InvalidRows
from experiments.findings.words import numbers_text
from experiments.sweeping.envelope import QUANTITIES

_KNOWN_KEYS: Final = ConfigDict(strict=True, allow_inf_nan=False)

Value = float | str


@checked(frozen=True, config=_KNOWN_KEYS)
class Probe:
    """What happened at one value."""

    value: Value
    runs: Annotated[int, Field(ge=1)]
    failed: Annotated[int, Field(ge=0)]

    @property
    def fails(self) -> bool:
        """Return whether at least half of the runs failed."""
        return 2 * self.failed >= self.runs


@checked(frozen=True, config=_KNOWN_KEYS)
class Question:
    """What was asked."""

    scenario: str
    controller: str
    quantity: str
    limit_m: float | None
    seeds: tuple[int, ...]
    settings: dict[str, Any] = Field(default_factory=dict)  # laid over the scenario

    @property
    def rest(self) -> str:
        """Return all of it but controller and quantity, in words."""
        limit = self.limit_m
        return (
            f"{Path(self.scenario).stem}"
            + (f" with {json.dumps(self.settings, sort_keys=True)}" if self.settings else "")
            + f", seeds {numbers_text(self.seeds)}; a run fails where it is lost"
            + ("" if limit is None else f", or errs by more than {100 * limit:g} cm")
        )


@checked(frozen=True, config=_KNOWN_KEYS)
class Answer:
    """The breaking point of one controller."""

    question: Question
    outcome: Literal["found", "holds", "fails"]
    monotone: bool
    holds_at: Value | None
    fails_at: Value | None
    probes: Annotated[tuple[Probe, ...], Field(min_length=1)]


@dataclass(frozen=True, slots=True)
class Breaking:
    """The breaking points of controllers that were asked the same."""

    label: str  # the quantity with its unit
    asked: str  # the rest of the question in words
    logarithmic: bool
    answers: tuple[Answer, ...]  # of a controller each
    files: tuple[str, ...]  # that they stand in


def read_breaking(files: Sequence[Path]) -> tuple[Breaking, ...]:
    """Return what files of `ttempc envelope` hold, answers to one question together.

    Raises:
        InvalidRows: a file is none of these.
    """
    found: dict[tuple[str, str], dict[str, tuple[Answer, str]]] = {}
    for file in files:
        for answer in _answers(file):
            asked = answer.question
            same = found.setdefault((asked.quantity, asked.rest), {})
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


def _answers(file: Path) -> tuple[Answer, ...]:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        # As JSON, because only there does the strict mode take lists for tuples.
        text = json.dumps(content["envelopes"])
        answers = TypeAdapter(tuple[Answer, ...]).validate_json(text)
    except OSError as error:
        raise InvalidRows(f"{file}: cannot be read: {error.strerror}") from None
    except (ValueError, KeyError, TypeError, ValidationError):
        raise InvalidRows(f"{file}: is not what `ttempc envelope` writes") from None
    for answer in answers:
        if answer.question.quantity not in QUANTITIES:
            raise InvalidRows(f"{file}: no such quantity: {answer.question.quantity}")
    return answers
