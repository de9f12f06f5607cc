"""Print the lowest or the newest allowed release of each library of the core, for pip.

python packaging/libraries.py lowest | xargs python -m pip install
"""

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
CORE = ("numpy", "scipy", "numba", "mujoco", "piqp")
"""Libraries whose numbers or whose inside the results depend on."""


def requirements() -> dict[str, str]:
    """Return the bounds of every library of the core, as `numpy>=2.4,<3`."""
    found = {}
    for file in ("ttempc/pyproject.toml", "pyproject.toml"):
        for line in tomllib.loads((ROOT / file).read_text())["project"]["dependencies"]:
            name = re.match(r"[\w-]+", line)
            if name and name[0] in CORE:
                found[name[0]] = line
    return found


def lowest(requirement: str) -> str:
    """Return the lowest minor release that a requirement allows, as `numpy==2.4.*`."""
    name, version = re.match(r"([\w-]+)>=([\d.]+)", requirement).groups()  # type: ignore[union-attr]
    minor = ".".join(version.split(".")[:2])
    return f"{name}=={minor}.*"


def main(arguments: list[str]) -> int:
    """Print one requirement a line; return 2 on another argument than `lowest` or `newest`."""
    if arguments not in (["lowest"], ["newest"]):
        print(f"libraries.py: got {arguments}, must be `lowest` or `newest`", file=sys.stderr)
        return 2
    for requirement in requirements().values():
        print(lowest(requirement) if arguments == ["lowest"] else requirement)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
