"""Controllers retuned by one rule with one budget, and compared anew.

    python -m experiments.studies.retuned

The rule is a coordinate search from the options that ship. Each controller has one or two knobs
(`KNOBS`). A round multiplies and divides one knob by its factor and keeps the best of three; once
every knob had its round, the factors become their square roots. The objective is the
geometric mean over `FIELDS` of the error of both points on a tuning seed, a lost run counting
`LOST_CM`. All runs are one lap.

Prints the Markdown tables of docs/compare.md: the chosen options, and the errors on all fields with
report seeds, before and after.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ttempc.errors import TtempcError
from ttempc.guidance.controllers import controller_options

from ...testbed.errors import TestbedError
from ..errors import ExperimentError
from ..results.leads import RunError, leads_sentence
from ..run.assembly import check
from ..run.simulate import simulate
from ..scenario.scenario import load, shipped
from ..seeds import TUNING, report_seeds
from .batch import StudyRun, one_lap, run_tasks
from .ranking import error_cm

FIELDS: Final = ("grass", "patchy", "wet-slope", "old-valves", "farm", "furrows")
"""Fields of the search."""

SEEDS: Final = tuple(TUNING[:1])
"""Seeds of the search."""

LOST_CM: Final = 100.0
"""Error of a lost run in the objective [cm]."""

ROUNDS: Final = 4
"""Rounds of the search, with two trials of each controller: nine evaluations with the first."""

Options = Mapping[str, object]


@dataclass(frozen=True, slots=True)
class Knob:
    """A tuning option, or entries of one that move together."""

    option: str
    factor: float
    entries: tuple[int, ...] = ()  # of a vector; empty: the option is a number

    def turned(self, options: Options, power: float) -> dict[str, object]:
        """Return the options with this one multiplied by `factor` to a power."""
        scale, value = self.factor**power, options[self.option]
        if isinstance(value, Sequence):
            turned: object = [
                float(f"{x * scale:.3g}") if n in self.entries else x for n, x in enumerate(value)
            ]
        else:
            turned = float(f"{value * scale:.3g}")  # pyright: ignore[reportOperatorIssue]
        return {**options, self.option: turned}


_WEIGHTS: Final = (
    Knob("step_weight", factor=4.0, entries=(0, 1)),  # of both steerings
    Knob("step_weight", factor=4.0, entries=(2,)),  # of the hydrostat
)
KNOBS: Final[dict[str, tuple[Knob, ...]]] = {
    "ttempc": _WEIGHTS,
    "ttempc-tube": _WEIGHTS,
    "pid": (Knob("lag_ratio", factor=1.5),),
    "lqr": _WEIGHTS,
    "nmpc-rti": _WEIGHTS,
}
"""Knobs by controller; the first controller is compared with the others."""

SAME_PROBLEM: Final = {"nmpc": "nmpc-rti"}
"""Controllers that solve the optimisation problem of another one and take its chosen options."""


def run_of(
    controller: str, options: Options, field: str, seed: int, overrides: tuple[str, ...] = ()
) -> StudyRun:
    """Return the run of a controller with options that are keys of its knobs."""
    lines = [f"controller.options.{name}={value!r}" for name, value in options.items()]
    return StudyRun(field, seed, (f'controller.name="{controller}"', *lines, *overrides))


def run_error_cm(run: StudyRun) -> float:
    """Return the error of one lap [cm]; infinite for a lost run, NaN where it is refused."""
    name, scenario = load(run.scenario, run.overrides)
    scenario = one_lap(scenario)
    try:
        check(scenario)
    except (ExperimentError, TestbedError, TtempcError):
        return math.nan
    return error_cm(simulate(name, scenario, run.seed)[0])


def errors_cm(runs: Sequence[StudyRun]) -> dict[StudyRun, float]:
    """Return the error of each run, driven once."""
    distinct = list(dict.fromkeys(runs))
    return dict(zip(distinct, run_tasks(run_error_cm, distinct), strict=True))


def objective(errors: Sequence[float]) -> float:
    """Return the geometric mean of errors [cm] over the fields that were driven."""
    driven = [min(error, LOST_CM) for error in errors if not math.isnan(error)]
    return math.exp(float(np.mean(np.log(driven)))) if driven else math.nan


@dataclass(frozen=True, slots=True)
class Choice:
    """Options of a controller with their objective [cm]."""

    options: Options
    value: float


def search(
    controllers: Sequence[str], fields: Sequence[str], overrides: tuple[str, ...] = ()
) -> Iterator[dict[str, Choice]]:
    """Yield the choices of all controllers: those that ship, then the best after each round."""
    shipped_options = {name: _knob_options(name) for name in controllers}
    chosen = _evaluated(list(shipped_options.items()), fields, overrides)
    best = dict(zip(controllers, chosen, strict=True))
    yield dict(best)
    for turn in range(ROUNDS):
        trials = [
            (name, knob.turned(best[name].options, sign * power))
            for name in controllers
            for knob, power in (_knob_of(KNOBS[name], turn),)
            for sign in (1.0, -1.0)
        ]
        for (name, _), choice in zip(trials, _evaluated(trials, fields, overrides), strict=True):
            if choice.value < best[name].value:
                best[name] = choice
        yield dict(best)


def _knob_of(knobs: Sequence[Knob], turn: int) -> tuple[Knob, float]:
    """Return the knob of a round and the power of its factor."""
    cycle, number = divmod(turn, len(knobs))
    return knobs[number], 0.5**cycle


def _knob_options(controller: str) -> dict[str, object]:
    """Return the shipped values of a controller's knobs."""
    values = controller_options(controller, {})
    names = dict.fromkeys(knob.option for knob in KNOBS[controller])
    return {
        name: list(value) if isinstance(value := values[name], tuple) else value for name in names
    }


def _evaluated(
    trials: Sequence[tuple[str, Options]], fields: Sequence[str], overrides: tuple[str, ...]
) -> list[Choice]:
    """Return the choices of trials: controllers with options."""
    runs = [
        [run_of(name, options, field, seed, overrides) for field in fields for seed in SEEDS]
        for name, options in trials
    ]
    errors = errors_cm([run for own in runs for run in own])
    return [
        Choice(options, objective([errors[run] for run in own]))
        for (_, options), own in zip(trials, runs, strict=True)
    ]


def main(
    seeds: tuple[int, ...] = report_seeds(2),
    controllers: Sequence[str] = tuple(KNOBS),
    tuned_on: Sequence[str] = FIELDS,
    fields: Sequence[str] = (),
    overrides: tuple[str, ...] = (),
) -> None:
    """Search, drive all fields before and after, and print the tables.

    Args:
        seeds: of the report.
        controllers: keys of `KNOBS`.
        tuned_on: fields of the search.
        fields: of the report; default: all that ship.
        overrides: of every scenario.
    """
    first, *_, last = search(controllers, tuned_on, overrides)
    print("| controller | options | ships | chosen | error of the search, before and after [cm] |")
    print("|---" * 5 + "|")
    for name in controllers:
        before, after = first[name], last[name]
        columns = (before.options, before.options.values(), after.options.values())
        names, old, new = (", ".join(map(str, column)) for column in columns)
        print(f"| `{name}` | {names} | {old} | {new} | {before.value:.2f}, {after.value:.2f} |")
    print()
    _report([first, last], fields or shipped(), seeds, overrides)


def _report(
    stages: Sequence[Mapping[str, Choice]],
    fields: Sequence[str],
    seeds: Sequence[int],
    overrides: tuple[str, ...],
) -> None:
    """Drive all fields with the choices before and after the search, and print the errors."""
    sources = {name: name for name in stages[0]}
    sources |= {name: other for name, other in SAME_PROBLEM.items() if other in sources}
    runs = {
        (stage, field, name, seed): run_of(name, choices[source].options, field, seed, overrides)
        for stage, choices in enumerate(stages)
        for field in fields
        for name, source in sources.items()
        for seed in seeds
    }
    known = errors_cm(list(runs.values()))
    errors = {key: known[run] for key, run in runs.items()}

    def cells(places: Sequence[str], summary: Callable[[Sequence[float]], str]) -> Iterator[str]:
        for name in sources:
            yield ", ".join(
                summary([errors[stage, place, name, seed] for place in places for seed in seeds])
                for stage in range(len(stages))
            )

    print(f"| before, after [cm] | {' | '.join(f'`{name}`' for name in sources)} |")
    print("|---" * (len(sources) + 1) + "|")
    for field in fields:
        print(f"| `{field}` | {' | '.join(cells([field], _mean))} |")
    over_fields = cells(fields, lambda values: f"{objective(values):.2f}")
    print(f"| geometric mean | {' | '.join(over_fields)} |")
    compared = [
        RunError(field, seed, name, error if math.isfinite(error) else math.nan)
        for (stage, field, name, seed), error in errors.items()
        if stage == len(stages) - 1 and not math.isnan(error)
    ]
    print(f"\nAll retuned. {leads_sentence(compared, next(iter(sources)), 'fields')}")


def _mean(errors: Sequence[float]) -> str:
    """Return the mean of errors, the number of lost runs if there are any, a dash without runs."""
    lost = sum(map(math.isinf, errors))
    if all(map(math.isnan, errors)):
        return "–"
    return f"{lost} lost" if lost else f"{np.mean(errors):.2f}"


if __name__ == "__main__":
    main()
