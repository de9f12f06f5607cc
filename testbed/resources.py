"""Where the project's data files are, in a checkout and in an installed wheel alike."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path


def resource(package: str, name: str = "") -> Path:
    """Return the path of the file or folder `name` that ships inside `package`.

    Raises:
        FileNotFoundError: the package ships no such file.
    """
    path = Path(str(files(package))) / name
    if not path.exists():
        raise FileNotFoundError(f"package {package!r} ships no {name!r}")
    return path
