"""Probes: short runs whose state stands for the plant and the controllers behind a table.

A change of the code that changes no bit of them makes no table stale; a changed constant does.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from ...testbed.recording.channels import STATE
from ...testbed.recording.record import Recorder
from ..results.metrics import tracking_statistics
from ..results.tracking_errors import tracking_errors
from ..run.assembly import assemble
from ..run.simulate import drive_into
from ..scenario.scenario import Scenario, load
from ..seeds import FIRST
from ..sweep.plan import SweepPlan
from ..sweep.study import load_study

PROBE_S: Final = 20.0  # simulated: a straight, the blend and the first metres of a curve
_REFERENCE: Final = "ttempc"  # the controller that drives every scenario of a study
_CLOSE: Final = 1e-9  # [m]
_END: Final = ("x_t_m", "y_t_m", "x_i_m", "y_i_m")

Outcome = Literal["same bits", "equal to 1e-9", "differs"]
"""Result of a probe that was driven again, from best to worst."""

OUTCOMES: Final[tuple[Outcome, ...]] = ("same bits", "equal to 1e-9", "differs")


@dataclass(frozen=True, slots=True)
class Probe:
    """A short run."""

    name: str
    scenario: Scenario
    seed: int = FIRST


@dataclass(frozen=True, slots=True)
class Fingerprint:
    """Result of a probe."""

    sha256: str  # of times and values of `/state`, little-endian doubles; the first 16 digits
    values: tuple[
        float, ...
    ]  # last place of both points, their mean errors after start-up [m], 0 without

    def compare(self, other: Fingerprint) -> Outcome:
        """Return how the same probe, driven again, compares.

        The state of another processor may differ in its last bits, because linear algebra libraries
        choose their instructions by processor; the closed loop does not let the difference grow.
        """
        if self == other:
            return "same bits"
        pairs = zip(self.values, other.values, strict=True)
        close = all(abs(one - another) <= _CLOSE for one, another in pairs)
        return "equal to 1e-9" if close else "differs"


def probe(scenario: str, controller: str, *overrides: str) -> Probe:
    """Return the probe of a controller on a shipped scenario, with changes as of `--set`."""
    name = ", ".join((scenario, controller, *overrides))
    return Probe(name, load(scenario, [*overrides, f'controller.name="{controller}"'])[1])


def study_probes(study: str) -> tuple[Probe, ...]:
    """Return the probes of a shipped study.

    They are every controller at its first point, and `ttempc` at its last point, or at all points
    if scenarios are an axis.
    """
    plan = SweepPlan(*load_study(study))
    per_point = plan.size // plan.points
    settings = [plan[run] for run in range(plan.controller_count)]
    names = [planned.setting.scenario.controller.name for planned in settings]
    reference = names.index(_REFERENCE)
    points = range(1, plan.points) if "scenario" in plan.study.names else [plan.points - 1]
    settings += [plan[point * per_point + reference] for point in points]
    return tuple(
        Probe(
            f"{study} {planned.point}: {planned.setting.name}, "
            f"{planned.setting.scenario.controller.name}",
            planned.setting.scenario,
            planned.seed,
        )
        for planned in settings
    )


def fingerprint(item: Probe) -> Fingerprint:
    """Drive a probe and return its fingerprint."""
    assembly = assemble(item.scenario, item.seed)
    ticks = min(round(PROBE_S / assembly.guidance.period_s), assembly.ticks)
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


def digest_of(fingerprints: Sequence[Fingerprint]) -> str:
    """Return a short digest of the fingerprints of several probes, in any order."""
    text = " ".join(sorted(item.sha256 + repr(item.values) for item in fingerprints))
    return hashlib.sha256(text.encode()).hexdigest()[:8]
