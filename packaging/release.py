"""Check the distributions in `dist/` and drive from them in an empty environment: `make release`.

The environment has neither a compiler nor a cache of kernels. Exit code 1 with a line for each
fault, 0 with the list of the distributions.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tarfile
import tempfile
import venv
import zipfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
DIST = ROOT / "dist"
DRIVE_S = 600.0  # after which a command of the check counts as hung
KERNELS = Path(".cache") / "ttempc" / "kernels"  # of the user, below the home folder
# Of each wheel: the folders of the checkout that it carries, and where they stand in it.
FOLDERS = {
    "ttempc": {"ttempc": "ttempc"},
    "ttempc_proving_ground": {
        "packaging/proving_ground": "proving_ground",
        "mjcf": "proving_ground/mjcf",
        "testbed": "proving_ground/testbed",
        "experiments": "proving_ground/experiments",
    },
}
# Files of those folders that no user of a wheel needs.
LEFT_OUT = re.compile(r"experiments/papers/|ttempc/(pyproject\.toml|LICENSE|README\.md)$")


def tracked(folder: str) -> Iterator[str]:
    """Yield the files of a folder that git tracks, relative to the root."""
    command = ["git", "ls-files", folder]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    yield from done.stdout.splitlines()


def expected(wheel: str) -> set[str]:
    """Return the names that a wheel must have: what git tracks in its folders."""
    return {
        place + file.removeprefix(folder)
        for folder, place in FOLDERS[wheel].items()
        for file in tracked(folder)
        if not LEFT_OUT.search(file)
    }


def faults_of_wheel(path: Path) -> Iterator[str]:
    """Yield what is wrong with the content of a wheel."""
    wheel = path.name.partition("-")[0]
    with zipfile.ZipFile(path) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        about = {name.partition(".dist-info/")[2] for name in archive.namelist()}
    kernels = {name for name in names if name.endswith(".code")}
    if not kernels:
        yield f"{path.name}: carries no kernel"
    for name in sorted(expected(wheel) - names):
        yield f"{path.name}: lacks {name}"
    for name in sorted(names - kernels - expected(wheel)):
        yield f"{path.name}: has {name}, which git does not track"
    for name in ("METADATA", "licenses/LICENSE"):
        if name not in about:
            yield f"{path.name}: lacks {name}"
    if wheel == "ttempc" and "ttempc/py.typed" not in names:
        yield f"{path.name}: does not say that it is typed"


def faults_of_source(path: Path) -> Iterator[str]:
    """Yield what is wrong with the content of a source distribution."""
    with tarfile.open(path) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        if name not in names:
            yield f"{path.name}: lacks {name}"
    if any(name.endswith(".code") for name in names):
        yield f"{path.name}: has machine code"


def example_of_readme() -> str:
    """Return the controller of README with the runs below it."""
    found = re.search(r"^```python\n(.*?)^```$", (ROOT / "README.md").read_text(), re.M | re.S)
    assert found is not None
    return found.group(1)


def faults_of_drives(wheels: list[Path]) -> Iterator[str]:
    """Yield what goes wrong where only the wheels and what they require are installed."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        venv.create(place / "empty", with_pip=True)
        programs = place / "empty" / "bin"
        install = [programs / "python", "-m", "pip", "install", "--quiet", *wheels]
        subprocess.run(install, check=True)
        # No compiler is on this path, and the caches are empty.
        environment = {"PATH": str(programs), "HOME": folder, "MUJOCO_GL": "egl"}
        short = ["--set", "path={kind='straight',length_m=12}"]
        drives = {
            "ttempc demo": [programs / "ttempc", "demo", "-o", "demo"],
            "ttempc run": [programs / "ttempc", "run", "grass", *short, "-o", "run"],
            "README": [programs / "python", "-c", example_of_readme()],
        }
        compiled: set[Path] = set()
        for name, command in drives.items():
            done = subprocess.run(
                command,
                cwd=place,
                env=environment,
                capture_output=True,
                text=True,
                check=False,
                timeout=DRIVE_S,
            )
            if done.returncode:
                yield f"{name}: exit code {done.returncode}: {done.stderr.strip()[-500:]}"
            new = {*(place / KERNELS).glob("*.code")} - compiled
            compiled |= new
            for kernel in sorted(new):
                yield f"{name}: compiles {kernel.name.partition('-')[0]}, which no wheel carries"


def main() -> None:
    """Check everything and print what there is."""
    wheels = sorted(DIST.glob("*.whl"))
    sources = sorted(DIST.glob("*.tar.gz"))
    faults = [fault for wheel in wheels for fault in faults_of_wheel(wheel)]
    faults += [fault for source in sources for fault in faults_of_source(source)]
    if len(wheels) != len(FOLDERS) or len(sources) != len(FOLDERS):
        faults.append(f"dist: {len(wheels)} wheels, {len(sources)} sources; must be 2 of each")
    if not faults:
        faults += faults_of_drives(wheels)
    for fault in faults:
        print(fault, file=sys.stderr)
    for file in (*wheels, *sources):
        print(f"{file.relative_to(ROOT)}  {file.stat().st_size / 1e6:.1f} MB")
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
