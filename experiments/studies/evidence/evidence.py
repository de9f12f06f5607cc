"""A published figure beside that of the plant, and the table of many."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Final, Literal

from ....testbed.validation.check import Check, number

Verdict = Literal["in band", "below", "above", "no figure", "not judged"]

ASSUMED_SHARE: Final = 0.25  # of a value whose source states no spread; assumed
ASSUMED_RULE: Final = f"the source states no spread: ± {100 * ASSUMED_SHARE:.0f} %, assumed"


@dataclass(frozen=True, slots=True)
class Evidence:
    """A figure of the plant, the band of the published one, and the reason where it is outside.

    `check.source` is the publication. The plant is not tuned for any of these figures.
    """

    check: Check  # our figure, the band and the source of the published figure
    published: str  # the figure as the source states it
    rule: str  # where the band comes from
    method: str  # what was driven: scenario, settings, seeds
    below: str = "unknown"  # reason, shown where our figure is below the band
    above: str = "unknown"  # reason, shown where it is above, or without a figure

    @property
    def verdict(self) -> Verdict:
        """Place of our figure against the band."""
        figure, low, high = self.check.figure, self.check.low, self.check.high
        if figure is None or math.isnan(figure):
            return "no figure"
        if math.isinf(low) and math.isinf(high):
            return "not judged"
        if figure < low:
            return "below"
        return "above" if figure > high else "in band"

    @property
    def reason(self) -> str:
        """Physical reason of a figure outside the band, "unknown" where we have none, else ""."""
        reasons = {"below": self.below, "above": self.above, "no figure": self.above}
        return reasons.get(self.verdict, "")


def around(value: float, share: float = ASSUMED_SHARE) -> tuple[float, float]:
    """Return the band of +- a share about a value.

    >>> around(8.0, 0.5)
    (4.0, 12.0)
    """
    return value - share * abs(value), value + share * abs(value)


def verdict_line(items: Sequence[Evidence]) -> str:
    """Return how many figures are inside their bands, as a sentence."""
    judged = [item for item in items if item.verdict != "not judged"]
    held = sum(item.verdict == "in band" for item in judged)
    sources = len({item.check.source for item in judged})
    return f"{held} of {len(judged)} figures from {sources} sources are inside their bands."


def table(items: Sequence[Evidence]) -> str:
    """Return the figures as a Markdown table, and below it how they were made."""
    head = "| | figure | published | band | ours | verdict |\n|---|---|---|---|---|---|\n"
    numbered = list(enumerate(items, 1))
    rows = "".join(f"| {k} | {_cells(item)} |\n" for k, item in numbered)
    groups = groupby(numbered, lambda pair: (pair[1].check.source, pair[1].method))
    return f"{head}{rows}\n" + "".join(_note(list(group)) for _, group in groups)


def _cells(item: Evidence) -> str:
    check, unit, verdict = item.check, item.check.unit, item.verdict
    rounded = number(float(f"{check.figure:.3g}"))
    figure = "–" if verdict == "no figure" else f"{rounded} {unit}".rstrip()
    band = "–" if verdict == "not judged" else f"{check.expectation} {unit}".rstrip()
    word = verdict if verdict in ("in band", "not judged") else f"**{verdict}**"
    return f"{check.name} | {item.published} | {band} | {figure} | {word}"


def _note(group: list[tuple[int, Evidence]]) -> str:
    """Return how a run of figures with one source, band rule and method was made."""
    (first, item), (last, _) = group[0], group[-1]
    name = f"{first}" if first == last else f"{first} to {last}"
    text = f"**{name}.** {item.check.source.rstrip('.')}. Ours: {item.method}.\n\n"
    for rule, members in groupby(group, lambda pair: pair[1].rule):
        text += f"- Band of {_numbers(members)}: {rule}.\n"
    for k, each in group:
        if each.check.note:
            text += f"- Of {k}: {each.check.note}.\n"
    for reason, members in groupby(group, lambda pair: pair[1].reason):
        if reason:
            text += f"- Outside, {_numbers(members)}: {reason}.\n"
    return text + "\n"


def _numbers(members: Iterable[tuple[int, Evidence]]) -> str:
    return ", ".join(str(k) for k, _ in members)
