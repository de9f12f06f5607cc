"""Where the project's data files are, in a checkout and in an installed wheel alike."""

from __future__ import annotations

from dataclasses import dataclass
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


@dataclass(frozen=True, slots=True)
class Shelf:
    """Files of one kind that ship with the project, each by its name; others go by their path."""

    what: str  # one of them is, such as "vehicle"
    package: str
    folder: str
    suffix: str  # of the files, with the dot
    error: type[Exception]  # raised with one line
    made_by: str = ""  # the command that writes such files

    def names(self) -> list[str]:
        """Return the names of those that ship with the project."""
        folder = resource(self.package, self.folder)
        return sorted(path.stem for path in folder.glob(f"*{self.suffix}"))

    def find(self, name: str) -> Path:
        """Return the file of a shipped name, or the path of a file as it is.

        Raises:
            Exception: `error`, where there is none.
        """
        if name in self.names():
            return resource(self.package, f"{self.folder}/{name}{self.suffix}")
        file = Path(name)
        if file.suffix == self.suffix and file.is_file():
            return file
        missing = "file" if file.suffix == self.suffix else self.what
        written = f" that {self.made_by} has written" if self.made_by else ""
        raise self.error(
            f"{self.what} {name!r}: no such {missing}; shipped are {', '.join(self.names())}, "
            f"or give the path of a {self.suffix} file{written}"
        )
