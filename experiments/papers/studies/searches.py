"""Searches of runs: breaking points, worst cases, and controllers retuned by one rule."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd

from ttempc.errors import TtempcError
from ttempc.guidance.controllers import CONTROLLERS, controller_options

from ....testbed.errors import TestbedError
from ...errors import ExperimentError
from ...run.assembly import check
from ...run.simulate import simulate
from ...scenario.scenario import merge_tables, parse_overrides, read_scenario, shipped
from ...search.limit import Limit, Question, find_limit
from ...search.quantities import QUANTITIES, read_subject
from ...search.worst_case import Report, find_worst_case
from ...seeds import TUNING, report_seeds
from ...sweep.engine import engine
from ..cells import numbers
from ..kayacan.eight_numbers import CONTROLLER
from ..leads import leads_sentence
from ..runner import Runner
from ..study import Case, Row, Study, summary_row
from ..tables import markdown
from .control import errors_cm
from .estimation import one_lap

BROKEN: Final = ("ttempc", "pid", "paper")
TOLERANCES: Final = {"cone-index": 10.0, "slope": 0.01, "delay": 0.05}


def breaking_point(question: Question) -> Limit:
    """Return the answer to a question, found in this process."""
    with engine(workers=0) as here:
        return find_limit(question, here)


def breaking_points(runner: Runner, path: str = "path.laps=1") -> str:
    """Return the last value at which a lap is completed, and the first at which it is lost.

    Lost: in at least half of the seeds.
    """
    questions = [
        Question(
            scenario="grass",
            controller=controller,
            quantity=quantity,
            parameter=QUANTITIES[quantity],
            tolerance=tolerance,
            limit_m=None,
            seeds=runner.report_seeds(3),
            settings=parse_overrides([path]),
        )
        for quantity, tolerance in TOLERANCES.items()
        for controller in BROKEN
    ]
    found = iter(runner.map(breaking_point, questions))
    lines = []
    for quantity in TOLERANCES:
        cells = [_broken(next(found)) for _ in BROKEN]
        lines.append([f"{quantity.replace('-', ' ')} [{QUANTITIES[quantity].unit}]", *cells])
    return markdown(["quantity", *(f"`{name}`" for name in BROKEN)], lines)


def _broken(found: Limit) -> str:
    if found.outcome != "found":
        return f"{found.outcome} from {found.probes[0].value:g} to {found.probes[-1].value:g}"
    note = "" if found.monotone else ", not monotone"
    return f"{found.holds_at:.3g}, {found.fails_at:.3g}{note}"


@dataclass(frozen=True)
class Hunt:
    """A search for worst cases of a controller on `grass`."""

    controller: str
    words: tuple[str, ...]  # of `search`
    limit_m: float | None  # of the trailer's 95 % cross-track error
    seed: int
    budget: int = 30  # runs


HEADLAND: Final = "path={kind='headland', length_m=10.0, passes=2, width_m=14.0}"
HUNTED: Final[dict[str, tuple[tuple[str, ...], float | None]]] = {
    "Gust on the trailer": (("gust",), None),
    "Soft patch on a slope": (("soil_patch", "slope", "terrain.uphill_deg=0:360:free"), None),
    "Late commands": (("commands_late",), 0.3),
}


def hunt(task: Hunt, path: str = HEADLAND) -> Report:
    """Return the report of a search in this process."""
    settings = parse_overrides([path])
    merge_tables(settings, {"controller": {"name": task.controller}})
    subject = read_subject(read_scenario("grass"), "grass", settings, task.words)
    with engine(workers=0) as here:
        return find_worst_case(subject, here, task.seed, task.budget, task.limit_m)


SEARCHED: Final = (*CONTROLLERS, CONTROLLER)


def worst_cases(runner: Runner) -> str:
    """Return the worst case of every controller by question."""
    (seed, *_) = runner.report_seeds(1)
    tasks = [Hunt(name, *what, seed) for what in HUNTED.values() for name in SEARCHED]
    reports = iter(runner.map(hunt, tasks))
    parts = []
    for title, (words, limit) in HUNTED.items():
        option = f" --limit {limit:g}" if limit else ""
        parts.append(f"**{title}**: `{' '.join(words)}{option}`")
        parts.append(worst_table([next(reports) for _ in SEARCHED]))
    return "\n\n".join(parts).replace(CONTROLLER, "kayacan-nmpc")


def worst_table(reports: Sequence[Report]) -> str:
    """Return the worst case of each report with its values."""
    keys = [key.rpartition(".")[2] for key in reports[0].values]
    lines = []
    for report in reports:
        values = [f"{v:.3g}" if isinstance(v, float) else str(v) for v in report.values.values()]
        severity = f"{report.severity:.2f}" if report.failure else "-"
        end = report.failure or f"holds; least robustness {report.robustness:.2f}"
        failed = f"{report.failed} of {report.runs}"
        lines.append([f"`{report.controller}`", failed, severity, *values, end])
    return markdown(
        ["controller", "failed", "severity", *(f"`{key}`" for key in keys), "end"], lines
    )


Options = Mapping[str, Any]
Knob = tuple[str, float, tuple[int, ...]]  # option, factor, entries of a vector (none: a number)
Trial = tuple[str, Options]  # a controller with options

TUNED_ON: Final = ("grass", "patchy", "wet-slope", "old-valves", "farm", "furrows")
TUNING_SEEDS: Final = tuple(TUNING[:1])
LOST_CM: Final = 100.0  # error of a lost run in the objective
ROUNDS: Final = 4  # with two trials of each controller: nine evaluations with the first
_WEIGHTS: Final[tuple[Knob, ...]] = (
    ("step_weight", 4.0, (0, 1)),  # of both steerings
    ("step_weight", 4.0, (2,)),  # of the hydrostat
)
KNOBS: Final[dict[str, tuple[Knob, ...]]] = {
    "ttempc": _WEIGHTS,
    "ttempc-tube": _WEIGHTS,
    "pid": (("lag_ratio", 1.5, ()),),
    "lqr": _WEIGHTS,
    "nmpc-rti": _WEIGHTS,
}
"""Tuning options that move together, by controller; the first is compared with the others."""
SAME_PROBLEM: Final = {"nmpc": "nmpc-rti"}
"""Controllers that solve the optimisation problem of another one and take its chosen options."""


def turned(options: Options, knob: Knob, power: float) -> Options:
    """Return the options with one knob multiplied by its factor to a power, to three digits."""
    option, factor, entries = knob
    value, scale = options[option], factor**power
    if isinstance(value, Sequence):
        new: Any = [float(f"{x * scale:.3g}") if n in entries else x for n, x in enumerate(value)]
    else:
        new = float(f"{value * scale:.3g}")
    return {**options, option: new}


def objective(errors: Sequence[float]) -> float:
    """Return the geometric mean of errors [cm] over the fields that were driven (not NaN)."""
    driven = [min(error, LOST_CM) for error in errors if not math.isnan(error)]
    return math.exp(float(np.mean(np.log(driven)))) if driven else math.nan


def search(
    controllers: Sequence[str], values: Callable[[Sequence[Trial]], Sequence[float]]
) -> Iterator[dict[str, tuple[Options, float]]]:
    """Yield options and objective of all controllers: as they ship, then the best of each round.

    A coordinate search: a round multiplies and divides one knob by its factor and keeps the best of
    three; once every knob had its round, the factors become their square roots.

    Args:
        controllers: keys of `KNOBS`.
        values: objectives of controllers with options.
    """
    first: list[Trial] = []
    for name in controllers:
        known = controller_options(name, {})
        own = {option: known[option] for option, _, _ in KNOBS[name]}
        listed = {o: [*value] if isinstance(value, tuple) else value for o, value in own.items()}
        first.append((name, listed))
    best = {name: (own, value) for (name, own), value in zip(first, values(first), strict=True)}
    yield dict(best)
    for turn in range(ROUNDS):
        trials: list[Trial] = []
        for name in controllers:
            cycle, number = divmod(turn, len(KNOBS[name]))
            ways = (0.5**cycle, -(0.5**cycle))
            knob = KNOBS[name][number]
            trials += [(name, turned(best[name][0], knob, power)) for power in ways]
        for (name, options), value in zip(trials, values(trials), strict=True):
            if value < best[name][1]:
                best[name] = (options, value)
        yield dict(best)


def error_cm(case: Case) -> Row:
    """Return the error of one lap [cm]; infinite for a lost run, NaN where it is refused."""
    name, scenario = one_lap(case)
    try:
        check(scenario)
    except (ExperimentError, TestbedError, TtempcError):
        return {"error": math.nan}
    run = pd.DataFrame([summary_row(simulate(name, scenario, case.seed)[0])])
    return {"error": float(errors_cm(run)[0])}


def _case(trial: Trial, field: str, seed: int, **labels: object) -> Case:
    name, options = trial
    lines = [f"controller.options.{option}={value!r}" for option, value in options.items()]
    return Case(field, seed, (f'controller.name="{name}"', *lines), labels)


def retuned(runner: Runner, fields: Sequence[str] = (), tuned_on: Sequence[str] = TUNED_ON) -> str:
    """Return options chosen with one budget for all, and errors before and after on all fields."""

    def values(trials: Sequence[Trial]) -> list[float]:
        cases = [
            _case(trial, field, seed)
            for trial in trials
            for field in tuned_on
            for seed in TUNING_SEEDS
        ]
        errors = numbers(runner.frame(cases, error_cm), "error").reshape(len(trials), -1)
        return [objective(own) for own in errors.tolist()]

    first, *_, last = search([*KNOBS], values)
    lines = []
    for name, (options, before) in first.items():
        chosen, after = last[name]
        columns = (options, options.values(), chosen.values())
        texts = [", ".join(map(str, column)) for column in columns]
        lines.append([f"`{name}`", *texts, f"{before:.2f}, {after:.2f}"])
    heads = ["controller", "options", "ships", "chosen"]
    chosen_table = markdown([*heads, "error of the search, before and after [cm]"], lines)

    sources = {**{name: name for name in KNOBS}, **SAME_PROBLEM}
    runs = runner.frame(
        [
            _case((name, stage[source][0]), field, seed, stage=number, driver=name)
            for number, stage in enumerate((first, last))
            for field in fields or shipped()
            for name, source in sources.items()
            for seed in runner.report_seeds(2)
        ],
        error_cm,
    )

    def line(head: str, of: pd.DataFrame, text: Callable[[Sequence[float]], str]) -> list[str]:
        cells = of.groupby(["driver", "stage"], sort=False)["error"].agg(lambda e: text([*e]))
        return [head, *(f"{cells[name, 0]}, {cells[name, 1]}" for name in sources)]

    rows = [line(f"`{name}`", own, _mean) for name, own in runs.groupby("scenario", sort=False)]
    rows.append(line("geometric mean", runs, lambda errors: f"{objective(errors):.2f}"))
    errors_table = markdown(["before, after [cm]", *(f"`{name}`" for name in sources)], rows)
    after = runs.loc[(runs["stage"] == 1) & runs["error"].notna()]
    compared = pd.DataFrame(
        {
            "place": after["scenario"],
            "pair": after["seed"],
            "controller": after["driver"],
            "error_cm": after["error"].replace(math.inf, math.nan),
        }
    )
    leads = leads_sentence(compared, "fields", error="the errors of both points")
    return "\n\n".join([chosen_table, errors_table, f"All retuned. {leads}"])


def _mean(errors: Sequence[float]) -> str:
    """Return the mean of errors, the number of lost runs if there are any, a dash without runs."""
    lost = sum(map(math.isinf, errors))
    if all(map(math.isnan, errors)):
        return "–"
    return f"{lost} lost" if lost else f"{np.mean(errors):.2f}"


STUDIES: Final = (
    Study(
        name="breaking-points",
        seeds=report_seeds(3),
        make=breaking_points,
        checks=tuple(("grass", name) for name in BROKEN),
        minutes=5.0,
    ),
    Study(
        name="worst-cases",
        seeds=report_seeds(1),
        make=worst_cases,
        checks=tuple(("grass", name) for name in SEARCHED),
        minutes=11.0,
    ),
    Study(
        name="retuned",
        seeds=report_seeds(2),
        make=retuned,
        checks=(
            *((name, "ttempc") for name in shipped()),
            *(("grass", name) for name in (*KNOBS, *SAME_PROBLEM)),
        ),
        minutes=13.0,
    ),
)
