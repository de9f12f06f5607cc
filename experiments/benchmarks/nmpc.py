"""Cost of nonlinear MPC relative to the linear one, both compiled and with the same QP solver.

    python -m experiments.benchmarks.nmpc

Ticks, horizon, weights and bounds are equal. The estimates are those of the linear MPC from a
straight into a curve. Every controller gets all of them, in turn tick by tick, and processor time
counts, so that other processes slow all alike; each step counts with its fastest of several
replays. Medians are over the ticks at which the QP of the linear MPC has no active bound and needs
no solver ("free"), and over the others ("active"). "off" is the largest difference of a command to
that of the converged NMPC.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ttempc.guidance.controllers import make_controller
from ttempc.mpc.lmpc import SOLVERS
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
REPEATS = 7


@dataclass(frozen=True, slots=True)
class Replay:
    """A controller's steps on all estimates."""

    times_s: FloatArray  # (N,)
    commands: FloatArray  # (N, 3)
    iterations: FloatArray  # (N,) of its solver, 0 where there is none


def replayed(
    options: Mapping[str, tuple[str, dict[str, object]]],
    vehicle: Vehicle,
    reference: Reference,
    estimates: Sequence[Estimate],
) -> dict[str, Replay]:
    """Return the steps of every controller, given by label as name and options."""
    controllers = {
        label: make_controller(name, vehicle, reference, PERIOD_S, options=values)
        for label, (name, values) in options.items()
    }
    count = len(estimates)
    replays = {
        label: Replay(np.empty(count), np.empty((count, 3)), np.zeros(count))
        for label in controllers
    }
    for k, estimate in enumerate(estimates):
        for label, controller in controllers.items():
            # Without preparation, the controller after the slowest one has the coldest caches.
            controller.prepare(k)
            begin = time.thread_time()
            step = controller.step(estimate, k)
            replays[label].times_s[k] = time.thread_time() - begin
            replays[label].commands[k] = step.command.as_array()
            if step.diagnostics.solver:
                replays[label].iterations[k] = step.diagnostics.solver.iterations
    return replays


def main() -> None:
    """Print medians and tail of every step, and the ratios to the linear MPC's step."""
    vehicle = Vehicle()
    reference = Reference(figure_eight(), vehicle, ConstantSpeed(1.0))
    estimates = estimates_along(LINEAR, vehicle, reference)[:TICKS]
    options: dict[str, tuple[str, dict[str, object]]] = {
        f"{name}, {solver}": (name, {"solver": solver}) for solver in SOLVERS for name in NAMES
    }
    options |= {name: (name, {}) for name in WITHOUT_QP}
    runs = [replayed(options, vehicle, reference, estimates) for _ in range(REPEATS)]
    first = runs[0]
    active = first[f"{LINEAR}, {SOLVERS[0]}"].iterations[WARM_UP:] > 0
    converged = first[f"nmpc, {SOLVERS[-1]}"].commands
    times_us = {
        label: 1e6 * np.min([run[label].times_s for run in runs], axis=0)[WARM_UP:]
        for label in options
    }
    medians = {
        label: [float(np.median(values[chosen])) for chosen in (~active, active)]
        for label, values in times_us.items()
    }
    print(f"{active.sum()} of {len(active)} ticks active")
    heads = "free us", "active us", "p99 us", "free / linear", "active / linear", "off"
    print(f"{'':26s}" + "".join(f"{head:>16s}" for head in heads))
    for label, (_, values) in options.items():
        linear = medians[f"{LINEAR}, {values.get('solver', SOLVERS[0])}"]
        ratios = [own / other for own, other in zip(medians[label], linear, strict=True)]
        off = float(np.abs(first[label].commands - converged).max())
        columns = [*medians[label], float(np.quantile(times_us[label], 0.99))]
        print(
            f"{label:26s}"
            + "".join(f"{value:16.0f}" for value in columns)
            + "".join(f"{ratio:16.2f}" for ratio in ratios)
            + f"{off:16.1e}"
        )


if __name__ == "__main__":
    main()
