"""`[plant]`: what the vehicle really is and how it is simulated."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from experiments.settings.base import STRICT, NotNegative, Positive
from testbed.actuators import ActuatorSpecification
from testbed.plant import Plant
from testbed.soil import SoilMap
from testbed.terrain import Terrain
from testbed.vehicle_model import PlantVehicle


@dataclass(frozen=True, config=STRICT)
class TrueVehicle:
    """What the vehicle really is, where it may differ from what the controller believes."""

    hitch_offset_m: Positive = 0.3  # rear axle to RJ1
    drawbar_m: Positive = 0.8  # RJ1 to RJ2
    load_kg: NotNegative = 0.0  # in the trailer, on top of its own mass
    load_height_m: Positive = 0.55  # centre of the load above the trailer axle
    load_forward_m: float = 0.0  # centre of the load ahead of the trailer axle


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
            PlantVehicle(**asdict(self.vehicle)),
            terrain,
            soil,
            wheels=self.wheels,
            timestep_s=self.timestep_s,
            actuators=actuators,
        )
