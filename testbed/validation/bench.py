"""Test bench: the plants of the validation, and what its experiments read from them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import Final

import numpy as np

from ttempc.types import Command, FloatArray
from ttempc.vehicle import Vehicle

from ..ground.soil import SoilMap
from ..ground.terrain import Terrain, flat
from ..simulation.plant import Plant
from ..truth import WHEELS, Truth
from ..vehicle.vehicle import PlantVehicle
from ..wheels.soil_law import SoilLaw
from ..wheels.tyre import WheelMotion

FIRM_KPA: Final = SoilMap.named("hard").background
SPEED: Final = 1.0  # [m/s] default of the experiments
DRIVEN: Final = np.array([wheel.startswith("rear") for wheel in WHEELS])
TRAILER: Final = np.array([wheel.startswith("trailer") for wheel in WHEELS])
STOP: Final = Command(0.0, 0.0, 0.0)
RELEASED: Final = Command(0.0, 0.0, 1e-9)
"""Stands with the parking brake open, so that tyres and drive give up what settling wound up."""


@dataclass(frozen=True)
class Bench:
    """Vehicle, ground and wheel model of a scenario, from which experiments build plants."""

    vehicle: PlantVehicle
    terrain: Terrain  # of the scenario, slope included
    soil: SoilMap
    slope_rad: float = 0.0
    wheel_law: SoilLaw = SoilLaw()  # noqa: RUF009 - frozen
    timestep_s: float = 0.002

    @cached_property
    def cone_index(self) -> float:
        """Median cone index of the scenario's ground [kPa]."""
        return float(np.median(self.soil.rasterised(self.terrain)))

    @cached_property
    def nominal(self) -> Vehicle:
        """Model parameters of the vehicle's file."""
        vehicle = self.vehicle
        front = vehicle.front_steering
        trailer = vehicle.trailer_steering
        drive = vehicle.hydrostat
        return Vehicle(
            wheelbase=vehicle.tractor.wheelbase_m,
            hitch_offset=vehicle.hitch.offset_m,
            drawbar_length=vehicle.drawbar.length_m,
            trailer_length=vehicle.trailer.length_m,
            speed_gain=drive.speed_gain_mps,
            speed_time_constant=drive.time_constant_s,
            steering_lag_t=front.lag_s,
            steering_lag_i=trailer.lag_s,
            steering_limit_t=math.radians(front.limit_deg),
            steering_limit_i=math.radians(trailer.limit_deg),
            steering_rate_t=math.radians(front.rate_degps),
            steering_rate_i=math.radians(trailer.rate_degps),
            hp_rate=drive.rate_per_s,
        )

    def command(self, speed: float = SPEED, delta_t: float = 0.0, delta_i: float = 0.0) -> Command:
        """Return the command for a speed [m/s] on firm ground and steering angles [rad]."""
        return Command(delta_t, delta_i, speed / self.nominal.speed_gain)

    def plant(
        self,
        ground: Terrain | None = None,
        cone_index: float | SoilMap = FIRM_KPA,
        timestep_s: float | None = None,
    ) -> Plant:
        """Return a plant of the vehicle; the ground is level and firm by default."""
        return Plant(
            self.vehicle,
            ground or flat((60.0, 40.0)),
            cone_index if isinstance(cone_index, SoilMap) else SoilMap(cone_index),
            wheel_law=self.wheel_law,
            timestep_s=timestep_s or self.timestep_s,
        )


def steps(plant: Plant, seconds: float) -> int:
    """Return the number of physics steps in a time [s]."""
    return round(seconds / plant.timestep_s)


def drive(plant: Plant, command: Command, seconds: float, every: float) -> list[Truth]:
    """Return the truth after every `every` seconds while the plant holds a command."""
    count = steps(plant, every)
    return [plant.advance(command, count) for _ in range(round(seconds / every))]


def column(truths: Sequence[Truth], name: str) -> FloatArray:
    """Return a quantity of each truth, (n, ...); `name` may have dots, as "wheels.load"."""
    return np.array([attrgetter(name)(truth) for truth in truths])


def bodies(plant: Plant, root: str) -> Sequence[int]:
    """Return the ids of a body and of all bodies below it in the kinematic tree."""
    parent = plant.model.body_parentid
    top = plant.body_names.index(root)
    members = [top]
    for body in range(top + 1, len(parent)):
        if parent[body] in members:
            members.append(body)
    return members


def centre_of_mass(plant: Plant, members: Sequence[int]) -> tuple[float, FloatArray]:
    """Return the mass [kg] and the present centre of mass [m], (3,) map frame, of bodies."""
    mass = plant.model.body_mass[list(members)]
    return float(mass.sum()), mass @ plant.data.xipos[list(members)] / mass.sum()


def wheel_places(plant: Plant) -> FloatArray:
    """Return the centres of the wheels, (6, 3) [m], map frame."""
    return plant.data.xpos[[plant.body_names.index(wheel) for wheel in WHEELS]].copy()


def wheel_motion(plant: Plant) -> WheelMotion:
    """Return position and motion of the wheels."""
    data = plant.data
    ids = [plant.body_names.index(wheel) for wheel in WHEELS]
    rotation = data.cvel[ids, :3]
    arm = data.xpos[ids] - data.subtree_com[1]
    velocity = data.cvel[ids, 3:] + np.cross(rotation, arm)
    return WheelMotion(data.xpos[ids], data.xmat[ids][:, [1, 4, 7]], velocity, rotation)
