"""Runner: drives the studies of tables by the sweep engine, writes the tables into their pages."""

import contextlib
import hashlib
import inspect
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final, TypeVar

import pandas as pd
from tqdm import tqdm

from ...testbed.recording.provenance import code_digest, versions
from ..output import write_file
from ..pictures.sweep_report.format import format_numbers
from ..studies.sweep.engine import Engine, engine, imap_bounded
from ..studies.sweep.folder import is_begun, lock_folder, read_origin
from ..studies.sweep.plan import SweepPlan
from ..studies.sweep.results import FILE, read_frame, rows
from ..studies.sweep.study import Study
from ..studies.sweep.sweep import sweep
from ..studies.sweep.work import run_job
from .checks import (
    HELD,
    NO_CHECK,
    OUTCOMES,
    SAME_BITS,
    Check,
    Fingerprint,
    Making,
    digest_of,
    fingerprint,
    read_ledger,
    write_ledger,
)
from .pages import ROOT, pages_of_tables, read_page, with_block
from .table import Block, Table, Work

_SHOWN: Final = ("commit", "code", "ttempc", "mujoco", "numpy", "piqp")
sys.path.append(str(ROOT / "docs" / "examples"))  # controllers there; workers get this path, too

Task = TypeVar("Task")
Result = TypeVar("Result")


class Runner:
    """Source of the rows that tables are made from.

    Each study is a sweep in a folder whose name follows from the study, the code that makes its
    rows, and the fingerprints of the table's checks: a finished sweep is taken again while these
    are the same, an interrupted one goes on. Without checks the folder is that of the code.

    Args:
        folder: for rows.
        workers: processes; None: one per core, 0: this process.
    """

    def __init__(self, folder: Path, workers: int | None = None) -> None:
        self.folder = folder
        self.versions = current_versions()  # of the rows that were read last
        self._workers = workers
        self._fingerprints: dict[str, Fingerprint] = {}

    def engine(self) -> contextlib.AbstractContextManager[Engine]:
        """Return the workers of the runs, until the block ends."""
        return engine(self._workers)

    def fingerprints(self, checks: Iterable[Check]) -> dict[str, Fingerprint]:
        """Return the fingerprints of checks by name; each check is driven once."""
        by_name = {check.name: check for check in checks}
        missing = [check for name, check in by_name.items() if name not in self._fingerprints]
        for check, found in zip(missing, self.map(fingerprint, missing, "checks"), strict=True):
            self._fingerprints[check.name] = found
        return {name: self._fingerprints[name] for name in by_name}

    def block(self, table: Table) -> Block:
        """Return a table, made from finished sweeps and from runs that are still missing."""
        if table.make is not None:
            made = table.make(self)
        else:
            assert table.text is not None
            made = table.text(self.frame(table))
        return made if isinstance(made, Block) else Block(made)

    def frame(self, table: Table) -> pd.DataFrame:
        """Return the rows of all studies of a table, with the name of the study as a column."""
        folders = {name: self._sweep_folder(table, name) for name in table.all_studies}
        missing = [name for name, folder in folders.items() if not is_finished(folder)]
        if missing:
            with self.engine() as workers:
                for name in missing:
                    self._drive(name, table.all_studies[name], folders[name], table.work, workers)
        frames = [read_frame(folder).copy().assign(study=name) for name, folder in folders.items()]
        origin = read_origin(next(reversed(folders.values())))
        self.versions = {**origin.versions, "code": origin.code}
        return pd.concat(frames, ignore_index=True)

    def map(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], what: str
    ) -> list[Result]:
        """Return the results of tasks in their order; a worker calls the function for each."""
        if not tasks:
            return []
        results: dict[int, Result] = {}
        numbered = [*enumerate(tasks)]
        with self.engine() as workers, tqdm(total=len(tasks), desc=what) as bar:
            for (number, _), future in imap_bounded(workers, partial(_second, function), numbered):
                results[number] = future.result()
                bar.update()
        return [results[number] for number in range(len(tasks))]

    def _sweep_folder(self, table: Table, name: str) -> Path:
        """Return the folder of a study of a table."""
        checks = table.all_checks
        state = digest_of(self.fingerprints(checks).values()) if checks else code_digest()
        text = table.all_studies[name].dump()
        if table.work is not run_job:
            text += _source(table.work)
        digest = hashlib.sha256(text.encode()).hexdigest()[:8]
        own = "" if name == table.name else f"-{_file_name(name)}"
        return self.folder / f"{table.name}{own}-{state}-{digest}"

    def _drive(self, name: str, study: Study, folder: Path, work: Work, workers: Engine) -> None:
        """Drive the runs of a study that have no row yet.

        Raises:
            SweepRefused: an interrupted sweep was begun with other code.
        """
        plan = SweepPlan(name, study)
        with (
            lock_folder(folder, plan) as locked,
            tqdm(total=plan.run_count, desc=name, unit="run") as bar,
        ):
            sweep(plan, locked, workers, lambda progress: bar.update(progress.done - bar.n), work)


def is_finished(folder: Path) -> bool:
    """Return whether every run of the sweep in a folder has its row."""
    if not is_begun(folder) or not (folder / FILE).exists():
        return False
    origin = read_origin(folder)
    return sum(1 for _ in rows(folder / FILE)) == origin.runs - origin.refused


def current_versions() -> dict[str, str]:
    """Return the versions of all software, and a digest of the code."""
    return {**versions(), "code": code_digest()}


def _second(function: Callable[[Task], Result], numbered: tuple[int, Task]) -> Result:
    return function(numbered[1])


def _source(work: Work) -> str:
    """Return the text of the module in which the rows are made."""
    inner = work.keywords["measure"] if isinstance(work, partial) else work
    module = inspect.getmodule(inner)
    assert module is not None
    return inspect.getsource(module)


def _file_name(name: str) -> str:
    """Return the name of a study without characters that a path must not have."""
    return "".join(letter if letter.isalnum() else "-" for letter in name)


def write_tables(tables: Sequence[Table], runner: Runner, out: Path = ROOT) -> Iterator[Table]:
    """Make tables, one after the other, and yield each when its page is written.

    A table without a page is printed.

    Args:
        tables: to make.
        runner: of their runs.
        out: folder that gets the pages; by default they are replaced in the checkout.

    Raises:
        InvalidPage: markers of the pages are invalid; nothing is driven.
        ExperimentError, TestbedError, TtempcError: a run is refused; tables before it are written.
    """
    pages = pages_of_tables()
    runner.fingerprints([check for table in tables for check in table.all_checks])
    for table in tables:
        runner.versions = current_versions()
        block = runner.block(table)
        if table.name not in pages:
            print(block.text, flush=True)
            continue
        page = pages[table.name]
        making = Making(runner.versions, runner.fingerprints(table.all_checks))
        line = block.footer or provenance(table, making)
        text = with_block(read_page(page, out), table.name, f"{block.text.strip()}\n\n{line}")
        for name, content in block.files.items():
            write_file((out / page).parent / name, content)
        write_file(out / page, text.encode())
        write_ledger({**read_ledger(out), table.name: making}, out)
        yield table


def provenance(table: Table, making: Making) -> str:
    """Return the line below a table: its name, seeds, versions and the digest of its checks."""
    drawn = "" if table.seed is None else f" --seed {table.seed}"
    parts = [f"`python -m proving_ground.experiments.papers {table.name}{drawn}`"]
    if seeds := table.all_seeds:
        parts.append(f"seed{'s' if len(seeds) > 1 else ''} {format_numbers(seeds)}")
    known = (f"{name} {making.versions[name]}" for name in _SHOWN if name in making.versions)
    parts.append(", ".join(known))
    if count := len(making.checks):
        digest = digest_of(making.checks.values())
        parts.append(f"{count} regression check{'s' if count > 1 else ''} {digest}")
    return f"<sub>{'; '.join(parts)}</sub>"


def check(tables: Sequence[Table], runner: Runner, out: Path = ROOT) -> Mapping[str, str]:
    """Drive the checks of all tables again and return the state of each by its name.

    States are those of `OUTCOMES` with the worst check where it has not the same bits, `NO_CHECK`,
    "not made", or "other checks".
    """
    ledger = read_ledger(out)
    made = [table for table in tables if table.name in ledger]
    now = runner.fingerprints([check for table in made for check in table.all_checks])
    return {table.name: _state(table, ledger.get(table.name), now) for table in tables}


def holds(state: str) -> bool:
    """Return whether no check asks for a table in a state of `check` to be made anew."""
    return state.startswith(HELD)


def _state(table: Table, making: Making | None, now: Mapping[str, Fingerprint]) -> str:
    if making is None:
        return "not made"
    names = {item.name for item in table.all_checks}
    if other := names ^ making.checks.keys():
        return f"other checks ({min(other)})"
    if not names:
        return NO_CHECK
    compared = [(OUTCOMES.index(making.checks[name].compare(now[name])), name) for name in names]
    worst, name = max(compared)
    return f"{OUTCOMES[worst]} ({name})" if worst else SAME_BITS
