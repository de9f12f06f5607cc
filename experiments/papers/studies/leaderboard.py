"""Leaderboard of the benchmark: entries driven here, and score cards of others.

An entry's cost is the 95th percentile of the absolute cross-track error of the working point, the
tool where there is one, else the trailer's axle point; losses count, see `trials.score_card`.

How much the benchmark can tell is measured on six serious entries: the pairs that a trial
separates, the share of each trial in the variance of the log ratio of two entries, and whether a
second set of seeds gives the same verdicts.
"""

import itertools
import re
from collections.abc import Sequence
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ....testbed.recording.provenance import code_digest
from ...output import write_file
from ...pictures.sweep_report.format import format_numbers
from ...results.statistics import resampled_means
from ...seeds import CHECKS
from ...studies.trials.bench import Entrant, bench
from ...studies.trials.definition import trial_files, weights
from ...studies.trials.score_card import (
    LOSS_M,
    MARGIN,
    PUBLIC,
    Interval,
    ScoreCard,
    compare_cards,
    costs,
    overall,
    public_draws,
    read_score_card,
)
from ..markdown import markdown
from ..runner import Runner
from ..table import Block, Table

CARDS: Final = "cards"
"""Folder of the score cards, among the kept rows: those made here, and those that others sent."""

SHIPPED: Final = (
    ("ttempc",),
    ("ttempc", "controller.options.robust=false"),
    ("ttempc", "controller.options.tube=false"),
    ("ttempc", "controller.options.robust=false", "controller.options.tube=false"),
    ("ttempc", "controller.learn=false"),
    ("ttempc", "controller.detect=false"),
    ("ttempc", "controller.compensate=false"),
    ("ttempc-nominal",),
    ("nmpc-rti",),
    ("lqr",),
    ("pid",),
    ("romea-backstepping",),
    ("romea-predictive",),
)
"""Shipped controllers, and parts of the default switched off, as of `--set`."""

OTHERS: Final = (
    ("geometric:Stanley",),
    ("geometric:PurePursuit",),
    ("casadi_mpc:CasadiMpc",),
    ("learnt_policy:learnt",),
)
"""Controllers of docs/examples, written against the public interface."""

SERIOUS: Final = ("ttempc", "ttempc-nominal", "nmpc-rti", "lqr", "pid", "geometric:Stanley")
"""Entries on which the trials' power to separate is measured; Stanley's law is far from all."""

_SEPARATED: Final = 3.0  # |t| of a paired difference of costs

FAULTS: Final = "faults"
"""Trial without a weight in the score: what comes home of its runs is a column of its own."""

HEADLINE: Final = ("ttempc", "pid", "lqr", "nmpc-rti")
_ABOUT: Final = {
    "corridor": "crop rows of +-6 cm on a soft slope",
    "faults": "one of ten faults a run",
    "headland": "loops at the stops, wet slope",
    "line-entry": "entry from 2 m beside a pass, side slope",
    "reverse": "a lap in reverse, gentle side slope",
    "rough-grass": "rough grass",
    "ruts": "two laps in one's own ruts",
    "slow-valve": "steering of 8 deg/s",
    "tool": "cultivator on a side slope: the tool",
    "wet-slope": "wet slope",
    "wood": "wet slope at the edge of a wood",
    "worn-valves": "worn valves",
}


def make(runner: Runner) -> str:
    """Return the leaderboard of the entries driven here and of the cards of others."""
    folder = runner.folder / CARDS
    made = []
    for name, *changes in (*SHIPPED, *OTHERS):
        entrant = Entrant.of(name, changes)
        made.append(_driven(runner, entrant, PUBLIC))
        write_file(folder / f"{entrant.stem}.json", made[-1].to_json().encode())

    cards = [read_score_card(file) for file in sorted(folder.glob("*.json"))]
    own = (made[0].identifier, made[0].draws.sha256)
    same = [card for card in cards if (card.identifier, card.draws.sha256) == own]
    parts = [leaderboard(same)]
    if left_out := [card for card in cards if card not in same]:
        listed = ", ".join(f"`{entry(card)}` ({card.identifier})" for card in left_out)
        parts.append(f"Of other versions or seeds, not shown: {listed}.")
    return "\n\n".join(parts)


def _driven(runner: Runner, entrant: Entrant, seeds: tuple[int, ...]) -> ScoreCard:
    draws = public_draws(seeds)
    folder = runner.folder / code_digest() / f"bench-{draws.sha256[:8]}-{entrant.stem}"
    with runner.engine() as workers:
        return bench(entrant, draws, folder, workers)


def _serious(runner: Runner, seeds: tuple[int, ...]) -> list[ScoreCard]:
    return [_driven(runner, Entrant.of(name, ()), seeds) for name in SERIOUS]


def make_power(runner: Runner) -> Block:
    """Return what the trials tell apart, and the verdicts of two sets of seeds."""
    sets = {seeds: _serious(runner, seeds) for seeds in (PUBLIC, tuple(CHECKS))}
    first, second = sets.values()
    numbers = pair_numbers(first)
    shares = variance_shares(first)
    lines = [
        (
            name,
            f"{(np.abs(row) > _SEPARATED).sum()} of {len(row)}",
            f"{weights()[name]:.2f}",
            f"{100.0 * share:.0f}",
        )
        for name, row, share in zip(first[0].trials, numbers.T, shares.max(axis=0), strict=True)
    ]
    pairs = [*itertools.combinations(range(len(SERIOUS)), 2)]
    verdicts = []
    for one, other in pairs:
        found = [compare_cards(cards[one], cards[other]) for cards in (first, second)]
        ratios = (Interval(**item["ratio"]).text(1.0, ".3f") for item in found)
        said = (item["verdict"] for item in found)
        verdicts.append((f"`{entry(first[other])}` / `{entry(first[one])}`", *ratios, *said))
    heads = [f"seeds {format_numbers(seeds)}" for seeds in sets]
    differing = [{*pair[3:]} for pair in verdicts if pair[3] != pair[4]]
    against = sum("undecided" not in said for said in differing)
    same = f"{len(pairs) - len(differing)} of {len(pairs)} are the same, {against} contradict"
    columns = (
        "trial",
        f"pairs with t above {_SEPARATED:g}",
        "weight",
        "largest variance share [%]",
    )
    text = f"Ratio of the overall costs, and what it says of the first; of the verdicts {same}:"
    return Block(
        "\n\n".join((markdown(columns, lines), text, markdown(("pair", *heads, *heads), verdicts)))
    )


def _gaps(tables: Sequence[FloatArray]) -> FloatArray:
    """Return second less first table (seeds, trials) of each pair, (pairs, seeds, trials)."""
    return np.array([b - a for a, b in itertools.combinations(tables, 2)])


def pair_numbers(cards: Sequence[ScoreCard]) -> FloatArray:
    """Return Student's t of the paired difference of costs, (pairs, trials); 0 of equal costs."""
    gaps = _gaps([costs(card.trials) for card in cards])
    spread = gaps.std(axis=1, ddof=1) / np.sqrt(gaps.shape[1])
    equal = np.where(gaps.mean(axis=1) == 0.0, 0.0, np.inf)
    return np.divide(gaps.mean(axis=1), spread, out=equal, where=spread > 0.0)


def variance_shares(cards: Sequence[ScoreCard]) -> FloatArray:
    """Return shares of trials in the variance of the log ratio of two entries, (pairs, trials)."""
    weight = np.array([weights()[name] for name in cards[0].trials])
    found = [costs(card.trials) for card in cards]
    logs = _gaps([cost / cost.mean(axis=0) for cost in found])  # linearised at the means
    parts = weight**2 * logs.var(axis=1, ddof=1)
    return parts / parts.sum(axis=1, keepdims=True)


def entry(card: ScoreCard) -> str:
    """Return the name of an entry; of an own controller, without its module."""
    return re.sub(r"^[\w.]+:", "", card.label)


def headline(shown: Sequence[ScoreCard]) -> Block:
    """Return the short table of README from the cards of `HEADLINE`, and who is ahead where."""
    lines = [
        (
            f"`{name}`: {about}",
            *(f"{100.0 * card.score.trials[name].cost_m.value:.1f}" for card in shown),
        )
        for name, about in _ABOUT.items()
    ]
    overall = (f"{100.0 * card.score.cost_m.value:.2f}" for card in shown)
    heads = ("cross-track p95 of the working point [cm]", *(f"`{name}`" for name in HEADLINE))
    first = shown[0]
    footer = (
        f"<sub>Cards of the simulated benchmark `{first.identifier}`: mean over "
        f"{first.draws.count} public seeds ({format_numbers(PUBLIC)}), a run that does "
        f"not complete counts {LOSS_M:g} m, trials are weighted; level: within {MARGIN:.0%} or not "
        "told apart; `ttempc bench NAME`; "
        "[all entries and intervals](docs/results.md#benchmark)</sub>"
    )
    lines += [
        ("all, weighted geometric mean", *overall),
        (f"not completed, of {first.score.runs}", *(f"{c.score.not_completed}" for c in shown)),
    ]
    said = "\n".join(_beside(first, card) for card in shown[1:])
    return Block(f"{markdown(heads, lines)}\n\n{said}", footer=footer)


def _beside(first: ScoreCard, other: ScoreCard) -> str:
    """Return the ratio of the costs of another entry to the first, and where it is as good."""
    found = compare_cards(first, other)
    places: dict[str, list[str]] = {"ahead": [], "level": [], "behind": []}
    for name, trial in found["trials"].items():
        ends = (trial["difference_m"][end] or 0.0 for end in ("low", "high"))
        low, high = (end / trial["first_m"] for end in ends)
        where = "behind" if low > MARGIN else "ahead" if high < -MARGIN else "level"
        places[where].append(f"`{name}`")
    parts = "; ".join(f"{how} in {', '.join(names)}" for how, names in places.items() if names)
    ratio = Interval(**found["ratio"]).text(1.0, ".3f")
    return f"- `{entry(other)}`: cost {ratio} times that of `{entry(first)}`; {parts}."


def leaderboard(cards: Sequence[ScoreCard]) -> str:
    """Return the cards of one identifier as Markdown tables, the least cost first."""
    first = cards[0]
    ordered = sorted(cards, key=lambda card: card.score.cost_m.value)
    names = [*trial_files()]
    holds = rank_shares(ordered)
    lines = []
    by_trial = []
    for card, held in zip(ordered, holds, strict=True):
        item = card.score
        outside = [t.outside for t in item.trials.values() if t.outside is not None]
        faults = item.trials.get(FAULTS)
        step = item.step_p99_us
        lines.append(
            (
                f"`{entry(card)}`",
                item.cost_m.text(),
                f"{100.0 * held:.0f}",
                f"{item.not_completed} of {item.runs}",
                f"{card.draws.count - faults.not_completed}" if faults else "–",
                f"{100.0 * max(outside):.1f}" if outside else "–",
                "–" if step is None else f"{1e-3 * step:.2f}",
            )
        )
        costs = (f"{100 * item.trials[name].cost_m.value:.1f}" for name in names)
        by_trial.append((f"`{entry(card)}`", *costs))
    keys = ("processor", "cores", "system")
    machines = {", ".join(f"{k} {card.machine.get(k, '?')}" for k in keys): None for card in cards}
    loads = sorted(float(card.machine.get("load") or "nan") for card in cards)
    heads = (
        "entry",
        "cost [cm]",
        "has this rank [%]",
        "not completed",
        "faults survived",
        "outside rows [%]",
        "step p99 [ms]",
    )
    count = f"{first.draws.count} seed{'s' if first.draws.count > 1 else ''}"
    return "\n\n".join(
        (
            f"Benchmark `{first.identifier}`, {count}.",
            "Cost: p95 of the cross-track error of the working point, losses counted.",
            markdown(heads, lines),
            "Mean cost by scenario [cm]:",
            markdown(("entry", *names), by_trial),
            f"Steps were timed on: {'; '.join(machines)}; load {loads[0]:g} to {loads[-1]:g}. A "
            "load above the number of cores makes them longer.",
        )
    )


def rank_shares(ordered: Sequence[ScoreCard]) -> FloatArray:
    """Return in which share of resamples of the seeds each entry has the rank it has here, (n,)."""
    tables = [costs(card.trials) for card in ordered]
    if len(tables[0]) < 2:
        return np.full(len(ordered), np.nan)
    trials = tables[0].shape[1]
    means = resampled_means(np.hstack(tables))
    found = np.array(
        [
            overall(means[:, k * trials : (k + 1) * trials], card.trials)
            for k, card in enumerate(ordered)
        ]
    )
    return (found.argsort(axis=0).argsort(axis=0) == np.arange(len(ordered))[:, None]).mean(axis=1)


TABLES: Final = (
    Table(
        name="field-trials",
        make=make,
        seeds=PUBLIC,
        checks=(
            *(
                (field, "ttempc")
                for field in ("wet-slope", "old-valves", "cultivate", "rows", "grass-field")
            ),
            *(("grass", *words) for words in SHIPPED),
        ),
    ),
    Table(name="trial-power", make=make_power, seeds=(*PUBLIC, *CHECKS), checks=()),
    Table(
        name="headline",
        make=lambda runner: headline(
            [_driven(runner, Entrant.of(name, ()), PUBLIC) for name in HEADLINE]
        ),
    ),
)
