"""A search on a scenario: its runs, its report, and scenario files of its worst cases."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ...testbed.randomness import generator
from ...testbed.recording.provenance import versions
from ..errors import SweepStopped
from ..output import write_file
from ..sweep.engine import Engine
from ..sweep.plan import Setting, SweepPlan
from ..sweep.points import drive_plan, points_plan
from ..sweep.row import Row
from ..sweep.study import Scalar
from .falsification import Case, best, distinct, falsify
from .quantities import Subject
from .robustness import Outcome, Specification
from .subset_simulation import Probability, subset_simulation

_WORST: Final = 3  # failures that are reported
_ERRORS: Final = ("failed", "crashed")  # status of a run that raised an error: no result


@dataclass(frozen=True)
class CaseReport:
    """A case of the search."""

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
    probability: Probability | None  # None if it was not asked for, or the nominal run fails
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
        limit_m: on the trailer's 95 % cross-track error [m]; None: not limited.
        folder: for runs and report; None: nothing is kept.
        on_runs: called with the number of runs so far after every generation.

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
        on_runs: Callable[[int], object] = lambda runs: None,
    ) -> None:
        self.subject, self._engine, self.seed, self.folder = subject, engine, seed, folder
        self._generations, self._runs, self._on_runs = 0, 0, on_runs
        nominal = subject.space.nominal
        self.specification = Specification.of(self.setting(nominal).scenario, limit_m)
        row = self._drive(nominal[None, :])[0]
        if row is None or row["status"] in _ERRORS:
            raise SweepStopped(f"nominal run: {row['failure'] if row else 'refused'}")
        self._nominal_shares = self.specification.shares(row)
        outcome = self.specification.judge(row, self._nominal_shares)
        self.cases = [Case(nominal, 0.0, outcome)]

    def falsify(self, budget: int) -> None:
        """Search with a number of runs, the nominal one among them; see `falsification.falsify`."""
        if not self.cases[0].failed and budget > 1:
            self.cases += falsify(self.subject.space, self._outcomes, budget - 1, self.seed)

    def probability(self, samples: int) -> Probability | None:
        """Return the probability of failure, None if the nominal run fails.

        The parameters have the distributions of `Parameter.quantile`; terrain and noise are those
        of the seed. A point without a result counts as one that holds.

        Args:
            samples: runs per level, see `subset_simulation`.
        """
        if self.cases[0].failed:
            return None
        space = self.subject.space

        def limit_state(samples: FloatArray) -> FloatArray:
            outcomes = self._outcomes(space.from_normal(samples))
            return np.array(
                [1.0 if outcome is None else outcome.robustness for outcome in outcomes]
            )

        rng = generator(self.seed, "subset simulation")
        return subset_simulation(limit_state, len(space.parameters), samples, rng)

    def report(self, probability: Probability | None = None) -> Report:
        """Return the report, written to the folder with a scenario file for each case."""
        worst = distinct(self.subject.space, self.cases, _WORST) or [best(self.cases)]
        settings = [self.setting(case.point) for case in worst]
        controller = settings[0].scenario.controller.name
        reports = []
        for number, (case, setting) in enumerate(zip(worst, settings, strict=True), 1):
            outcome, name = case.outcome, f"{setting.name}-{controller.replace(':', '-')}-{number}"
            assert outcome is not None
            reports.append(
                CaseReport(
                    severity=case.severity,
                    robustness=outcome.robustness,
                    failure=outcome.reason,
                    values=self.subject.space.changes(case.point),
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
            probability=probability,
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
        self._runs += len(points)
        self._on_runs(self._runs)
        return [rows[0] if rows else None for rows in driven]
