"""Tube for tests: disturbances as large as on grass, gains from an earlier search."""

from __future__ import annotations

import numpy as np

from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.tube.reference_tube import AncillaryWeights, ReferenceTube, TubeDesign
from ttempc.tube.sets import DisturbanceSet
from ttempc.vehicle import Vehicle

PERIOD_S = 0.2
TICKS = 690  # one lap
VEHICLE = Vehicle()
REFERENCE = Reference(figure_eight(laps=1), VEHICLE, ConstantSpeed(1.0))
WEIGHTS = AncillaryWeights(
    outputs=(0.12, 1.0, 0.07, 2.3), states=(0.001, 0.4, 0.01, 0.05, 0.13), inputs=(0.34, 1.5, 0.96)
)
# Standard deviations of x, y [m], psi_t, psi_i, delta_t, delta_i [rad], v [m/s].
SPREAD = np.array([0.0046, 0.0054, 0.0021, 0.0020, 0.0007, 0.0007, 0.0026])
WINDOW = DisturbanceSet(4.4 * np.diag(SPREAD), window=5)
STEP = DisturbanceSet(2.0 * np.diag(SPREAD), shape="box")
ERROR = DisturbanceSet(np.diag([0.02, 0.03, 0.015, 0.015, 0.001, 0.001, 0.03]))
DESIGN = TubeDesign(VEHICLE, PERIOD_S, WINDOW, ERROR, WEIGHTS)


def along(design=DESIGN, reference=REFERENCE, ticks=TICKS) -> ReferenceTube:
    return ReferenceTube.along(design, reference, ticks)


def admissible(disturbance: DisturbanceSet, steps: int, generator: np.random.Generator):
    """Return disturbances (steps, n) with every window in the set and one on its boundary."""
    kind = generator.integers(3)
    raw = generator.standard_normal((steps, disturbance.dimension))
    if kind == 1:
        raw = np.sign(raw)
    elif kind == 2:  # a square wave along each axis
        half_period = generator.integers(1, 20, disturbance.dimension)
        raw = (-1.0) ** ((np.arange(steps)[:, None] + half_period) // half_period)
    run = raw @ disturbance.axes.T
    return run / disturbance.fill(run).max()
