"""Compile the kernels that the wheels carry; `make wheels` runs it before it builds them.

A wheel has the machine code of its own package for the Python and the level of processor that this
script runs with: anywhere else the kernels are compiled when they are first called. What short
drives of the shipped scenarios and controllers do not call is not carried.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
MADE = ROOT / "build" / "kernels"
PACKAGES = {"ttempc": ROOT / "ttempc", "proving_ground": ROOT / "packaging" / "proving_ground"}
FOLDER = "kernels"  # in a package, see `ttempc.jit.cache.SHIPPED`

STRAIGHT = "path={kind='straight',length_m=12}"
LOOP = "path={kind='headland',passes=2,length_m=10}"  # in curves the lengths are learnt

DRIVES = (
    ("grass", "ttempc", STRAIGHT),
    ("grass", "ttempc-nominal", STRAIGHT),
    ("grass", "ttempc-tube", STRAIGHT),
    ("grass", "pid", STRAIGHT),
    ("grass", "lqr", STRAIGHT),
    ("grass", "nmpc-rti", STRAIGHT),
    ("wet-slope", "ttempc", LOOP),
    ("cultivate", "ttempc", STRAIGHT),  # a tool
    ("soft-passes", "ttempc", STRAIGHT),  # ruts
    ("plain-trailer", "ttempc", STRAIGHT),
)


def drive(scenario: str, controller: str, path: str) -> None:
    """Drive a short path in a process whose kernels go to `MADE`."""
    command = [sys.executable, "-m", "proving_ground.experiments.commands.cli", "run", scenario]
    for setting in (path, f"controller.name={controller}"):
        command += ["--set", setting]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(MADE)}
    with tempfile.TemporaryDirectory() as folder:
        command += ["--out", str(Path(folder) / "run"), "--quiet"]
        subprocess.run(command, env=environment, check=True)


def carry() -> None:
    """Copy the kernels of each package into it, in place of those of an earlier build."""
    for package, source in PACKAGES.items():
        folder = source / FOLDER
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        kernels = sorted(MADE.glob(f"{package}.*.code"))
        for kernel in kernels:
            shutil.copyfile(kernel, folder / kernel.name)
        size_mb = sum(kernel.stat().st_size for kernel in kernels) / 1e6
        print(f"{package}: {len(kernels)} kernels, {size_mb:.1f} MB")


def main() -> None:
    """Compile from nothing, so that no kernel of older code is carried."""
    shutil.rmtree(MADE, ignore_errors=True)
    MADE.mkdir(mode=0o700, parents=True)
    for each in DRIVES:
        drive(*each)
    carry()


if __name__ == "__main__":
    main()
