"""Runs behind the tables: driven once, kept, and taken again while nothing has changed."""

from __future__ import annotations

import contextlib
import hashlib
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from tqdm import tqdm

from ...testbed.recording.provenance import code_digest, versions
from ..errors import InvalidRows
from ..seeds import report_seeds
from ..studies.batch import BatchSettings, batch_settings, run_tasks
from ..sweep.engine import Engine, engine
from ..sweep.folder import is_begun, lock_folder
from ..sweep.plan import SweepPlan
from ..sweep.study import load_study
from ..sweep.sweep import sweep
from ..sweep_report.runs import Sweep, read_sweep
from .probes import Fingerprint, Probe, digest_of, fingerprint, study_probes


def current_versions() -> dict[str, str]:
    """Return the versions of all software, and a digest of the code."""
    return {**versions(), "code": code_digest()}


class Driver:
    """Source of the runs that tables are made from.

    Rows of a sweep lie in a folder whose name follows from the study and from the fingerprints of
    its probes: they are taken again while both are the same, and an interrupted sweep goes on.
    Tasks of a study in Python are kept while the code is the same.

    Args:
        folder: for rows and results.
        workers: processes; None: one per core, 0: this process.
        seeds: of all runs, in place of those of the tables; for a rehearsal.
    """

    def __init__(
        self, folder: Path, workers: int | None = None, seeds: tuple[int, ...] | None = None
    ) -> None:
        self.folder, self._workers, self._seeds = folder, workers, seeds
        self._fingerprints: dict[str, Fingerprint] = {}
        self._swept: dict[str, Path] = {}
        self.versions = current_versions()  # of the rows that were read last

    def seeds(self, seeds: tuple[int, ...]) -> tuple[int, ...]:
        """Return the seeds of a table, or those of the rehearsal."""
        return self._seeds or seeds

    def engine(self) -> contextlib.AbstractContextManager[Engine]:
        """Return the workers of the runs, until the block ends."""
        return engine(self._workers)

    def report_seeds(self, count: int) -> tuple[int, ...]:
        """Return the first seeds of reported runs, or those of the rehearsal."""
        return self.seeds(report_seeds(count))

    def fingerprints(self, probes: Sequence[Probe]) -> Mapping[str, Fingerprint]:
        """Return the fingerprints of probes by name; each probe is driven once."""
        by_name = {item.name: item for item in probes}
        missing = [item for name, item in by_name.items() if name not in self._fingerprints]
        with batch_settings(BatchSettings(self._workers)):
            results = run_tasks(fingerprint, missing, "probes") if missing else ()
            for item, result in zip(missing, results, strict=True):
                self._fingerprints[item.name] = result
        return {name: self._fingerprints[name] for name in by_name}

    def rows(self, name: str) -> Path:
        """Return the folder of a finished sweep of a shipped study.

        Raises:
            SweepRefused: an interrupted sweep was begun with other code.
        """
        if name not in self._swept:
            self._swept[name] = self._drive(name)
        return self._swept[name]

    def sweep(self, name: str) -> Sweep:
        """Return the runs of a shipped study."""
        runs = read_sweep(self.rows(name))
        self.versions = {**runs.origin["versions"], "code": runs.origin["code"]}
        return runs

    def printed(self, main: Callable[..., object], *arguments: object) -> str:
        """Return what the `main` of a study prints, its tasks computed and kept."""
        module = main.__module__.rpartition(".")[2]
        results = self.folder / code_digest() / f"{module}.pickle"
        results.parent.mkdir(parents=True, exist_ok=True)
        output = io.StringIO()
        with (
            batch_settings(BatchSettings(self._workers, results)),
            contextlib.redirect_stdout(output),
        ):
            main(*arguments)
        return output.getvalue()

    def _drive(self, name: str) -> Path:
        _, study = load_study(name)
        if self._seeds:
            study = replace(study, seeds=self._seeds)
        plan = SweepPlan(name, study)
        probes = digest_of([*self.fingerprints(study_probes(name)).values()])
        text = hashlib.sha256(study.dump().encode()).hexdigest()[:8]
        folder = self.folder / f"{probes}-{text}" / f"sweep-{name}"
        if is_begun(folder) and (folder / "results.jsonl").exists():
            with contextlib.suppress(InvalidRows):
                if not read_sweep(folder).missing:
                    return folder
        with (
            self.engine() as workers,
            lock_folder(folder, plan) as locked,
            tqdm(total=plan.run_count, desc=name, unit="run") as bar,
        ):
            sweep(plan, locked, workers, lambda progress: bar.update(progress.done - bar.n))
        return folder
