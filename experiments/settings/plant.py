"""`[plant]`: what the vehicle really is and how it is simulated."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from experiments.settings.vehicle import TrueVehicle
from testbed.actuators import ActuatorSpecification
from testbed.plant import Plant
from testbed.soil import SoilMap
from testbed.strict import STRICT
from testbed.terrain import Terrain


@dataclass(frozen=True, config=STRICT)
class PlantSettings:
    """How the vehicle is simulated."""

    wheels: Literal["soil", "contact"] = "soil"
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
