"""Where a run comes from: versions, commit and identity, as words for log, summary and report."""

from __future__ import annotations

import hashlib
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path
from typing import Final

_PACKAGES: Final = ("ttempc", "mujoco", "piqp", "numpy", "scipy", "numba")
_CHECKOUT: Final = Path(__file__).resolve().parent.parent


def versions() -> dict[str, str]:
    """Return the version of everything whose change can change a run.

    "commit" is among them where the code runs from a checkout, with "-dirty" where that differs
    from its last commit.
    """
    found = {name: version(name) for name in _PACKAGES}
    found["python"] = platform.python_version()
    commit = _commit()
    return {**found, "commit": commit} if commit else found


def run_id(scenario_toml: str, code: dict[str, str]) -> str:
    """Return the identity of a run: a hash of its resolved scenario and the code's `versions`."""
    text = scenario_toml + "".join(f"\n{name} {code[name]}" for name in sorted(code))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def _commit() -> str:
    """Return the commit of the checkout, empty where there is none or no git to ask."""
    if not (_CHECKOUT / ".git").exists():  # installed: a repository above is someone else's
        return ""
    command = ["git", "-C", str(_CHECKOUT), "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10)
    except (OSError, subprocess.SubprocessError):
        return ""
    return answer.stdout.strip()
