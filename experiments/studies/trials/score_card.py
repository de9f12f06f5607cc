"""Score cards of the benchmark.

The cost of a run is a length: the 95th percentile of the absolute cross-track error of the working
point, which is the tool where there is one, else the trailer's axle point, on the scored part of
the run (`definition.scored_part`). A run that does not complete costs `LOSS_M`, and no run costs
more. Over seeds the mean counts, as the expected cost: a loss counts with its frequency.

The score is the geometric mean over trials of the mean cost over the oracle's error in that trial:
how many times the error of a drive that knew all beforehand. It has no weights, and the ratio of
the scores of two entries does not depend on the oracle (Fleming and Wallace 1986, "How not to lie
with statistics: the correct way to summarize benchmark results", CACM 29(3)). Faults have no score:
what counts is the share of runs that come home.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import secrets
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import Field, TypeAdapter
from pydantic.dataclasses import dataclass

from ttempc.types import FloatArray

from ....testbed.configuration.config_io import STRICT, validated
from ....testbed.foreign_files import json_table, read_bounded
from ...errors import BadOptions, InvalidScoreCard
from ...output import refuse_existing, write_file
from ...results.statistics import IntervalEstimate, bootstrap_means, cvar95
from ...seeds import TRIALS
from ..sweep.row import RowStatus
from ..sweep.study import Seed
from .definition import identifier, is_scored, oracle_error

PUBLIC: Final = tuple(TRIALS)
"""The public seeds."""

_MOST: Final = 1000  # seeds of a file
_LARGEST: Final = 2**32 - 1
_MOST_BYTES: Final = 2**24  # of a card of 1,000 seeds


@dataclass(frozen=True, config=STRICT)
class Draws:
    """Seeds under which every trial is driven, each once."""

    kind: Literal["public", "quick", "hidden"]
    sha256: str
    """Of the seeds as text, one a line, as in an organiser's file."""
    count: Annotated[int, Field(ge=1, le=_MOST)]
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
        words = read_bounded(file, _MOST_BYTES).decode().split()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "is no text"
        raise BadOptions(f"--seeds-file {file}: cannot be read: {reason}") from None
    valid = all(re.fullmatch(r"0|[1-9][0-9]{0,9}", word) for word in words)
    seeds = tuple(map(int, words)) if valid else ()
    if not 1 <= len({*seeds}) == len(seeds) <= _MOST or max(seeds) > _LARGEST:
        raise BadOptions(
            f"--seeds-file {file}: must have 1 to {_MOST} different whole numbers from 0 to "
            f"{_LARGEST}"
        )
    return Draws("hidden", seeds_hash(seeds), len(seeds), seeds)


def draw_hidden(file: Path) -> Draws:
    """Draw as many seeds as there are public ones and write them to a new file, one a line.

    The hash does not give the seeds away: they are drawn by the system, 32 bits each.

    Raises:
        OutputExists: the file exists already or cannot be written.
    """
    refuse_existing(file)
    seeds: set[int] = set()
    while len(seeds) < len(PUBLIC):
        seeds.add(secrets.randbits(32))
    write_file(file, "".join(f"{seed}\n" for seed in seeds))
    return hidden_draws(file)


def seeds_hash(seeds: Iterable[int]) -> str:
    """Return the SHA-256 of seeds, as `sha256sum` prints it of a file with one seed a line."""
    return hashlib.sha256("".join(f"{seed}\n" for seed in seeds).encode()).hexdigest()


LOSS_M: Final = 0.5
"""Cost of a run that does not complete, and the largest cost of any run [m]; assumed."""

MARGIN: Final = 0.02
"""Entries whose costs differ by a smaller share are level."""

_LEAST_M: Final = 1e-3  # smallest cost of a trial: below, no receiver of a field could tell
_MEANS: Final = (  # of completed runs, in `TrialScore`
    *("tractor_p95_m", "peak_m", "outside"),
    *("front_rad_per_m", "trailer_rad_per_m", "hydrostat_per_m"),
)

Number = Annotated[float, Field(ge=0)] | None


@dataclass(frozen=True, kw_only=True, config=STRICT)
class TrialRun:
    """What counts of a run; a number that does not exist is None."""

    status: RowStatus | Literal["refused"]
    failure: str = ""
    working_p95_m: Number = None
    """95th percentile of the absolute cross-track error of the working point."""
    tractor_p95_m: Number = None
    """The same of the tractor's axle point."""
    peak_m: Number = None
    """Largest absolute cross-track error of the working point where the curvature changes; mean
    over the changes."""
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
        if not self.completed or self.working_p95_m is None:
            return LOSS_M
        return min(self.working_p95_m, LOSS_M)


@dataclass(frozen=True, config=STRICT)
class Interval:
    """An estimate with its 95 % confidence interval; without ends where there is one seed."""

    value: float
    low: float | None = None
    high: float | None = None

    @classmethod
    def of(cls, estimate: IntervalEstimate) -> Interval:
        """Return an estimate, rounded to 6 decimals."""
        ends = (None if x is None else round(x, 6) for x in (estimate.low, estimate.high))
        return cls(round(estimate.value, 6), *ends)

    def text(self, factor: float = 100.0, form: str = ".2f") -> str:
        """Return the estimate with its interval, of a length in cm."""
        value, *ends = (
            f"{factor * x:{form}}" for x in (self.value, self.low, self.high) if x is not None
        )
        return f"{value} ({' to '.join(ends)})" if ends else value


@dataclass(frozen=True, kw_only=True, config=STRICT)
class TrialScore:
    """Figures of a trial over its runs; all but the cost are means over completed runs."""

    cost_m: Interval
    tail_m: float
    """Mean cost of the worst 5 % of the runs."""
    not_completed: int
    oracle_m: float | None = None
    """Error of the oracle, see `definition.oracle_error`."""
    tractor_p95_m: float | None = None
    peak_m: float | None = None
    outside: float | None = None
    front_rad_per_m: float | None = None
    trailer_rad_per_m: float | None = None
    hydrostat_per_m: float | None = None
    step_p99_us: float | None = None
    """Median over runs."""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Score:
    """Figures of an entry."""

    times_oracle: Interval
    """Geometric mean over trials of mean cost over the oracle's error: the score, low is good."""
    home: float | None
    """Share of the runs with faults that complete; None: there were none."""
    runs: int
    not_completed: int
    step_p99_us: float | None = None
    """The largest of the trials."""
    trials: dict[str, TrialScore]


CARD: Final = "ttempc benchmark, card 3"
"""Kind and version of the format of cards that are made now."""

Runs = Mapping[str, tuple[TrialRun, ...]]
"""Runs of each trial, in the order of the seeds."""


def score(runs: Runs) -> Score:
    """Return the score of an entry.

    Raises:
        InvalidScoreCard: no trial is scored.
    """
    trials = {name: _trial_score(name, own) for name, own in runs.items()}
    scored = scored_runs(runs)
    if not scored:
        raise InvalidScoreCard("score: of the trials none has an oracle error")
    with_faults = [run for name, own in runs.items() if name not in scored for run in own]
    steps = [item.step_p99_us for item in trials.values() if item.step_p99_us is not None]
    times = bootstrap_means(costs(scored), lambda means: overall(means, scored))
    return Score(
        times_oracle=Interval.of(times),
        home=_share(with_faults),
        runs=sum(len(own) for own in runs.values()),
        not_completed=sum(trials[name].not_completed for name in scored),
        step_p99_us=max(steps, default=None),
        trials=trials,
    )


def scored_runs(runs: Runs) -> dict[str, tuple[TrialRun, ...]]:
    """Return the runs of the trials that count in the score."""
    return {name: own for name, own in runs.items() if oracle_error(name) and is_scored(name)}


def _share(runs: Sequence[TrialRun]) -> float | None:
    return round(sum(run.completed for run in runs) / len(runs), 6) if runs else None


def costs(runs: Runs) -> FloatArray:
    """Return the costs of all runs [m], (seeds, trials)."""
    return np.array([[run.cost_m for run in own] for own in runs.values()]).T


def overall(means: FloatArray, trials: Iterable[str]) -> FloatArray:
    """Return the scores (n,) of mean costs (n, trials): geometric means over oracle errors."""
    units = np.array([oracle_error(name) for name in trials], dtype=float)
    return np.exp(np.log(np.maximum(means, _LEAST_M) / units).mean(axis=1))


def _trial_score(trial: str, runs: tuple[TrialRun, ...]) -> TrialScore:
    cost = costs({"": runs})
    completed = [run for run in runs if run.completed]

    def numbers(name: str) -> list[float]:
        return [value for run in completed if (value := getattr(run, name)) is not None]

    found = {name: numbers(name) for name in _MEANS}
    steps = numbers("step_p99_us")
    return TrialScore(
        cost_m=Interval.of(bootstrap_means(cost, _only)),
        tail_m=round(float(cvar95(cost[:, 0], np.ones((1, len(cost))))[0]), 6),
        not_completed=len(runs) - len(completed),
        oracle_m=oracle_error(trial),
        step_p99_us=round(float(np.median(steps)), 1) if steps else None,
        **{name: round(math.fsum(own) / len(own), 6) for name, own in found.items() if own},
    )


def _only(means: FloatArray) -> FloatArray:
    return means[:, 0]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class ScoreCard:
    """Content of `score.json`."""

    format: Literal["ttempc benchmark, card 3"]
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

    def to_json(self) -> str:
        """Return the text of `score.json`: a line for each key and trial, without defaults."""
        content = TypeAdapter(ScoreCard).dump_python(self, mode="json", exclude_defaults=True)
        trials = content.pop("trials")
        lines = [f" {json.dumps(key)}: {json.dumps(value)}" for key, value in content.items()]
        by_trial = (f"  {json.dumps(name)}: {json.dumps(runs)}" for name, runs in trials.items())
        lines.append(' "trials": {\n' + ",\n".join(by_trial) + "\n }")
        return "{\n" + ",\n".join(lines) + "\n}\n"


def entry_label(controller: str, settings: Mapping[str, Any]) -> str:
    """Return a controller with its settings, in one line."""

    def leaves(table: Mapping[str, Any], prefix: str) -> Iterator[str]:
        for key, value in table.items():
            if isinstance(value, dict):
                yield from leaves(value, f"{prefix}{key}.")
            else:
                yield f"{prefix}{key}={value if isinstance(value, str) else json.dumps(value)}"

    return " ".join((controller, *sorted(leaves(settings, ""))))


def read_score_card(file: Path) -> ScoreCard:
    """Return the content of a score card whose score follows from its runs.

    Raises:
        InvalidScoreCard: the file cannot be read, is no score card, or its score is another one.
    """
    try:
        content = json_table(read_bounded(file, _MOST_BYTES))
        card = validated(ScoreCard, content, InvalidScoreCard)
    except OSError as error:
        raise InvalidScoreCard(f"{file}: cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError, InvalidScoreCard) as error:
        raise InvalidScoreCard(f"{file}: {error}") from None
    for name, runs in card.trials.items():
        if len(runs) != card.draws.count:
            raise InvalidScoreCard(
                f"{file}: trials.{name} has {len(runs)} runs, must be {card.draws.count}"
            )
    ours = card.identifier.partition("+")[0] == identifier()  # others have other weights
    if not card.trials or (ours and score(card.trials) != card.score):
        raise InvalidScoreCard(f"{file}: score does not follow from the runs in trials")
    return card


def compare_cards(first: ScoreCard, second: ScoreCard) -> dict[str, Any]:
    """Compare two entries run by run; intervals resample whole seeds.

    Returns:
        identifier, labels `first` and `second`, `ratio` of the scores of the second to the first,
        `verdict` on the second, and by scored trial the costs, the difference second minus first,
        and the runs that did not complete.

    Raises:
        InvalidScoreCard: they are of other scenarios, another plant or other seeds.
    """
    for what, one, other in (
        ("format", first.format, CARD),
        ("format", second.format, CARD),
        ("identifier", first.identifier, second.identifier),
        ("seeds", first.draws.sha256[:12], second.draws.sha256[:12]),
        ("trials", ", ".join(first.trials), ", ".join(second.trials)),
    ):
        if one != other:
            raise InvalidScoreCard(f"bench --compare: {what} {one} and {other}: must be the same")
    scored = [*scored_runs(first.trials)]
    before = costs(scored_runs(first.trials))
    after = costs(scored_runs(second.trials))
    count = len(scored)

    def of(means: FloatArray) -> FloatArray:
        return overall(means, scored)

    ratio = bootstrap_means(
        np.hstack([before, after]), lambda means: of(means[:, count:]) / of(means[:, :count])
    )
    trials = {}
    for k, name in enumerate(scored):
        one = first.score.trials[name]
        other = second.score.trials[name]
        trials[name] = {
            "first_m": one.cost_m.value,
            "second_m": other.cost_m.value,
            "difference_m": asdict(
                Interval.of(bootstrap_means((after - before)[:, k : k + 1], _only))
            ),
            "not_completed": [one.not_completed, other.not_completed],
        }
    return {
        "identifier": first.identifier,
        "first": first.label,
        "second": second.label,
        "ratio": asdict(Interval.of(ratio)),
        "verdict": verdict(*ratio.ends),
        "trials": trials,
    }


def verdict(low: float, high: float) -> str:
    """Return what the ends of the interval of a ratio of costs say of the one in the numerator."""
    if low >= 1.0 - MARGIN and high <= 1.0 + MARGIN:
        return f"level within {MARGIN:.0%}"
    return "ahead" if high < 1.0 else "behind" if low > 1.0 else "undecided"


_COLUMNS: Final = (  # head of the table, figure of `TrialScore`, factor, decimals
    ("worst 5 % [cm]", "tail_m", 100.0, 1),
    ("oracle [cm]", "oracle_m", 100.0, 2),
    ("tractor [cm]", "tractor_p95_m", 100.0, 1),
    ("peak [cm]", "peak_m", 100.0, 1),
    ("not completed", "not_completed", 1.0, 0),
    ("outside [%]", "outside", 100.0, 1),
    ("front [deg/m]", "front_rad_per_m", math.degrees(1.0), 1),
    ("trailer [deg/m]", "trailer_rad_per_m", math.degrees(1.0), 1),
    ("hydrostat [%/m]", "hydrostat_per_m", 100.0, 1),
    ("step p99 [µs]", "step_p99_us", 1.0, 0),
)


def format_card(card: ScoreCard) -> str:
    """Return the score card as plain text, with the reasons of runs that did not complete."""
    rows = [["trial", "working point [cm]", *(column[0] for column in _COLUMNS)]]
    for name, item in card.score.trials.items():
        cells = [name, item.cost_m.text()]
        for _, figure, factor, decimals in _COLUMNS:
            value = getattr(item, figure)
            cells.append("–" if value is None else f"{factor * value:.{decimals}f}")
        rows.append(cells)
    failures = [
        f"{name}: {count} {status}: {failure}"
        for name, runs in card.trials.items()
        for (status, failure), count in Counter(
            (run.status, run.failure) for run in runs if not run.completed
        ).most_common(3)
    ]
    total = card.score
    home = "" if total.home is None else f"; with faults {total.home:.0%} come home"
    end = (
        f"{card.label}, benchmark {card.identifier}, {card.draws.kind} seeds: "
        f"{total.times_oracle.text(1.0)} times the oracle's error, {total.not_completed} runs not "
        f"completed{home}"
    )
    return "\n".join([*_aligned(rows), "", *failures, end])


def format_comparison(found: Mapping[str, Any]) -> str:
    """Return what `compare_cards` found as plain text."""
    rows = [["", "A", "B", "B - A (95 % interval)", "not completed"]]
    for name, item in found["trials"].items():
        ends = [f"{100.0 * item[key]:.2f}" for key in ("first_m", "second_m")]
        lost = "{} / {}".format(*item["not_completed"])
        rows.append([name, *ends, Interval(**item["difference_m"]).text(100.0, "+.2f"), lost])
    title = f"Benchmark {found['identifier']}; costs [cm], paired by scenario and seed"
    ratio = Interval(**found["ratio"]).text(1.0, ".3f")
    end = f"Score B / A: {ratio}: B is {found['verdict']}"
    heads = [f"A: {found['first']}", f"B: {found['second']}", title]
    return "\n".join([*heads, "", *_aligned(rows), "", end])


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return lines of columns of equal width, all but the first to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]) for row in rows
    ]
