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

DRIVES = (
    ("grass", "ttempc"),
    ("grass", "ttempc-nominal"),
    ("grass", "ttempc-tube"),
    ("grass", "pid"),
    ("grass", "lqr"),
    ("grass", "nmpc-rti"),
    ("wet-slope", "ttempc"),
    ("cultivate", "ttempc"),  # a tool
    ("soft-passes", "ttempc"),  # ruts
    ("plain-trailer", "ttempc"),
)
SHORT = ("path={kind='straight',length_m=12}",)


def drive(scenario: str, controller: str) -> None:
    """Drive a short straight in a process whose kernels go to `MADE`."""
    settings = [*SHORT, f"controller.name={controller}"]
    command = [sys.executable, "-m", "proving_ground.experiments.commands.cli", "run", scenario]
    for setting in settings:
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
        kernels = sorted(MADE.glob(f"{package}.*.kernel"))
        for kernel in kernels:
            shutil.copyfile(kernel, folder / kernel.name)
        size_mb = sum(kernel.stat().st_size for kernel in kernels) / 1e6
        print(f"{package}: {len(kernels)} kernels, {size_mb:.1f} MB")


def main() -> None:
    """Compile from nothing, so that no kernel of older code is carried."""
    shutil.rmtree(MADE, ignore_errors=True)
    MADE.mkdir(mode=0o700, parents=True)
    for scenario, controller in DRIVES:
        drive(scenario, controller)
    carry()


if __name__ == "__main__":
    main()
