"""Score cards of the benchmark: seeds, scores, files, paired comparison.

The cost of a run is a length: the 95th percentile of the absolute cross-track error of the working
point, which is the tool where there is one, else the trailer's axle point. A run that does not
complete costs `LOSS_M`, and so does the share of the time outside the corridor. Over seeds the mean
counts, as the expected cost: a loss counts with its frequency. Over scenarios the geometric mean
counts: the order of two entries does not depend on the scale of a scenario (Fleming and Wallace
1986, "How not to lie with statistics: the correct way to summarize benchmark results", CACM 29(3)),
and no hard scenario outweighs the others.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import secrets
import typing
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import Field, TypeAdapter
from pydantic.dataclasses import dataclass

from ttempc.types import FloatArray

from ...testbed.bounded_read import read_bounded
from ...testbed.configuration.config_io import STRICT, validated
from ..errors import BadOptions, InvalidScoreCard
from ..output import refuse_existing, write_file
from ..results.statistics import IntervalEstimate, bootstrap_means, cvar95
from ..seeds import TRIALS
from ..sweep.row import RowStatus
from ..sweep.study import Seed

PUBLIC: Final = tuple(TRIALS)
"""The public seeds."""

MOST: Final = 1000
"""Largest number of seeds of a file."""

_LARGEST: Final = 2**32 - 1
_MOST_BYTES: Final = 2**24  # of a card of 1,000 seeds


@dataclass(frozen=True, config=STRICT)
class Draws:
    """Seeds under which every trial is driven, each once."""

    kind: Literal["public", "quick", "hidden"]
    sha256: str
    """Of the seeds as text, one a line: that of an organiser's file."""
    count: Annotated[int, Field(ge=1, le=MOST)]
    seeds: tuple[Seed, ...] | None = None
    """The seeds; absent in the score card of hidden ones."""


def public_draws(seeds: tuple[int, ...] = PUBLIC) -> Draws:
    """Return public seeds; others than all of them make a quick bench."""
    kind = "public" if seeds == PUBLIC else "quick"
    return Draws(kind, seeds_hash(seeds), len(seeds), seeds)


def hidden_draws(file: Path) -> Draws:
    """Return the seeds of an organiser's file, whole numbers separated by white space.

    Raises:
        BadOptions: the file cannot be read, or its content is not allowed.
    """
    try:
        words = file.read_text(encoding="utf-8").split()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "is no text"
        raise BadOptions(f"--seeds-file {file}: cannot be read: {reason}") from None
    if not 1 <= len(words) <= MOST or len({*words}) < len(words):
        raise BadOptions(
            f"--seeds-file {file}: has {len(words)} seeds, must have 1 to {MOST}, each once"
        )
    for word in words:
        if not re.fullmatch(r"0|[1-9][0-9]{0,9}", word) or int(word) > _LARGEST:
            raise BadOptions(
                f"--seeds-file {file}: {word[:40]!r} must be a whole number from 0 to {_LARGEST}"
            )
    seeds = tuple(int(word) for word in words)
    return Draws("hidden", seeds_hash(seeds), len(seeds), seeds)


def draw_hidden(file: Path) -> Draws:
    """Draw as many seeds as there are public ones and write them to a new file, one a line.

    The hash does not give the seeds away: they are drawn by the system, 32 bits each.

    Raises:
        OutputExists: the file exists already or cannot be written.
    """
    refuse_existing(file)
    seeds: dict[int, None] = {}
    while len(seeds) < len(PUBLIC):
        seeds[secrets.randbits(32)] = None
    write_file(file, _text((*seeds,)))
    return hidden_draws(file)


def seeds_hash(seeds: tuple[int, ...]) -> str:
    """Return the SHA-256 of seeds, as `sha256sum` prints it of a file with one seed a line."""
    return hashlib.sha256(_text(seeds).encode()).hexdigest()


def _text(seeds: tuple[int, ...]) -> str:
    return "".join(f"{seed}\n" for seed in seeds)


LOSS_M: Final = 1.0
"""Cost of a run that does not complete, and the largest cost of any run [m]; assumed."""

_LEAST_M: Final = 1e-3  # smallest cost of a trial: below, no receiver of a field could tell

Number = Annotated[float, Field(ge=0)] | None
Status = RowStatus | Literal["refused"]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class TrialRun:
    """What counts of a run; a number that does not exist is None."""

    status: Status
    failure: str = ""
    trailer_p95_m: Number = None
    """95th percentile of the absolute cross-track error."""
    tool_p95_m: Number = None
    trailer_max_m: Number = None
    """Largest Euclidean error."""
    outside: Annotated[float, Field(ge=0, le=1)] | None = None
    """Share of the time outside the corridor, of the point that is outside longest."""
    front_rad_per_m: Number = None
    """Travel of the front steering's command over the distance driven."""
    trailer_rad_per_m: Number = None
    hydrostat_per_m: Number = None
    step_p99_us: Number = None
    """99th percentile of the time of the controller's step."""

    @property
    def completed(self) -> bool:
        """Return whether the run ended at the end of its path."""
        return self.status == "completed"

    @property
    def cost_m(self) -> float:
        """Return the cost of the run [m]."""
        error = self.trailer_p95_m if self.tool_p95_m is None else self.tool_p95_m
        if not self.completed or error is None:
            return LOSS_M
        outside = self.outside or 0.0
        return (1.0 - outside) * min(error, LOSS_M) + outside * LOSS_M


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Interval:
    """An estimate with its 95 % confidence interval; without ends where there is one seed."""

    value: float
    low: float | None
    high: float | None

    @classmethod
    def of(cls, estimate: IntervalEstimate, factor: float = 1.0) -> Interval:
        """Return an estimate times a factor, rounded to 6 decimals."""
        ends = (estimate.value, estimate.low, estimate.high)
        value, low, high = (None if x is None else round(factor * x, 6) for x in ends)
        assert value is not None
        return cls(value=value, low=low, high=high)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class TrialScore:
    """Figures of a trial over its runs; means of errors and travel are those of completed runs."""

    cost_m: Interval
    tail_m: float
    """Mean cost of the worst 5 % of the runs."""
    not_completed: int
    trailer_p95_m: float | None
    tool_p95_m: float | None
    trailer_max_m: float | None
    """The largest of all runs."""
    outside: float | None
    front_rad_per_m: float | None
    trailer_rad_per_m: float | None
    hydrostat_per_m: float | None
    step_p99_us: float | None
    """Median over runs."""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Score:
    """Figures of an entry."""

    cost_m: Interval
    """Geometric mean over trials of the mean costs: the overall figure, less is better."""
    runs: int
    not_completed: int
    step_p99_us: float | None
    """The largest of the trials."""
    trials: dict[str, TrialScore]


Runs = Mapping[str, tuple[TrialRun, ...]]
"""Runs of each trial, in the order of the seeds."""


def score(runs: Runs) -> Score:
    """Return the score of an entry."""
    trials = {name: _trial_score(own) for name, own in runs.items()}
    steps = [item.step_p99_us for item in trials.values() if item.step_p99_us is not None]
    return Score(
        cost_m=Interval.of(bootstrap_means(costs(runs), overall)),
        runs=sum(len(own) for own in runs.values()),
        not_completed=sum(item.not_completed for item in trials.values()),
        step_p99_us=max(steps, default=None),
        trials=trials,
    )


def costs(runs: Runs) -> FloatArray:
    """Return the costs of all runs [m], (seeds, trials)."""
    return np.array([[run.cost_m for run in own] for own in runs.values()]).T


def overall(means: FloatArray) -> FloatArray:
    """Return the geometric mean of mean costs over trials: (n, trials) -> (n,)."""
    return np.exp(np.log(np.maximum(means, _LEAST_M)).mean(axis=1))


def _trial_score(runs: tuple[TrialRun, ...]) -> TrialScore:
    cost = costs({"": runs})
    completed = [run for run in runs if run.completed]

    def numbers(name: str) -> list[float]:
        values = (getattr(run, name) for run in completed)
        return [value for value in values if value is not None]

    def mean(name: str) -> float | None:
        values = numbers(name)
        return round(math.fsum(values) / len(values), 6) if values else None

    steps = numbers("step_p99_us")
    return TrialScore(
        cost_m=Interval.of(bootstrap_means(cost, lambda means: means[:, 0])),
        tail_m=round(float(cvar95(cost[:, 0], np.ones((1, len(cost))))[0]), 6),
        not_completed=len(runs) - len(completed),
        trailer_p95_m=mean("trailer_p95_m"),
        tool_p95_m=mean("tool_p95_m"),
        trailer_max_m=max(numbers("trailer_max_m"), default=None),
        outside=mean("outside"),
        front_rad_per_m=mean("front_rad_per_m"),
        trailer_rad_per_m=mean("trailer_rad_per_m"),
        hydrostat_per_m=mean("hydrostat_per_m"),
        step_p99_us=round(float(np.median(steps)), 1) if steps else None,
    )


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


def compare_cards(first: ScoreCard, second: ScoreCard) -> dict[str, Any]:
    """Compare two entries run by run; intervals resample whole seeds.

    Returns:
        identifier, labels `first` and `second`, `ratio` of the overall costs of the second to the
        first, and by scenario the costs, the difference second minus first, and the runs that did
        not complete.

    Raises:
        InvalidScoreCard: they are of other scenarios, another plant or other seeds.
    """
    for what, one, other in (
        ("identifier", first.identifier, second.identifier),
        ("seeds", first.draws.sha256[:12], second.draws.sha256[:12]),
        ("trials", ", ".join(first.trials), ", ".join(second.trials)),
    ):
        if one != other:
            raise InvalidScoreCard(f"bench --compare: {what} {one} and {other}: must be the same")
    before, after = costs(first.trials), costs(second.trials)
    count = len(first.trials)
    ratio = bootstrap_means(
        np.hstack([before, after]),
        lambda means: overall(means[:, count:]) / overall(means[:, :count]),
    )
    trials = {}
    for k, name in enumerate(first.trials):
        gap = bootstrap_means((after - before)[:, k : k + 1], lambda means: means[:, 0])
        one, other = first.score.trials[name], second.score.trials[name]
        trials[name] = {
            "first_m": one.cost_m.value,
            "second_m": other.cost_m.value,
            "difference_m": asdict(Interval.of(gap)),
            "not_completed": [one.not_completed, other.not_completed],
        }
    return {
        "identifier": first.identifier,
        "first": first.label,
        "second": second.label,
        "ratio": asdict(Interval.of(ratio)),
        "trials": trials,
    }
