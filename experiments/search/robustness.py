"""Robustness of a run: how far it stays from failure.

Falsification searches for inputs of negative robustness (Annpureddy, Liu, Fainekos and
Sankaranarayanan, S-TaLiRo, TACAS 2011, doi 10.1007/978-3-642-19835-9_21). The specification is
that no figure ever reaches its limit. Its robustness is the least distance to a limit; each is
counted from the figure of the nominal run, so that a figure that is always large, as the hitch
angle on a curve, does not hide the others.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ...testbed.simulation.termination import TerminationLimits
from ..scenario.scenario import Scenario
from ..sweep.failure import ERROR, has_failed
from ..sweep.row import Row

_LEAST = 1e-9  # robustness of a run that reaches a limit and has not failed
_POINTS = ("tractor", "trailer", "tool")


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run."""

    failed: bool
    robustness: float  # 1 nominal, 0 failed
    reason: str = ""  # of the failure


@dataclass(frozen=True)
class Specification:
    """What a run must keep to: it completes, in the corridor, with an error below a limit.

    Args:
        limits: figure of a row -> limit, in the unit of the figure.
        limit_m: on the trailer's 95 % cross-track error [m]; None: not limited.
    """

    limits: Mapping[str, float]
    limit_m: float | None = None

    @classmethod
    def of(cls, scenario: Scenario, limit_m: float | None = None) -> Specification:
        """Return the specification of a scenario: its corridor and the termination limits."""
        termination = TerminationLimits.of(scenario.vehicles().plant)
        limits = {
            "extremes.tilt_rad": termination.tilt,
            "extremes.fold_rad": termination.fold,
            "tracking.all.tractor.max_m": termination.deviation,
        }
        if scenario.corridor is not None:
            width = scenario.corridor.half_width_m
            limits |= {f"corridor.{point}.max_m": width for point in _POINTS}
        if limit_m is not None:
            limits[ERROR] = limit_m
        return cls(limits, limit_m)

    def shares(self, row: Row) -> dict[str, float]:
        """Return the share of each limit that a run reaches; 0 where it has no such figure."""
        return {name: _number(row.get(name)) / limit for name, limit in self.limits.items()}

    def judge(self, row: Row, nominal: Mapping[str, float]) -> Outcome:
        """Return the outcome of a run.

        Args:
            row: of the run.
            nominal: `shares` of the nominal run, which has not failed.
        """
        if reason := self._failure(row):
            return Outcome(failed=True, robustness=0.0, reason=reason)
        shares = {n: share for n, share in self.shares(row).items() if nominal[n] < 1.0}
        nearest = max((share - nominal[n]) / (1.0 - nominal[n]) for n, share in shares.items())
        return Outcome(failed=False, robustness=max(1.0 - nearest, _LEAST))

    def _failure(self, row: Row) -> str:
        """Return why a run has failed, "" if it has not."""
        if row["status"] != "completed":
            return f"{row['status']}: {row['failure']}"
        for point in _POINTS:
            name = f"corridor.{point}.max_m"
            if name in self.limits and _number(row[name]) > self.limits[name]:
                return f"out of the corridor: {point} {_number(row[name]):.3f} m from its path"
        if _number(row["corridor.hitch_outside_fraction"]) > 0.0:
            return "hitch angle beyond the limit of the corridor"
        if has_failed(row, self.limit_m):
            return f"95 % cross-track error of the trailer {_number(row[ERROR]):.3f} m"
        return ""


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else 0.0
