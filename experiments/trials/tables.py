"""Score cards and their comparison as text, score cards as pages."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Final

from ..report.html import environment
from .definition import trial, trial_files
from .score_card import LOSS_M, Interval, ScoreCard, TrialScore

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
    return "\n".join([*_aligned([HEADS, *trial_rows(card)]), "", *_failures(card), card.badge])


def format_comparison(found: Mapping[str, Any]) -> str:
    """Return what `compare_cards` found as plain text."""
    lines = [["", "A", "B", "B - A", "95 % interval", "not completed"]]
    for name, item in found["trials"].items():
        gap, lost = item["difference_m"], item["not_completed"]
        values = [100.0 * item[key] for key in ("first_m", "second_m")]
        cells = [f"{value:.2f}" for value in values] + [f"{100.0 * gap['value']:+.2f}"]
        lines.append([name, *cells, _ends(gap, 100.0, "+.2f"), f"{lost[0]} / {lost[1]}"])
    ratio = found["ratio"]
    return "\n".join(
        [
            f"A: {found['first']}",
            f"B: {found['second']}",
            f"Benchmark {found['identifier']}; costs [cm], paired by scenario and seed",
            "",
            *_aligned(lines),
            "",
            f"Overall cost B / A: {ratio['value']:.3f} ({_ends(ratio, 1.0, '.3f')})",
        ]
    )


def _ends(interval: Mapping[str, Any], factor: float, form: str) -> str:
    if interval["low"] is None:
        return "one seed: none"
    return f"{factor * interval['low']:{form}} to {factor * interval['high']:{form}}"


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return lines of columns of equal width, all but the first to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]) for row in rows
    ]


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


def _cells(item: TrialScore, runs: int) -> tuple[str, ...]:
    degrees = math.degrees(1.0)
    return (
        format_interval(item.cost_m),
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


def format_interval(interval: Interval) -> str:
    """Return an estimate with its interval [cm]."""
    value = f"{100 * interval.value:.2f}"
    if interval.low is None or interval.high is None:
        return value
    return f"{value} ({100 * interval.low:.2f} to {100 * interval.high:.2f})"


def _number(value: float | None, factor: float, decimals: int) -> str:
    return "–" if value is None else f"{factor * value:.{decimals}f}"
