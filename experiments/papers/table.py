"""Declaration of a table: the studies behind it, and how their rows become text."""

from __future__ import annotations

import importlib
import itertools
import pkgutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ..scenario.scenario import parse_overrides
from ..studies.sweep.row import Row
from ..studies.sweep.study import ListAxis, Scalar, Study, VariantAxis, load_study
from ..studies.sweep.work import SweepJob, run_job
from .checks import Check, scenario_check, sweep_checks

if TYPE_CHECKING:
    import pandas as pd

Work = Callable[[SweepJob], Row]
"""Makes the row of a run in a worker."""


@dataclass(frozen=True, slots=True)
class Block:
    """Text of a table, and files beside its page."""

    text: str  # in Markdown, without the markers
    files: Mapping[str, bytes] = field(default_factory=dict)  # by path relative to the page
    footer: str = ""  # instead of the line of seeds and versions


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table and the studies that it is made from.

    It is written into the page that has the markers of its name, see `pages`; without markers it is
    printed. The studies are those of the sweep engine. `text` formats the frame of all their rows,
    in which the column `study` has the name of each row's study. A table of anything else than runs
    has `make`. A table whose drives are drawn has the seed, and `anew` returns that of another one.
    """

    name: str
    text: Callable[[pd.DataFrame], str | Block] | None = None
    sweeps: tuple[str, ...] = ()  # names of shipped studies
    studies: Mapping[str, Study] = field(default_factory=dict)  # own studies, by name
    work: Work = run_job
    make: Callable[[Any], str | Block] | None = None  # takes a `Runner`
    seeds: tuple[int, ...] = ()  # reported, where they are not those of all studies
    checks: tuple[tuple[str, ...], ...] = ()  # scenario, controller, overrides; sweeps have theirs
    seed: int | None = None  # that draws the studies
    anew: Callable[[int], Table] | None = None  # returns the table of another such seed

    @property
    def all_studies(self) -> dict[str, Study]:
        """Studies of the table, shipped ones first."""
        return {**{name: load_study(name)[1] for name in self.sweeps}, **self.studies}

    @property
    def all_seeds(self) -> tuple[int, ...]:
        """Seeds of all runs that the table reports on."""
        of_studies = (study.point_seeds for study in self.all_studies.values())
        return self.seeds or tuple(sorted({*itertools.chain.from_iterable(of_studies)}))

    @property
    def all_checks(self) -> tuple[Check, ...]:
        """Regression checks behind the table."""
        own = [scenario_check(*words) for words in self.checks]
        return (*itertools.chain.from_iterable(map(sweep_checks, self.sweeps)), *own)


def all_tables() -> dict[str, Table]:
    """Return every table by its name."""
    folder = importlib.import_module(".studies", __package__)
    studies = [f".studies.{item.name}" for item in pkgutil.iter_modules(folder.__path__)]
    names = (*studies, ".benchmarks", ".growth")
    modules = [importlib.import_module(name, __package__) for name in names]
    return {table.name: table for module in modules for table in module.TABLES}


def study(
    scenario: str,
    seeds: Iterable[int],
    overrides: Iterable[str] = (),
    *axes: ListAxis | VariantAxis,
) -> Study:
    """Return a study of one scenario with changes of all its runs, as of `--set`."""
    changes = parse_overrides([*overrides])
    return Study(scenario=scenario, seeds=tuple(seeds), set=changes, axis=axes)


def listed(key: str, *values: Scalar) -> ListAxis:
    """Return the axis of the values of a key."""
    return ListAxis(kind="list", key=key, values=values)


def variants(name: str, values: Mapping[str, Iterable[str]]) -> VariantAxis:
    """Return the axis of named sets of changes, as of `--set`."""
    tables: dict[str, dict[str, Any]] = {
        label: parse_overrides([*overrides]) for label, overrides in values.items()
    }
    return VariantAxis(kind="variants", name=name, values=tables)
