"""Cost of nonlinear MPC relative to the linear one, both compiled and with the same QP solver.

    python -m experiments.benchmarks.nmpc

Ticks, horizon, weights and bounds are equal. The estimates are those of the linear MPC from a
straight into a curve. Every controller gets all of them, in turn tick by tick, and processor time
counts, so that other processes slow all alike; each step counts with its fastest of several
replays. "off" is the largest difference of a command to that of the converged NMPC.
"""

from __future__ import annotations

import time
from typing import Final

import numpy as np

from ttempc.guidance.controllers import make_controller
from ttempc.mpc.qp import SOLVERS
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Estimate, FloatArray
from ttempc.vehicle import Vehicle

from .control_step import PERIOD_S, estimates_along

LINEAR: Final = "ttempc-nominal"
NAMES: Final = (LINEAR, "ttempc", "nmpc-rti", "nmpc", "nmpc-decentralised", "nmpc-distributed")
WITHOUT_QP: Final = ("pid", "lqr")
TICKS = 150  # 30 s
WARM_UP = 5
REPEATS = 5


def replayed(
    names: dict[str, tuple[str, dict[str, object]]],
    vehicle: Vehicle,
    reference: Reference,
    estimates: list[Estimate],
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Return times of steps (N,) [s] and their commands (N, 3) of every controller."""
    made = {
        label: make_controller(name, vehicle, reference, PERIOD_S, options=options)
        for label, (name, options) in names.items()
    }
    times = {label: np.empty(len(estimates)) for label in made}
    commands = {label: np.empty((len(estimates), 3)) for label in made}
    for k, estimate in enumerate(estimates):
        for label, controller in made.items():
            # Without preparation, the controller after the slowest one has the coldest caches.
            controller.prepare(k)
            begin = time.thread_time()
            step = controller.step(estimate, k)
            times[label][k] = time.thread_time() - begin
            commands[label][k] = step.command.as_array()
    return {label: (times[label], commands[label]) for label in made}


def main() -> None:
    """Print median and tail of every step, and the ratios to the linear MPC's step."""
    vehicle = Vehicle()
    reference = Reference(figure_eight(), vehicle, ConstantSpeed(1.0))
    estimates = estimates_along(LINEAR, vehicle, reference)[:TICKS]
    names: dict[str, tuple[str, dict[str, object]]] = {
        f"{name}, {solver}": (name, {"solver": solver}) for solver in SOLVERS for name in NAMES
    }
    names |= {name: (name, {}) for name in WITHOUT_QP}
    runs = [replayed(names, vehicle, reference, estimates) for _ in range(REPEATS)]
    fastest = {
        label: 1e6 * np.min([run[label][0] for run in runs], axis=0)[WARM_UP:] for label in names
    }
    medians = {label: float(np.median(times)) for label, times in fastest.items()}
    converged = runs[0][f"nmpc, {SOLVERS[-1]}"][1]
    heads = "median us", "p99 us", *(f"/ linear, {solver}" for solver in SOLVERS), "off"
    print(f"{'':26s}" + "".join(f"{head:>16s}" for head in heads))
    for label, times in fastest.items():
        ratios = [medians[label] / medians[f"{LINEAR}, {solver}"] for solver in SOLVERS]
        off = float(np.abs(runs[0][label][1] - converged).max())
        print(
            f"{label:26s}{medians[label]:16.0f}{np.quantile(times, 0.99):16.0f}"
            + "".join(f"{ratio:16.2f}" for ratio in ratios)
            + f"{off:16.1e}"
        )


if __name__ == "__main__":
    main()
