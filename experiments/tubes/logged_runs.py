"""Logged runs that a tube is made from, and what they must have in common."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeVar

from ttempc.guidance.controllers import CONTROLLERS
from ttempc.reference.reference import Reference

from ...testbed.errors import LogError
from ...testbed.log.reader import read_log
from ...testbed.recording.channels import CONTROL
from ...testbed.recording.record import Record
from ..errors import InvalidFit, InvalidScenario
from ..run.assembly import model_vehicle
from ..scenario.plant import PAPER_PERIOD_S
from ..scenario.scenario import Scenario, load

Run = TypeVar("Run")


@dataclass(frozen=True)
class LoggedRun:
    """A run that drove its whole path, by its settings."""

    scenario: str
    controller: str
    seed: int
    settings: Scenario
    reference: Reference

    @property
    def label(self) -> str:
        """Name of the run in messages."""
        return f"{self.scenario}, seed {self.seed}"

    @property
    def drives_in_a_tube(self) -> bool:
        """Whether the controller keeps the vehicle in a tube."""
        entry = CONTROLLERS.get(self.controller)
        return entry is not None and entry.tube == "required"


def logged_run(record: Record, scenario: Scenario) -> LoggedRun:
    """Return the settings of a run."""
    if scenario.control.period_s != PAPER_PERIOD_S:
        raise InvalidFit(
            f"control.rate_hz = {scenario.control.rate_hz:g}: a tube is fitted to runs at "
            f"{1.0 / PAPER_PERIOD_S:g} Hz"
        )
    mission = scenario.mission()
    vehicle = model_vehicle(mission, scenario, scenario.vehicles())
    reference = Reference(mission.path, vehicle, mission.speed)
    end_s = max(record[CONTROL].time_s, default=0.0)
    if end_s < reference.duration_s - 2.0 * PAPER_PERIOD_S:
        raise InvalidFit(
            f"the run ended after {end_s:.1f} s of {reference.duration_s:.1f} s: runs must complete"
        )
    return LoggedRun(
        scenario=record.metadata["scenario"],
        controller=record.metadata["controller"],
        seed=int(record.metadata["seed"]),
        settings=scenario,
        reference=reference,
    )


def read_runs(folders: Sequence[Path], make: Callable[[Record, Scenario], Run]) -> list[Run]:
    """Return what `make` takes from all runs in the folders and their subfolders, by name.

    Raises:
        InvalidFit: a folder holds no run, a log or its scenario cannot be read, or `make` refuses
            a run.
    """
    runs = []
    for folder in folders:
        logs = sorted(folder.rglob("log.mcap"))
        if not logs:
            raise InvalidFit(f"{folder}: there is no log.mcap in it or below")
        for log in logs:
            try:
                _, scenario = load(str(log.parent / "scenario.toml"))
                runs.append(make(read_log(log), scenario))
            except (LogError, InvalidScenario) as error:
                raise InvalidFit(str(error)) from None
            except InvalidFit as error:
                raise InvalidFit(f"{log}: {error}") from None
    return runs


def require_alike(runs: Sequence[LoggedRun]) -> None:
    """Refuse runs that are not of one scenario with a seed of its own each."""
    first = asdict(runs[0].settings) if runs else {}
    labels: dict[int, str] = {}
    for run in runs:
        if difference := _difference(first, asdict(run.settings)):
            raise InvalidFit(
                f"{run.label}: {difference} in {runs[0].label}: all runs must be of one field and "
                "one controller"
            )
        if run.seed in labels:
            raise InvalidFit(f"{run.label}: there twice: every run must have a seed of its own")
        labels[run.seed] = run.label


def _difference(first: Mapping[str, object], other: Mapping[str, object], above: str = "") -> str:
    """Return the first key with another value, and both values; "" where all are equal."""
    for key in sorted({*first, *other}):
        one, two = first.get(key), other.get(key)
        if one == two:
            continue
        if isinstance(one, Mapping) and isinstance(two, Mapping):
            return _difference(one, two, f"{above}{key}.")
        return f"{above}{key} = {two!r}, but {one!r}"
    return ""
