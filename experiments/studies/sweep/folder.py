"""Folder of a sweep: its lock, its study and the versions that it was begun with."""

from __future__ import annotations

import fcntl
import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, BinaryIO, Final

import pydantic.dataclasses
from pydantic import Field

from ....testbed.atomic_write import atomic_write, partial_path
from ....testbed.configuration.config_io import STRICT, validated
from ....testbed.foreign_files import json_table, open_member, read_member
from ....testbed.recording.provenance import code_digest, versions
from ...errors import SweepRefused, SweepStopped
from .plan import SweepPlan
from .results import FILE, rows
from .row import Row, columns, line
from .study import MOST_RUNS

_LOCK: Final = ".lock"
_STUDY: Final = "study.toml"
_VERSIONS: Final = "versions.json"
_MOST_DIGITS: Final = 20  # of the number of a process


@pydantic.dataclasses.dataclass(frozen=True, slots=True, config=STRICT)
class Origin:
    """Provenance of the rows of a folder, besides its study."""

    plan: str  # digest of all scenarios and seeds
    runs: Annotated[int, Field(ge=0, le=MOST_RUNS)]  # numbers in the plan
    code: str  # digest of the source code
    versions: dict[str, str]
    machine: str
    cpus: int
    refused: Annotated[int, Field(ge=0)] = 0  # of the numbers, those of refused combinations
    study: str = ""  # name of its file

    @classmethod
    def here(cls, plan: str, runs: int, refused: int = 0, study: str = "") -> Origin:
        """Return the origin of rows that this process makes."""
        machine = platform.platform()
        cpus = os.cpu_count() or 1
        return cls(plan, runs, code_digest(), versions(), machine, cpus, refused, study)

    def dump(self) -> str:
        """Return the content of `versions.json`."""
        return json.dumps(asdict(self), indent=2) + "\n"


@dataclass(frozen=True, slots=True)
class SweepFolder:
    """Locked folder of a sweep; no other process writes to it."""

    path: Path
    origin: Origin  # of the first sweep in the folder

    @property
    def results(self) -> Path:
        """Return the file of the rows."""
        return self.path / FILE

    @property
    def logs(self) -> Path:
        """Return the folder of the logs."""
        return self.path / "logs"


def is_begun(path: Path) -> bool:
    """Return whether a sweep has been begun in a folder."""
    return (path / _STUDY).exists()


def read_origin(path: Path, error: type[Exception] = SweepRefused) -> Origin:
    """Return the origin of a folder in which a sweep has been begun.

    Raises:
        Exception: `error` with one line, where the folder has none or it is not as it was written.
    """
    where = f"{path / _VERSIONS}: is not what `ttempc sweep` writes"
    try:
        return validated(Origin, json_table(read_member(path, _VERSIONS)), error)
    except OSError as reason:
        raise error(f"{where}: {reason.strerror}") from None
    except (ValueError, error) as reason:
        raise error(f"{where}: {reason}") from None


@contextmanager
def lock_folder(path: Path, plan: SweepPlan) -> Iterator[SweepFolder]:
    """Lock a new folder, or the folder of the same sweep, until the block or the process ends.

    Rows of a study that has grown since are kept under their numbers in the new plan.

    Args:
        path: of the folder.
        plan: of the sweep.

    Raises:
        SweepRefused: the folder has other content, rows of other runs or other versions, or
            another process has locked it; nothing is changed.
        InvalidStudy: a scenario of the plan is invalid.
    """
    _refuse_foreign(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
        lock = open_member(path, _LOCK, os.O_RDWR | os.O_CREAT)
    except OSError as error:
        raise SweepRefused(f"output folder {path}: cannot be made: {error.strerror}") from None
    with lock:
        _take(lock, path)
        digest = plan.extent().digest
        refused = plan.size - plan.run_count
        origin = Origin.here(digest, plan.size, refused, plan.name)
        if is_begun(path):
            origin = _resumed(path, plan, origin)
        else:
            _write(path / _VERSIONS, origin.dump())
            _write(path / _STUDY, plan.study.dump())
        yield SweepFolder(path, origin)


def _refuse_foreign(path: Path) -> None:
    """Look at a folder before anything in it is written.

    Raises:
        SweepRefused: it is no folder of a sweep and not empty, or what it has was not written by
            one.
    """
    try:
        items = list(path.iterdir()) if path.exists() else []
    except OSError as error:
        raise SweepRefused(f"output folder {path}: cannot be read: {error.strerror}") from None
    for item in items:
        if item.is_symlink():
            raise SweepRefused(f"output folder {path}: {item.name} is a link, give another folder")
    found = {item.name for item in items}
    if _STUDY in found:
        read_origin(path)
        return
    parts = {partial_path(path / name).name for name in (_VERSIONS, _STUDY)}
    if found - {_LOCK, _VERSIONS, *parts}:  # a sweep that died at its start leaves these
        raise SweepRefused(f"output folder {path}: holds something else, give another")


def _take(lock: BinaryIO, path: Path) -> None:
    """Lock a folder by its open file, and write into it which process did.

    Raises:
        SweepRefused: another process has locked it.
    """
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        holder = lock.read(_MOST_DIGITS).decode(errors="replace") or "unknown"
        raise SweepRefused(
            f"output folder {path}: another sweep is at work in it (process {holder})"
        ) from None
    lock.truncate(0)
    lock.write(str(os.getpid()).encode())


def _resumed(path: Path, plan: SweepPlan, origin: Origin) -> Origin:
    """Return the origin of a folder in which this sweep was begun before, perhaps smaller.

    Raises:
        SweepRefused: it belongs to another sweep; the message says what differs.
    """
    begun = read_origin(path)
    refuse_other_code(path, begun, origin)
    if same_study(path, plan) and begun.plan == origin.plan:
        return begun
    origin = replace(origin, versions=begun.versions)
    kept = _renumbered(path, plan, origin)
    # The digest of the plan comes last: until it is written, rows are found by their identity.
    _write(path / _STUDY, plan.study.dump())
    _write(path / FILE, "".join(map(line, kept)))
    _write(path / _VERSIONS, origin.dump())
    return origin


def refuse_other_code(path: Path, begun: Origin, origin: Origin) -> None:
    """Refuse a folder that was begun with other code or other versions than those of `origin`.

    Raises:
        SweepRefused: the message says what differs.
    """
    # The commit may differ: the digest says whether the code does.
    before, after = ({"code": item.code, **item.versions, "commit": ""} for item in (begun, origin))
    for name in {**before, **after}:
        if (old := before.get(name)) != (now := after.get(name)):
            raise SweepRefused(
                f"folder {path}: was begun with another {name} ({old}, now {now}); "
                "give another folder"
            )


def same_study(path: Path, plan: SweepPlan) -> bool:
    """Return whether a folder was begun with the study of a plan.

    Raises:
        SweepRefused: its study cannot be read.
    """
    try:
        return read_member(path, _STUDY) == plan.study.dump().encode()
    except OSError as error:
        raise SweepRefused(f"{path / _STUDY}: cannot be read: {error.strerror}") from None


def _renumbered(path: Path, plan: SweepPlan, origin: Origin) -> list[Row]:
    """Return the rows of a folder with the numbers and axes of another plan of the same runs."""
    rest = {str(row["run_id"]): row for row in rows(path / FILE)} if (path / FILE).exists() else {}
    kept: list[Row] = []
    for run in plan.runs() if rest else ():
        planned = plan[run]
        if row := rest.pop(plan.identity(planned, origin.versions), None):
            values = {**row, **planned.setting.axes, "run": run, "point": planned.point}
            first = {name: values.pop(name) for name in columns(plan.study.names)}
            kept.append({**first, **values})  # a study of the pages has columns of its own
    for row in rest.values():
        raise SweepRefused(
            f"output folder {path}: holds {len(rest)} rows of runs that are not in study "
            f"{plan.name}, such as run {row['run']} ({row['controller']} on {row['scenario']}, "
            f"seed {row['seed']}); a study may grow, its runs may not change: give another folder"
        )
    return kept


def _write(file: Path, text: str) -> None:
    try:
        with atomic_write(file) as stream:
            stream.write(text.encode())
    except OSError as error:
        raise SweepStopped(f"{file}: cannot be written: {error.strerror}") from None
