"""Runner: drives the cases of studies, keeps their rows, writes the tables into their pages."""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import pandas as pd
from tqdm import tqdm

from ...testbed.recording.provenance import code_digest, versions
from ..errors import InvalidRows
from ..seeds import report_seeds
from ..sweep.engine import Engine, engine, imap_bounded
from ..sweep.folder import is_begun, lock_folder
from ..sweep.plan import SweepPlan
from ..sweep.results import rows
from ..sweep.study import load_study
from ..sweep.sweep import sweep
from ..sweep_report.format import format_numbers
from ..sweep_report.runs import read_sweep
from .checks import (
    OUTCOMES,
    Check,
    Fingerprint,
    Making,
    digest_of,
    fingerprint,
    read_ledger,
    source_digest,
    sweep_checks,
    write_ledger,
)
from .pages import ROOT, check_block, read_page, with_block, write_file
from .study import Block, Case, Row, Study

_SHOWN: Final = ("commit", "code", "ttempc", "mujoco", "numpy", "piqp")
_ROWS: Final = "rows.jsonl"


class Runner:
    """Source of the frames that tables are made from.

    Rows lie in folders whose names follow from the study and the fingerprints of its checks: they
    are taken again while both are the same, and an interrupted study goes on. Rows of a study
    without checks are kept while the code is the same.

    Args:
        folder: for rows.
        workers: processes; None: one per core, 0: this process.
        seeds: of all runs, in place of those of the studies; for a rehearsal.
        overrides: of all runs, as of `--set`; for a rehearsal. A path replaces that of the study.
    """

    def __init__(
        self,
        folder: Path,
        workers: int | None = None,
        seeds: tuple[int, ...] = (),
        overrides: tuple[str, ...] = (),
    ) -> None:
        self.folder, self._workers = folder, workers
        self._seeds, self._overrides = seeds, overrides
        self._fingerprints: dict[str, Fingerprint] = {}
        self.versions = current_versions()  # of the rows that were read last

    def seeds(self, seeds: tuple[int, ...]) -> tuple[int, ...]:
        """Return the seeds of a study, or those of the rehearsal."""
        return self._seeds or seeds

    def report_seeds(self, count: int) -> tuple[int, ...]:
        """Return the first seeds of reported runs, or those of the rehearsal."""
        return self.seeds(report_seeds(count))

    def engine(self) -> contextlib.AbstractContextManager[Engine]:
        """Return the workers of the runs, until the block ends."""
        return engine(self._workers)

    def fingerprints(self, checks: Iterable[Check]) -> dict[str, Fingerprint]:
        """Return the fingerprints of checks by name; each check is driven once."""
        by_name = {check.name: check for check in checks}
        missing = [check for name, check in by_name.items() if name not in self._fingerprints]
        for check, found in self._imap(fingerprint, missing, "checks"):
            self._fingerprints[check.name] = found
        return {name: self._fingerprints[name] for name in by_name}

    def block(self, study: Study) -> Block:
        """Return the table of a study, made from kept rows and from runs that are still missing."""
        if study.make is not None:
            made = study.make(self)
        else:
            assert study.table is not None
            made = study.table(self.frame(study))
        return made if isinstance(made, Block) else Block(made)

    def frame(self, study: Study) -> pd.DataFrame:
        """Return the rows of the grid or the sweeps of a study."""
        if not study.sweeps:
            return self.map(study, study.drive, study.cases(self._seeds))
        frames = [pd.DataFrame(rows(self.sweep(name) / "results.jsonl")) for name in study.sweeps]
        return pd.concat(frames, keys=study.sweeps, names=["study"]).reset_index("study")

    def map(
        self,
        study: Study,
        drive: Callable[[Case], Row | list[Row]],
        cases: Sequence[Case],
    ) -> pd.DataFrame:
        """Return the rows of cases in their order, with scenario, seed and labels as columns.

        Args:
            study: that the rows are kept for.
            drive: called for each case in a worker process; what it raises is raised here.
            cases: of one stage of the study.
        """
        cases = [self._rehearsed(case) for case in cases]
        file = self.kept(study) / _ROWS
        keys = [_key(drive, case) for case in cases]
        known = _read(file)
        missing = [(key, case) for key, case in zip(keys, cases, strict=True) if key not in known]
        with file.open("a", encoding="utf-8") as stream:
            work = partial(_drive, drive)
            for (key, _), found in self._imap(work, missing, study.name):
                line = json.dumps({"key": key, "rows": found}, default=lambda value: value.tolist())
                stream.write(line + "\n")
                stream.flush()
                known[key] = json.loads(line)["rows"]
        return pd.DataFrame(
            [
                {"scenario": case.scenario, "seed": case.seed, **case.labels, **row}
                for key, case in zip(keys, cases, strict=True)
                for row in known[key]
            ]
        )

    def kept(self, study: Study) -> Path:
        """Return the folder of the rows of a study, while study and fingerprints are the same."""
        source = inspect.getmodule(study.make or study.table)
        assert source is not None
        digest = hashlib.sha256(inspect.getsource(source).encode())
        digest.update(repr((self._seeds, self._overrides)).encode())
        folder = self._folder(study.name, study.all_checks, digest.hexdigest()[:8])
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / "versions.json"
        if not file.exists():
            write_file(file, json.dumps(current_versions()).encode())
        self.versions = json.loads(file.read_text(encoding="utf-8"))
        return folder

    def sweep(self, name: str) -> Path:
        """Return the folder of a finished shipped sweep.

        Raises:
            SweepRefused: an interrupted sweep was begun with other code.
        """
        _, study = load_study(name)
        if self._seeds:
            study = replace(study, seeds=self._seeds)
        text = hashlib.sha256(study.dump().encode()).hexdigest()[:8]
        folder = self._folder(name, sweep_checks(name), text) / f"sweep-{name}"
        if not self._is_finished(folder):
            plan = SweepPlan(name, study)
            with (
                self.engine() as workers,
                lock_folder(folder, plan) as locked,
                tqdm(total=plan.run_count, desc=name, unit="run") as bar,
            ):
                sweep(plan, locked, workers, lambda progress: bar.update(progress.done - bar.n))
        origin = read_sweep(folder).origin
        self.versions = {**origin["versions"], "code": origin["code"]}
        return folder

    def _is_finished(self, folder: Path) -> bool:
        if is_begun(folder) and (folder / "results.jsonl").exists():
            with contextlib.suppress(InvalidRows):
                return not read_sweep(folder).missing
        return False

    def _folder(self, name: str, checks: Sequence[Check], digest: str) -> Path:
        state = digest_of(self.fingerprints(checks).values()) if checks else code_digest()
        return self.folder / f"{name}-{state}-{digest}"

    def _rehearsed(self, case: Case) -> Case:
        own = case.overrides
        if any(text.startswith("path") for text in self._overrides):
            own = tuple(text for text in own if not text.startswith("path"))
        return replace(case, overrides=(*own, *self._overrides))

    def _imap(
        self, function: Callable[[Any], Any], tasks: Sequence[Any], label: str
    ) -> Iterator[tuple[Any, Any]]:
        """Yield tasks with their results as they complete."""
        if not tasks:
            return
        with self.engine() as workers, tqdm(total=len(tasks), desc=label) as bar:
            for task, future in imap_bounded(workers, function, tasks):
                yield task, future.result()
                bar.update()


def current_versions() -> dict[str, str]:
    """Return the versions of all software, and a digest of the code."""
    return {**versions(), "code": code_digest()}


def _drive(
    drive: Callable[[Case], Row | list[Row]], keyed: tuple[str, Case]
) -> list[dict[str, Any]]:
    """Return the rows of a case; executed in a worker."""
    found = drive(keyed[1])
    return [dict(row) for row in (found if isinstance(found, list) else [found])]


def _key(drive: Callable[..., Any], case: Case) -> str:
    """Return a name of a case that is the same in every process."""
    name = f"{drive.__module__}.{drive.__qualname__}"
    return hashlib.sha256(f"{name} {case!r}".encode()).hexdigest()[:16]


def _read(file: Path) -> dict[str, list[dict[str, Any]]]:
    """Return the kept rows by the key of their case, without a torn last line."""
    if not file.exists():
        return {}
    text = file.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        file.write_text(whole, encoding="utf-8")
    return {item["key"]: item["rows"] for item in map(json.loads, whole.splitlines())}


def write_tables(studies: Sequence[Study], runner: Runner, out: Path = ROOT) -> Iterator[Study]:
    """Make tables, one after the other, and yield each study when its page is written.

    Args:
        studies: to make.
        runner: of their runs.
        out: folder that gets the pages; by default they are replaced in the checkout.

    Raises:
        InvalidPage: a page has no markers for a table; nothing is driven.
        ExperimentError, TestbedError, TtempcError: a run is refused; tables before it are written.
    """
    for study in studies:
        check_block(study.page, study.name, out)
    runner.fingerprints([check for study in studies for check in study.all_checks])
    for study in studies:
        runner.versions = current_versions()
        block = runner.block(study)
        making = Making(runner.versions, source_digest(), runner.fingerprints(study.all_checks))
        line = provenance(study, making, runner.seeds(study.all_seeds))
        text = with_block(read_page(study.page, out), study.name, f"{block.text.strip()}\n\n{line}")
        for name, content in block.files.items():
            write_file((out / study.page).parent / name, content)
        write_file(out / study.page, text.encode())
        write_ledger({**read_ledger(out), study.name: making}, out)
        yield study


def provenance(study: Study, making: Making, seeds: Sequence[int]) -> str:
    """Return the line below a table: study, seeds, versions and the digest of its checks."""
    parts = [f"`papers {study.name}`"]
    if seeds and study.all_seeds:
        parts.append(f"seed{'s' if len(seeds) > 1 else ''} {format_numbers(seeds)}")
    known = (f"{name} {making.versions[name]}" for name in _SHOWN if name in making.versions)
    parts.append(", ".join(known))
    if count := len(making.checks):
        digest = digest_of(making.checks.values())
        parts.append(f"{count} regression check{'s' if count > 1 else ''} {digest}")
    return f"<sub>{'; '.join(parts)}</sub>"


def check(studies: Sequence[Study], runner: Runner, out: Path = ROOT) -> Mapping[str, str]:
    """Drive the checks of all tables again and return the state of each table by its study's name.

    States are those of `OUTCOMES` with the worst check where it has not the same bits, "not made",
    or "other checks".
    """
    ledger = read_ledger(out)
    made = [study for study in studies if study.name in ledger]
    now = runner.fingerprints([check for study in made for check in study.all_checks])
    return {study.name: _state(study, ledger.get(study.name), now) for study in studies}


def holds(state: str) -> bool:
    """Return whether a table in a state of `check` needs not be made anew."""
    return state.startswith(OUTCOMES[:2])


def _state(study: Study, making: Making | None, now: Mapping[str, Fingerprint]) -> str:
    if making is None:
        return "not made"
    names = {item.name for item in study.all_checks}
    if other := names ^ making.checks.keys():
        return f"other checks ({min(other)})"
    compared = [(OUTCOMES.index(making.checks[name].compare(now[name])), name) for name in names]
    worst, name = max(compared, default=(0, ""))
    return f"{OUTCOMES[worst]} ({name})" if worst else OUTCOMES[0]
