"""Correction of antenna positions for the lean of the vehicle, with the attitude of the IMUs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..types import Measurement, Sensor

_BODIES = ((Sensor.GNSS_TRACTOR, Sensor.IMU_TRACTOR), (Sensor.GNSS_TRAILER, Sensor.IMU_TRAILER))


@dataclass(frozen=True, slots=True)
class _Body:
    gnss: Sensor
    imu: Sensor
    height_m: float  # of the antenna above the axle point


class AntennaLean:
    """Positions of axle points from those of antennas on masts above them.

    An antenna at height h moves h sin(roll) to the right of its point and h cos(roll) sin(pitch)
    ahead of it; roll is positive with the left side up, pitch with the nose down. The attitude is
    that of the IMU sample of the body that is nearest in time; without one, and for a height of 0,
    a position stays as it is.

    Args:
        heights_m: of the antennas of tractor and trailer above the axle points [m].
        memory_s: time for which samples of the IMUs are kept, at least the latency of GNSS.

    Examples:
        >>> lean = AntennaLean((2.0, 0.0), memory_s=1.0)
        >>> imu = Measurement(0.2, Sensor.IMU_TRACTOR, (0.0, 0.1, 0.0))  # left side up by 0.1 rad
        >>> gnss = Measurement(0.2, Sensor.GNSS_TRACTOR, (5.0, 3.0))
        >>> corrected, _ = lean.corrected([gnss, imu], headings=(0.0, 0.0))  # faces east
        >>> round(corrected.value[1], 3)
        3.2
    """

    def __init__(self, heights_m: tuple[float, float], memory_s: float) -> None:
        self._memory_s = memory_s
        self._bodies = tuple(
            _Body(gnss, imu, height)
            for (gnss, imu), height in zip(_BODIES, heights_m, strict=True)
            if height > 0.0
        )
        self._attitudes: dict[Sensor, list[Measurement]] = {body.imu: [] for body in self._bodies}

    @property
    def corrects(self) -> bool:
        """Whether there is an antenna above its point."""
        return bool(self._bodies)

    def corrected(
        self, samples: Sequence[Measurement], headings: tuple[float, float]
    ) -> Sequence[Measurement]:
        """Return the samples with every position moved to its axle point.

        Args:
            samples: as they arrive, those of the IMUs among them.
            headings: of tractor and trailer [rad]; an error e moves a point by height x lean x e.
        """
        for body in self._bodies:
            kept = self._attitudes[body.imu]
            kept += [
                sample
                for sample in samples
                if sample.sensor is body.imu and all(map(math.isfinite, sample.value))
            ]
            newest = max((sample.time_s for sample in kept), default=0.0)
            kept[:] = [sample for sample in kept if sample.time_s >= newest - self._memory_s]
        return [self._moved(sample, headings) for sample in samples]

    def _moved(self, sample: Measurement, headings: tuple[float, float]) -> Measurement:
        for body in self._bodies:
            attitudes = self._attitudes[body.imu]
            if sample.sensor is body.gnss and attitudes and len(sample.value) == 2:
                near = min(attitudes, key=lambda item: abs(item.time_s - sample.time_s))
                _, roll, pitch = near.value
                right = body.height_m * math.sin(roll)
                ahead = body.height_m * math.cos(roll) * math.sin(pitch)
                yaw = headings[sample.sensor is Sensor.GNSS_TRAILER]
                cos, sin = math.cos(yaw), math.sin(yaw)
                x, y = sample.value
                value = (x - ahead * cos - right * sin, y - ahead * sin + right * cos)
                return replace(sample, value=value)
        return sample
