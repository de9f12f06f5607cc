"""Leaderboard of the benchmark: entries driven here, and score cards of others.

An entry's score is the geometric mean over trials of its error over the oracle's, see
`trials.score_card`. How much the benchmark can tell is measured on six serious entries: the pairs
that a trial separates, and whether a second set of seeds gives the same verdicts.
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
    scored_runs,
)
from ..markdown import markdown
from ..runner import Runner
from ..table import Block, Table

CARDS: Final = "cards"
"""Folder of the score cards, among the kept rows: those made here, and those that others sent."""

SHIPPED: Final = (
    "ttempc",
    "ttempc-nominal",
    "nmpc-rti",
    "romea-predictive",
    "romea-backstepping",
    "lqr",
    "pid",
)
"""Shipped controllers. What a part of the default does is the question of the table `ablation`."""

OTHERS: Final = (
    "geometric:Stanley",
    "geometric:PurePursuit",
    "casadi_mpc:CasadiMpc",
    "learnt_policy:learnt",
)
"""Controllers of docs/examples, written against the public interface."""

SERIOUS: Final = ("ttempc", "ttempc-nominal", "nmpc-rti", "lqr", "pid", "geometric:Stanley")
"""Entries on which the trials' power to separate is measured; Stanley's law is far from all."""

_SEPARATED: Final = 3.0  # |t| of a paired difference of costs

HEADLINE: Final = ("ttempc", "pid", "lqr", "romea-predictive", "nmpc-rti")
_ABOUT: Final = {
    "corridor": "crop rows on a soft slope, 1 m/s",
    "fast-eight": "wide figure eight, 15 km/h",
    "fast-slope": "passes on a side slope, 15 km/h",
    "fast-tool": "passes with a cultivator, 15 km/h: the tool",
    "headland": "passes between loops near the stops, wet slope, 1 m/s",
    "reverse": "a lap in reverse, gentle side slope, 1 m/s",
    "rough-grass": "rough grass, 1 m/s",
    "wet-slope": "wet slope, 1 m/s",
    "work-eight": "wide figure eight, 10 km/h",
    "work-plain": "plain trailer, 10 km/h",
    "work-tool": "passes with a cultivator, 10 km/h: the tool",
    "work-valves": "worn valves, 10 km/h",
}


def make(runner: Runner) -> str:
    """Return the leaderboard of the entries driven here and of the cards of others."""
    folder = runner.folder / CARDS
    made = []
    for name in (*SHIPPED, *OTHERS):
        entrant = Entrant.of(name, ())
        made.append(driven(runner, entrant, PUBLIC))
        write_file(folder / f"{entrant.stem}.json", made[-1].to_json().encode())

    cards = [read_score_card(file) for file in sorted(folder.glob("*.json"))]
    own = (made[0].identifier, made[0].draws.sha256)
    same = [card for card in cards if (card.identifier, card.draws.sha256) == own]
    parts = [leaderboard(same)]
    if left_out := [card for card in cards if card not in same]:
        listed = ", ".join(f"`{entry(card)}` ({card.identifier})" for card in left_out)
        parts.append(f"Of other versions or seeds, not shown: {listed}.")
    return "\n\n".join(parts)


def driven(runner: Runner, entrant: Entrant, seeds: tuple[int, ...]) -> ScoreCard:
    """Return the card of an entry under some seeds; its runs are kept, by the code."""
    draws = public_draws(seeds)
    folder = runner.folder / code_digest() / f"bench-{draws.sha256[:8]}-{entrant.stem}"
    with runner.engine() as workers:
        return bench(entrant, draws, folder, workers)


def _serious(runner: Runner, seeds: tuple[int, ...]) -> list[ScoreCard]:
    return [driven(runner, Entrant.of(name, ()), seeds) for name in SERIOUS]


def make_power(runner: Runner) -> Block:
    """Return what the trials tell apart, and the verdicts of two sets of seeds."""
    sets = {seeds: _serious(runner, seeds) for seeds in (PUBLIC, tuple(CHECKS))}
    first, second = sets.values()
    numbers = pair_numbers(first)
    lines = [
        (name, f"{(np.abs(row) > _SEPARATED).sum()} of {len(row)}")
        for name, row in zip(scored_runs(first[0].trials), numbers.T, strict=True)
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
    same = f"{len(pairs) - len(differing)} of {len(pairs)} are the same, contradicting {against}"
    columns = ("trial", f"pairs with t above {_SEPARATED:g}")
    text = f"Ratio of the scores, and what it says of the first; of the verdicts {same}:"
    return Block(
        "\n\n".join((markdown(columns, lines), text, markdown(("pair", *heads, *heads), verdicts)))
    )


def _gaps(tables: Sequence[FloatArray]) -> FloatArray:
    """Return second less first table (seeds, trials) of each pair, (pairs, seeds, trials)."""
    return np.array([b - a for a, b in itertools.combinations(tables, 2)])


def pair_numbers(cards: Sequence[ScoreCard]) -> FloatArray:
    """Return Student's t of the paired difference of costs, (pairs, trials); 0 of equal costs."""
    gaps = _gaps([costs(scored_runs(card.trials)) for card in cards])
    spread = gaps.std(axis=1, ddof=1) / np.sqrt(gaps.shape[1])
    equal = np.where(gaps.mean(axis=1) == 0.0, 0.0, np.inf)
    return np.divide(gaps.mean(axis=1), spread, out=equal, where=spread > 0.0)


def entry(card: ScoreCard) -> str:
    """Return the name of an entry; of an own controller, without its module."""
    return re.sub(r"^[\w.]+:", "", card.label)


def headline(shown: Sequence[ScoreCard]) -> Block:
    """Return the short table of results from the cards of `HEADLINE`, and who is ahead where."""
    first = shown[0]
    lines = [
        (
            f"`{name}`: {about}",
            *(pair(card, name) for card in shown),
            f"{100.0 * (first.score.trials[name].oracle_m or np.nan):.2f}",
        )
        for name, about in _ABOUT.items()
    ]
    times = (f"{card.score.times_oracle.value:.2f}" for card in shown)
    heads = (
        "cross-track p95 of working point / tractor [cm]",
        *(f"`{name}`" for name in HEADLINE),
        "oracle",
    )
    footer = (
        f"<sub>Cards of the simulated benchmark `{first.identifier}`: mean over "
        f"{first.draws.count} public seeds ({format_numbers(PUBLIC)}), a run that does "
        f"not complete counts {LOSS_M:g} m; oracle: a drive that knew all beforehand, no proven "
        f"optimum; level: within {MARGIN:.0%} or not told apart; `ttempc bench NAME`; "
        "all entries: appendix</sub>"
    )
    home = (_percent(card.score.home) for card in shown)
    runs = len(_ABOUT) * first.draws.count
    lines += [
        ("times the oracle's error, geometric mean", *times, "1"),
        (f"not completed, of {runs}", *(f"{c.score.not_completed}" for c in shown), "–"),
        ("with one of ten faults: come home [%]", *home, "–"),
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


def pair(card: ScoreCard, name: str) -> str:
    """Return the errors of working point and tractor in a trial as text [cm]."""
    item = card.score.trials[name]
    return f"{100.0 * item.cost_m.value:.1f} / {_centimetres(item.tractor_p95_m)}"


def _centimetres(length_m: float | None) -> str:
    return "–" if length_m is None else f"{100.0 * length_m:.1f}"


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100.0 * share:.0f}"


def leaderboard(cards: Sequence[ScoreCard]) -> str:
    """Return the cards of one identifier as Markdown tables, the lowest score first."""
    first = cards[0]
    ordered = sorted(cards, key=lambda card: card.score.times_oracle.value)
    names = [*scored_runs(first.trials)]
    lines = []
    by_trial = []
    peaks = []
    for card, held in zip(ordered, rank_shares(ordered), strict=True):
        item = card.score
        label = f"`{entry(card)}`"
        step = item.step_p99_us
        lines.append(
            (
                label,
                item.times_oracle.text(1.0),
                _percent(held),
                f"{item.not_completed} of {len(names) * card.draws.count}",
                _percent(item.home),
                "–" if step is None else f"{1e-3 * step:.2f}",
            )
        )
        by_trial.append((label, *(pair(card, name) for name in names)))
        peaks.append((label, *(_centimetres(item.trials[name].peak_m) for name in names)))
    oracle = (_hundredths(first.score.trials[name].oracle_m) for name in names)
    by_trial.append(("oracle", *oracle))
    heads = (
        "entry",
        "times the oracle's error",
        "has this rank [%]",
        "not completed",
        "faults: come home [%]",
        "step p99 [ms]",
    )
    count = f"{first.draws.count} seed{'s' if first.draws.count > 1 else ''}"
    return "\n\n".join(
        (
            f"Benchmark `{first.identifier}`, {count}.",
            markdown(heads, lines),
            "Cross-track p95 of working point / tractor by trial, mean over seeds [cm]; of the "
            f"working point a run that does not complete counts {100.0 * LOSS_M:g} cm:",
            markdown(("entry", *names), by_trial),
            "Peak at the working point where the curvature changes, mean [cm]:",
            markdown(("entry", *names), peaks),
            _timed_on(cards),
        )
    )


def _hundredths(length_m: float | None) -> str:
    return "–" if length_m is None else f"{100.0 * length_m:.2f}"


def _timed_on(cards: Sequence[ScoreCard]) -> str:
    """Return on which machines, and under what load, the steps were timed."""
    keys = ("processor", "cores", "system")
    machines = {", ".join(f"{k} {card.machine.get(k, '?')}" for k in keys): None for card in cards}
    loads = sorted(float(card.machine.get("load") or "nan") for card in cards)
    return (
        f"Steps were timed on: {'; '.join(machines)}; load {loads[0]:g} to {loads[-1]:g}. A "
        "load above the number of cores makes them longer."
    )


def rank_shares(ordered: Sequence[ScoreCard]) -> FloatArray:
    """Return in which share of resamples of the seeds each entry has the rank it has here, (n,)."""
    tables = [costs(scored_runs(card.trials)) for card in ordered]
    if len(tables[0]) < 2:
        return np.full(len(ordered), np.nan)
    trials = tables[0].shape[1]
    means = resampled_means(np.hstack(tables))
    found = np.array(
        [
            overall(means[:, k * trials : (k + 1) * trials], scored_runs(card.trials))
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
            *(("grass", name) for name in SHIPPED),
        ),
    ),
    Table(name="trial-power", make=make_power, seeds=(*PUBLIC, *CHECKS), checks=()),
    Table(
        name="headline",
        make=lambda runner: headline(
            [driven(runner, Entrant.of(name, ()), PUBLIC) for name in HEADLINE]
        ),
    ),
)
