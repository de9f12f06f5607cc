"""Plan of a sweep: scenario and seed of each run, computed from the run's number.

The number counts controllers fastest, then seeds, then points, so that runs that are compared with
each other end at about the same time. Memory does not grow with the number of runs.
"""

import functools
import hashlib
import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

from ttempc.errors import TtempcError

from ....testbed.errors import TestbedError
from ...errors import ExperimentError, InvalidScenario, InvalidStudy
from ...run.assembly import check
from ...run.user_code import named_parts, refuse_untrusted, user_sources
from ...scenario.scenario import (
    Scenario,
    ScenarioFile,
    dump,
    identity,
    list_index,
    merge_tables,
    read_scenario,
)
from .row import Value
from .study import MOST_RUNS, Change, Dimension, Scalar, Study, VariantAxis, dimensions

_CACHED = 64  # scenarios: those of one point, for all its seeds


@dataclass(frozen=True)
class Setting:
    """A scenario of the plan with the values of its axes."""

    name: str  # of the scenario file
    scenario: Scenario
    axes: Mapping[str, Value]  # varied keys with their resolved values

    @functools.cached_property
    def toml(self) -> str:
        """Return the resolved scenario as text, which takes half as long as to make it."""
        return dump(self.scenario)


@dataclass(frozen=True, slots=True)
class PlannedRun:
    """A run of the plan."""

    run: int
    point: int
    seed: int
    setting: Setting


@dataclass(frozen=True, slots=True)
class PlanExtent:
    """Size of a plan."""

    runs: int
    points: int
    controllers: tuple[str, ...]
    simulated_s: float  # of all runs, if none terminates early; drawn ones as those checked
    digest: str  # of all scenarios and seeds
    refused: tuple[str, ...]  # reasons of the combinations that are left out


class SweepPlan:
    """All runs of a study.

    Args:
        name: of the study.
        study: content of its file.
        trusted: whether code that study or scenario names as package.module:factory may run.

    Raises:
        InvalidScenario: no such scenario.
        InvalidStudy: it has too many runs.
    """

    def __init__(self, name: str, study: Study, *, trusted: bool = True) -> None:
        self.name = name
        self.study = study
        self._trusted = trusted
        factors = dimensions(study)
        self._shared = [factor for factor in factors if not factor.selects_controller]
        self._controllers = next((f for f in factors if f.selects_controller), Dimension([{}]))
        self._relative = {key for axis in study.axis if axis.relative for key in axis.names}
        self._optional = {key for axis in study.axis if axis.optional for key in axis.names}
        self._variants = {a.name: a.values for a in study.axis if isinstance(a, VariantAxis)}
        self._seeds = study.point_seeds
        self._drafts: dict[str, ScenarioFile] = {}
        self._plain: dict[Path, Scenario] = {}  # by file, see `_without_axes`
        for dimension in factors:
            for entry in dimension.entries:
                self._draft(str(entry.get("scenario", study.scenario)))
        self.points = math.prod(len(dimension.entries) for dimension in self._shared)
        if self.size > MOST_RUNS:
            raise InvalidStudy(f"study {name}: {self.size} runs, must be {MOST_RUNS} or fewer")
        self._setting = functools.lru_cache(_CACHED)(
            lambda point, controller: self.setting(self.changes(point, controller))
        )

    @property
    def size(self) -> int:
        """Return how many run numbers there are, refused combinations included."""
        return self.points * len(self._seeds) * self.controller_count

    @property
    def controller_count(self) -> int:
        """Return the number of compared controllers."""
        return len(self._controllers.entries)

    def __getitem__(self, run: int) -> PlannedRun:
        """Return a run by its number.

        Raises:
            InvalidStudy: its scenario is invalid; the message names the values of its axes.
        """
        point, seed, controller = self._place(run)
        return PlannedRun(run, point, self._seeds[seed], self._setting(point, controller))

    def _place(self, run: int) -> tuple[int, int, int]:
        rest, controller = divmod(run, self.controller_count)
        return *divmod(rest, len(self._seeds)), controller

    def runs(self) -> Iterator[int]:
        """Yield the numbers of the runs to drive: all but the refused combinations."""
        refused = self.refusals if self.study.skip_refused else {}
        for run in range(self.size):
            point, _, controller = self._place(run)
            if (point, controller) not in refused:
                yield run

    @property
    def run_count(self) -> int:
        """Return the number of runs to drive."""
        refused = len(self.refusals) if self.study.skip_refused else 0
        return self.size - refused * len(self._seeds)

    def changes(self, point: int, controller: int = 0) -> dict[str, Scalar]:
        """Return the values of the axes at a point, relative ones as factors."""
        changes: dict[str, Scalar] = {}
        for dimension in reversed(self._shared):
            point, entry = divmod(point, len(dimension.entries))
            changes |= dimension.entries[entry]
        changes |= self._controllers.entries[controller]
        return {name: changes[name] for name in self.study.names}

    def extent(self) -> PlanExtent:
        """Check the runs of the plan and return its size.

        The values of every point are validated. Path, ground and controller, some 30 ms a point,
        are checked for all combinations of listed values, and of drawn points for those with the
        least and the greatest value of an axis. What a drawn point between them has against it is
        the failure in its row. A study that skips what is refused checks every point.

        Raises:
            InvalidStudy: a scenario is invalid, and the study does not skip it, or no scenario
                accepts a controller; the message names the values of the axes.
        """
        return self._survey[0]

    @property
    def refusals(self) -> Mapping[tuple[int, int], InvalidStudy]:
        """Return the refused pairs of point and controller with their reasons, see `extent`."""
        return self._survey[1]

    @functools.cached_property
    def _survey(self) -> tuple[PlanExtent, Mapping[tuple[int, int], InvalidStudy]]:
        digest = hashlib.sha256()
        durations = []  # of the checked runs [s]
        accepted: dict[int, str] = {}  # names of the controllers
        refusals: dict[tuple[int, int], InvalidStudy] = {}
        for point, controller in itertools.product(
            range(self.points), range(self.controller_count)
        ):
            try:
                setting = self._setting(point, controller)
                if self._is_checked(point):
                    ticks = self._ticks(setting)
                    durations.append(setting.scenario.control.period_s * ticks)
            except InvalidStudy as error:
                if not self.study.skip_refused:
                    raise
                refusals[point, controller] = error
                continue
            # All between the ends of its axes follows from its values and a scenario at the ends.
            between = repr(self.changes(point, controller))
            digest.update((setting.toml if self._is_checked(point) else between).encode())
            accepted.setdefault(controller, setting.scenario.controller.name)
        for (_, controller), error in refusals.items():
            if controller not in accepted:
                raise error
        digest.update(repr(self._seeds).encode())
        runs = self.size - len(refusals) * len(self._seeds)
        extent = PlanExtent(
            runs=runs,
            points=self.points,
            controllers=tuple(dict.fromkeys(accepted.values())),
            simulated_s=runs * fmean(durations),
            digest=digest.hexdigest()[:12],
            refused=tuple(map(str, refusals.values())),
        )
        return extent, refusals

    def _is_checked(self, point: int) -> bool:
        """Return whether path, ground and controller of a point are checked before the first run.

        Those between the ends of the drawn axes are not, see `extent`.
        """
        if self.study.skip_refused:
            return True
        for dimension in reversed(self._shared):
            point, entry = divmod(point, len(dimension.entries))
            if dimension.ends is not None:
                return entry in dimension.ends
        return True

    def _ticks(self, setting: Setting) -> int:
        try:
            return check(setting.scenario)
        except (ExperimentError, TestbedError, TtempcError) as error:
            raise self._refusal(setting.axes, error) from None

    def identity(self, planned: PlannedRun, versions: dict[str, str]) -> str:
        """Return the `run_id` of a run under these versions."""
        sources = user_sources(planned.setting.scenario)
        return identity(planned.setting.toml, planned.seed, {**versions, **sources})

    def setting(self, changes: Change) -> Setting:
        """Return the scenario at these values of the axes.

        Raises:
            InvalidStudy: it is invalid.
        """
        draft = self._draft(str(changes.get("scenario", self.study.scenario)))
        tables: dict[str, Any] = {}
        merge_tables(tables, self.study.set)
        try:
            for key, value in changes.items():
                if key in self._variants:
                    merge_tables(tables, self._variants[key][str(value)])
                    continue
                if key in self._optional and self._lacks(draft, key):
                    continue
                if key in self._relative:
                    value = self._scaled(draft, key, value)
                _set(tables, key, value)
            scenario = draft.scenario(tables)
            if not self._trusted:
                self._refuse_code(draft, scenario, tables)
        except ExperimentError as error:
            raise self._refusal(changes, error) from None
        axes = {
            key: label if key in self._variants else scenario_value(scenario, key, draft.name)
            for key, label in changes.items()
        }
        return Setting(draft.name, scenario, axes)

    def _refuse_code(
        self, draft: ScenarioFile, scenario: Scenario, changes: Mapping[str, Any]
    ) -> None:
        """Refuse code that nobody trusted, with the name of the file that names it."""
        parts = named_parts(scenario)
        refuse_untrusted(draft.file, parts, changes)
        # What is left is named by the study, in [set] or an axis.
        refuse_untrusted(Path(f"{self.name}.toml"), parts, {})

    def _draft(self, name: str) -> ScenarioFile:
        if name not in self._drafts:
            self._drafts[name] = read_scenario(name)
        return self._drafts[name]

    def _without_axes(self, draft: ScenarioFile) -> Scenario:
        """Return the scenario of a file with what all points share, which is made once."""
        if draft.file not in self._plain:
            self._plain[draft.file] = draft.scenario(self.study.set)
        return self._plain[draft.file]

    def _lacks(self, draft: ScenarioFile, key: str) -> bool:
        """Return whether the scenario has no such key without any axis."""
        try:
            return scenario_value(self._without_axes(draft), key, draft.name) is None
        except InvalidScenario:  # a table that its list does not have
            return True

    def _scaled(self, draft: ScenarioFile, key: str, factor: Scalar) -> float:
        """Return the factor times the value of the key in the scenario without any axis."""
        number = scenario_value(self._without_axes(draft), key, draft.name)
        if isinstance(number, (bool, str)) or number is None or isinstance(factor, (bool, str)):
            raise InvalidStudy(f"{key}: relative, but {draft.name} has no number there: {number!r}")
        return number * factor

    def _refusal(self, changes: Mapping[str, Value], error: Exception) -> InvalidStudy:
        values = ", ".join(f"{key} = {value!r}" for key, value in changes.items())
        return InvalidStudy(f"study {self.name}: {values or 'its one point'}: {error}")


def _set(tables: dict[str, Any], key: str, value: Scalar) -> None:
    """Set the value of an axis in the tables of a scenario file."""
    if key == "scenario":
        return
    *path, last = ("controller", "name") if key == "controller" else key.split(".")
    merge_tables(
        tables, functools.reduce(lambda below, part: {part: below}, path[::-1], {last: value})
    )


def scenario_value(scenario: Scenario, key: str, name: str) -> Value:
    """Return the value of an axis's key in a resolved scenario, in the key's own type.

    Raises:
        InvalidStudy: the key is a table.
    """
    if key == "scenario":
        return name
    value: Any = scenario
    for part in ("controller", "name") if key == "controller" else key.split("."):
        if isinstance(value, tuple):
            value = value[list_index(key, value, part)]
        else:
            value = getattr(value, part, None)
    if value is not None and not isinstance(value, (str, float, int)):
        raise InvalidStudy(f"axis {key}: is a table, give one of its keys")
    return value
