"""`[plant]`: simulated vehicle and method of simulation."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from proving_ground.testbed.configuration.config_io import STRICT
from proving_ground.testbed.wheels.wheel_models import DEFAULT_WHEEL_MODEL, WheelModelName

from .vehicle import PlantVehicleSettings


@dataclass(frozen=True, config=STRICT)
class PlantSettings:
    """Simulated vehicle and method of simulation."""

    wheels: WheelModelName = DEFAULT_WHEEL_MODEL
    """Wheel forces: traction equations of the soil, or MuJoCo's own contacts."""
    timestep_s: Annotated[float, Field(ge=0.0005, le=0.004)] = 0.002
    """Physics step."""
    vehicle: PlantVehicleSettings = PlantVehicleSettings()
    """Parameters of the vehicle."""
