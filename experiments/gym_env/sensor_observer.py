"""Observation of samples: the newest of each sensor with its age, and the reference, in the map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ttempc.models.kinematics import wrap_angle
from ttempc.reference.reference import Reference
from ttempc.types import FloatArray, Measurement

from ...testbed.sensing.sensor_specification import SensorSpecification
from ...testbed.sensing.sensors import COMPONENTS
from .observation import REFERENCE_NAMES, ReferenceAhead, bounds, cut

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


def sensor_names(specification: SensorSpecification) -> tuple[str, ...]:
    """Return the entries of the observation: components and age of each sensor, the reference."""
    samples = (
        f"{sensor}_{part}"
        for sensor, parts in COMPONENTS.items()
        if specification.imu.on or not sensor.startswith("imu")
        for part in (*parts, "age_s")
    )
    return (*samples, *_POSE_NAMES, *REFERENCE_NAMES)


class SensorObserver:
    """Observation of what the sensors have delivered, in the order of `sensor_names`.

    Args:
        specification: of the sensors.
        reference: that is followed.
        period_s: control period [s].
    """

    def __init__(
        self, specification: SensorSpecification, reference: Reference, period_s: float
    ) -> None:
        names = sensor_names(specification)
        self._bounds = bounds(names)
        self._ahead = ReferenceAhead(reference, period_s)
        sensors = [sensor for sensor in COMPONENTS if f"{sensor}_age_s" in names]
        self._newest = {sensor: (0.0,) * len(COMPONENTS[sensor]) for sensor in sensors}
        self._taken_s: dict[str, float] = {}

    def observe(
        self, time_s: float, samples: Sequence[Measurement], k: int, sent: FloatArray
    ) -> FloatArray:
        """Return the observation at `time_s`, tick `k` of the reference, (n,).

        Args:
            time_s: present time [s].
            samples: delivered since the last call.
            k: tick of the reference.
            sent: last command, (3,).
        """
        for sample in samples:
            if sample.time_s >= self._taken_s.get(sample.sensor, sample.time_s):
                self._newest[sample.sensor] = sample.value
                self._taken_s[sample.sensor] = sample.time_s
        values: list[float] = []
        for sensor, value in self._newest.items():
            taken = self._taken_s.get(sensor)
            values += [*value, NO_SAMPLE_S if taken is None else time_s - taken]
        grid, i = self._ahead.grid, self._ahead.tick(k)
        x, y, psi_t, psi_i, _, _, v = grid.state[i].tolist()
        x_i, y_i = grid.trailer_xy[i].tolist()
        values += [x, y, wrap_angle(psi_t), x_i, y_i, wrap_angle(psi_i), v]
        return cut(np.concatenate([values, self._ahead.observe(k, sent)]), self._bounds)
