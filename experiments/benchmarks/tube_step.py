"""Cost of a control step of the tube MPC relative to the plain MPC, and of a tube.

Replays the same estimates of half a lap to `ttempc-nominal`, `ttempc` without and with its tube,
and `ttempc-tube`, in turns, so that the ratios of their medians do not depend on the machine.
Then measures the tube of a figure eight.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Final

import numpy as np

from ttempc.guidance.controllers import make_controller
from ttempc.tube.reference_tube import ReferenceTube

from ..scenario.tube_file import read_tube
from .control_step import PERIOD_S, default_reference, estimates_along, timed
from .figure import BenchmarkFigure

REPEATS = 5

_PLAIN: Final = "ttempc-nominal"
_OTHERS: Final[dict[str, tuple[str, Mapping[str, object]]]] = {
    "`ttempc`, tightening = none": ("ttempc", {"tightening": "none"}),
    "`ttempc`": ("ttempc", {}),
    "`ttempc-tube`": ("ttempc-tube", {}),
}


def figures() -> list[BenchmarkFigure]:
    """Return the median step of the plain MPC, the ratios of the others, the time of a tube."""
    vehicle, reference = default_reference()
    estimates = estimates_along(_PLAIN, vehicle, reference)
    design = read_tube("grass").design()
    controllers = {_PLAIN: (_PLAIN, {}), **_OTHERS}
    steps: dict[str, list[float]] = {label: [] for label in controllers}
    for _ in range(REPEATS):
        for label, (name, options) in controllers.items():
            controller = make_controller(name, vehicle, reference, PERIOD_S, design, options)
            steps[label].extend(timed(controller, estimates)[0])
    medians = {label: 1e6 * float(np.median(times)) for label, times in steps.items()}
    begin = time.perf_counter()
    ticks = int(reference.duration_s / PERIOD_S)
    ReferenceTube.along(design, reference, ticks)
    tube_s = time.perf_counter() - begin
    return [
        BenchmarkFigure(f"`{_PLAIN}` step", medians[_PLAIN], "us"),
        *(
            BenchmarkFigure(f"{name} / that", medians[name] / medians[_PLAIN], "")
            for name in _OTHERS
        ),
        BenchmarkFigure(f"tube of {ticks} ticks", tube_s, "s"),
    ]
