"""The folder of a sweep: whose it is, what it was begun with, and who is at work in it."""

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
from .plan import Plan

_LOCK: Final = ".lock"
_STUDY: Final = "study.toml"
_VERSIONS: Final = "versions.json"


@dataclass(frozen=True, slots=True)
class Origin:
    """What the rows of a folder follow from, besides its study."""

    plan: str  # digest of all scenarios and seeds
    runs: int
    code: str  # digest of the source code
    versions: dict[str, str]
    machine: str
    cpus: int

    @classmethod
    def here(cls, plan: str, runs: int) -> Origin:
        """Return the origin of rows that this process would make."""
        machine, cpus = platform.platform(), os.cpu_count() or 1
        return cls(plan, runs, code_digest(), versions(), machine, cpus)


@dataclass(frozen=True, slots=True)
class Folder:
    """A sweep's folder that nobody else writes to while it is held."""

    path: Path
    origin: Origin  # as the sweep was begun

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
def held(path: Path, plan: Plan, digest: str) -> Iterator[Folder]:
    """Hold a new folder, or the one of the same sweep, until the block is left or the process dies.

    Args:
        path: of the folder.
        plan: of the sweep.
        digest: of the plan.

    Raises:
        SweepRefused: the folder holds something else, another study or other versions, or another
            process is at work in it; nothing is changed.
    """
    parts = {partial_path(path / name).name for name in (_VERSIONS, _STUDY)}
    ours = {_LOCK, _VERSIONS, *parts}  # of one that died at once
    try:
        if not is_begun(path) and path.exists() and {item.name for item in path.iterdir()} - ours:
            raise SweepRefused(f"output folder {path}: holds something else, give another")
        path.mkdir(parents=True, exist_ok=True)
        lock = open(path / _LOCK, "a+")  # noqa: SIM115 - closed below
    except OSError as error:
        raise SweepRefused(f"output folder {path}: cannot be made: {error.strerror}") from None
    with lock:
        _take(lock.fileno(), path)
        lock.truncate(0)
        lock.write(str(os.getpid()))
        lock.flush()
        origin = Origin.here(digest, plan.size)
        if is_begun(path):
            yield Folder(path, _resumed(path, plan, origin))
        else:
            _write(path / _VERSIONS, json.dumps(asdict(origin), indent=2) + "\n")
            _write(path / _STUDY, plan.study.dump())
            yield Folder(path, origin)


def _take(lock: int, path: Path) -> None:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        holder = (path / _LOCK).read_text(encoding="utf-8") or "unknown"
        raise SweepRefused(
            f"output folder {path}: another sweep is at work in it (process {holder})"
        ) from None


def _resumed(path: Path, plan: Plan, origin: Origin) -> Origin:
    """Return the origin of a folder that was begun before, where it is this sweep's.

    Raises:
        SweepRefused: it is not; the message says what differs.
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
    """Return what differs between two origins and would change rows, in words."""
    # The commit may differ: the digest says whether the code does.
    was, found = ({**item, "commit": ""} for item in (begun["versions"], now.versions))
    pairs = [("plan", begun["plan"], now.plan), ("code", begun["code"], now.code)]
    pairs += [(name, was.get(name), found.get(name)) for name in sorted({*was, *found})]
    return next(
        (f"{what} ({before}, now {after})" for what, before, after in pairs if before != after), ""
    )


def _write(file: Path, text: str) -> None:
    try:
        with atomic_write(file) as stream:
            stream.write(text.encode())
    except OSError as error:
        raise SweepStopped(f"{file}: cannot be written: {error.strerror}") from None
