"""Rays: how severe disturbances may become before a controller fails, along shared directions.

A ray leads from the nominal values of a scenario to the bounds of its quantities; directions and
the values of free quantities, as places, are those of a Latin hypercube that follows from the seed
alone, so that all controllers meet the same rays and compare in pairs. Along each ray bisection
finds a severity that holds and one that fails. Bisection finds one boundary: where failure comes
and goes, a milder failure may exist.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from scipy.stats import qmc

from ttempc.types import FloatArray

from ....testbed.randomness import generator
from ....testbed.recording.provenance import versions
from ...errors import SweepStopped
from ...output import write_file
from ...scenario.scenario import Scenario
from ..sweep.engine import Engine
from ..sweep.plan import Setting, SweepPlan
from ..sweep.row import Row, has_failed, working_error
from ..sweep.study import Scalar
from ..sweep.sweep import drive_plan, points_plan
from .quantities import Space, Subject

RAYS: Final = 50
STEPS: Final = 5
"""Halvings of a ray that fails at its end: severities are known to 1/32."""

_ERRORS: Final = ("failed", "crashed")  # status of a run that raised an error: no result
_POINTS: Final = ("tractor", "trailer", "tool")


@dataclass(frozen=True)
class Ray:
    """What was found along a ray; severity is the share of the distance from the
    nominal values to the point where the first quantity meets its bound."""

    holds: float
    """Largest severity found to hold."""
    fails: float | None
    """Least severity found to fail; None: the ray holds to its end."""
    failure: str = ""
    """How the run at `fails` failed."""
    broken: bool = False
    """Whether a run was refused by the scenario or raised an error, which ends the bisection."""


@dataclass(frozen=True)
class Specification:
    """What a run must keep to: it completes, in the corridor, with an error below a limit."""

    corridor_m: float  # half width of the corridor [m]
    limit_m: float | None = None  # on the 95 % cross-track error of the working point [m]

    @classmethod
    def of(cls, scenario: Scenario, limit_m: float | None = None) -> "Specification":
        """Return the specification of a scenario."""
        corridor = scenario.corridor
        return cls(math.inf if corridor is None else corridor.half_width_m, limit_m)

    def failure(self, row: Row) -> str:
        """Return how a run failed; "" of one that holds."""
        if row["status"] != "completed":
            return f"{row['status']}: {row['failure']}"
        for point in _POINTS:
            largest = _number(row[f"corridor.{point}.max_m"])
            if largest > self.corridor_m:
                return f"out of the corridor: {point} {largest:.3f} m from its path"
        if _number(row["corridor.hitch_outside_fraction"]) > 0.0:
            return "hitch angle beyond the limit of the corridor"
        if has_failed(row, self.limit_m):
            return f"95 % cross-track error {working_error(row):.3f} m"
        return ""


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else 0.0


def ends(space: Space, count: int, seed: int) -> FloatArray:
    """Return the far ends of rays (count, n), where a counted quantity meets its bound."""
    rng = generator(seed, "rays")
    found = qmc.LatinHypercube(len(space.parameters), rng=rng).random(count)
    counted = space.counted > 0.0
    nominal = space.nominal
    change = np.where(counted, found - nominal, 0.0)
    room = np.where(change > 0.0, 1.0 - nominal, nominal)
    share = np.abs(change) / np.where(counted, room, 1.0)
    return np.where(counted, nominal + change / share.max(axis=1, keepdims=True), found)


def bisect(
    evaluate: Callable[[Sequence[tuple[int, float]]], Sequence[str | None]], count: int
) -> list[Ray]:
    """Return what was found along rays.

    Args:
        evaluate: drives rays at severities; of each how it failed, "" if it held, None without a
            result.
        count: of the rays.
    """
    rays = [Ray(0.0, None) for _ in range(count)]
    asked = [(k, 1.0) for k in range(count)]
    for _ in range(1 + STEPS):
        for (k, severity), failure in zip(asked, evaluate(asked), strict=True):
            if failure is None:
                rays[k] = replace(rays[k], broken=True)
            elif failure:
                rays[k] = replace(rays[k], fails=severity, failure=failure)
            else:
                rays[k] = replace(rays[k], holds=severity)
        asked = [
            (k, 0.5 * (ray.holds + ray.fails))
            for k, ray in enumerate(rays)
            if ray.fails is not None and not ray.broken
        ]
        if not asked:
            break
    return rays


def least_severe(rays: Sequence[Ray]) -> int | None:
    """Return the number of the ray that fails at the least severity; None if all hold."""
    failing = [k for k, ray in enumerate(rays) if ray.fails is not None]
    return min(failing, key=lambda k: rays[k].fails or 0.0, default=None)


@dataclass(frozen=True)
class Report:
    """Content of `rays.json`."""

    scenario: str
    controller: str
    seed: int
    limit_m: float | None
    rays: tuple[Ray, ...]
    values: Mapping[str, Scalar]
    """Of the scenario's keys in the least severe failure; without a failure the nominal ones."""
    versions: Mapping[str, str]

    @property
    def least(self) -> int | None:
        """Number of the ray that fails at the least severity; None if all hold."""
        return least_severe(self.rays)

    def survived(self, severity: float) -> int:
        """Return how many rays hold at a severity, up to the width of the bisection."""
        return sum(ray.fails is None or ray.holds >= severity for ray in self.rays)

    def to_json(self) -> str:
        """Return the text of the file."""
        return json.dumps(asdict(self), indent=1, allow_nan=False) + "\n"


def search_rays(
    subject: Subject,
    engine: Engine,
    seed: int,
    count: int = RAYS,
    limit_m: float | None = None,
    folder: Path | None = None,
    on_run: Callable[[], object] = lambda: None,
) -> Report:
    """Find the severity of failure along rays and return the report, written to the folder.

    Args:
        subject: scenario and space of quantities.
        engine: executes the runs.
        seed: of all runs, for terrain and noise, and of the rays.
        count: of the rays.
        limit_m: as of `Specification`.
        folder: of the report, of `worst.toml`, the scenario of the least severe failure, and of the
            rows, each step of the bisection in a sweep's folder of its own; None: nothing is kept.
        on_run: called after every run.

    Raises:
        InvalidScenario, InvalidStudy: the nominal run is refused.
        SweepRefused: the folder has other content.
        SweepStopped: the nominal run fails or raised an error.
    """
    space = subject.space
    far = ends(space, count, seed)
    driver = _Driver(subject, engine, seed, folder, on_run)
    nominal = driver.setting(space.nominal)
    specification = Specification.of(nominal.scenario, limit_m)

    def point(ray: int, severity: float) -> FloatArray:
        share = np.where(space.counted > 0.0, severity, 1.0)
        return space.nominal + share * (far[ray] - space.nominal)

    def failures(points: Sequence[FloatArray]) -> list[str | None]:
        rows = driver.drive(points)
        return [None if row is None else specification.failure(row) for row in rows]

    (failure,) = failures([space.nominal])
    if failure or failure is None:
        raise SweepStopped(f"nominal run: {failure or 'refused, or raised an error'}")
    rays = bisect(lambda asked: failures([point(*one) for one in asked]), count)

    # The worst that is shown: the least severe failure, without a failure the nominal run
    worst = space.nominal
    least = least_severe(rays)
    if least is not None:
        worst = point(least, rays[least].fails or 0.0)
    report = Report(
        scenario=nominal.name,
        controller=nominal.scenario.controller.name,
        seed=seed,
        limit_m=limit_m,
        rays=tuple(rays),
        values=space.changes(worst),
        versions=versions(),
    )
    if folder is not None:
        write_file(folder / "worst.toml", driver.setting(worst).toml)
        write_file(folder / "rays.json", report.to_json())
    return report


class _Driver:
    """Drives points of the space of a search, each call as a sweep in a folder of its own."""

    def __init__(
        self,
        subject: Subject,
        engine: Engine,
        seed: int,
        folder: Path | None,
        on_run: Callable[[], object],
    ) -> None:
        self._subject = subject
        self._engine = engine
        self._seed = seed
        self._folder = folder
        self._on_run = on_run
        self._steps = 0  # calls of `drive` so far

    def setting(self, point: FloatArray) -> Setting:
        """Return the scenario at a point."""
        return self._plan([point]).setting(self._subject.space.changes(point))

    def drive(self, points: Sequence[FloatArray]) -> list[Row | None]:
        """Return the row of each point, None of a run that was refused or raised an error."""
        place = self._folder and self._folder / "steps" / f"{self._steps:03d}"
        self._steps += 1
        driven = drive_plan(self._plan(points), self._engine, place)
        for _ in points:
            self._on_run()
        return [rows[0] if rows and rows[0]["status"] not in _ERRORS else None for rows in driven]

    def _plan(self, points: Sequence[FloatArray]) -> SweepPlan:
        changes = [self._subject.space.changes(point) for point in points]
        return points_plan(self._subject.scenario, changes, self._subject.settings, [self._seed])
