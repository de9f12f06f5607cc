"""Declaration of a study: its runs, and the table of their frame."""

from __future__ import annotations

import importlib
import itertools
import pkgutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ..results.summary import Summary
from ..run.simulate import simulate
from ..scenario.scenario import load
from ..studies.sweep.row import figures
from ..studies.sweep.study import load_study
from .checks import Check, scenario_check, sweep_checks

if TYPE_CHECKING:
    import pandas as pd


Row = Mapping[str, Any]
"""One line of a frame, by the names of its columns."""

Axis = Mapping[Any, tuple[str, ...]] | Sequence[Any]
"""Labels of one column of the frame, with the overrides that each sets, if any."""


def all_studies() -> dict[str, Study]:
    """Return every study by its name."""
    folder = importlib.import_module(".studies", __package__)
    names = [f".studies.{item.name}" for item in pkgutil.iter_modules(folder.__path__)]
    modules = [importlib.import_module(name, __package__) for name in (*names, ".benchmarks")]
    return {study.name: study for module in modules for study in module.STUDIES}


@dataclass(frozen=True, slots=True)
class Case:
    """One task of a study: a run, or a search of many runs."""

    scenario: str
    seed: int
    overrides: tuple[str, ...] = ()  # as of `--set`
    labels: Mapping[str, Any] = field(default_factory=dict)  # columns of its rows, from the axes

    def __getitem__(self, axis: str) -> Any:  # noqa: ANN401 - a label may be of any type
        return self.labels[axis]


@dataclass(frozen=True, slots=True)
class Block:
    """Text of a table, and files beside its page."""

    text: str  # Markdown
    files: Mapping[str, bytes] = field(default_factory=dict)  # by path relative to the page
    footer: str = ""  # instead of the line of seeds and versions


def summary_row(summary: Summary) -> dict[str, Any]:
    """Return status and figures of a run by the column names of `results.jsonl`."""
    head = {"controller": summary.controller, "status": summary.status, "failure": summary.failure}
    return {**head, **figures(summary)}


def lap(case: Case) -> Row:
    """Drive the run of a case and return its `summary_row`."""
    return summary_row(simulate(*load(case.scenario, case.overrides), case.seed)[0])


@dataclass(frozen=True, kw_only=True)
class Study:
    """A table and the runs it is made from.

    It is written into the page that has the markers of its name, see `pages`; without markers it is
    printed.

    There are three forms. A grid has `scenarios`, `axes` and `seeds`: `drive` is called for each
    combination (seeds count fastest), and `table` formats the frame of all rows, whose columns are
    `scenario`, `seed`, the axes, and what `drive` returns. A study of shipped sweeps names them in
    `sweeps`; `table` formats the frame of their rows, with the column `study`. Any other study has
    `make`, which may call `Runner.frame` and `Runner.map` for runs of its own.
    """

    name: str
    table: Callable[[pd.DataFrame], str | Block] | None = None
    sweeps: tuple[str, ...] = ()  # shipped
    scenarios: tuple[str, ...] = ("grass",)
    axes: Mapping[str, Axis] = field(default_factory=dict)
    seeds: tuple[int, ...] = ()
    overrides: tuple[str, ...] = ("path.laps=1",)  # of all runs of a grid
    drive: Callable[[Case], Row | list[Row]] = lap  # of a grid; called in a worker process
    make: Callable[[Any], str | Block] | None = None  # of a `Runner`
    checks: tuple[tuple[str, ...], ...] = ()  # scenario, controller, overrides; sweeps have theirs

    def cases(self) -> list[Case]:
        """Return the combinations of a grid."""
        axes = [
            [(label, values[label] if isinstance(values, Mapping) else ()) for label in values]
            for values in self.axes.values()
        ]
        return [
            Case(
                scenario,
                seed,
                (*self.overrides, *(change for _, changes in point for change in changes)),
                dict(zip(self.axes, (label for label, _ in point), strict=True)),
            )
            for scenario in self.scenarios
            for point in itertools.product(*axes)
            for seed in self.seeds
        ]

    @property
    def all_seeds(self) -> tuple[int, ...]:
        """Seeds of all runs behind the table."""
        of_sweeps = (load_study(name)[1].point_seeds for name in self.sweeps)
        return tuple(sorted({*self.seeds, *itertools.chain.from_iterable(of_sweeps)}))

    @property
    def all_checks(self) -> tuple[Check, ...]:
        """Regression checks behind the table."""
        own = [scenario_check(*words) for words in self.checks]
        return (*itertools.chain.from_iterable(map(sweep_checks, self.sweeps)), *own)
