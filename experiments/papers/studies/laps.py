"""Laps: readings of the paper, parts of `ttempc`, estimators."""

import json
import math
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
from ...scenario.scenario import load, shipped
from ...seeds import report_seeds
from ..study import Case, Row, Study, summary_row
from ..tables import grouped, label, lost, mean, mean_errors, numbers


def _options(**options: object) -> tuple[str, ...]:
    return tuple(f"controller.options.{key}={json.dumps(value)}" for key, value in options.items())


def _named(controller: str) -> tuple[str, ...]:
    return (f'controller.name="{controller}"',)


READINGS: Final = {
    "`paper`": (),
    "1: hitch sign by geometry": _options(hitch_sign=-1),
    "2: hitch angle of the reference": _options(hitch_angle="reference"),
    "3: feedforward by geometry": _options(feedforward="geometry"),
    "1 and 3": _options(hitch_sign=-1, feedforward="geometry"),
    "1, 2 and 3": _options(hitch_sign=-1, hitch_angle="reference", feedforward="geometry"),
    "4 as printed": _options(trailer_error_frame="tractor"),
    "5: exact trailer speed": _options(trailer_speed="exact"),
    "6 as printed": _options(robust_sign=1),
    "7 as printed": _options(hp_full_scale=100),
    "8: the tube's own nominal": _options(nominal="tube"),
    "6 as printed, with 8: `paper-printed-sign`": _options(robust_sign=1, nominal="tube"),
    "robust action off": _options(robust=False),
}
"""Corrections of the paper's equations, each changed by itself, on `pavement`, where the plant is
closest to the kinematic model."""

PARTS: Final = {
    "feedforward": _named("feedforward"),
    "+ LMPC": _options(robust=False, disturbances=False),
    "+ LMPC, robust": _options(disturbances=False, tightening="none"),
    "+ LMPC, disturbance (`ttempc-nominal`)": _options(robust=False),
    "+ LMPC, disturbance, robust": _options(tightening="none"),
    "+ LMPC, disturbance, robust, growing tube (`ttempc`)": (),
    "no tube, MPC tightened by the law's authority": _options(tightening="saturation"),
    "no tube, robust in the tube reading": _options(tightening="none", nominal="tube"),
    "no robust, step weights 1, 1, 0.02": _options(robust=False, step_weight=(1.0, 1.0, 0.02)),
    "no robust, step weights 0.05, 0.05, 0.1": _options(
        robust=False, step_weight=(0.05, 0.05, 0.1)
    ),
    "no robust, horizon 12": _options(robust=False, horizon=12),
}

FIELDS: Final = ("pavement", "grass", "wet-grass", "side-slope", "wet-slope", "patchy")
ESTIMATORS: Final = ("ekf", "nmhe")
_COST: Final = "timing.estimator_us.median"


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
    name, scenario = load(case.scenario, case.overrides)
    if isinstance(scenario.path, FigureEight):
        scenario = replace(scenario, path=replace(scenario.path, laps=1))
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
        name="ablation",
        scenarios=("grass", "wet-slope", "patchy", "old-valves"),  # where the parts differ most
        axes={"parts": PARTS},
        seeds=report_seeds(2),
        table=lambda runs: grouped(
            runs,
            ["scenario", "parts"],
            {
                "scenario": label("scenario", "`{}`"),
                "parts": label("parts"),
                **mean_errors(),
                "steering rate, deg/s": mean(
                    "inputs.delta_t.rms_rate", form=".1f", factor=math.degrees(1.0)
                ),
                "lost": lost,
            },
        ),
        checks=(
            *((name, "ttempc") for name in ("grass", "wet-slope", "patchy", "old-valves")),
            ("grass", "ttempc-nominal"),
            ("grass", "feedforward"),
        ),
    ),
    Study(
        name="errata",
        scenarios=("pavement",),
        overrides=("path.laps=1", *_named("paper")),
        axes={"reading": READINGS},
        seeds=report_seeds(3),
        table=lambda runs: grouped(
            runs, ["reading"], {"reading": label("reading"), **mean_errors(".1f"), "lost": lost}
        ),
        checks=(("pavement", "paper"), ("pavement", "paper-printed-sign")),
    ),
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
    ),
    Study(
        name="consistency",
        scenarios=tuple(shipped()),
        overrides=(),
        seeds=report_seeds(2),
        drive=consistent,
        table=consistency_table,
        checks=tuple((name, "ttempc") for name in shipped()),
    ),
)
