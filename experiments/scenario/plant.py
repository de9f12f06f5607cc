"""`[plant]`: what the vehicle really is and how it is simulated."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from proving_ground.testbed.actuation.actuators import ActuatorSpecification
from proving_ground.testbed.configuration.config_io import STRICT
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.ground.terrain import Terrain
from proving_ground.testbed.simulation.plant import Plant
from proving_ground.testbed.wheels.wheel_models import DEFAULT_WHEEL_MODEL, WheelModelName

from .vehicle import TrueVehicle


@dataclass(frozen=True, config=STRICT)
class PlantSettings:
    """How the vehicle is simulated."""

    wheels: WheelModelName = DEFAULT_WHEEL_MODEL
    timestep_s: Annotated[float, Field(ge=0.0005, le=0.004)] = 0.002
    vehicle: TrueVehicle = TrueVehicle()

    def plant(self, terrain: Terrain, soil: SoilMap, actuators: ActuatorSpecification) -> Plant:
        """Return the vehicle on its field, steered through these actuators.

        Raises:
            InvalidPlant: the vehicle cannot be.
        """
        return Plant(
            self.vehicle.vehicle(),
            terrain,
            soil,
            wheels=self.wheels,
            timestep_s=self.timestep_s,
            actuators=actuators,
        )
