"""Worst case of a scenario: search for the least severe point that fails, by CMA-ES.

Two points are compared by the rules of Deb (An efficient constraint handling method for genetic
algorithms, CMAME 186, 2000, doi 10.1016/S0045-7825(99)00389-8), with failure as the constraint: of
two that fail, the less severe is better; one that fails is better than one that holds; of two that
hold, the less robust is better. The optimiser uses the order alone: CMA-ES (Hansen, The CMA
evolution strategy: a tutorial, arXiv 1604.00772), restarted with twice the population when it has
converged (Auger and Hansen, CEC 2005, doi 10.1109/CEC.2005.1554902). Every new best failure is
simplified, as in delta debugging (Zeller and Hildebrandt, IEEE TSE 28, 2002, doi
10.1109/32.988498): without one of its deviations, and with a share of all; CMA-ES then goes on from
the mildest.

The robustness of a run is its least distance to a limit (Annpureddy, Liu, Fainekos and
Sankaranarayanan, S-TaLiRo, TACAS 2011, doi 10.1007/978-3-642-19835-9_21). Each is counted from the
figure of the nominal run, so that a figure that is always large, as the hitch angle on a curve,
does not hide the others.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.stats import qmc

from ttempc.types import FloatArray

from ...testbed.randomness import generator
from ...testbed.recording.provenance import versions
from ...testbed.simulation.termination import TerminationLimits
from ..errors import MissingExtra, SweepStopped
from ..output import write_file
from ..scenario.scenario import Scenario
from ..sweep.engine import Engine
from ..sweep.plan import Setting, SweepPlan
from ..sweep.row import Row, has_failed, working_error
from ..sweep.study import Scalar
from ..sweep.sweep import drive_plan, points_plan
from .quantities import Space, Subject

if TYPE_CHECKING:
    from cmaes import CMA

_WORST: Final = 3  # failures that are reported
_ERRORS: Final = ("failed", "crashed")  # status of a run that raised an error: no result
_SIGMA: Final = 0.2  # first standard deviation, of the bounds
_EXPLORED: Final = 2  # generations of the first, space-filling sample
_SHARES: Final = (0.5, 0.75, 0.9, 0.97)  # of the deviations of a failure
_REFUSED: Final = 4.0  # cost, above that of every run
_LEAST: Final = 1e-9  # robustness of a run that reaches a limit and has not failed
_POINTS: Final = ("tractor", "trailer", "tool")


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run."""

    failed: bool
    robustness: float  # 1 nominal, 0 failed
    reason: str = ""  # of the failure


@dataclass(frozen=True)
class Specification:
    """What a run must keep to: it completes, in the corridor, with an error below a limit.

    Args:
        limits: figure of a row -> limit, in the unit of the figure.
        limit_m: on the 95 % cross-track error of the working point [m]; None: not limited.
    """

    limits: Mapping[str, float]
    limit_m: float | None = None

    @classmethod
    def of(cls, scenario: Scenario, limit_m: float | None = None) -> Specification:
        """Return the specification of a scenario: its corridor and the termination limits."""
        termination = TerminationLimits.of(scenario.vehicles().plant)
        limits = {
            "extremes.tilt_rad": termination.tilt,
            "extremes.fold_rad": termination.fold,
            "tracking.all.tractor.max_m": termination.deviation,
        }
        if scenario.corridor is not None:
            width = scenario.corridor.half_width_m
            limits |= {f"corridor.{point}.max_m": width for point in _POINTS}
        return cls(limits, limit_m)

    def shares(self, row: Row) -> dict[str, float]:
        """Return the share of each limit that a run reaches; 0 where it has no such figure."""
        shares = {name: _number(row.get(name)) / limit for name, limit in self.limits.items()}
        error = 0.0 if self.limit_m is None else (working_error(row) or 0.0) / self.limit_m
        return shares | {"working point": error}

    def judge(self, row: Row, nominal: Mapping[str, float]) -> Outcome:
        """Return the outcome of a run.

        Args:
            row: of the run.
            nominal: `shares` of the nominal run, which has not failed.
        """
        if reason := self._failure(row):
            return Outcome(failed=True, robustness=0.0, reason=reason)
        shares = {n: share for n, share in self.shares(row).items() if nominal[n] < 1.0}
        nearest = max((share - nominal[n]) / (1.0 - nominal[n]) for n, share in shares.items())
        return Outcome(failed=False, robustness=max(1.0 - nearest, _LEAST))

    def _failure(self, row: Row) -> str:
        """Return why a run has failed, "" if it has not."""
        if row["status"] != "completed":
            return f"{row['status']}: {row['failure']}"
        for point in _POINTS:
            name = f"corridor.{point}.max_m"
            if name in self.limits and _number(row[name]) > self.limits[name]:
                return f"out of the corridor: {point} {_number(row[name]):.3f} m from its path"
        if _number(row["corridor.hitch_outside_fraction"]) > 0.0:
            return "hitch angle beyond the limit of the corridor"
        if has_failed(row, self.limit_m):
            return f"95 % cross-track error {working_error(row):.3f} m"
        return ""


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else 0.0


@dataclass(frozen=True)
class Case:
    """A point of the search and its outcome."""

    point: FloatArray  # (n,)
    severity: float
    outcome: Outcome | None  # None: the scenario refuses the point, or the run raised an error

    @property
    def failed(self) -> bool:
        """Return whether the run failed."""
        return self.outcome is not None and self.outcome.failed

    @property
    def cost(self) -> float:
        """Return the number by which cases are ordered, best first."""
        if self.outcome is None:
            return _REFUSED
        return self.severity if self.outcome.failed else 2.0 + self.outcome.robustness


def falsify(
    space: Space, evaluate: Callable[[FloatArray], Sequence[Outcome | None]], budget: int, seed: int
) -> list[Case]:
    """Search for the least severe failure; return all cases in the order of their runs.

    The cases depend on space, budget and seed alone, not on how `evaluate` shares its work.

    Args:
        space: of the parameters.
        evaluate: drives points (m, n) and returns their outcomes in order.
        budget: largest number of points.
        seed: of the optimiser.

    Raises:
        MissingExtra: `cmaes` is not installed.
    """
    try:
        import cmaes
    except ImportError:
        raise MissingExtra(
            "search worst needs cmaes: pip install 'ttempc-proving-ground[search]'"
        ) from None
    rng = generator(seed, "falsification")
    size = len(space.parameters)
    cases: list[Case] = []

    def add(points: FloatArray) -> list[Case]:
        pairs = zip(points, evaluate(points), strict=True)
        new = [Case(point, space.severity(point), outcome) for point, outcome in pairs]
        cases.extend(new)
        return new

    def strategy(mean: FloatArray, population: int) -> CMA:
        bounds = np.tile([0.0, 1.0], (size, 1))
        state = int(rng.integers(2**31))
        return cmaes.CMA(mean, _SIGMA, bounds=bounds, seed=state, population_size=population)

    population = 4 + int(3.0 * np.log(size))  # Hansen's default
    add(qmc.LatinHypercube(size, rng=rng).random(min(_EXPLORED * population, budget)))
    optimiser = strategy(best(cases).point, population)
    simplified: Case | None = None
    while (rest := budget - len(cases)) > 0:
        known = best(cases)
        if known.failed and known.severity == 0.0:
            break  # at a place where the nominal values fail
        if known.failed and known is not simplified:
            simplified = known
            add(milder(space, known.point)[:rest])
            if best(cases) is not known:
                optimiser = strategy(best(cases).point, population)
            continue
        points = np.array([optimiser.ask() for _ in range(min(population, rest))])
        new = add(points)
        if len(new) == population:
            optimiser.tell([(case.point, case.cost) for case in new])
        if optimiser.should_stop():
            population *= 2
            optimiser = strategy(rng.random(size), population)
    return cases


def best(cases: Sequence[Case]) -> Case:
    """Return the least severe failure, or the least robust case if none failed."""
    return min(cases, key=lambda case: case.cost)


def distinct(space: Space, cases: Sequence[Case], most: int, apart: float = 0.2) -> list[Case]:
    """Return failures in the order of their severity, without neighbours of one returned before.

    Args:
        space: of the parameters.
        cases: to choose from.
        most: largest number of failures to return.
        apart: least root mean square distance, of the bounds.
    """
    chosen: list[Case] = []
    scale = apart * np.sqrt(len(space.parameters))
    for case in sorted((case for case in cases if case.failed), key=lambda case: case.cost):
        if all(np.linalg.norm(case.point - other.point) >= scale for other in chosen):
            chosen.append(case)
    return chosen[:most]


def milder(space: Space, point: FloatArray) -> FloatArray:
    """Return milder points, (m, n), that share the free parameters of a point.

    Each lacks the deviation of one parameter, or has a share of all deviations.
    """
    deviation = np.where(space.counted > 0.0, point - space.nominal, 0.0)
    counted = np.flatnonzero(deviation)
    without = [np.where(np.arange(len(point)) == i, deviation, 0.0) for i in counted]
    removed = without if len(counted) > 1 else []
    return np.array([point - part for part in (*removed, *((1 - s) * deviation for s in _SHARES))])


@dataclass(frozen=True)
class CaseReport:
    """A case of the report."""

    severity: float
    robustness: float  # 1 nominal, 0 failed
    failure: str  # "" of a run that did not fail
    values: Mapping[str, Scalar]  # of the scenario's keys
    file: str  # the scenario, in the folder of the report


@dataclass(frozen=True)
class Report:
    """Content of `falsification.json`."""

    scenario: str
    controller: str
    seed: int
    limit_m: float | None
    runs: int  # of the search
    failed: int  # of these
    without_result: int  # of these: refused by the scenario, or ended by an error
    cases: tuple[CaseReport, ...]  # failures, least severe first; without any the least robust case
    versions: Mapping[str, str]

    def to_json(self) -> str:
        """Return the text of the file."""
        return json.dumps(asdict(self), indent=2, allow_nan=False) + "\n"


class Search:
    """A search and its runs; every generation of runs has a sweep's folder of its own.

    Args:
        subject: scenario and space of parameters.
        engine: executes the runs.
        seed: of all runs, for terrain and noise, and of the optimiser.
        limit_m: as of `Specification`.
        folder: for runs and report; None: nothing is kept.
        on_run: called after every run.

    Raises:
        InvalidScenario, InvalidStudy: the nominal run is refused.
        SweepRefused: the folder has other content.
        SweepStopped: the nominal run raised an error.
    """

    def __init__(
        self,
        subject: Subject,
        engine: Engine,
        seed: int,
        limit_m: float | None = None,
        folder: Path | None = None,
        on_run: Callable[[], object] = lambda: None,
    ) -> None:
        self.subject, self._engine, self.seed, self.folder = subject, engine, seed, folder
        self._generations, self._on_run = 0, on_run
        nominal = subject.space.nominal
        self.specification = Specification.of(self.setting(nominal).scenario, limit_m)
        row = self._drive(nominal[None, :])[0]
        if row is None or row["status"] in _ERRORS:
            raise SweepStopped(f"nominal run: {row['failure'] if row else 'refused'}")
        self._nominal_shares = self.specification.shares(row)
        outcome = self.specification.judge(row, self._nominal_shares)
        self.cases = [Case(nominal, 0.0, outcome)]

    def falsify(self, budget: int) -> None:
        """Search with a number of runs, the nominal one among them; see `falsify`."""
        if not self.cases[0].failed and budget > 1:
            self.cases += falsify(self.subject.space, self._outcomes, budget - 1, self.seed)

    def report(self) -> Report:
        """Return the report, written to the folder with a scenario file for each case."""
        space, reports = self.subject.space, []
        worst = distinct(space, self.cases, _WORST) or [best(self.cases)]
        settings = [self.setting(case.point) for case in worst]
        controller = settings[0].scenario.controller.name
        for number, (case, setting) in enumerate(zip(worst, settings, strict=True), 1):
            outcome, name = case.outcome, f"{setting.name}-{controller.replace(':', '-')}-{number}"
            assert outcome is not None
            reports.append(
                CaseReport(
                    severity=case.severity,
                    robustness=outcome.robustness,
                    failure=outcome.reason,
                    values=space.changes(case.point),
                    file=f"worst/{name}.toml",
                )
            )
        report = Report(
            scenario=settings[0].name,
            controller=controller,
            seed=self.seed,
            limit_m=self.specification.limit_m,
            runs=len(self.cases),
            failed=sum(case.failed for case in self.cases),
            without_result=sum(case.outcome is None for case in self.cases),
            cases=tuple(reports),
            versions=versions(),
        )
        if self.folder is not None:
            for case, setting in zip(reports, settings, strict=True):
                write_file(self.folder / case.file, setting.toml)
            write_file(self.folder / "falsification.json", report.to_json())
        return report

    def setting(self, point: FloatArray) -> Setting:
        """Return the scenario at a point.

        Raises:
            InvalidStudy: it is refused.
        """
        return self._plan(point[None, :]).setting(self.subject.space.changes(point))

    def _plan(self, points: FloatArray) -> SweepPlan:
        subject = self.subject
        changes = [subject.space.changes(point) for point in points]
        return points_plan(subject.scenario, changes, subject.settings, [self.seed])

    def _outcomes(self, points: FloatArray) -> list[Outcome | None]:
        return [
            None
            if row is None or row["status"] in _ERRORS
            else self.specification.judge(row, self._nominal_shares)
            for row in self._drive(points)
        ]

    def _drive(self, points: FloatArray) -> Sequence[Row | None]:
        """Drive one generation and return the row of each point, None where it is refused."""
        folder = self.folder and self.folder / "generations" / f"{self._generations:03d}"
        self._generations += 1
        driven = drive_plan(self._plan(points), self._engine, folder)
        for _ in points:
            self._on_run()
        return [rows[0] if rows else None for rows in driven]
