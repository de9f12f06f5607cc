"""`[sensors]`: rates and noise of what the controller can measure."""

from __future__ import annotations

import math

from pydantic.dataclasses import dataclass

from experiments.settings.base import STRICT, NotNegative, Positive
from testbed.sensors import SensorSpecification
from ttempc.noise import SensorNoise

# A sensor without noise would leave the filter nothing to weigh it by.
_LEAST_BELIEVED = SensorNoise(gnss=1e-3, steering=1e-3, hitch=1e-3, encoder=1e-3)


@dataclass(frozen=True, config=STRICT)
class SensorSettings:
    """Rates and noise of the paper's sensors."""

    gnss_rate_hz: Positive = 5.0
    gnss_sd_m: NotNegative = 0.03
    angle_rate_hz: Positive = 25.0
    angle_sd_deg: NotNegative = 1.0
    encoder_rate_hz: Positive = 25.0
    encoder_sd_mps: NotNegative = 0.1

    def specification(self) -> SensorSpecification:
        """Return the sensors as they are."""
        return SensorSpecification(
            gnss_rate=self.gnss_rate_hz,
            gnss_sd=self.gnss_sd_m,
            angle_rate=self.angle_rate_hz,
            angle_sd=math.radians(self.angle_sd_deg),
            encoder_rate=self.encoder_rate_hz,
            encoder_sd=self.encoder_sd_mps,
        )

    def believed_noise(self) -> SensorNoise:
        """Return the noise that the filter assumes: the true one, but never none at all."""
        true, least = self.specification(), _LEAST_BELIEVED
        return SensorNoise(
            gnss=max(true.gnss_sd, least.gnss),
            steering=max(true.angle_sd, least.steering),
            hitch=max(true.angle_sd, least.hitch),
            encoder=max(true.encoder_sd, least.encoder),
        )
