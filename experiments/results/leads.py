"""Places at which a controller is ahead of the default one."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

MARGIN_CM: Final = 0.05
"""Difference of mean errors below which none of two controllers counts as ahead [cm]."""


@dataclass(frozen=True, slots=True)
class RunError:
    """Error of a run, for comparison with others."""

    place: str  # field or study
    pair: Hashable  # equal for runs of several controllers under the same conditions
    controller: str
    error_cm: float  # mean Euclidean error, mean of both axle points; NaN for a lost run

    @property
    def lost(self) -> bool:
        """Whether the run has no error."""
        return math.isnan(self.error_cm)


@dataclass(frozen=True, slots=True)
class Lead:
    """Lead of a controller over the default one at a place."""

    place: str
    controller: str
    error_cm: float  # error of the default one less its own, mean over pairs; NaN without pairs
    runs: int  # runs that the default one lost, less those that it lost itself

    def __str__(self) -> str:
        reasons = [f"{self.error_cm:.2f} cm"] if self.error_cm > MARGIN_CM else []
        reasons += [f"{self.runs} lost run{'s' * (self.runs > 1)} fewer"] if self.runs > 0 else []
        return f"`{self.controller}` on `{self.place}` ({', '.join(reasons)})"


def leads(runs: Iterable[RunError], default: str) -> list[Lead]:
    """Return all leads over `default`: more than `MARGIN_CM` of mean error, or fewer lost runs.

    Mean errors are those of pairs that both completed; pairs that one of the two did not drive
    count nowhere.
    """
    by_key = {(run.place, run.controller, run.pair): run for run in runs}
    result = []
    for place, controller in dict.fromkeys(key[:2] for key in by_key):
        both = [
            (by_key[place, default, pair], run)
            for (at, name, pair), run in by_key.items()
            if (at, name) == (place, controller) and (place, default, pair) in by_key
        ]
        known = [own.error_cm - run.error_cm for own, run in both if not (own.lost or run.lost)]
        lead = Lead(
            place,
            controller,
            sum(known) / len(known) if known else math.nan,
            sum(own.lost - run.lost for own, run in both),
        )
        if lead.error_cm > MARGIN_CM or lead.runs > 0:
            result.append(lead)
    return result


def leads_sentence(runs: Sequence[RunError], default: str, what: str) -> str:
    """Return a sentence that lists all leads over `default`.

    Args:
        runs: of all controllers.
        default: name of the controller that the others are compared with.
        what: plural of the places, such as "fields".
    """
    rivals = [name for name in dict.fromkeys(run.controller for run in runs) if name != default]
    places = {run.place for run in runs}
    ahead = leads(runs, default)
    rest = len(places - {lead.place for lead in ahead})
    compared = ", ".join(f"`{name}`" for name in rivals)
    listed = f"Ahead of `{default}`: {'; '.join(map(str, ahead))}. " if ahead else ""
    return (
        f"{listed}On {rest} of {len(places)} {what} none of {compared} is ahead of `{default}` by "
        f"more than {MARGIN_CM} cm in the mean error of both points, or in lost runs."
    )
