"""Cost of a control step of the tube MPC relative to the plain MPC, and of a tube.

    python -m experiments.benchmarks.tube_step

Replays the same estimates of half a lap to `ttempc-nominal` and `ttempc-tube`, in turns, so that
the ratio of their medians does not depend on the machine. Then measures the tube of a figure eight.
"""

from __future__ import annotations

import time

import numpy as np

from ttempc.guidance.controllers import make_controller
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.tube.reference_tube import ReferenceTube
from ttempc.vehicle import Vehicle

from ..scenario.tube_file import read_tube
from .control_step import PERIOD_S, estimates_along, timed

REPEATS = 5


def main() -> None:
    """Print medians, their ratio, and the time of a tube."""
    vehicle = Vehicle()
    reference = Reference(figure_eight(), vehicle, ConstantSpeed(1.0))
    estimates = estimates_along("ttempc-nominal", vehicle, reference)
    design = read_tube("grass").design()
    steps: dict[str, list[float]] = {"ttempc-nominal": [], "ttempc-tube": []}
    for _ in range(REPEATS):
        for name, times in steps.items():
            controller = make_controller(name, vehicle, reference, PERIOD_S, design)
            times.extend(timed(controller, estimates, pause_s=0.0, prepared=False)[0])
    medians = {name: 1e6 * float(np.median(times)) for name, times in steps.items()}
    for name, median in medians.items():
        print(f"{name:<16}{median:8.1f} us (median)")
    print(f"ratio           {medians['ttempc-tube'] / medians['ttempc-nominal']:8.2f}")
    begin = time.perf_counter()
    ticks = int(reference.duration_s / PERIOD_S)
    along = ReferenceTube.along(design, reference, ticks)
    print(
        f"tube            {time.perf_counter() - begin:8.2f} s for {ticks} ticks, "
        f"alpha {along.tube.certificate.alpha:.3f}"
    )


if __name__ == "__main__":
    main()
