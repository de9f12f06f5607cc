"""Runner: drives the cases of studies, keeps their rows, writes the tables into their pages."""

import contextlib
import hashlib
import inspect
import json
import os
import pickle
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

import pandas as pd
from tqdm import tqdm

from ...testbed.recording.provenance import code_digest, versions
from ..errors import InvalidRows
from ..output import write_file
from ..pictures.sweep_report.format import format_numbers
from ..pictures.sweep_report.runs import read_sweep
from ..studies.sweep.engine import Engine, engine, imap_bounded
from ..studies.sweep.folder import is_begun, lock_folder
from ..studies.sweep.plan import SweepPlan
from ..studies.sweep.results import read_frame
from ..studies.sweep.study import load_study
from ..studies.sweep.sweep import sweep
from .checks import (
    OUTCOMES,
    Check,
    Fingerprint,
    Making,
    digest_of,
    fingerprint,
    read_ledger,
    sweep_checks,
    write_ledger,
)
from .pages import ROOT, pages_of_tables, read_page, with_block
from .study import Block, Case, Row, Study, lap

_SHOWN: Final = ("commit", "code", "ttempc", "mujoco", "numpy", "piqp")
sys.path.append(str(ROOT / "docs" / "examples"))  # controllers there; workers get this path, too

_UNREADABLE: Final = (pickle.UnpicklingError, AttributeError, ImportError, TypeError)

Task = TypeVar("Task")
Result = TypeVar("Result")


class Runner:
    """Source of the frames that tables are made from.

    Rows lie in folders whose names follow from the study and the fingerprints of its checks: they
    are taken again while both are the same, and an interrupted study goes on. Rows of a study
    without checks are kept while the code is the same. A study is made at a time.

    Args:
        folder: for rows.
        workers: processes; None: one per core, 0: this process.
    """

    def __init__(self, folder: Path, workers: int | None = None) -> None:
        self.folder, self._workers = folder, workers
        self._fingerprints: dict[str, Fingerprint] = {}
        self._study: Study
        self.versions = current_versions()  # of the rows that were read last

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
        self._study = study
        if study.make is not None:
            made = study.make(self)
        else:
            assert study.table is not None
            rows = (
                self.sweep_rows(study.sweeps)
                if study.sweeps
                else self.frame(study.cases(), study.drive)
            )
            made = study.table(rows)
        return made if isinstance(made, Block) else Block(made)

    def sweep_rows(self, names: Sequence[str]) -> pd.DataFrame:
        """Return the rows of shipped sweeps, with the name of the sweep in the column `study`."""
        frames = [read_frame(self.sweep(name)).copy().assign(study=name) for name in names]
        return pd.concat(frames, ignore_index=True)

    def frame(
        self, cases: Sequence[Case], drive: Callable[[Case], Row | list[Row]] = lap
    ) -> pd.DataFrame:
        """Return the rows of cases in their order, with scenario, seed and labels as columns."""
        return pd.DataFrame(
            [
                {"scenario": case.scenario, "seed": case.seed, **case.labels, **row}
                for case, found in zip(cases, self.map(drive, cases), strict=True)
                for row in (found if isinstance(found, list) else [found])
            ]
        )

    def map(self, function: Callable[[Task], Result], tasks: Sequence[Task]) -> list[Result]:
        """Return the results of tasks in their order; they are kept for the study being made.

        Args:
            function: called for each task in a worker process; what it raises is raised here.
            tasks: picklable; equal ones have an equal `repr`.
        """
        file = self.kept() / "results.pickle"
        name = f"{function.__module__}.{function.__qualname__}"
        keys = [hashlib.sha256(f"{name} {task!r}".encode()).hexdigest() for task in tasks]
        known = _read(file)
        missing = {key: task for key, task in zip(keys, tasks, strict=True) if key not in known}
        with file.open("ab") as stream:
            work = partial(_keyed, function)
            for (key, _), result in self._imap(work, [*missing.items()], self._study.name):
                pickle.dump((key, result), stream)
                stream.flush()
                known[key] = result
        return [known[key] for key in keys]

    def kept(self) -> Path:
        """Return the folder for results of the study being made, while its checks are the same."""
        study = self._study
        source = inspect.getmodule(study.make or study.table)
        assert source is not None
        digest = hashlib.sha256(inspect.getsource(source).encode()).hexdigest()
        folder = self._folder(study.name, study.all_checks, digest[:8])
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


def _keyed(function: Callable[[Task], Result], keyed: tuple[str, Task]) -> Result:
    return function(keyed[1])


def _read(file: Path) -> dict[str, Any]:
    """Return kept results by key, without a torn last one; of other classes: none."""
    results: dict[str, Any] = {}
    whole = 0
    if not file.exists():
        return results
    with file.open("rb") as stream, contextlib.suppress(EOFError, *_UNREADABLE):
        while True:
            whole = stream.tell()
            key, result = pickle.load(stream)
            results[key] = result
    os.truncate(file, whole)
    return results


def write_tables(studies: Sequence[Study], runner: Runner, out: Path = ROOT) -> Iterator[Study]:
    """Make tables, one after the other, and yield each study when its page is written.

    The table of a study without a page is printed.

    Args:
        studies: to make.
        runner: of their runs.
        out: folder that gets the pages; by default they are replaced in the checkout.

    Raises:
        InvalidPage: markers of the pages are invalid; nothing is driven.
        ExperimentError, TestbedError, TtempcError: a run is refused; tables before it are written.
    """
    pages = pages_of_tables()
    runner.fingerprints([check for study in studies for check in study.all_checks])
    for study in studies:
        runner.versions = current_versions()
        block = runner.block(study)
        if study.name not in pages:
            print(block.text, flush=True)
            continue
        page = pages[study.name]
        making = Making(runner.versions, runner.fingerprints(study.all_checks))
        line = block.footer or provenance(study, making)
        text = with_block(read_page(page, out), study.name, f"{block.text.strip()}\n\n{line}")
        for name, content in block.files.items():
            write_file((out / page).parent / name, content)
        write_file(out / page, text.encode())
        write_ledger({**read_ledger(out), study.name: making}, out)
        yield study


def provenance(study: Study, making: Making) -> str:
    """Return the line below a table: study, seeds, versions and the digest of its checks."""
    parts = [f"`python -m proving_ground.experiments.papers {study.name}`"]
    if seeds := study.all_seeds:
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
