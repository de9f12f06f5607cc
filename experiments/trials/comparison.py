"""Two score cards of the same trials and seeds, run by run."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Final

import numpy as np
from pydantic.dataclasses import dataclass

from ...testbed.configuration.config_io import STRICT
from ..errors import InvalidScoreCard
from ..results.statistics import bootstrap_means
from .score import Interval, costs, overall
from .score_card import ScoreCard

_WIDTH: Final = 15


@dataclass(frozen=True, kw_only=True, config=STRICT)
class TrialComparison:
    """Costs of a trial in both cards, paired by seed."""

    first_m: float
    second_m: float
    difference_m: Interval
    """Second minus first."""
    not_completed: tuple[int, int]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class CardComparison:
    """Difference of two entries; intervals resample whole seeds."""

    identifier: str
    first: str
    second: str
    ratio: Interval
    """Overall cost of the second over that of the first."""
    trials: dict[str, TrialComparison]

    def to_json(self) -> str:
        """Return the comparison as JSON."""
        return json.dumps(asdict(self), indent=1, ensure_ascii=False) + "\n"

    def __str__(self) -> str:
        heads = ("A", "B", "B - A", "95 % interval", "not completed")
        widths = (8, 8, 8, 18, 15)
        lines = [
            f"A: {self.first}",
            f"B: {self.second}",
            f"Field trials {self.identifier}; costs [cm], paired by trial and seed",
            "",
            "".ljust(_WIDTH) + _cells(heads, widths),
        ]
        for name, item in self.trials.items():
            gap, lost = item.difference_m, item.not_completed
            cells = (
                f"{100 * item.first_m:.2f}",
                f"{100 * item.second_m:.2f}",
                f"{100 * gap.value:+.2f}",
                _ends(gap, 100.0, "+.2f"),
                f"{lost[0]} / {lost[1]}",
            )
            lines.append(name.ljust(_WIDTH) + _cells(cells, widths))
        ratio = self.ratio
        lines += ["", f"Overall cost B / A: {ratio.value:.3f} ({_ends(ratio, 1.0, '.3f')})"]
        return "\n".join(lines)


def compare_cards(first: ScoreCard, second: ScoreCard) -> CardComparison:
    """Compare two entries run by run.

    Raises:
        InvalidScoreCard: they are of other trials, another plant or other seeds.
    """
    for what, one, other in (
        ("identifier", first.identifier, second.identifier),
        ("seeds", first.draws.sha256[:12], second.draws.sha256[:12]),
        ("trials", ", ".join(first.trials), ", ".join(second.trials)),
    ):
        if one != other:
            raise InvalidScoreCard(
                f"bench --compare: {what} {one} and {other}; cards of the same trials and seeds "
                "can be compared"
            )
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
        trials[name] = TrialComparison(
            first_m=one.cost_m.value,
            second_m=other.cost_m.value,
            difference_m=Interval.of(gap),
            not_completed=(one.not_completed, other.not_completed),
        )
    return CardComparison(
        identifier=first.identifier,
        first=first.label,
        second=second.label,
        ratio=Interval.of(ratio),
        trials=trials,
    )


def _cells(cells: tuple[str, ...], widths: tuple[int, ...]) -> str:
    return "".join(cell.rjust(width) for cell, width in zip(cells, widths, strict=True))


def _ends(interval: Interval, factor: float, form: str) -> str:
    if interval.low is None or interval.high is None:
        return "one seed: none"
    return f"{factor * interval.low:{form}} to {factor * interval.high:{form}}"
