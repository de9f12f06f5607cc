"""Provenance of a run: versions, commit and identity for log, summary and report."""

import contextlib
import functools
import hashlib
import os
import platform
import subprocess
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from typing import Final

_PACKAGES: Final = ("ttempc", "mujoco", "piqp", "numpy", "scipy", "numba")
_OPTIONAL: Final = ("daqp",)  # a solver of controllers
_SOURCE: Final = {  # files that affect a run; scenarios are part of its identity
    "experiments": (".py",),
    "mjcf": (".py", ".toml", ".xml"),
    "testbed": (".py",),
    "ttempc": (".py",),
}
_CODE: Final = ("--", ".", ":(exclude)docs")  # what git compares
_ROOT: Final = Path(__file__).resolve().parents[2]  # folder of testbed, experiments and mjcf


def versions() -> dict[str, str]:
    """Return the versions of all software that can change a run.

    Optional packages are included where they are installed, "commit" where the code runs from a
    checkout, with "-dirty" where code of it differs from its last commit.
    """
    versions = {name: _version(name) for name in _PACKAGES}
    for name in _OPTIONAL:
        with contextlib.suppress(PackageNotFoundError):
            versions[name] = _version(name)
    versions["python"] = platform.python_version()
    commit = _commit(_ROOT)
    return {**versions, "commit": commit} if commit else versions


@functools.cache
def machine() -> Mapping[str, str]:
    """Return processor, cores and system of this machine; its name is nobody's business."""
    model = platform.processor() or platform.machine()
    with contextlib.suppress(OSError):  # the file exists on Linux only
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
        model = next(iter(names), model)
    system = f"{platform.system()} {platform.release()}"
    return {"processor": model, "cores": str(os.cpu_count()), "system": system}


def run_id(scenario_toml: str, code: dict[str, str]) -> str:
    """Return the identity of a run: a hash of its resolved scenario and the code's `versions`."""
    text = scenario_toml + "".join(f"\n{name} {code[name]}" for name in sorted(code))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


@functools.cache
def code_digest() -> str:
    """Return a hash of the source of the four packages, the vehicles included.

    Two processes, also on two machines, run the same code where their digests are equal. This holds
    for a checkout with changes and for an installed package.
    """
    digest = hashlib.sha256()
    for package, suffixes in _SOURCE.items():
        folder = Path(str(files(package))) if package == "ttempc" else _ROOT / package
        for file in sorted(folder.rglob("*")):
            if file.suffix in suffixes:
                name = f"{package}/{file.relative_to(folder).as_posix()}"
                digest.update(name.encode() + b"\0")
                digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


@functools.cache
def _version(package: str) -> str:
    return version(package)  # reads files: a millisecond


@functools.cache
def _commit(checkout: Path) -> str:
    """Return the commit of the checkout; empty without a repository or without git."""
    if not (checkout / ".git").exists():  # installed: a repository above is not this project's
        return ""
    try:
        commit = _git(checkout, "rev-parse", "--short=12", "HEAD")
        # A study writes its table into docs/ while the next one runs: pages are no code
        changed = _git(checkout, "status", "--porcelain", "--untracked-files=no", *_CODE)
    except (OSError, subprocess.SubprocessError):
        return ""
    return f"{commit}-dirty" if changed else commit


def _git(checkout: Path, *arguments: str) -> str:
    """Return what git prints of a checkout."""
    command = ["git", "-C", str(checkout), *arguments]
    answer = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10)
    return answer.stdout.strip()
