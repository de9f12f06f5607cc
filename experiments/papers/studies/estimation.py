"""Estimators compared, consistency of the default one, and the parts of the tracking error."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
import pandas as pd

from ttempc.types import FloatArray, State

from ....testbed.recording.channels import ESTIMATE, STATE
from ....testbed.sensing.sensor_specification import SensorSpecification
from ...logs.replay import estimator_of, replay
from ...results.consistency import consistency
from ...results.tracking_errors import BODIES, START_UP_S, position_fields, rows_at_same_time
from ...run.simulate import simulate
from ...scenario.controller import TRUTH, NoiseSettings
from ...scenario.path import FigureEight
from ...scenario.scenario import Scenario, load, shipped
from ...seeds import report_seeds
from ..cells import grouped, groups, label, mean, mean_errors, numbers
from ..study import Case, Row, Study, summary_row
from ..tables import markdown

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


def _clean(scenario: Scenario) -> Scenario:
    """Return the scenario with the paper's sensors, undelayed at the axle points, without noise."""
    sensors = SensorSpecification(gnss_sd_m=0.0, angle_sd_deg=0.0, encoder_sd_mps=0.0)
    controller = replace(scenario.controller, noise=NoiseSettings().filled(sensors))
    return replace(scenario, sensors=sensors, controller=controller)


def _truth(scenario: Scenario) -> Scenario:
    return replace(scenario, controller=replace(scenario.controller, estimator=TRUTH))


def _level(scenario: Scenario) -> Scenario:
    """Return the scenario with `truth` on level, smooth ground of the same soil."""
    scenario = _truth(scenario)
    level = replace(scenario.terrain, iso_class="flat", slope_rad=0.0, height_map="", features=())
    return replace(scenario, terrain=level)


VARIANTS: Final[dict[str, Callable[[Scenario], Scenario]]] = {
    "as it is": lambda scenario: scenario,
    "clean sensors": _clean,
    "`truth`": _truth,
    "`truth`, smooth level ground": _level,
}
"""Each leaves out one source of error more than the one before."""

PARTS: Final = ("sensor noise", "filter's model", "ground", "soil and control")
"""Parts of the mean square error: differences of neighbouring variants, and the last variant."""


def mean_squares(case: Case) -> Row:
    """Return the mean square errors of tracking and estimation by point [m^2], NaN if lost."""
    name, scenario = one_lap(case)
    summary, record = simulate(name, VARIANTS[case["variant"]](scenario), case.seed)
    time_s, state, estimate = rows_at_same_time(record, STATE, ESTIMATE)
    row: dict[str, float] = {}
    for body in BODIES:
        rms = getattr(summary.tracking.all, body).rms_m or math.nan
        row[f"{body} tracking"] = rms**2 if summary.status == "completed" else math.nan
        places = position_fields(body)
        error = record[ESTIMATE].columns(*places)[estimate] - record[STATE].columns(*places)[state]
        after = np.sum(error[time_s >= START_UP_S] ** 2, axis=1)
        row[f"{body} estimation"] = float(np.mean(after))
    return row


def parts(tracking: FloatArray) -> FloatArray:
    """Return the parts of the mean square error in the order of `PARTS`, (4, ...).

    Their sum is the first variant's. A part is negative where leaving out its source makes the
    error larger.

    Args:
        tracking: mean squares by variant, (4, ...).
    """
    return tracking - np.concatenate([tracking[1:], np.zeros_like(tracking[:1])])


def limit_tables(runs: pd.DataFrame) -> str:
    """Return root mean square errors [cm], and the parts of the mean square error [%], by field."""
    errors, shares = [], []
    for field in groups(runs, ["scenario"]):
        variants = [*groups(field, ["variant"])]
        tracking, estimation = (
            np.array(
                [numbers(own, *(f"{body} {what}" for body in BODIES)) for own in variants]
            ).mean(axis=1)
            for what in ("tracking", "estimation")
        )  # (4, 2) each
        followed = tracking[0] - tracking[2] - estimation[0]
        split = 100.0 * np.array([*parts(tracking), followed]) / tracking[0]
        name = f"`{field['scenario'].iloc[0]}`"
        errors.append([name, *_pairs(100.0 * np.sqrt([*tracking, estimation[0]]), ".2f")])
        shares.append([name, *_pairs(np.round(split) + 0.0, ".0f")])  # + 0.0: no "-0"
    return "\n\n".join(
        [
            markdown(["tractor / trailer [cm]", *VARIANTS, "estimation error"], errors),
            markdown(["share of the mean square error [%]", *PARTS, "noise followed"], shares),
        ]
    )


def _pairs(values: FloatArray, form: str) -> list[str]:
    return [" / ".join("lost" if math.isnan(x) else f"{x:{form}}" for x in two) for two in values]


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
    Study(
        name="limits",
        scenarios=tuple(shipped()),
        overrides=('controller.name="ttempc"',),
        axes={"variant": tuple(VARIANTS)},
        seeds=report_seeds(2),
        drive=mean_squares,
        table=limit_tables,
        checks=(
            *((name, "ttempc") for name in shipped()),
            *(
                (name, "ttempc", f'controller.estimator="{TRUTH}"')
                for name in ("furrows", "grass", "wet-slope")
            ),
        ),
        minutes=4.0,
    ),
)
