"""Observations of a policy: estimate or newest samples, reference ahead, and last command."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from ttempc.models.kinematics import Error, estimated_error, wrap_angle
from ttempc.reference.reference import Reference
from ttempc.types import Estimate, FloatArray, Measurement, State

from ...testbed.recording.channels import TRACKING
from ...testbed.sensing.sensor_specification import SensorSpecification
from ...testbed.sensing.sensors import COMPONENTS

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
"""Entries of every observation: reference at a tick and ahead of it, last command."""

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

_POSE_NAMES: Final = (
    "x_t_reference_m",
    "y_t_reference_m",
    "psi_t_reference_rad",
    "x_i_reference_m",
    "y_i_reference_m",
    "psi_i_reference_rad",
    "v_reference_mps",
)
NO_SAMPLE_S: Final = -1.0
"""Age of a sensor that has not delivered yet; its components are 0."""

# By the unit at the end of a name: a modulus that no vehicle reaches, and one that few exceed, by
# which an entry is divided where it is scaled; both assumed.
_BOUNDS: Final = {
    "per_m": (10.0, 0.2),
    "rad": (2.0 * math.pi, math.pi),
    "radps": (20.0, 1.0),
    "mps": (20.0, 5.0),
    "mps2": (20.0, 1.0),
    "m": (1e4, 100.0),
    "e_m": (1e4, 2.0),  # an error
    "s": (1e4, 2.0),
}
_NO_UNIT: Final = (10.0, 1.0)


def bounds(names: Sequence[str]) -> FloatArray:
    """Return bound and scale of each named entry of an observation, (2, n), in its unit."""
    words = (name.split("_") for name in names)
    ends = (("_".join(word[-2:]), word[-1]) for word in words)
    return np.array([_BOUNDS.get(two, _BOUNDS.get(one, _NO_UNIT)) for two, one in ends]).T


class _Observer:
    """Observation with given entries, whose last are `REFERENCE_NAMES`.

    Entries are cut to `bounds`; one that is not finite is 0.
    """

    def __init__(self, names: Sequence[str], reference: Reference, period_s: float) -> None:
        self._bounds = bounds(names)[0]
        self._grid = reference.on_grid(period_s)
        self._last = len(self._grid.time_s) - 1
        ahead = np.array([0, *(round(time_s / period_s) for time_s in _AHEAD_S)])
        places = np.minimum(np.arange(self._last + 1)[:, None] + ahead, self._last)
        self._entries = np.column_stack([self._grid.curvature[places], self._grid.inputs])  # (N, 7)

    def _entries_at(self, values: FloatArray, k: int, sent: FloatArray) -> FloatArray:
        """Return values, then the reference at a tick of the grid, then the last command (3,)."""
        entries = np.concatenate([values, self._entries[k], sent])
        finite = np.where(np.isfinite(entries), entries, 0.0)
        return np.minimum(np.maximum(finite, -self._bounds), self._bounds)


class EstimateObserver(_Observer):
    """Observation of what a controller sees, in `ESTIMATE_NAMES`; errors in the bodies' frames."""

    def __init__(self, reference: Reference, period_s: float) -> None:
        super().__init__(ESTIMATE_NAMES, reference, period_s)

    def observe(self, estimate: Estimate, k: int, sent: FloatArray) -> FloatArray:
        """Return the observation at tick `k` after the command `sent` (3,), (n,)."""
        k = min(k, self._last)
        error, state = estimated_error(estimate, self._grid, k), estimate.state[State.DELTA_T :]
        values = np.concatenate([error, state, [estimate.hitch_angle], estimate.disturbance])
        return self._entries_at(values, k, sent)


def sensor_names(specification: SensorSpecification) -> tuple[str, ...]:
    """Return the entries of the observation: components and age of each sensor, the reference."""
    samples = (
        f"{sensor}_{part}"
        for sensor, parts in COMPONENTS.items()
        if specification.imu.on or not sensor.startswith("imu")
        for part in (*parts, "age_s")
    )
    return (*samples, *_POSE_NAMES, *REFERENCE_NAMES)


class SensorObserver(_Observer):
    """Observation of what the sensors have delivered, in the order of `sensor_names`."""

    def __init__(
        self, specification: SensorSpecification, reference: Reference, period_s: float
    ) -> None:
        names = sensor_names(specification)
        super().__init__(names, reference, period_s)
        sensors = [sensor for sensor in COMPONENTS if f"{sensor}_age_s" in names]
        self._newest = {sensor: (0.0,) * len(COMPONENTS[sensor]) for sensor in sensors}
        self._taken_s: dict[str, float] = {}

    def observe(
        self, time_s: float, samples: Sequence[Measurement], k: int, sent: FloatArray
    ) -> FloatArray:
        """Return the observation at `time_s`, tick `k` of the reference, (n,).

        `samples` were delivered since the last call; `sent` (3,) is the last command.
        """
        for sample in samples:
            if sample.time_s >= self._taken_s.get(sample.sensor, sample.time_s):
                self._newest[sample.sensor] = sample.value
                self._taken_s[sample.sensor] = sample.time_s
        values: list[float] = []
        for sensor, value in self._newest.items():
            taken = self._taken_s.get(sensor)
            values += [*value, NO_SAMPLE_S if taken is None else time_s - taken]
        k = min(k, self._last)
        x, y, psi_t, psi_i, _, _, v = self._grid.state[k].tolist()
        x_i, y_i = self._grid.trailer_xy[k].tolist()
        values += [x, y, wrap_angle(psi_t), x_i, y_i, wrap_angle(psi_i), v]
        return self._entries_at(np.array(values), k, sent)
