"""Laps: readings of the paper, its published errors, estimators."""

import json
from dataclasses import replace
from typing import Final

import numpy as np
import pandas as pd

from ttempc.types import FloatArray, State

from ...logs.replay import estimator_of, replay
from ...results.consistency import consistency
from ...run.simulate import simulate
from ...scenario.path import FigureEight
from ...scenario.scenario import shipped
from ...seeds import report_seeds
from ...studies.sweep.row import Row
from ...studies.sweep.work import SweepJob
from ..markdown import (
    COLUMNS,
    ERRORS,
    PUBLISHED_M,
    PUBLISHED_NMPC_M,
    grouped,
    groups,
    label,
    lost,
    markdown,
    mean,
    mean_errors,
    numbers,
)
from ..table import Table, listed, study, variants


def _options(**options: object) -> tuple[str, ...]:
    return tuple(f"controller.options.{key}={json.dumps(value)}" for key, value in options.items())


def _named(controller: str) -> tuple[str, ...]:
    return (f'controller.name="{controller}"',)


_TUBE: Final = {"nominal": "model", "mpc_start": "nominal"}

READINGS: Final = {
    "`paper`": (),
    "1: hitch sign by geometry": _options(hitch_sign=-1),
    "2: hitch angle of the reference": _options(hitch_angle="reference"),
    "3: feedforward by geometry": _options(feedforward="geometry"),
    "1, 2 and 3": _options(hitch_sign=-1, hitch_angle="reference", feedforward="geometry"),
    "4 as printed": _options(trailer_error_frame="tractor"),
    "5: exact trailer speed": _options(trailer_speed="exact"),
    "6 as printed: `paper-printed-sign`": _options(robust_sign=1),
    "7 as printed": _options(hp_full_scale=100),
    "8: nominal state one step ahead": _options(nominal="one-step"),
    "8: the tube's own nominal: `paper-tube`": _options(**_TUBE),
    "9: hitch angle subtracted": _options(hitch_angle="subtracted"),
    "10: speed in the yaw rows": _options(yaw_by_speed=True),
    "13: hydrostat as a fraction": _options(hp_in_cost="fraction"),
    "13: steering in rad/s: `paper-rate-weight`": _options(steering_in_cost="rad/s"),
    "8, 9, 13: `paper-subtracted`": _options(
        hitch_angle="subtracted", nominal="one-step", hp_in_cost="fraction"
    ),
    "robust action off": _options(robust=False),
}
"""Readings of the paper's equations, each changed by itself, on `pavement`, where the plant is
closest to the kinematic model."""

PUBLISHED: Final = {"LMPC": tuple(PUBLISHED_M.values()), "NMPC": PUBLISHED_NMPC_M}
"""Mean errors [m] of the two controllers published for the vehicle."""

_PRINTED: Final = (*_named("nmpc-path"), 'controller.estimator="nmhe-printed"')
LAWS: Final = {
    "LMPC, `paper`": _named("paper"),
    "LMPC, `paper-rate-weight`": _named("paper-rate-weight"),
    "NMPC, `nmpc-path`": _PRINTED,
    "NMPC, `nmpc-path`, by time": (*_PRINTED, *_options(parametrised_by="time")),
    "`nmpc` with the EKF, by time": _named("nmpc"),
}


def published_errors(runs: pd.DataFrame) -> str:
    """Return the mean errors of both published controllers beside the published ones."""
    lines = []
    told: set[str] = set()
    for own in groups(runs, ["law"]):
        name = own["law"].iloc[0]
        errors = 100.0 * numbers(own, *ERRORS)
        kind = name.partition(",")[0]
        if kind in PUBLISHED and kind not in told:
            cells = (f"{100.0 * m:.2f}" for m in PUBLISHED[kind])
            lines.append((f"{kind}, published", *cells, _ratio(np.array(PUBLISHED[kind])), "-"))
            told.add(kind)
        spread = np.array([errors.mean(0), errors.min(0), errors.max(0)]).T
        cells = (f"{m:.1f} ({low:.1f}-{high:.1f})" for m, low, high in spread)
        lines.append((name, *cells, _ratio(errors.mean(0)), lost(own)))
    return markdown(("error [cm]", *COLUMNS, "curve / straight", "lost"), lines)


def _ratio(errors: FloatArray) -> str:
    """Return the errors on curves over those on straights of both bodies."""
    return ", ".join(f"{ratio:.2f}" for ratio in errors[2:] / errors[:2])


_STATES: Final = tuple(state.name.lower() for state in State)
_NUMBERS: Final = (
    "position",
    "heading",
    *_STATES,
    "NIS",
    "autocorrelation",
    "estimated tractor",
    "estimated trailer, cm",
)


def consistent(job: SweepJob) -> Row:
    """Return the normalised errors of the default estimator, replayed from the record of a lap."""
    scenario = job.scenario
    if isinstance(scenario.path, FigureEight):
        scenario = replace(scenario, path=replace(scenario.path, laps=1))
    summary, record = simulate(job.name, scenario, job.seed)
    found = consistency(replay(record, estimator_of(scenario)), record)
    gnss = [item.autocorrelation for item in found.sensors if item.name.startswith("gnss")]
    errors = {name: item.nees for name, item in zip(_STATES, found.states, strict=True)}
    others = {
        "position": found.position_nees,
        "heading": found.heading_nees,
        "NIS": found.nis,
        "autocorrelation": float(np.mean(gnss)),
        "estimated tractor": 100.0 * found.tractor_m,
        "estimated trailer, cm": 100.0 * found.trailer_m,
    }
    return job.row(summary.status, summary.failure, {**errors, **others}, None)


def consistency_table(runs: pd.DataFrame) -> str:
    """Return the mean normalised estimation error squared of each state, then of innovations."""
    cells = {name: mean(name, factor=1.0) for name in _NUMBERS}
    return grouped(runs, ["scenario"], {"scenario": label("scenario", "`{}`"), **cells})


def errata_table(runs: pd.DataFrame) -> str:
    """Return the errors of each reading of the paper."""
    cells = {"reading": label("reading"), **mean_errors(".1f"), "lost": lost}
    return grouped(runs, ["reading"], cells)


_LAP: Final = ("path.laps=1",)
_FRESH: Final = (3001, 3002)
"""Seeds of the filter's consistency: the first reported ones were looked at while it was built."""

TABLES: Final = (
    Table(
        name="errata",
        studies={
            "errata": study(
                "pavement",
                report_seeds(2),
                (*_LAP, *_named("paper")),
                variants("reading", READINGS),
            )
        },
        text=errata_table,
        checks=(("pavement", "paper"), ("pavement", "paper-printed-sign")),
    ),
    Table(
        name="kayacan2016",
        studies={
            "kayacan2016": study("kayacan2016", report_seeds(5), _LAP, variants("law", LAWS)),
        },
        text=published_errors,
        checks=(("kayacan2016", "paper"), ("kayacan2016", "nmpc-path")),
    ),
    Table(
        name="consistency",
        studies={
            "consistency": study("grass", _FRESH, (), listed("scenario", *shipped())),
        },
        work=consistent,
        text=consistency_table,
        checks=tuple((name, "ttempc") for name in shipped()),
    ),
)
