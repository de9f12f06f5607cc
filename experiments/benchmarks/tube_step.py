"""Cost of a control step of the tube MPC relative to the plain MPC, and of a tube.

    python -m experiments.benchmarks.tube_step

Replays the same estimates of half a lap to `ttempc-nominal`, `ttempc`, `ttempc` tightened by the
tube, and `ttempc-tube`, in turns, so that the ratios of their medians do not depend on the machine.
Then measures the tube of a figure eight.
"""

from __future__ import annotations

import time
from collections.abc import Mapping

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
    options: dict[str, Mapping[str, object]] = {
        "ttempc-nominal": {},
        "ttempc": {},
        "ttempc, tightening = tube": {"tightening": "tube"},
        "ttempc-tube": {},
    }
    steps: dict[str, list[float]] = {label: [] for label in options}
    for _ in range(REPEATS):
        for label, times in steps.items():
            name = label.split(",")[0]
            controller = make_controller(name, vehicle, reference, PERIOD_S, design, options[label])
            times.extend(timed(controller, estimates, pause_s=0.0, prepared=False)[0])
    medians = {label: 1e6 * float(np.median(times)) for label, times in steps.items()}
    for label, median in medians.items():
        ratio = median / medians["ttempc-nominal"]
        print(f"{label:<28}{median:8.1f} us (median), ratio {ratio:.2f}")
    begin = time.perf_counter()
    ticks = int(reference.duration_s / PERIOD_S)
    along = ReferenceTube.along(design, reference, ticks)
    print(
        f"{'tube':<28}{time.perf_counter() - begin:8.2f} s for {ticks} ticks, "
        f"alpha {along.tube.certificate.alpha:.3f}"
    )


if __name__ == "__main__":
    main()
