"""Steering valves: a set point that runs to the command at a limited rate."""

from __future__ import annotations

import numpy as np

from ttempc.types import FloatArray
from ttempc.vehicle import Vehicle


def slew(
    set_points: FloatArray, command: FloatArray, vehicle: Vehicle, duration_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return the inputs (3,) of the articulated model over `duration_s`, and the new set points.

    The steering angles lag behind `set_points` (2,) [rad], which run to the angles of `command`
    (3,) no faster than the valves; their mean over the duration acts. The hydrostat position is
    that of the command.
    """
    reach = vehicle.input_rate[:2] * duration_s
    after = np.minimum(np.maximum(command[:2], set_points - reach), set_points + reach)
    return np.array([*(0.5 * (set_points + after)), command[2]]), after
