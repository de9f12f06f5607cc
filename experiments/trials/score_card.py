"""Score card of an entry: its runs, its score, and where and by what it was made."""

from __future__ import annotations

import json
import typing
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, TypeAdapter
from pydantic.dataclasses import dataclass

from ...testbed.bounded_read import read_bounded
from ...testbed.configuration.config_io import STRICT, validated
from ..errors import InvalidScoreCard
from .draws import Draws
from .score import Score, TrialRun, score

_MOST_BYTES = 2**24  # of 1,000 seeds

Format = Literal["ttempc field trials, card 1"]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class ScoreCard:
    """Content of `score.json`."""

    format: Format = typing.get_args(Format)[0]
    """Kind and version of this format."""
    identifier: str
    """Version and content hash of the trials; with the digest of the code if that changes the
    plant."""
    controller: str
    """Name of the entry's controller."""
    settings: dict[str, Any] = Field(default_factory=dict)
    """Its values of `[controller]` that are not the defaults."""
    source: str = ""
    """Hash of the source of an own controller or estimator."""
    draws: Draws
    """Seeds of the runs."""
    machine: dict[str, str]
    """That measured the computation times."""
    versions: dict[str, str]
    """Of the software."""
    score: Score
    """Follows from `trials`."""
    trials: dict[str, tuple[TrialRun, ...]]
    """Runs of each trial in the order of the seeds."""

    @property
    def label(self) -> str:
        """Return the controller with its settings, in one line."""
        return entry_label(self.controller, self.settings)

    @property
    def badge(self) -> str:
        """Return identifier, entry and score in one line."""
        cost, lost = self.score.cost_m, self.score.not_completed
        ends = (
            "" if cost.low is None else f" ({100 * cost.low:.2f} to {100 * (cost.high or 0):.2f})"
        )
        seeds = {"public": "", "quick": ", quick", "hidden": f", hidden {self.draws.sha256[:8]}"}
        return (
            f"field trials {self.identifier}{seeds[self.draws.kind]} | {self.label} | "
            f"{100 * cost.value:.2f}{ends} cm | {lost} of {self.score.runs} not completed"
        )

    def to_json(self) -> str:
        """Return the text of `score.json`: one line a key and a trial."""
        content = _without_defaults(asdict(self))
        trials = content.pop("trials")
        lines = [f" {json.dumps(key)}: {_compact(value)}" for key, value in content.items()]
        by_trial = (f"  {json.dumps(name)}: {_compact(runs)}" for name, runs in trials.items())
        lines.append(' "trials": {\n' + ",\n".join(by_trial) + "\n }")
        return "{\n" + ",\n".join(lines) + "\n}\n"


def entry_label(controller: str, settings: Mapping[str, Any]) -> str:
    """Return a controller with its settings, in one line."""
    leaves = sorted(_leaves(settings).items())
    return " ".join((controller, *(f"{key}={_plain(value)}" for key, value in leaves)))


def read_score_card(file: Path) -> ScoreCard:
    """Return the content of a score card whose score follows from its runs.

    Raises:
        InvalidScoreCard: the file cannot be read, is no score card, or its score is another one.
    """
    try:
        content = json.loads(read_bounded(file, _MOST_BYTES))
    except OSError as error:
        raise InvalidScoreCard(f"{file}: cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:
        raise InvalidScoreCard(f"{file}: is no JSON: {error}") from None
    if not isinstance(content, dict):
        raise InvalidScoreCard(f"{file}: must be an object")
    try:
        card = validated(ScoreCard, content, InvalidScoreCard)
    except InvalidScoreCard as error:
        raise InvalidScoreCard(f"{file}: {error}") from None
    for name, runs in card.trials.items():
        if len(runs) != card.draws.count:
            raise InvalidScoreCard(
                f"{file}: trials.{name} has {len(runs)} runs, must be {card.draws.count}"
            )
    if not card.trials or score(card.trials) != card.score:
        raise InvalidScoreCard(f"{file}: score does not follow from the runs in trials")
    return card


def card_schema() -> dict[str, Any]:
    """Return the JSON schema of a score card (draft 2020-12)."""
    schema = TypeAdapter(ScoreCard).json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _leaves(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    leaves: dict[str, Any] = {}
    for key, value in table.items():
        inside = isinstance(value, dict)
        leaves |= _leaves(value, f"{prefix}{key}.") if inside else {f"{prefix}{key}": value}
    return leaves


def _plain(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _compact(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def _without_defaults(content: dict[str, Any]) -> dict[str, Any]:
    """Leave out the numbers of runs that do not exist, and seeds that are not told."""
    runs = {
        name: [{k: v for k, v in run.items() if v is not None and v != ""} for run in own]
        for name, own in content["trials"].items()
    }
    draws = {key: value for key, value in content["draws"].items() if value is not None}
    return {**content, "draws": draws, "trials": runs}
