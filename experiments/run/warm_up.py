"""Compilation in two processes, which halves the first run on a machine.

Where this process begins to compile, a second one compiles what comes later in a run and does not
depend on what this one compiles meanwhile. Both keep their kernels in the same folder.
"""

import os
import subprocess
import sys
from argparse import Namespace
from typing import Final

from ..threads import use_one_thread

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
    """Compile correction, controller, detectors and physics steps of the default scenario."""
    import numpy as np

    from ttempc.estimation.filter.correct import CORRECTION_SIZE, Reading, correct
    from ttempc.estimation.filter.records import SNAPSHOT_SIZE, filter_parameters
    from ttempc.estimation.noise import ProcessNoise, SensorNoise
    from ttempc.types import Command
    from ttempc.vehicle import Vehicle

    parameters = filter_parameters(Vehicle(), SensorNoise(), ProcessNoise())
    reading = Reading(sensor=0, first=0.0, second=0.0, variance=1.0)
    snapshot = np.zeros(SNAPSHOT_SIZE)
    correct(parameters, snapshot, reading, False, False, np.empty(CORRECTION_SIZE))

    from ..scenario.scenario import load
    from .assembly import assemble

    _, scenario = load("grass", ["path={kind='straight', length_m=6}"])
    assembly = assemble(scenario, seed=1)
    assembly.guidance.warm_up()
    assembly.plant.restore(assembly.start)
    assembly.plant.advance(Command(0.0, 0.0, 0.0), 1)


if __name__ == "__main__":
    use_one_thread()
    _compile()
