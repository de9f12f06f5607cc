"""Cost of nonlinear MPC relative to the linear one at equal ticks, horizon, weights and bounds.

    python -m experiments.benchmarks.nmpc

The estimates are those of the linear MPC from a straight into a curve. Every controller gets all of
them, in turn tick by tick, and processor time counts, so that other processes slow all alike.
`nmpc` is the project's Gauss-Newton method on CasADi's derivatives with
PIQP; ipopt, fatrop and sqpmethod (with qrqp) are CasADi's own solvers on the same problem,
all in CasADi's virtual machine, without a C compiler. The table also shows
the largest difference of the first move to that of `nmpc`.
"""

from __future__ import annotations

import time
from functools import partial

import numpy as np

from ttempc.baselines.nmpc import nmpc_controller
from ttempc.guidance.controllers import make_controller
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import ControlStep, Preparing
from ttempc.vehicle import Vehicle

from .control_step import PERIOD_S, estimates_along
from .programme import SOLVERS, Programme

LINEAR = "ttempc-nominal"
NAMES = (
    LINEAR,
    "ttempc",
    "pid",
    "lqr",
    "nmpc",
    "nmpc-rti",
    "nmpc-decentralised",
    "nmpc-distributed",
)
TICKS = 150  # 30 s
WARM_UP = 5


def main() -> None:
    """Print median and tail of every step, and ratios to the linear MPC's step and bare QP."""
    vehicle = Vehicle()
    reference = Reference(figure_eight(), vehicle, ConstantSpeed(1.0))
    estimates = estimates_along(LINEAR, vehicle, reference)[:TICKS]
    controllers = {name: make_controller(name, vehicle, reference, PERIOD_S) for name in NAMES}
    for name in SOLVERS:
        solver = partial(Programme, solver=name)
        controllers[name] = nmpc_controller(vehicle, reference, PERIOD_S, solver=solver)
    costs_us: dict[str, list[float]] = {name: [] for name in controllers}
    steps: dict[str, list[ControlStep]] = {name: [] for name in controllers}
    for k, estimate in enumerate(estimates):
        for name, controller in controllers.items():
            # Without preparation, the controller after the slowest one has the coldest caches.
            if isinstance(controller, Preparing):
                controller.prepare(k)
            begin = time.thread_time()
            step = controller.step(estimate, k)
            costs_us[name].append(1e6 * (time.thread_time() - begin))
            steps[name].append(step)

    def medians(name: str) -> float:
        return float(np.median(costs_us[name][WARM_UP:]))

    reports = [step.diagnostics.solver for step in steps[LINEAR][WARM_UP:]]
    solves = [report.solve_time_s for report in reports if report and report.iterations]
    bare_us = 1e6 * float(np.median(solves))
    print(f"bare QP of {LINEAR}: {bare_us:.0f} us")
    heads = ("median us", "p99 us", "/ linear", "/ bare QP", "iterations", "off nmpc", "fallbacks")
    print(f"{'':20s}" + "".join(f"{head:>11s}" for head in heads))
    for name, own in steps.items():
        median, tail = medians(name), np.quantile(costs_us[name][WARM_UP:], 0.99)
        counts = [s.diagnostics.solver.iterations for s in own if s.diagnostics.solver]
        off = [
            np.abs(one.command.as_array() - other.command.as_array()).max()
            for one, other in zip(own, steps["nmpc"], strict=True)
        ]
        print(
            f"{name:20s}{median:11.0f}{tail:11.0f}{median / medians(LINEAR):11.2f}"
            f"{median / bare_us:11.2f}{np.mean(counts) if counts else 0:11.1f}"
            f"{max(off):11.1e}{sum(bool(s.diagnostics.fallback) for s in own):11d}"
        )


if __name__ == "__main__":
    main()
