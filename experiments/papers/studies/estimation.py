"""Estimators compared, and consistency of the default one."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
import pandas as pd

from ttempc.types import State

from ....testbed.recording.channels import ESTIMATE
from ...logs.replay import estimator_of, replay
from ...results.consistency import consistency
from ...results.tracking_errors import BODIES
from ...run.simulate import simulate
from ...scenario.path import FigureEight
from ...scenario.scenario import Scenario, load, shipped
from ...seeds import report_seeds
from ..study import Case, Row, Study, summary_row
from ..tables import grouped, label, mean, mean_errors, numbers

FIELDS: Final = ("pavement", "grass", "wet-grass", "side-slope", "wet-slope", "patchy")
ESTIMATORS: Final = ("ekf", "nmhe")
_COST: Final = "timing.estimator_us.median"


def one_lap(case: Case) -> tuple[str, Scenario]:
    """Return the scenario of a case with one lap of its path, if that has laps."""
    name, scenario = load(case.scenario, case.overrides)
    if isinstance(scenario.path, FigureEight):
        scenario = replace(scenario, path=replace(scenario.path, laps=1))
    return name, scenario


def estimated(case: Case) -> Row:
    """Return the figures of a run, and its mean normalised innovation squared `nis`.

    The innovations of `nmhe` are those of its internal filter.
    """
    summary, record = simulate(*load(case.scenario, case.overrides), case.seed)
    table = record[ESTIMATE]
    return {
        **summary_row(summary),
        "nis": float(np.nansum(table["nis"]) / np.nansum(table["nis_dof"])),
    }


def consistent(case: Case) -> Row:
    """Return the normalised errors of the default estimator, replayed from the record of a lap."""
    name, scenario = one_lap(case)
    _, record = simulate(name, scenario, case.seed)
    found = consistency(replay(record, estimator_of(scenario)), record)
    gnss = [item.autocorrelation for item in found.sensors if item.name.startswith("gnss")]
    return {
        **{state.name.lower(): item.nees for state, item in zip(State, found.states, strict=True)},
        "NIS": found.nis,
        "autocorrelation": float(np.mean(gnss)),
        "estimated tractor": 100.0 * found.tractor_m,
        "estimated trailer, cm": 100.0 * found.trailer_m,
    }


def consistency_table(runs: pd.DataFrame) -> str:
    """Return the mean normalised estimation error squared of each state, then of innovations."""
    heads = [name for name in runs.columns if name not in ("scenario", "seed")]
    cells = {name: mean(name, factor=1.0) for name in heads}
    return grouped(runs, ["scenario"], {"scenario": label("scenario", "`{}`"), **cells})


STUDIES: Final = (
    Study(
        name="estimators",
        scenarios=FIELDS,
        overrides=("path.laps=1", 'controller.name="ttempc-nominal"'),
        axes={"estimator": {name: (f'controller.estimator="{name}"',) for name in ESTIMATORS}},
        seeds=report_seeds(2),
        drive=estimated,
        table=lambda runs: grouped(
            runs,
            ["scenario", "estimator"],
            {
                "scenario": label("scenario", "`{}`"),
                "estimator": label("estimator", "`{}`"),
                **{
                    f"estimated {body}": mean(f"estimation.{body}.mean_euclidean_m")
                    for body in BODIES
                },
                **mean_errors(),
                "NIS": lambda own: ", ".join(f"{value:.3f}" for value in own["nis"]),
                "ms": lambda own: f"{1e-3 * np.median(numbers(own, _COST)):.2f}",
            },
        ),
        checks=tuple(
            (name, "ttempc-nominal", f'controller.estimator="{estimator}"')
            for name in FIELDS
            for estimator in ESTIMATORS
        ),
        minutes=3.0,
    ),
    Study(
        name="consistency",
        scenarios=tuple(shipped()),
        overrides=(),
        seeds=report_seeds(2),
        drive=consistent,
        table=consistency_table,
        checks=tuple((name, "ttempc") for name in shipped()),
        minutes=2.0,
    ),
)
