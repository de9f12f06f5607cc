"""`[actuators]`: what is lost between a command and the wheels; nothing by default."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from proving_ground.testbed.actuation.actuators import (
    LONGEST_DEAD_TIME_S,
    ActuatorSpecification,
    SteeringValve,
)
from proving_ground.testbed.configuration.config_io import STRICT, NotNegative

DeadTime = Annotated[float, Field(ge=0, le=LONGEST_DEAD_TIME_S)]


@dataclass(frozen=True, config=STRICT)
class ValveSettings:
    """The valve and the linkage of one steering axis."""

    dead_time_s: DeadTime = 0.0  # from command to valve
    dead_band_deg: NotNegative = 0.0  # half width: smaller errors do not open the valve
    backlash_deg: NotNegative = 0.0  # whole play between cylinder and wheel
    resolution_deg: NotNegative = 0.0  # of the command as it is sent

    def valve(self) -> SteeringValve:
        """Return the valve in radians."""
        return SteeringValve(
            dead_time=self.dead_time_s,
            dead_band=math.radians(self.dead_band_deg),
            backlash=math.radians(self.backlash_deg),
            resolution=math.radians(self.resolution_deg),
        )


@dataclass(frozen=True, config=STRICT)
class HydrostatSettings:
    """The drive, besides the lag that it has in any case."""

    dead_time_s: DeadTime = 0.0


@dataclass(frozen=True, config=STRICT)
class ActuatorSettings:
    """All actuators."""

    front: ValveSettings = ValveSettings()
    trailer: ValveSettings = ValveSettings()
    hydrostat: HydrostatSettings = HydrostatSettings()

    def specification(self) -> ActuatorSpecification:
        """Return the actuators as they are."""
        return ActuatorSpecification(
            front=self.front.valve(),
            trailer=self.trailer.valve(),
            hydrostat_dead_time=self.hydrostat.dead_time_s,
        )
