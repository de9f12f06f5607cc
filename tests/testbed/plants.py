"""Plants and helper functions for the tests of the testbed."""

import dataclasses
import hashlib
from pathlib import Path

import numpy as np
import pytest
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.simulation.plant import Plant
from proving_ground.testbed.vehicle.vehicle import VEHICLES, read_vehicle

from ttempc.types import Command

ROOT = Path(__file__).parents[2]
HARD = SoilMap.named("hard")
SIDES = ("left", "right")
STOP = Command(0.0, 0.0, 0.0)
ROLL = Command(0.0, 0.0, 1.0 / 1.4)
SMALL = read_vehicle()
both_vehicles = pytest.mark.parametrize(
    "vehicle", [read_vehicle(name) for name in VEHICLES.names()], ids=VEHICLES.names()
)


def plant_on(ground=None, soil=HARD, vehicle=None, **options):
    return Plant(vehicle or SMALL, ground or terrain.flat((60.0, 40.0)), soil, **options)


def changed(vehicle, table, **keys):
    """Return the vehicle with some keys of one table of its file changed."""
    return dataclasses.replace(
        vehicle, **{table: dataclasses.replace(getattr(vehicle, table), **keys)}
    )


def top_speed(vehicle):
    return vehicle.hydrostat.speed_gain_mps


def weight(plant):
    return -plant.model.opt.gravity[2] * plant.model.body_mass.sum()


def axle_points(truth):
    return np.array([truth.tractor.x, truth.tractor.y, truth.trailer.x, truth.trailer.y])


def state_hash(plant):
    snapshot = plant.snapshot()
    return hashlib.sha256(snapshot.physics.tobytes() + snapshot.wheel_state.tobytes()).hexdigest()


def rough_run(seed, steps=1000):
    plant = plant_on(terrain.rough("E", np.random.default_rng(seed), (30.0, 20.0)), SoilMap(300.0))
    plant.reset(-5.0, 0.0, 0.2, 1.0)
    plant.advance(Command(0.2, -0.1, 0.8), steps)
    return plant
