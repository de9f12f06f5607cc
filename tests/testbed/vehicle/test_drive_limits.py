"""Limits of the drive: power of the engine, parking brake."""

import math

import numpy as np
import pytest
from proving_ground.testbed.ground.terrain import flat
from proving_ground.testbed.vehicle.vehicle import read_vehicle

from tests.testbed.plants import STOP, changed, plant_on
from ttempc.types import Command

FARM = read_vehicle("farm4500")
FULL = Command(0.0, 0.0, 1.0)


def pulling(vehicle, force_n, seconds=8.0):
    """Return power at the driven wheels [W] and speed [m/s] of a vehicle that is held back."""
    plant = plant_on(flat((120.0, 20.0)), vehicle=vehicle)
    plant.reset(-50.0, 0.0, 0.0, 3.0)
    plant.data.xfrc_applied[plant.body_names.index("trailer"), 0] = -force_n
    powers = []
    for _ in range(round(seconds / 0.1)):
        truth = plant.advance(FULL, 50)
        hydrostat = plant.model.actuator("hydrostat").id
        powers.append(
            plant.data.actuator_force[hydrostat] * plant.data.actuator_velocity[hydrostat]
        )
    return np.array(powers), truth.speed


def test_the_engine_limits_the_power_at_the_wheels():
    """48 kW; under a pull of 20 kN speed falls to what is left, without a limit it hardly falls."""
    powers, speed = pulling(FARM, 20e3)
    assert powers.max() <= 1.01 * 48e3
    assert powers[-20:].mean() == pytest.approx(48e3, rel=0.01)
    unlimited, faster = pulling(changed(FARM, "hydrostat", power_kw=None), 20e3)
    assert unlimited[-20:].mean() > 60e3
    assert speed < 0.85 * faster


def test_a_light_pull_is_not_limited():
    powers, speed = pulling(FARM, 5e3)
    _, free = pulling(changed(FARM, "hydrostat", power_kw=None), 5e3)
    assert powers.max() < 40e3
    assert speed == free


@pytest.mark.parametrize("uphill", [0.0, 0.5 * math.pi, math.pi])
def test_a_parked_vehicle_stays_on_a_slope(uphill):
    """On 0.15 rad it moves by less than 5 mm in 10 s; the hydrostat alone lets it creep 0.2 m."""
    plant = plant_on(flat((60.0, 40.0)).tilted(0.15, uphill), vehicle=FARM)
    plant.reset(0.0, 0.0, 0.0, 0.0)
    start = plant.advance(STOP, 1000)
    end = plant.advance(STOP, 5000)
    moved = math.hypot(end.tractor.x - start.tractor.x, end.tractor.y - start.tractor.y)
    assert moved < 0.005


def test_the_brake_opens_at_the_first_command():
    """A vehicle that drives off is as fast as one whose brake never closed."""
    speeds = []
    for standing in (0, 500):
        plant = plant_on(flat((60.0, 20.0)), vehicle=FARM)
        plant.reset(-20.0, 0.0, 0.0, 0.0)
        if standing:
            plant.advance(STOP, standing)
        speeds.append(plant.advance(FULL, 1500).speed)
    assert speeds[0] == pytest.approx(speeds[1], rel=1e-3)
