"""Folder of a sweep: its lock, its study and the versions that it was begun with."""

from __future__ import annotations

import fcntl
import json
import os
import platform
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from proving_ground.testbed.atomic_write import atomic_write, partial_path
from proving_ground.testbed.recording.provenance import code_digest, versions

from ..errors import SweepRefused, SweepStopped
from .plan import SweepPlan

_LOCK: Final = ".lock"
_STUDY: Final = "study.toml"
_VERSIONS: Final = "versions.json"


@dataclass(frozen=True, slots=True)
class Origin:
    """Provenance of the rows of a folder, besides its study."""

    plan: str  # digest of all scenarios and seeds
    runs: int  # numbers in the plan
    code: str  # digest of the source code
    versions: dict[str, str]
    machine: str
    cpus: int
    refused: int = 0  # of the numbers, those of refused combinations

    @classmethod
    def here(cls, plan: str, runs: int, refused: int = 0) -> Origin:
        """Return the origin of rows that this process makes."""
        machine, cpus = platform.platform(), os.cpu_count() or 1
        return cls(plan, runs, code_digest(), versions(), machine, cpus, refused)


@dataclass(frozen=True, slots=True)
class SweepFolder:
    """Locked folder of a sweep; no other process writes to it."""

    path: Path
    origin: Origin  # of the first sweep in the folder

    @property
    def results(self) -> Path:
        """Return the file of the rows."""
        return self.path / "results.jsonl"

    @property
    def logs(self) -> Path:
        """Return the folder of the logs."""
        return self.path / "logs"


def is_begun(path: Path) -> bool:
    """Return whether a sweep has been begun in a folder."""
    return (path / _STUDY).exists()


@contextmanager
def lock_folder(path: Path, plan: SweepPlan) -> Iterator[SweepFolder]:
    """Lock a new folder, or that of the same sweep, until the block or the process ends.

    Args:
        path: of the folder.
        plan: of the sweep.

    Raises:
        SweepRefused: the folder has other content, another study or other versions, or another
            process has locked it; nothing is changed.
        InvalidStudy: a scenario of the plan is invalid.
    """
    parts = {partial_path(path / name).name for name in (_VERSIONS, _STUDY)}
    ours = {_LOCK, _VERSIONS, *parts}  # of a sweep that died at its start
    try:
        if not is_begun(path) and path.exists() and {item.name for item in path.iterdir()} - ours:
            raise SweepRefused(f"output folder {path}: holds something else, give another")
        path.mkdir(parents=True, exist_ok=True)
        lock = open(path / _LOCK, "a+")  # noqa: SIM115 - closed below
    except OSError as error:
        raise SweepRefused(f"output folder {path}: cannot be made: {error.strerror}") from None
    with lock:
        _acquire(lock.fileno(), path)
        lock.truncate(0)
        lock.write(str(os.getpid()))
        lock.flush()
        extent = plan.extent()
        origin = Origin.here(extent.digest, plan.size, plan.size - plan.run_count)
        if is_begun(path):
            yield SweepFolder(path, _resumed(path, plan, origin))
        else:
            _write(path / _VERSIONS, json.dumps(asdict(origin), indent=2) + "\n")
            _write(path / _STUDY, plan.study.dump())
            yield SweepFolder(path, origin)


def _acquire(lock: int, path: Path) -> None:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        holder = (path / _LOCK).read_text(encoding="utf-8") or "unknown"
        raise SweepRefused(
            f"output folder {path}: another sweep is at work in it (process {holder})"
        ) from None


def _resumed(path: Path, plan: SweepPlan, origin: Origin) -> Origin:
    """Return the origin of a folder in which this sweep was begun before.

    Raises:
        SweepRefused: it belongs to another sweep; the message says what differs.
    """
    if (path / _STUDY).read_text(encoding="utf-8") != plan.study.dump():
        raise SweepRefused(
            f"output folder {path}: holds another study ({_STUDY} differs from {plan.name}), "
            "give another folder"
        )
    begun = json.loads((path / _VERSIONS).read_text(encoding="utf-8"))
    if difference := _difference(begun, origin):
        raise SweepRefused(
            f"output folder {path}: was begun with another {difference}; give another folder"
        )
    return Origin(**begun)


def _difference(begun: Mapping[str, Any], now: Origin) -> str:
    """Return the first difference of two origins that can change rows, as text."""
    # The commit may differ: the digest says whether the code does.
    before, after = ({**item, "commit": ""} for item in (begun["versions"], now.versions))
    pairs = [("plan", begun["plan"], now.plan), ("code", begun["code"], now.code)]
    pairs += [(name, before.get(name), after.get(name)) for name in sorted({*before, *after})]
    return next((f"{name} ({old}, now {new})" for name, old, new in pairs if old != new), "")


def _write(file: Path, text: str) -> None:
    try:
        with atomic_write(file) as stream:
            stream.write(text.encode())
    except OSError as error:
        raise SweepStopped(f"{file}: cannot be written: {error.strerror}") from None
