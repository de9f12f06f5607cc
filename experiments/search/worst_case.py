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

import itertools
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

    failure: str  # its reason; "" of a run that holds
    robustness: float = 0.0  # 1 nominal, 0 failed


@dataclass(frozen=True)
class Specification:
    """What a run must keep to: it completes, in the corridor, with an error below a limit."""

    limits: Mapping[str, float]  # of figures of a row, in the unit of the figure
    limit_m: float | None = None  # on the 95 % cross-track error of the working point [m]

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
        """Return the outcome of a run, by the `shares` of the nominal run, which did not fail."""
        if row["status"] != "completed":
            return Outcome(f"{row['status']}: {row['failure']}")
        for point in _POINTS:
            name = f"corridor.{point}.max_m"
            if _number(row[name]) > self.limits.get(name, math.inf):
                reason = f"out of the corridor: {point} {_number(row[name]):.3f} m from its path"
                return Outcome(reason)
        if _number(row["corridor.hitch_outside_fraction"]) > 0.0:
            return Outcome("hitch angle beyond the limit of the corridor")
        if has_failed(row, self.limit_m):
            return Outcome(f"95 % cross-track error {working_error(row):.3f} m")
        shares = {n: share for n, share in self.shares(row).items() if nominal[n] < 1.0}
        nearest = max((share - nominal[n]) / (1.0 - nominal[n]) for n, share in shares.items())
        return Outcome("", max(1.0 - nearest, _LEAST))


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
        return self.outcome is not None and bool(self.outcome.failure)

    @property
    def cost(self) -> float:
        """Return the number by which cases are ordered, best first."""
        if self.outcome is None:
            return _REFUSED
        return self.severity if self.failed else 2.0 + self.outcome.robustness


def falsify(
    space: Space, evaluate: Callable[[FloatArray], Sequence[Outcome | None]], budget: int, seed: int
) -> list[Case]:
    """Search for the least severe failure; return all cases in the order of their runs.

    `evaluate` drives points (m, n) and returns their outcomes in order, at most `budget` points.

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
        cases.extend(Case(point, space.severity(point), outcome) for point, outcome in pairs)
        return cases[-len(points) :]

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
class Report:
    """Content of `falsification.json`: the least severe failure, or the least robust case."""

    scenario: str
    controller: str
    seed: int
    limit_m: float | None
    runs: int  # of the search
    failed: int  # of these
    without_result: int  # of these: refused by the scenario, or ended by an error
    severity: float
    robustness: float  # 1 nominal, 0 failed
    failure: str  # "" of a run that did not fail
    values: Mapping[str, Scalar]  # of the scenario's keys
    versions: Mapping[str, str]

    def to_json(self) -> str:
        """Return the text of the file."""
        return json.dumps(asdict(self), indent=2, allow_nan=False) + "\n"


def find_worst_case(
    subject: Subject,
    engine: Engine,
    seed: int,
    budget: int,
    limit_m: float | None = None,
    folder: Path | None = None,
    on_run: Callable[[], object] = lambda: None,
) -> Report:
    """Search for the least severe failure and return the report, written to the folder.

    Args:
        subject: scenario and space of parameters.
        engine: executes the runs.
        seed: of all runs, for terrain and noise, and of the optimiser.
        budget: runs of the search, the nominal one among them.
        limit_m: as of `Specification`.
        folder: of the report, of `worst.toml`, the scenario of its case, and of the rows, each
            generation in a sweep's folder of its own; None: nothing is kept.
        on_run: called after every run.

    Raises:
        InvalidScenario, InvalidStudy: the nominal run is refused.
        SweepRefused: the folder has other content.
        SweepStopped: the nominal run raised an error.
    """
    space, generation = subject.space, itertools.count()

    def plan(points: FloatArray) -> SweepPlan:
        changes = [space.changes(point) for point in points]
        return points_plan(subject.scenario, changes, subject.settings, [seed])

    def setting(point: FloatArray) -> Setting:
        return plan(point[None, :]).setting(space.changes(point))

    def drive(points: FloatArray) -> list[Row | None]:
        """Return the row of each point, None where it is refused."""
        place = folder and folder / "generations" / f"{next(generation):03d}"
        driven = drive_plan(plan(points), engine, place)
        for _ in points:
            on_run()
        return [rows[0] if rows else None for rows in driven]

    def evaluate(points: FloatArray) -> list[Outcome | None]:
        return [
            None if row is None or row["status"] in _ERRORS else specification.judge(row, shares)
            for row in drive(points)
        ]

    specification = Specification.of(setting(space.nominal).scenario, limit_m)
    (row,) = drive(space.nominal[None, :])
    if row is None or row["status"] in _ERRORS:
        raise SweepStopped(f"nominal run: {row['failure'] if row else 'refused'}")
    shares = specification.shares(row)
    cases = [Case(space.nominal, 0.0, specification.judge(row, shares))]
    if not cases[0].failed and budget > 1:
        cases += falsify(space, evaluate, budget - 1, seed)
    worst = best(cases)
    assert worst.outcome is not None
    found = setting(worst.point)
    report = Report(
        scenario=found.name,
        controller=found.scenario.controller.name,
        seed=seed,
        limit_m=limit_m,
        runs=len(cases),
        failed=sum(case.failed for case in cases),
        without_result=sum(case.outcome is None for case in cases),
        severity=worst.severity,
        robustness=worst.outcome.robustness,
        failure=worst.outcome.failure,
        values=space.changes(worst.point),
        versions=versions(),
    )
    if folder is not None:
        write_file(folder / "worst.toml", found.toml)
        write_file(folder / "falsification.json", report.to_json())
    return report
