"""Regression checks: short runs whose states stand for the plant and controllers behind a table.

A change of the code that changes no bit of them makes no table stale; a changed constant does.
`docs/fingerprints.json` is the ledger: the fingerprints with which each table was made.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from ...testbed.recording.channels import STATE
from ...testbed.recording.record import Recorder
from ..errors import InvalidPage
from ..output import write_file
from ..results.summary import tracking_statistics
from ..results.tracking_errors import tracking_errors
from ..run.assembly import assemble
from ..run.simulate import drive_into
from ..scenario.scenario import Scenario, load
from ..seeds import FIRST
from ..studies.sweep.plan import SweepPlan
from ..studies.sweep.study import load_study
from .pages import ROOT

CHECK_S: Final = 20.0  # simulated: a straight, the blend and the first metres of a curve
LEDGER: Final = "docs/fingerprints.json"
_REFERENCE: Final = "ttempc"  # the controller that drives every scenario of a sweep
_CLOSE: Final = 1e-9  # [m]
_END: Final = ("x_t_m", "y_t_m", "x_i_m", "y_i_m")

SAME_BITS: Final = "same bits"
EQUAL: Final = "equal to 1e-9"
DIFFERS: Final = "differs"
OUTCOMES: Final = (SAME_BITS, EQUAL, DIFFERS)
"""Results of a check that was driven again, from best to worst."""
NO_CHECK: Final = "no check"
"""State of a table that has none: nobody knows whether it holds."""
HELD: Final = (SAME_BITS, EQUAL, NO_CHECK)
"""States in which no check asks for a table to be made anew."""


@dataclass(frozen=True, slots=True)
class Check:
    """A short run."""

    name: str
    scenario: Scenario
    seed: int = FIRST


class Fingerprint(NamedTuple):
    """Result of a check."""

    sha256: str  # of times and values of `/state`, little-endian doubles; the first 16 digits
    values: tuple[float, ...]  # last position and mean error of both axle points [m], (6,)

    def compare(self, other: Fingerprint) -> str:
        """Return how the same check, driven again, compares: one of `OUTCOMES`.

        The state of another processor may differ in its last bits, because linear algebra libraries
        choose their instructions by processor; the closed loop does not let the difference grow.
        """
        if self == other:
            return SAME_BITS
        pairs = zip(self.values, other.values, strict=True)
        close = all(abs(one - another) <= _CLOSE for one, another in pairs)
        return EQUAL if close else DIFFERS


def scenario_check(scenario: str, controller: str, *overrides: str) -> Check:
    """Return the check of a controller on a shipped scenario, with changes as of `--set`."""
    name = ", ".join((scenario, controller, *overrides))
    return Check(name, load(scenario, [*overrides, f'controller.name="{controller}"'])[1])


def sweep_checks(sweep: str) -> tuple[Check, ...]:
    """Return the checks of a shipped sweep.

    They are every controller at its first point, and `ttempc` at its last point, or at all points
    if scenarios are an axis.
    """
    plan = SweepPlan(*load_study(sweep))
    per_point = plan.size // plan.points
    settings = [plan[run] for run in range(plan.controller_count)]
    names = [planned.setting.scenario.controller.name for planned in settings]
    reference = names.index(_REFERENCE)
    points = range(1, plan.points) if "scenario" in plan.study.names else [plan.points - 1]
    settings += [plan[point * per_point + reference] for point in points]
    return tuple(
        Check(
            f"{sweep} {planned.point}: {planned.setting.name}, "
            f"{planned.setting.scenario.controller.name}",
            planned.setting.scenario,
            planned.seed,
        )
        for planned in settings
    )


def fingerprint(check: Check) -> Fingerprint:
    """Drive a check and return its fingerprint."""
    assembly = assemble(check.scenario, check.seed)
    ticks = min(round(CHECK_S / assembly.guidance.period_s), assembly.ticks)
    recorder = Recorder()
    drive_into(recorder, replace(assembly, ticks=ticks))
    record = recorder.record()
    state = record[STATE]
    digest = hashlib.sha256()
    for array in (state.time_s, state.values):
        digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
    errors = tracking_statistics(tracking_errors(record)).all
    means = (errors.tractor.mean_euclidean_m, errors.trailer.mean_euclidean_m)
    values = [*state.columns(*_END)[-1], *(mean or 0.0 for mean in means)]
    return Fingerprint(digest.hexdigest()[:16], tuple(float(value) for value in values))


def digest_of(fingerprints: Iterable[Fingerprint]) -> str:
    """Return a short digest of several fingerprints, in any order."""
    text = " ".join(sorted(item.sha256 + repr(item.values) for item in fingerprints))
    return hashlib.sha256(text.encode()).hexdigest()[:8]


class Making(NamedTuple):
    """Circumstances under which a table was made."""

    versions: Mapping[str, str]  # of project and packages
    checks: Mapping[str, Fingerprint]  # by the name of the check


def read_ledger(out: Path = ROOT) -> dict[str, Making]:
    """Return the making of every table by the name of its study.

    Raises:
        InvalidPage: the file is not what `write_ledger` writes.
    """
    file = out / LEDGER if (out / LEDGER).exists() else ROOT / LEDGER
    try:
        return {
            name: Making(
                dict(versions),
                {check: Fingerprint(sha256, tuple(of)) for check, (sha256, of) in checks.items()},
            )
            for name, (versions, checks) in json.loads(file.read_text(encoding="utf-8")).items()
        }
    except (OSError, ValueError, TypeError, AttributeError):
        raise InvalidPage(f"{file}: is no ledger of regression checks") from None


def write_ledger(ledger: Mapping[str, Making], out: Path = ROOT) -> None:
    """Write the ledger, a line for each table."""
    lines = (f' "{name}": {json.dumps(making)}' for name, making in sorted(ledger.items()))
    write_file(out / LEDGER, ("{\n" + ",\n".join(lines) + "\n}\n").encode())
