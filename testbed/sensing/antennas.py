"""Where a GNSS antenna is and where its axle point is: the lever arm between the two."""

from __future__ import annotations

import math

from ttempc.types import FloatArray


def lever_in_map(lever: FloatArray, yaw: float, pitch: float, roll: float) -> tuple[float, float]:
    """Return the horizontal part (x, y) [m] of a lever arm in the map's frame.

    It is R_z(yaw) R_y(pitch) R_x(roll) lever: an antenna at height h above its point moves
    h sin(roll) to the right of it and h cos(roll) sin(pitch) ahead.

    Args:
        lever: from point to antenna in the body's frame, (3,) [m].
        yaw: heading of the body [rad].
        pitch: positive nose down [rad].
        roll: positive left side up [rad].
    """
    x, y, z = lever.tolist()
    aside = y * math.cos(roll) - z * math.sin(roll)
    up = y * math.sin(roll) + z * math.cos(roll)
    ahead = x * math.cos(pitch) + up * math.sin(pitch)
    return (
        ahead * math.cos(yaw) - aside * math.sin(yaw),
        ahead * math.sin(yaw) + aside * math.cos(yaw),
    )
