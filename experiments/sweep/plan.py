"""The plan of a sweep: what run number so and so drives, worked out one run at a time.

Runs are numbered with the point outermost, then the seed, then the controller, so that those which
are compared with each other end at about the same time. Nothing grows with the number of runs.
"""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from proving_ground.testbed.errors import TestbedError
from ttempc.errors import TtempcError

from ..errors import ExperimentError, InvalidStudy
from ..run.assembly import CONTROL_PERIOD_S, check
from ..scenario.scenario import Scenario, ScenarioFile, dump, identity, merge_tables, read_scenario
from .dimensions import Change, Dimension, dimensions
from .row import Value
from .study import Scalar, Study

_REMEMBERED = 64  # scenarios: those of one point, for its seeds


@dataclass(frozen=True, slots=True)
class Setting:
    """A scenario of the plan."""

    name: str  # of the scenario that it started from
    scenario: Scenario
    toml: str
    axes: Mapping[str, Value]  # what is varied, with the values that came out


@dataclass(frozen=True, slots=True)
class Planned:
    """A run of the plan."""

    run: int
    point: int
    seed: int
    setting: Setting


@dataclass(frozen=True, slots=True)
class Extent:
    """What a plan amounts to."""

    runs: int
    points: int
    controllers: tuple[str, ...]
    simulated_s: float  # of all runs, if none is lost
    digest: str  # of everything that the runs follow from, but for the code


class Plan:
    """All runs of a study.

    Args:
        name: of the study.
        study: as its file says.

    Raises:
        InvalidScenario: no such scenario.
    """

    def __init__(self, name: str, study: Study) -> None:
        self.name, self.study = name, study
        found = dimensions(study)
        self._shared = [dimension for dimension in found if not dimension.drives]
        self._drivers = next((d for d in found if d.drives), Dimension([{}]))
        self._relative = frozenset(key for dimension in found for key in dimension.relative)
        self._seeds = study.drawn_with
        self._drafts: dict[str, ScenarioFile] = {}
        for dimension in found:
            for entry in dimension.entries:
                self._draft(str(entry.get("scenario", study.scenario)))
        self.points = math.prod(len(dimension.entries) for dimension in self._shared)
        self._setting = functools.lru_cache(_REMEMBERED)(self._made)

    @property
    def size(self) -> int:
        """Return the number of runs."""
        return self.points * len(self._seeds) * self.drivers

    @property
    def drivers(self) -> int:
        """Return the number of controllers that are compared."""
        return len(self._drivers.entries)

    def __getitem__(self, run: int) -> Planned:
        """Return a run by its number.

        Raises:
            InvalidStudy: it cannot be; the message names the values of its axes.
        """
        rest, driver = divmod(run, self.drivers)
        point, seed = divmod(rest, len(self._seeds))
        return Planned(run, point, self._seeds[seed], self._setting(point, driver))

    def settings(self) -> Iterator[Setting]:
        """Yield every scenario of the plan once, not once a seed."""
        for point in range(self.points):
            for driver in range(self.drivers):
                yield self._setting(point, driver)

    def changed(self, point: int, driver: int = 0) -> dict[str, Scalar]:
        """Return what the axes say at a point, before it is laid over a scenario."""
        changes: dict[str, Scalar] = {}
        for dimension in reversed(self._shared):
            point, entry = divmod(point, len(dimension.entries))
            changes |= dimension.entries[entry]
        changes |= self._drivers.entries[driver]
        return {name: changes[name] for name in self.study.names}

    def extent(self) -> Extent:
        """Check all runs of the plan and return what they amount to.

        Raises:
            InvalidStudy: a run cannot be; the message names the values of its axes.
        """
        digest, simulated, controllers = hashlib.sha256(), 0.0, {}
        for setting in self.settings():
            try:
                ticks = check(setting.scenario)
            except (ExperimentError, TestbedError, TtempcError) as error:
                raise self._refusal(setting.axes, error) from None
            digest.update(setting.toml.encode())
            simulated += CONTROL_PERIOD_S * ticks * len(self._seeds)
            controllers[setting.scenario.controller.name] = True
        digest.update(repr(self._seeds).encode())
        return Extent(
            self.size, self.points, tuple(controllers), simulated, digest.hexdigest()[:12]
        )

    def identity(self, planned: Planned, versions: dict[str, str]) -> str:
        """Return the `run_id` of a run under these versions."""
        return identity(planned.setting.toml, planned.seed, versions)

    def setting(self, changes: Change) -> Setting:
        """Return the scenario that the values of axes lead to.

        Raises:
            InvalidStudy: it cannot be.
        """
        draft = self._draft(str(changes.get("scenario", self.study.scenario)))
        tables: dict[str, Any] = {}
        merge_tables(tables, self.study.set)
        try:
            for key, value in changes.items():
                if key in self._relative:
                    value = self._scaled(draft, key, value)
                _set(tables, key, value)
            scenario = draft.scenario(tables)
        except ExperimentError as error:
            raise self._refusal(changes, error) from None
        axes = {key: _get(scenario, key, draft.name) for key in changes}
        return Setting(draft.name, scenario, dump(scenario), axes)

    def _made(self, point: int, driver: int) -> Setting:
        return self.setting(self.changed(point, driver))

    def _draft(self, name: str) -> ScenarioFile:
        if name not in self._drafts:
            self._drafts[name] = read_scenario(name)
        return self._drafts[name]

    def _scaled(self, draft: ScenarioFile, key: str, factor: Scalar) -> float:
        """Return the factor times what the scenario has at the key without any axis."""
        number = _get(draft.scenario(self.study.set), key, draft.name)
        if isinstance(number, (bool, str)) or number is None or isinstance(factor, (bool, str)):
            raise InvalidStudy(f"{key}: relative, but {draft.name} has no number there: {number!r}")
        return number * factor

    def _refusal(self, changes: Mapping[str, Value], error: Exception) -> InvalidStudy:
        where = ", ".join(f"{key} = {value!r}" for key, value in changes.items())
        return InvalidStudy(f"study {self.name}: {where or 'its one point'}: {error}")


def _set(tables: dict[str, Any], key: str, value: Scalar) -> None:
    """Put the value of an axis into the tables of a scenario file."""
    if key == "scenario":
        return
    *path, last = ("controller", "name") if key == "controller" else key.split(".")
    merge_tables(
        tables, functools.reduce(lambda below, part: {part: below}, path[::-1], {last: value})
    )


def _get(scenario: Scenario, key: str, name: str) -> Value:
    """Return what a resolved scenario has at the key of an axis; always of the key's own type.

    Raises:
        InvalidStudy: the key is a table.
    """
    if key == "scenario":
        return name
    value: Any = scenario
    for part in ("controller", "name") if key == "controller" else key.split("."):
        value = getattr(value, part, None)
    if value is not None and not isinstance(value, (str, float, int)):
        raise InvalidStudy(f"axis {key}: is a table, give one of its keys")
    return value
