"""Leaderboard of the benchmark: entries driven here, and score cards of others.

An entry's cost is the 95th percentile of the absolute cross-track error of the working point, the
tool where there is one, else the trailer's axle point; losses count, see `trials.score_card`.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Final

from ....testbed.recording.provenance import code_digest
from ...sweep_report.format import format_numbers
from ...trials.bench import Entrant, bench
from ...trials.definition import trial_files
from ...trials.score_card import PUBLIC, ScoreCard, public_draws, read_score_card
from ..pages import ROOT
from ..runner import Runner
from ..study import Block, Study
from ..tables import markdown

CARDS: Final = "field-trials"
"""Folder of the score cards, beside the page."""

SHIPPED: Final = (
    ("ttempc",),
    ("ttempc", "controller.options.tightening=none"),
    ("ttempc", "controller.learn=false"),
    ("ttempc-nominal",),
    ("ttempc-tube",),
    ("pid",),
    ("lqr",),
    ("nmpc",),
    ("nmpc-rti",),
    ("paper",),
)
"""Shipped controllers with changes as of `--set`."""

OTHERS: Final = (("learnt_policy:learnt",), ("casadi_mpc:CasadiMpc",), ("do_mpc_controller:DoMpc",))
"""Controllers of docs/examples, written against the public interface."""


HEADLINE: Final = ("ttempc", "pid", "lqr", "nmpc-rti")
_ABOUT: Final = {
    "crop-rows": "crop rows on a soft slope",
    "cultivate": "cultivator on a side slope: the tool",
    "even-grass": "even grass",
    "faults": "bumpy grass with faults",
    "field-sensors": "sensors as in the field",
    "patches": "furrows, soft patches",
    "reverse": "passes in reverse",
    "rough-grass": "rough grass",
    "wet-slope": "wet slope",
    "worn-valves": "worn valves",
}


def make(runner: Runner) -> Block:
    """Return the leaderboard, and the score cards of all entries driven here."""
    draws = public_draws(PUBLIC)
    cards = {}
    for name, *changes in (*SHIPPED, *OTHERS):
        entrant = Entrant.of(name, changes)
        folder = runner.folder / code_digest() / f"bench-{draws.count}-{entrant.stem}"
        with runner.engine() as workers:
            cards[f"{CARDS}/{entrant.stem}.json"] = bench(entrant, draws, folder, workers)
    first = next(iter(cards.values()))
    others = [card for file, card in shipped_cards().items() if f"{CARDS}/{file}.json" not in cards]
    place = (first.identifier, first.draws.sha256)
    same = [card for card in others if (card.identifier, card.draws.sha256) == place]
    parts = [leaderboard([*cards.values(), *same])]
    if left_out := [card for card in others if card not in same]:
        listed = ", ".join(f"`{entry(card)}` ({card.identifier})" for card in left_out)
        parts.append(f"Of other versions or seeds, not shown: {listed}.")
    return Block(
        "\n\n".join(parts), {name: card.to_json().encode() for name, card in cards.items()}
    )


def shipped_cards() -> dict[str, ScoreCard]:
    """Return the committed score cards by the stems of their files."""
    files = sorted((ROOT / "docs" / CARDS).glob("*.json"))
    return {file.stem: read_score_card(file) for file in files}


def entry(card: ScoreCard) -> str:
    """Return the name of an entry; of an own controller, without its module."""
    return re.sub(r"^[\w.]+:", "", card.label)


def headline(cards: Mapping[str, ScoreCard]) -> Block:
    """Return the short table of README from the cards of `HEADLINE`, the geometric mean last."""
    shown = [cards[name] for name in HEADLINE]
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
        "not complete counts 1 m; `ttempc bench NAME`; "
        "[all entries and intervals](docs/results.md#benchmark)</sub>"
    )
    return Block(markdown(heads, [*lines, ("all, geometric mean", *overall)]), footer=footer)


def leaderboard(cards: Sequence[ScoreCard]) -> str:
    """Return the cards of one identifier as Markdown tables, the least cost first."""
    first, ordered = cards[0], sorted(cards, key=lambda card: card.score.cost_m.value)
    names = [*trial_files()]
    lines, by_trial = [], []
    for card in ordered:
        item = card.score
        outside = [t.outside for t in item.trials.values() if t.outside is not None]
        step = item.step_p99_us
        lines.append(
            (
                f"`{entry(card)}`",
                item.cost_m.text(),
                f"{item.not_completed} of {item.runs}",
                f"{100.0 * max(outside):.1f}" if outside else "–",
                "–" if step is None else f"{1e-3 * step:.2f}",
            )
        )
        costs = (f"{100 * item.trials[name].cost_m.value:.1f}" for name in names)
        by_trial.append((f"`{entry(card)}`", *costs))
    keys = ("processor", "cores", "system")
    machines = {", ".join(f"{k} {card.machine.get(k, '?')}" for k in keys): None for card in cards}
    loads = sorted(float(card.machine.get("load") or "nan") for card in cards)
    heads = ("entry", "cost [cm]", "not completed", "outside rows [%]", "step p99 [ms]")
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


STUDIES: Final = (
    Study(
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
    Study(name="headline", make=lambda runner: headline(shipped_cards())),
)
