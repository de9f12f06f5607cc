"""Invariance of the shipped tube on its own model."""

from collections.abc import Iterator
from typing import Final

import numpy as np

from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.tube.reference_tube import ReferenceTube
from ttempc.tube.sets import directions_in, linear_map, minkowski_sum

from ...scenario.tube_file import read_tube
from ..study import Study
from ..tables import fenced


def invariance(worst: int = 1_000, stride: int = 20) -> Iterator[str]:
    """Yield how far disturbances push the deviation in the tube of `grass`; no share may exceed 1.

    Deviations start at zero, at ticks all along the figure eight, and are disturbed over the memory
    of the tube by the worst case of a direction, random or along a state, an output or an input.
    Beside them stands the ratio of both sides of the invariance condition in dense directions.

    Args:
        worst: number of worst cases.
        stride: ticks between checks of the condition.
    """
    generator = np.random.default_rng(1)
    design = read_tube("grass").design()
    reference = Reference(figure_eight(laps=1), design.vehicle, ConstantSpeed(1.0))
    ticks = int(reference.duration_s / design.period_s)
    tube = ReferenceTube.along(design, reference, ticks).tube
    certificate = tube.certificate
    window, steps = certificate.window, certificate.terms * certificate.window
    yield f"alpha {certificate.alpha:.4f}, {certificate.terms} windows of {window}"

    largest = 0.0
    for k in range(window, ticks, stride):
        directions = directions_in(7, 1_000, generator) / tube.states[k]
        before = linear_map(tube.transition(k, window), tube.at(k - window))
        after = minkowski_sum([before, tube.last_window(k)]).support(directions)
        largest = max(largest, float((after / tube.at(k).support(directions)).max()))
    yield f"Phi S + V over S, largest in 1000 directions every {stride} ticks: {largest:.6f}"

    shares = []
    for count in range(worst):
        k = int(generator.integers(steps, ticks))
        rows = np.concatenate([np.eye(7), tube.system.c[k], tube.system.gains[k]])
        widths = np.concatenate([tube.states[k], tube.outputs[k], tube.inputs[k]])
        choice = count % (len(rows) + 6)
        if choice < len(rows):
            row, width = rows[choice], widths[choice]
        else:
            row = generator.standard_normal(7) / tube.states[k]
            width = float(tube.at(k).support(row[None])[0])
        deviation, runs = np.zeros(7), tube.worst_case(k, row)
        for step, w in enumerate(runs):
            deviation = tube.system.closed[max(0, k - len(runs) + step)] @ deviation + w
        shares.append(float(deviation @ row) / width)
    yield f"{worst} worst cases: share {min(shares):.4f} to {max(shares):.4f}"


STUDIES: Final = (
    Study(
        name="invariance",
        make=lambda runner: fenced(invariance()),
        checks=(("grass", "ttempc-tube"),),
    ),
)
