"""Observation of a policy: estimate, reference ahead and last command as one vector."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from ttempc.models.kinematics import Error, estimated_error
from ttempc.reference.reference import Reference
from ttempc.types import Estimate, FloatArray, State

from ...testbed.recording.channels import TRACKING

_AHEAD_S: Final = (1.0, 2.0, 3.0)  # of the curvatures; assumed: the vehicle is 3.4 s long at 1 m/s
REFERENCE_NAMES: Final = (
    "curvature_per_m",
    *(f"curvature_in_{ahead:g}_s_per_m" for ahead in _AHEAD_S),
    "delta_t_reference_rad",
    "delta_i_reference_rad",
    "hp_reference",
    "delta_t_command_rad",
    "delta_i_command_rad",
    "hp_command",
)
"""Entries of `ReferenceAhead`."""

ESTIMATE_NAMES: Final = (
    *TRACKING.fields[: len(Error)],
    "delta_t_rad",
    "delta_i_rad",
    "v_mps",
    "beta_rad",
    "slip_t_rad",
    "slip_i_rad",
    "steering_rad",
    "drive_mps2",
    "wheel_slip",
    *REFERENCE_NAMES,
)
"""Entries of the observation of an estimate."""

_BOUNDS: Final = {  # by the unit at the end of a name; assumed: no vehicle reaches them
    "per_m": 10.0,
    "rad": 2.0 * math.pi,
    "radps": 20.0,
    "mps": 20.0,
    "mps2": 20.0,
    "m": 1e4,
    "s": 1e4,
}
_NO_UNIT: Final = 10.0


def bounds(names: Sequence[str]) -> FloatArray:
    """Return the largest modulus of each named entry of an observation, (n,), in its unit."""
    units = ("per_m" if name.endswith("per_m") else name.rpartition("_")[2] for name in names)
    return np.array([_BOUNDS.get(unit, _NO_UNIT) for unit in units])


class ReferenceAhead:
    """The reference at a tick and ahead of it, and the last command, in `REFERENCE_NAMES`.

    Args:
        reference: that is followed.
        period_s: control period [s].
    """

    def __init__(self, reference: Reference, period_s: float) -> None:
        self.grid = reference.on_grid(period_s)
        self._last = len(self.grid.time_s) - 1
        ahead = np.array([0, *(round(time_s / period_s) for time_s in _AHEAD_S)])
        places = np.minimum(np.arange(len(self.grid.time_s))[:, None] + ahead, self._last)
        self._entries = np.column_stack([self.grid.curvature[places], self.grid.inputs])  # (N, 7)

    def tick(self, k: int) -> int:
        """Return the tick of the grid for control tick `k`: beyond the end the last one."""
        return min(k, self._last)

    def observe(self, k: int, sent: FloatArray) -> FloatArray:
        """Return the entries at tick `k` after the command `sent` (3,)."""
        return np.concatenate([self._entries[self.tick(k)], sent])


class EstimateObserver:
    """Observation of what a controller sees, in `ESTIMATE_NAMES`; errors in the bodies' frames.

    Entries are cut to `bounds`; one that is not finite is 0.

    Args:
        reference: that is followed.
        period_s: control period [s].
    """

    def __init__(self, reference: Reference, period_s: float) -> None:
        self._ahead = ReferenceAhead(reference, period_s)
        self._bounds = bounds(ESTIMATE_NAMES)

    def observe(self, estimate: Estimate, k: int, sent: FloatArray) -> FloatArray:
        """Return the observation at tick `k` after the command `sent` (3,), (n,)."""
        error = estimated_error(estimate, self._ahead.grid, self._ahead.tick(k))
        values = np.concatenate(
            [
                error,
                estimate.state[State.DELTA_T :],
                [estimate.hitch_angle],
                estimate.disturbance,
                self._ahead.observe(k, sent),
            ]
        )
        return cut(values, self._bounds)


def cut(values: FloatArray, largest: FloatArray) -> FloatArray:
    """Return values within plus and minus `largest`, 0 in the place of those not finite, (n,)."""
    finite = np.where(np.isfinite(values), values, 0.0)
    return np.minimum(np.maximum(finite, -largest), largest)
