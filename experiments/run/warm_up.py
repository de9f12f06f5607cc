"""Compilation in two processes, which halves the first run on a machine.

Where this process begins to compile, a second one compiles what comes later in a run and does not
depend on what this one compiles meanwhile. Both keep their kernels in the same folder.
"""

import os
import subprocess
import sys
from argparse import Namespace
from typing import Final

from ..numerics import settle_numerics

_ARGUMENTS: Final = ("-m", "proving_ground.experiments.run.warm_up")


def compile_in_two_processes(arguments: Namespace) -> None:
    """Start the second process when this one begins to compile, if there is a core for it.

    A command that was called in another program's process, as a test does, starts none.
    """
    from ttempc.jit import COMPILATION

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
    if arguments.own_process and cores > 1:
        COMPILATION.on_first = _start


def _start() -> None:
    null = subprocess.DEVNULL
    subprocess.Popen([sys.executable, *_ARGUMENTS], stdin=null, stdout=null, stderr=null)


def _compile() -> None:
    """Compile detectors, supervisor and default controller.

    The command itself begins with the physics and the filter: the two processes compile different
    kernels, in about the same time.
    """
    from ttempc import Guidance, Vehicle, figure_eight

    guidance = Guidance(Vehicle(), figure_eight())
    for part in (guidance._monitors, guidance._supervisor, guidance._pipeline.controller):
        part.warm_up()


if __name__ == "__main__":
    settle_numerics()
    _compile()
