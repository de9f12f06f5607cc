"""Benchmark: all runs of an entry, driven as a sweep, and its score card."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from ....testbed.recording.provenance import machine, versions
from ...errors import BadOptions, InvalidController
from ...run.assembly import assemble
from ...run.user_code import named_factory, user_sources
from ...scenario.controller import TRUTH
from ...scenario.scenario import parse_overrides, read_scenario
from ..oracle.drives import Part
from ..sweep.engine import Engine, imap_bounded
from ..sweep.folder import lock_folder
from ..sweep.plan import SweepPlan
from ..sweep.results import rows
from ..sweep.row import Row
from ..sweep.study import ListAxis, Study
from ..sweep.sweep import Progress, sweep
from .definition import (
    VERSION,
    differing,
    frozen_checks,
    identifier,
    plant_check,
    scored_part,
    trial,
    trial_files,
)
from .score_card import CARD, Draws, ScoreCard, TrialRun, entry_label, score

_COLUMNS: Final = {  # key of a run: column of a row
    "front_rad_per_m": "inputs.delta_t.travel_per_m",
    "trailer_rad_per_m": "inputs.delta_i.travel_per_m",
    "hydrostat_per_m": "inputs.hp.travel_per_m",
    "step_p99_us": "timing.control_step_us.p99",
}
_OUTSIDE: Final = tuple(f"corridor.{p}.outside_fraction" for p in ("tractor", "trailer", "tool"))


@dataclass(frozen=True, slots=True)
class Entrant:
    """A controller with its settings."""

    controller: str
    settings: Mapping[str, Any]  # tables of `[controller]` beside its name

    @classmethod
    def of(cls, controller: str, overrides: Sequence[str]) -> Entrant:
        """Return the entry of a command line.

        Raises:
            InvalidScenario: an override is not understood.
            BadOptions: it changes more than the controller, or gives it the true state.
        """
        changes = parse_overrides(overrides)
        settings = changes.pop("controller", {})
        if changes or not isinstance(settings, dict) or "name" in settings:
            wrong = next(iter(changes), "controller.name")
            raise BadOptions(
                f"bench --set {wrong}: must be a key of [controller] other than its name, such as "
                "controller.options.horizon=20; the trials are frozen"
            )
        if settings.get("estimator") == TRUTH:
            raise BadOptions(f"bench --set controller.estimator={TRUTH}: is not allowed in a trial")
        return cls(controller, settings)

    @property
    def changes(self) -> dict[str, Any]:
        """Return the tables that replace values of a trial's scenario."""
        return {"controller": {**self.settings, "name": self.controller}}

    @property
    def stem(self) -> str:
        """Return controller and settings as part of a file name."""
        label = entry_label(self.controller, self.settings)
        return re.sub(r"[^\w.=-]+", "-", label).strip("-")

    def plan(self, draws: Draws) -> SweepPlan:
        """Return all runs of the entry.

        Raises:
            BadOptions: the controller drives at a speed of its own: in a corridor, or because it
                follows the reference by place.
            ExperimentError, TtempcError: the controller or its settings are refused everywhere.
        """
        files = trial_files()
        for name, file in files.items():
            scenario = read_scenario(str(file)).scenario(self.changes, changed_by="--set")
            named_factory(self.controller, scenario.controller.options)  # no trial is to blame
            tube = scenario.controller.speed_tube()
            corridor = scenario.corridor
            if tube and corridor and tube.speed_within(corridor.half_width_m) < math.inf:
                raise BadOptions(
                    f"bench {self.controller}: controller.options must have no half widths over "
                    f"speed: they change the speed of {name}, which is fixed"
                )
        assert draws.seeds is not None
        study = Study(
            description=f"Benchmark {VERSION} of {self.controller}",
            scenario=str(next(iter(files.values()))),
            seeds=draws.seeds,
            skip_refused=True,
            set=self.changes,
            axis=(ListAxis(key="scenario", kind="list", values=(*map(str, files.values()),)),),
        )
        plan = SweepPlan(f"benchmark {VERSION}", study)
        plan.extent()
        first = plan[next(iter(plan.runs()))]
        try:
            by_place = assemble(first.setting.scenario, first.seed).guidance.space_based
        except InvalidController:  # its factory raises: so do its runs, which then count as lost
            by_place = False
        if by_place:
            raise BadOptions(
                f"bench {self.controller}: is space_based, follows the reference by place; the "
                "speed of the trials is fixed, and slower is easier"
            )
        return plan


def bench(
    entrant: Entrant,
    draws: Draws,
    folder: Path,
    engine: Engine,
    on_row: Callable[[Progress], object] = lambda progress: None,
) -> ScoreCard:
    """Drive all runs of an entry that have no row yet in the folder and return its score card.

    Raises:
        ExperimentError, TestbedError, TtempcError: the entry is refused.
    """
    plan = entrant.plan(draws)
    checks = {n: task.result() for n, task in imap_bounded(engine, plant_check, trial_files())}
    with lock_folder(folder, plan) as locked:
        sweep(plan, locked, engine, on_row)
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    runs = runs_of(rows(folder / "results.jsonl"), plan, draws)
    scenario = plan.setting(plan.changes(0)).scenario
    return ScoreCard(
        format=CARD,
        identifier=identifier(differing(checks, frozen_checks())),
        controller=entrant.controller,
        settings={**entrant.settings},
        source=", ".join(sorted(user_sources(scenario).values())),
        draws=replace(draws, seeds=None) if draws.kind == "hidden" else draws,
        machine={**machine(), "load": load},
        versions=versions(),
        score=score(runs),
        trials=runs,
    )


def runs_of(
    results: Iterable[Row], plan: SweepPlan, draws: Draws
) -> dict[str, tuple[TrialRun, ...]]:
    """Return what counts of all rows, by trial; a refused trial has refused runs."""
    assert draws.seeds is not None
    by_run = {(row["scenario"], row["seed"]): row for row in results}
    runs = {}
    for point, name in enumerate(trial_files()):
        error = plan.refusals.get((point, 0))
        # Without study and axes: the path of the scenario is of this machine.
        refused = error and TrialRun(status="refused", failure=str(error).split(": ", 2)[-1])
        part = scored_part(trial(name))
        runs[name] = tuple(refused or _trial_run(by_run[name, seed], part) for seed in draws.seeds)
    return runs


def _trial_run(row: Row, part: Part) -> TrialRun:
    outside = [share for share in map(row.get, _OUTSIDE) if isinstance(share, int | float)]
    tool = row.get(f"tracking.{part}.tool.cross_p95_m") is not None
    working = "tool" if tool else "trailer"
    return TrialRun(
        status=row["status"],  # pyright: ignore[reportArgumentType] - validated
        failure=str(row["failure"]),
        working_p95_m=_rounded(row[f"tracking.{part}.{working}.cross_p95_m"]),
        tractor_p95_m=_rounded(row[f"tracking.{part}.tractor.cross_p95_m"]),
        peak_m=_rounded(row[f"peaks.{working}_m"]),
        outside=_rounded(max(outside, default=None)),
        **{key: _rounded(row[column]) for key, column in _COLUMNS.items()},
    )


def _rounded(value: object) -> float | None:
    return round(float(value), 6) if isinstance(value, int | float) else None
