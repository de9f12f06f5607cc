"""`[plant]`: simulated vehicle and method of simulation."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from ...testbed.configuration.config_io import STRICT
from ...testbed.wheels.soil_law import SoilLaw
from ...testbed.wheels.wheel_models import (
    DEFAULT_WHEEL_MODEL,
    WheelModelName,
    wheel_model,
)
from .vehicle import PlantVehicleSettings


@dataclass(frozen=True, config=STRICT)
class PlantSettings:
    """Simulated vehicle and method of simulation."""

    wheels: WheelModelName = DEFAULT_WHEEL_MODEL
    """Wheel forces: traction equations of the soil, or MuJoCo's own contacts."""
    timestep_s: Annotated[float, Field(ge=0.0005, le=0.004)] = 0.002
    """Physics step."""
    wheel_law: SoilLaw = SoilLaw()
    """Coefficients of traction, motion resistance and side force on soil."""
    vehicle: PlantVehicleSettings = PlantVehicleSettings()
    """Parameters of the vehicle."""

    def __post_init__(self) -> None:
        if self.wheel_law.second_pass and not wheel_model(self.wheels).follows_soil_law:
            raise ValueError(f"wheel_law.second_pass needs soil wheels, got wheels {self.wheels!r}")
