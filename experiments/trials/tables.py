"""Tables of score cards: one entry as text and HTML, all entries as a leaderboard."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Final

from ..report.html import environment
from .definition import trial, trial_files
from .score import LOSS_M, Interval, TrialScore
from .score_card import ScoreCard

HEADS: Final = (
    "trial",
    "cost [cm]",
    "worst 5 % [cm]",
    "trailer p95 [cm]",
    "tool p95 [cm]",
    "not completed [%]",
    "outside [%]",
    "front [deg/m]",
    "trailer [deg/m]",
    "hydrostat [%/m]",
    "step p99 [us]",
)
"""Columns of the table of one entry."""


def trial_rows(card: ScoreCard) -> list[tuple[str, ...]]:
    """Return a row of cells for each trial, under `HEADS`."""
    return [(name, *_cells(item, card.draws.count)) for name, item in card.score.trials.items()]


def format_card(card: ScoreCard) -> str:
    """Return the score card as plain text."""
    table = [HEADS, *trial_rows(card)]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines = [
        "  ".join(
            cell.ljust(width) if k == 0 else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in table
    ]
    return "\n".join([*lines, "", *_failures(card), card.badge])


def card_page(card: ScoreCard) -> str:
    """Return the score card as an HTML page."""
    template = environment().get_template("score.html.j2")
    files = trial_files()
    about = {name: trial(name).description for name in card.trials if name in files}
    return template.render(
        card=card,
        heads=HEADS,
        rows=trial_rows(card),
        about=about,
        failures=_failures(card),
        loss_cm=100.0 * LOSS_M,
    )


def leaderboard(cards: Sequence[ScoreCard]) -> str:
    """Return the cards of one identifier as Markdown tables, the least cost first."""
    ordered = sorted(cards, key=lambda card: card.score.cost_m.value)
    heads = ("entry", "cost [cm]", "not completed", "outside rows [%]", "step p99 [ms]")
    rows = []
    for card in ordered:
        item = card.score
        outside = [t.outside for t in item.trials.values() if t.outside is not None]
        rows.append(
            (
                f"`{card.label}`",
                _interval(item.cost_m),
                f"{item.not_completed} of {item.runs}",
                _number(max(outside, default=None), 100.0, 1),
                _number(item.step_p99_us, 1e-3, 2),
            )
        )
    names = [*trial_files()]
    by_trial = [
        (
            f"`{card.label}`",
            *(f"{100 * card.score.trials[name].cost_m.value:.1f}" for name in names),
        )
        for card in ordered
    ]
    loads: dict[str, list[str]] = {}
    for card in cards:
        processor, cores, system = (
            card.machine.get(key, "unknown") for key in ("processor", "cores", "system")
        )
        own = loads.setdefault(f"{processor} ({system}), cores: {cores}", [])
        own.append(card.machine.get("load", ""))
    machines = [f"{name}, load {_range(own)}" for name, own in sorted(loads.items())]
    return "\n\n".join(
        (
            _markdown(heads, rows),
            "Mean cost of each trial [cm]:",
            _markdown(("entry", *names), by_trial),
            f"Steps were timed on: {'; '.join(machines)}. A load above the number of cores makes "
            "them longer.",
        )
    )


def _range(loads: Sequence[str]) -> str:
    """Return the least and the greatest load."""
    known = sorted({load for load in loads if load}, key=float)
    return " to ".join(dict.fromkeys((known[0], known[-1]))) if known else "unknown"


def _cells(item: TrialScore, runs: int) -> tuple[str, ...]:
    degrees = math.degrees(1.0)
    return (
        _interval(item.cost_m),
        _number(item.tail_m, 100.0, 1),
        _number(item.trailer_p95_m, 100.0, 1),
        _number(item.tool_p95_m, 100.0, 1),
        _number(item.not_completed / runs, 100.0, 0),
        _number(item.outside, 100.0, 1),
        _number(item.front_rad_per_m, degrees, 1),
        _number(item.trailer_rad_per_m, degrees, 1),
        _number(item.hydrostat_per_m, 100.0, 1),
        _number(item.step_p99_us, 1.0, 0),
    )


def _failures(card: ScoreCard) -> list[str]:
    """Return a line for each reason of runs that did not complete in a trial."""
    return [
        f"{name}: {count} {status}: {failure}"
        for name, runs in card.trials.items()
        for (status, failure), count in Counter(
            (run.status, run.failure) for run in runs if not run.completed
        ).most_common(3)
    ]


def _interval(interval: Interval) -> str:
    value = f"{100 * interval.value:.2f}"
    if interval.low is None or interval.high is None:
        return value
    return f"{value} ({100 * interval.low:.2f} to {100 * interval.high:.2f})"


def _number(value: float | None, factor: float, decimals: int) -> str:
    return "–" if value is None else f"{factor * value:.{decimals}f}"


def _markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [heads, ["---", *("--:" for _ in heads[1:])], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
