"""Faults of the plant: forces on its bodies, and parameters that change while it drives.

They act in whole control periods. A force is scaled by the share of the period in which it acts,
so that its impulse is exact.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from typing import Final, Literal

import mujoco
import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.types import FloatArray

from ..configuration.config_io import STRICT, BearingDeg, Fraction, NotNegative, PlaceM, Positive
from ..simulation.plant import Plant
from ..truth import WHEELS
from ..wheels.soil_wheels import SoilWheels
from .fault import FaultContext, LastingFault, Window

Effect = Callable[[float], None]
"""Sets a fault for the next control period, from the share of the period in which it acts."""

WheelName = Literal[
    "front_left", "front_right", "rear_left", "rear_right", "trailer_left", "trailer_right"
]
_RADIUS, _STIFFNESS = 0, 4  # columns of `Tyres.table`
_LARGEST_SHIFT: Final = 0.5  # of a load over the size of the box: its centre stays in the box


@dataclass(frozen=True, kw_only=True, config=STRICT)
class PlantFault(LastingFault):
    """A fault of the simulated vehicle."""

    @abstractmethod
    def attach(self, plant: Plant) -> Effect:
        """Return the effect on a plant, which has no fault yet.

        Forces are added to `qfrc_applied`, which is 0 before the effects of a control period.
        """


@dataclass(frozen=True, kw_only=True, config=STRICT)
class SteeringFree(PlantFault):
    """A steering cylinder has lost its oil: no torque holds the angle."""

    kind: Literal["front_steering_free", "trailer_steering_free"] = "trailer_steering_free"
    """Kind of fault."""

    def attach(self, plant: Plant) -> Effect:
        """Return the effect on the servo's largest force."""
        actuator = "steer" if self.kind.startswith("front") else "rj2"
        limits = plant.model.actuator_forcerange[plant.model.actuator(actuator).id]
        return _switched(limits, np.zeros(2))


@dataclass(frozen=True, kw_only=True, config=STRICT)
class LoadShift(PlantFault):
    """The load of the trailer slides."""

    kind: Literal["load_shift"] = "load_shift"
    """Kind of fault."""
    left_m: PlaceM = 0.0
    """Shift of its centre to the left."""
    forward_m: PlaceM = 0.0
    """Shift of its centre to the front."""

    def attach(self, plant: Plant) -> Effect:
        """Return the effect on the place of the load in the box."""
        place = plant.model.body_pos[plant.model.body("load").id]
        return _switched(place, place + np.array([self.forward_m, self.left_m, 0.0]))

    def refusal(self, window: Window, context: FaultContext) -> str:
        """Return why the fault cannot act."""
        if not context.vehicle.load.mass_kg:
            return "the trailer is empty, plant.vehicle.load_kg is 0"
        box = context.vehicle.box
        for key, shift, size in (
            ("left_m", self.left_m, box.width_m),
            ("forward_m", self.forward_m, box.length_m),
        ):
            most = _LARGEST_SHIFT * size
            if abs(shift) > most:
                return f"got {key} {shift:g}, must be at most {most:g}, half the box"
        return "" if self.left_m or self.forward_m else "left_m and forward_m are 0"


@dataclass(frozen=True, kw_only=True, config=STRICT)
class TyreFlat(PlantFault):
    """A tyre loses its air: it is smaller and softer."""

    kind: Literal["tyre_flat"] = "tyre_flat"
    """Kind of fault."""
    wheel: WheelName
    """Wheel that is concerned."""
    radius_loss_m: NotNegative = 0.05
    """Loss of radius; assumed."""
    stiffness_factor: Fraction = Field(default=0.4, gt=0.0)
    """Factor on the stiffness; assumed."""

    def attach(self, plant: Plant) -> Effect:
        """Return the effect on the tyre's radius and stiffness."""
        wheels = plant.wheels
        assert isinstance(wheels, SoilWheels)
        tyre = wheels.tyre_table[WHEELS.index(self.wheel)]
        flat = tyre.copy()
        flat[_RADIUS] -= self.radius_loss_m
        flat[_STIFFNESS] *= self.stiffness_factor
        return _switched(tyre, flat)

    def refusal(self, window: Window, context: FaultContext) -> str:
        """Return why the fault cannot act."""
        if not context.soil_wheels:
            return 'plant.wheels must be "soil"'
        radius = context.vehicle.wheels[self.wheel.split("_")[0]].radius_m
        if self.radius_loss_m > 0.5 * radius:
            return (
                f"got radius_loss_m {self.radius_loss_m:g}, must be at most {0.5 * radius:g}, "
                "half the radius"
            )
        return "" if self.radius_loss_m or self.stiffness_factor < 1.0 else "the tyre is as before"


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Gust(PlantFault):
    """A constant horizontal force on the centre of mass of a body."""

    kind: Literal["gust"] = "gust"
    """Kind of fault."""
    body: Literal["tractor", "trailer"] = "trailer"
    """Body that is pushed."""
    force_n: Positive
    """Force."""
    direction_deg: BearingDeg
    """Direction of the force, counter-clockwise from east."""

    def attach(self, plant: Plant) -> Effect:
        """Return the effect on the applied forces."""
        direction = math.radians(self.direction_deg)
        force = self.force_n * np.array([math.cos(direction), math.sin(direction), 0.0])
        body = plant.model.body(self.body).id

        def effect(share: float) -> None:
            _push(plant, share * force, plant.data.xipos[body], body)

        return effect


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Stone(PlantFault):
    """A wheel hits an obstacle: an impulse to the rear at its centre."""

    kind: Literal["stone"] = "stone"
    """Kind of fault."""
    wheel: WheelName
    """Wheel that hits the obstacle."""
    impulse_ns: Positive
    """Impulse."""
    duration_s: Positive = 0.1
    """Time over which the impulse is spread; assumed."""

    def attach(self, plant: Plant) -> Effect:
        """Return the effect on the applied forces."""
        wheel = plant.model.body(self.wheel).id
        carrier = "trailer" if self.wheel.startswith("trailer") else "tractor"
        body = plant.model.body(carrier).id

        def effect(share: float) -> None:
            ahead = plant.data.xmat[body].reshape(3, 3)[:, 0]
            force = -self.impulse_ns / self.duration_s * share * ahead
            _push(plant, force, plant.data.xpos[wheel], wheel)

        return effect


def _switched(values: FloatArray, faulty: FloatArray) -> Effect:
    """Return the effect that replaces values of the model in place while the fault acts."""
    healthy = values.copy()

    def effect(share: float) -> None:
        values[:] = faulty if share > 0.0 else healthy

    return effect


def _push(plant: Plant, force: FloatArray, point: FloatArray, body: int) -> None:
    """Add a force [N] at a point [m] of a body, both in the map frame."""
    if force.any():
        target = plant.data.qfrc_applied
        mujoco.mj_applyFT(plant.model, plant.data, force, np.zeros(3), point, body, target)
