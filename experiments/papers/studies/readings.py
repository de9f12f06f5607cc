"""Readings of the paper, scored by what it reports of its own experiment."""

import itertools
import json
import math
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ....testbed.recording.channels import CONTROL, ESTIMATE, REFERENCE
from ....testbed.recording.record import Record
from ...results.stretches import is_curved
from ...results.summary import Summary
from ...results.tracking_errors import TrackingErrors, tracking_errors
from ...run.simulate import simulate
from ...scenario.path import FigureEight
from ...seeds import report_seeds
from ...studies.sweep.work import SweepJob, run_job
from ..markdown import PUBLISHED_M, groups, label, lost, markdown, mean, numbers
from ..table import Table, study, variants

_TUBE: Final = {"nominal": "model", "mpc_start": "nominal"}
_NOMINALS: Final = {
    "reference": {},
    "one-step": {"nominal": "one-step"},
    "tube": _TUBE,
}
_HITCH: Final = {"+ beta": {}, "- beta": {"hitch_angle": "subtracted"}}
_SIGNS: Final = {"printed": {}, "geometry": {"hitch_sign": -1}}


def _grid() -> dict[str, dict[str, Any]]:
    """Return every combination of sign of beta, nominal state and hitch sign, by its words."""
    axes = itertools.product(_HITCH.items(), _NOMINALS.items(), _SIGNS.items())
    return {
        f"{beta[0]}, zbar {nominal[0]}, hitch {sign[0]}": {**beta[1], **nominal[1], **sign[1]}
        for beta, nominal, sign in axes
    }


_BEST: Final = "+ beta, zbar reference, hitch printed"
READINGS: Final = {
    **_grid(),
    f"{_BEST}, HP fraction": {"hp_in_cost": "fraction"},
    f"{_BEST}, steering rad/s": {"steering_in_cost": "rad/s"},
    f"{_BEST}, steering deg": {"steering_in_cost": "deg"},
    f"{_BEST}, v_e column": {"yaw_by_speed": True},
    f"{_BEST}, robust sign printed": {"robust_sign": 1},
    "- beta, zbar one-step, hitch printed, HP fraction": {
        "hitch_angle": "subtracted",
        "nominal": "one-step",
        "hp_in_cost": "fraction",
    },
}
"""Options of each reading; what a reading does not name is as in `paper`."""

NAMED: Final = {
    _BEST: "paper",
    f"{_BEST}, steering rad/s": "paper-rate-weight",
    "+ beta, zbar tube, hitch printed": "paper-tube",
    "- beta, zbar one-step, hitch printed, HP fraction": "paper-subtracted",
    f"{_BEST}, robust sign printed": "paper-printed-sign",
}
"""Readings that are controllers by name."""

_BEYOND: Final = 0.01  # share of ticks beyond a bound that counts as within them
_BY_BETA: Final = 0.25  # share of the trailer's second differences that beta has to explain
_WEAVES: Final = 2.0  # factor of the cross-track error by which a loop without derivative weaves
_LIKE: Final = 1.5  # factor to a published number that counts as agreement


def _options(options: dict[str, Any]) -> tuple[str, ...]:
    return tuple(f"controller.options.{key}={json.dumps(value)}" for key, value in options.items())


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else math.nan


def _means(errors: TrackingErrors, rows: NDArray[np.bool_]) -> FloatArray:
    """Return the mean Euclidean errors of the paper's table in some of the rows, (4,) [m]."""
    means = []
    for where, body in PUBLISHED_M:
        part = rows & (errors.curved if where == "curve" else ~errors.curved)
        distance = errors.by_point[body].euclidean_m[part]
        means.append(float(np.mean(distance)) if distance.size else math.nan)
    return np.array(means)


def _ratio(means: FloatArray) -> float:
    """Return the error on curves over that on straights, geometric mean of both bodies."""
    return float(np.sqrt(np.prod(means[2:] / means[:2])))


def _actions(record: Record) -> dict[str, float]:
    """Return robust over feedback action at the front, and what beta explains of the trailer's."""
    control = record[CONTROL]
    reference = record[REFERENCE]
    at = np.searchsorted(reference.time_s, control.time_s).clip(0, len(reference) - 1)
    curved = is_curved(record)[at]
    result = {}
    for name, rows in (("straight", ~curved), ("curve", curved)):
        robust, feedback = (
            _rms(control[f"delta_t_rad_{action}"][rows]) for action in ("robust", "feedback")
        )
        result[f"robust / feedback, {name}"] = robust / max(feedback, 1e-6)
    estimate = record[ESTIMATE]
    at = np.searchsorted(estimate.time_s, control.time_s).clip(0, len(estimate) - 1)
    beta = np.diff(estimate["beta_rad"][at], 2)
    total = np.diff(control["delta_i_rad_total"], 2)
    known = np.isfinite(beta)
    correlation = np.corrcoef(beta[known], total[known])[0, 1] if known.sum() > 2 else 0.0
    result["by beta"] = float(correlation**2)
    return result


def observations(job: SweepJob, summary: Summary, record: Record) -> dict[str, float | None]:
    """Return what the paper saw, from two laps of a reading and one without the derivative."""
    inputs = summary.inputs
    beyond = [each.beyond_fraction or 0.0 for each in (inputs.delta_t, inputs.delta_i, inputs.hp)]
    errors = tracking_errors(record)
    driven = bool(len(errors.time_s))
    half_s = 0.5 * float(record[REFERENCE].time_s[-1]) if driven else 0.0
    first = errors.time_s <= half_s
    lap = _means(errors, errors.counted & first)
    straight = errors.counted & ~errors.curved & first
    found = {
        "beyond": max(beyond),
        **dict(zip(map("-".join, PUBLISHED_M), lap.tolist(), strict=True)),
        "ratio": _ratio(lap),
        "ratio, start-up counted": _ratio(_means(errors, first)),
        "ratio, two laps": _ratio(_means(errors, errors.counted)),
        "cross": _rms(errors.tractor.cross_m[straight]),
        "along share": _along_share(errors, straight),
        **_actions(record),
        "cross, k_d = 0": _cross_without_derivative(job),
    }
    return {name: value if math.isfinite(value) else None for name, value in found.items()}


def _cross_without_derivative(job: SweepJob) -> float:
    """Drive a lap without the derivative of the robust action; return its error on straights."""
    controller = job.scenario.controller
    options = {**controller.options, "derivative": [0.0, 0.0, 0.0]}
    scenario = replace(job.scenario, controller=replace(controller, options=options))
    if isinstance(scenario.path, FigureEight):
        scenario = replace(scenario, path=replace(scenario.path, laps=1))
    errors = tracking_errors(simulate(job.name, scenario, job.seed)[1])
    return _rms(errors.tractor.cross_m[errors.counted & ~errors.curved])


def _along_share(errors: TrackingErrors, rows: NDArray[np.bool_]) -> float:
    """Return the share of the squared error of the tractor that is along the path."""
    along = _rms(errors.tractor.along_m[rows])
    cross = _rms(errors.tractor.cross_m[rows])
    return along**2 / (along**2 + cross**2)


def score(runs: pd.DataFrame) -> dict[str, bool]:
    """Return which of the paper's observations the runs of a reading show, by their words."""

    def average(key: str) -> float:
        return float(np.mean(numbers(runs, key)))

    completed = bool((runs["status"] == "completed").all())
    straight, curve = (
        numbers(runs, f"robust / feedback, {part}") for part in ("straight", "curve")
    )
    means = np.array([average("-".join(part)) for part in PUBLISHED_M])
    published = np.array([*PUBLISHED_M.values()])
    ratio = average("ratio") / _ratio(published)
    level = math.exp(float(np.mean(np.abs(np.log(means / published)))))
    return {
        "driven": completed,
        "bounds": completed and bool(numbers(runs, "beyond").max() < _BEYOND),
        "beta": completed and average("by beta") > _BY_BETA,
        "rises": completed and bool((curve > straight).all()),
        "crosses": completed and bool(straight.mean() < 1.0 < curve.mean()),
        "derivative": completed and average("cross, k_d = 0") > _WEAVES * average("cross"),
        "ratio": completed and abs(math.log(ratio)) < math.log(_LIKE),
        "level": completed and level < _LIKE,
    }


def scored(runs: pd.DataFrame) -> str:
    """Return the readings by their score, with the observations behind it."""
    lines = []
    for own in groups(runs, ["reading"]):
        facts = score(own)
        name = NAMED.get(own["reading"].iloc[0])
        straight, curve = (
            f"{np.mean(numbers(own, f'robust / feedback, {part}')):.2f}"
            for part in ("straight", "curve")
        )
        weaves = f"{mean('cross')(own)} > {mean('cross, k_d = 0')(own)}"
        errors = ", ".join(mean("-".join(part), form=".1f")(own) for part in PUBLISHED_M)
        ratios = ", ".join(
            f"{np.mean(numbers(own, key)):.2f}"
            for key in ("ratio", "ratio, start-up counted", "ratio, two laps")
        )
        cells = (
            label("reading")(own) + (f" (`{name}`)" if name else ""),
            f"{sum(facts.values())} of {len(facts)}",
            ", ".join(word for word, shown in facts.items() if not shown) or "-",
            mean("beyond", form=".1f")(own),
            mean("by beta", form=".0f")(own),
            f"{straight} > {curve}",
            weaves,
            ratios,
            errors,
            mean("along share", form=".0f")(own),
            lost(own),
        )
        lines.append((sum(facts.values()), cells))
    lines.sort(key=lambda line: -line[0])
    heads = (
        "reading",
        "score",
        "not shown",
        "beyond bounds [%]",
        "by beta [%]",
        "robust / feedback, straight > curve",
        "cross rms [cm], k_d printed > 0",
        "curve / straight: lap, with start-up, two laps",
        "mean error [cm]",
        "along [%]",
        "lost",
    )
    return markdown(heads, [cells for _, cells in lines])


_CHANGES: Final = ("path.laps=2", 'controller.name="paper"')

TABLES: Final = (
    Table(
        name="readings",
        studies={
            "readings": study(
                "kayacan2016",
                report_seeds(2),
                _CHANGES,
                variants("reading", {name: _options(each) for name, each in READINGS.items()}),
            )
        },
        work=partial(run_job, measure=observations),
        text=scored,
        checks=(("kayacan2016", "paper"), ("kayacan2016", "paper-rate-weight")),
    ),
)
