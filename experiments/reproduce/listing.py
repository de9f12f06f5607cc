"""List of all tables and figures of README and docs.

A table more is an entry more: a function that returns its Markdown, and markers in its page.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from ttempc.guidance.controllers import CONTROLLERS

from ..policy import study as policy
from ..scenario.controller import TRUTH
from ..scenario.scenario import shipped
from ..seeds import report_seeds
from ..studies import (
    errata,
    estimators,
    front,
    invariance,
    learning,
    paper_tube,
    ranking,
    retuned,
)
from ..studies.ablations import ablation, conditions, corridor, coverage, limits, recovery
from ..studies.failures import breaking_points, worst_cases
from ..studies.faults import cases, false_alarms, soak, stuck_valves
from ..studies.faults import study as faults
from ..trials.draws import PUBLIC
from . import comparison_tables, study_tables, trial_tables
from .comparison_tables import STUDY
from .entry import Entry
from .study_tables import CONTAINMENT_LAPS, RANKING_DRAWS, SWEEPS, printed


def _study(
    name: str,
    page: str,
    main: Callable[..., object],
    *arguments: object,
    seeds: tuple[int, ...] = (),
    probes: tuple[tuple[str, ...], ...] = (),
    minutes: float = 0.0,
    fenced: bool = False,
) -> Entry:
    """Return the entry of a study in Python whose `main` prints the table."""
    return Entry(
        name=name,
        page=page,
        make=printed(main, arguments, seeds, fenced),
        seeds=seeds,
        probes=probes,
        minutes=minutes,
    )


SWEEP_MINUTES: Final = {
    "compare": 15.0,
    "delay": 6.0,
    "mismatch": 5.0,
    "noise": 6.0,
    "speed-radius": 7.0,
    "terrain-slip": 15.0,
}
"""Time of the shipped studies on two cores, estimated from 58 simulated seconds a second."""

ENTRIES: Final = (
    Entry(name="headline", page="README.md", make=comparison_tables.headline, sweeps=(STUDY,)),
    Entry(name="fields", page="docs/results.md", make=comparison_tables.by_field, sweeps=(STUDY,)),
    Entry(name="errors", page="docs/results.md", make=comparison_tables.errors, sweeps=(STUDY,)),
    Entry(
        name="compare", page="docs/compare.md", make=comparison_tables.controllers, sweeps=(STUDY,)
    ),
    *(
        Entry(
            name=name,
            page=f"docs/results/{name}.md",
            make=study_tables.sweep_page(name),
            sweeps=(name,),
        )
        for name in SWEEPS
    ),
    Entry(name="studies", page="docs/results.md", make=study_tables.studies, sweeps=SWEEPS),
    _study(
        "breaking-points",
        "docs/results.md",
        breaking_points.main,
        seeds=report_seeds(3),
        probes=tuple(("grass", name) for name in breaking_points.CONTROLLERS),
        minutes=5.0,
    ),
    _study(
        "ablation",
        "docs/ablation.md",
        ablation.main,
        seeds=report_seeds(2),
        probes=(
            *((name, "ttempc") for name in ablation.SCENARIOS),
            ("grass", "ttempc-nominal"),
            ("grass", "feedforward"),
        ),
        minutes=2.0,
    ),
    Entry(
        name="front",
        page="docs/ablation.md",
        make=study_tables.fronts,
        seeds=report_seeds(2),
        probes=tuple((name, "ttempc") for name in front.SCENARIOS)
        + tuple(("grass", name) for name in ("pid", "lqr", "nmpc-rti", "ttempc-tube")),
        minutes=2.0,
    ),
    _study(
        "conditions",
        "docs/ablation.md",
        conditions.main,
        seeds=report_seeds(2),
        probes=tuple(("grass", "ttempc", *change) for change in conditions.CHANGES.values()),
        minutes=0.5,
    ),
    _study(
        "recovery",
        "docs/ablation.md",
        recovery.main,
        "ttempc",
        seeds=recovery.SEEDS,
        probes=tuple((name, "ttempc") for name in recovery.SCENARIOS),
        minutes=0.3,
    ),
    _study(
        "corridor",
        "docs/corridor.md",
        corridor.main,
        seeds=report_seeds(corridor.LAPS),
        probes=tuple((corridor.SCENARIO, name) for name in ("ttempc", "pid", "lqr", "nmpc-rti")),
        minutes=10.0,
    ),
    _study(
        "coverage",
        "docs/tube.md",
        coverage.main,
        seeds=report_seeds(coverage.LAPS),
        probes=tuple((name, "ttempc") for name in coverage.FIELDS),
        minutes=40.0,
    ),
    _study(
        "learning",
        "docs/learning.md",
        learning.main,
        "ttempc",
        seeds=learning.SEEDS,
        probes=((learning.SCENARIO, "ttempc"), (learning.SCENARIO, "ttempc", *learning.PROBE)),
        minutes=4.0,
    ),
    _study(
        "faults",
        "docs/faults.md",
        faults.main,
        seeds=faults.SEEDS,
        probes=tuple(
            (faults.SCENARIO, name, *change)
            for name in faults.CONTROLLERS
            for change in ((), cases.overrides("front steering stuck", 5.0))
        ),
        minutes=35.0,
    ),
    _study(
        "stuck-valves",
        "docs/faults.md",
        stuck_valves.main,
        seeds=stuck_valves.SEEDS,
        probes=((stuck_valves.SCENARIO, "ttempc", *cases.overrides("front steering stuck", 5.0)),),
        minutes=0.5,
    ),
    _study(
        "false-alarms",
        "docs/faults.md",
        false_alarms.main,
        seeds=report_seeds(false_alarms.DRIVES * len(false_alarms.fields())),
        probes=tuple((name, "ttempc") for name in shipped()),
        minutes=7.0,
    ),
    _study("soak", "docs/faults.md", soak.main, minutes=22.0),
    _study(
        "worst-cases",
        "docs/worst-cases.md",
        worst_cases.main,
        worst_cases.BUDGET,
        seeds=worst_cases.SEEDS,
        probes=tuple(("grass", name) for name in CONTROLLERS),
        minutes=11.0,
    ),
    _study(
        "limits",
        "docs/limits.md",
        limits.main,
        seeds=report_seeds(2),
        probes=(
            *((name, limits.CONTROLLER) for name in shipped()),
            *(
                (name, limits.CONTROLLER, f'controller.estimator="{TRUTH}"')
                for name in ("furrows", "grass", "wet-slope")
            ),
        ),
        minutes=4.0,
    ),
    _study(
        "retuned",
        "docs/compare.md",
        retuned.main,
        seeds=report_seeds(2),
        probes=(
            *((name, "ttempc") for name in shipped()),
            *(("grass", name) for name in (*retuned.KNOBS, *retuned.SAME_PROBLEM)),
        ),
        minutes=13.0,
    ),
    _study(
        "errata",
        "docs/errata.md",
        errata.main,
        seeds=errata.SEEDS,
        probes=(("pavement", "paper"), ("pavement", "paper-printed-sign")),
        minutes=1.0,
    ),
    _study(
        "estimators",
        "docs/estimators.md",
        estimators.main,
        estimators.SCENARIOS,
        seeds=estimators.SEEDS,
        probes=tuple(
            (name, "ttempc-nominal", f'controller.estimator="{estimator}"')
            for name in estimators.SCENARIOS
            for estimator in estimators.ESTIMATORS
        ),
        minutes=3.0,
    ),
    _study(
        "consistency",
        "docs/estimators.md",
        estimators.print_consistency,
        seeds=estimators.SEEDS,
        probes=tuple((name, "ttempc") for name in shipped()),
        minutes=2.0,
    ),
    _study(
        "invariance",
        "docs/tube.md",
        invariance.main,
        "grass",
        probes=(("grass", "ttempc-tube"),),
        minutes=0.5,
        fenced=True,
    ),
    _study(
        "paper-tube",
        "docs/tube.md",
        paper_tube.main,
        probes=(("pavement", "paper"),),
        minutes=0.1,
        fenced=True,
    ),
    Entry(
        name="containment",
        page="docs/tube.md",
        make=study_tables.contained,
        seeds=report_seeds(CONTAINMENT_LAPS),
        probes=tuple(
            (name, "ttempc-tube") for name in ("grass", "pavement", "wet-grass", "side-slope")
        ),
        minutes=13.0,
    ),
    Entry(
        name="ranking",
        page="docs/ranking.md",
        make=study_tables.ranked,
        seeds=report_seeds(RANKING_DRAWS),
        probes=tuple((name, "ttempc") for name in ranking.FIELDS)
        + tuple(("grass", name) for name in ranking.CONTROLLERS[1:]),
        minutes=10.0,
    ),
    Entry(
        name="evidence",
        page="docs/evidence.md",
        make=study_tables.evidence,
        probes=(("farm", "ttempc"), ("cultivate", "ttempc"), ("grass", "ttempc")),
        minutes=5.0,
    ),
    _study(
        "learnt-policy",
        "docs/howto/gym.md",
        policy.main,
        seeds=policy.SEEDS,
        probes=tuple((name, policy.FACTORY) for name in policy.FIELDS),
        minutes=1.5,
    ),
    Entry(
        name="card",
        page="docs/card/README.md",
        make=study_tables.plant_validation,
        probes=tuple((name, "ttempc") for name in shipped()),
        minutes=5.0,
    ),
    Entry(
        name="field-trials",
        page="docs/field-trials.md",
        make=trial_tables.field_trials,
        seeds=PUBLIC,
        probes=trial_tables.PROBES,
        minutes=110.0,
    ),
    Entry(
        name="performance",
        page="docs/performance.md",
        make=study_tables.performance,
        minutes=4.0,
    ),
)
"""All tables, in the order in which `ttempc reproduce all` makes them."""


def minutes(entry: Entry) -> float:
    """Return the time of an entry on two cores if none of its rows exist [min]."""
    return entry.minutes + sum(SWEEP_MINUTES[name] for name in entry.sweeps)
