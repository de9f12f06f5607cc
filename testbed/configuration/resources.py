"""Data files of the project, in a checkout and in an installed wheel."""

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from ttempc.suggestion import did_you_mean


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
class ShippedFiles:
    """Files of one kind in one folder of a package; a user's own files are given by their path."""

    kind: str  # noun for messages, such as "vehicle"
    package: str
    folder: str
    suffix: str  # of the files, with the dot
    error: type[Exception]  # raised with one line

    def names(self) -> list[str]:
        """Return the names of the shipped files."""
        folder = resource(self.package, self.folder)
        return sorted(path.stem for path in folder.glob(f"*{self.suffix}"))

    def find(self, name: str) -> Path:
        """Return the path of a shipped file, or the given path of a user's own file.

        Raises:
            Exception: `error`, if there is no such file.
        """
        if name in self.names():
            return resource(self.package, f"{self.folder}/{name}{self.suffix}")
        file = Path(name)
        if file.suffix == self.suffix and file.is_file():
            return file
        missing = "file" if file.suffix == self.suffix else self.kind
        raise self.error(
            f"{self.kind} {name!r}: no such {missing}; shipped are {', '.join(self.names())}, "
            f"or give the path of a {self.suffix} file{did_you_mean(name, self.names())}"
        )
