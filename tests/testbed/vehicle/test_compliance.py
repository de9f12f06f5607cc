"""Side slip of steady circles of the plant: in proportion to v^2 / R, as its file says."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.simulation.plant import Plant
from proving_ground.testbed.vehicle.vehicle import read_vehicle

from ttempc.reference.path import figure_eight
from ttempc.reference.posture import posture_on_path
from ttempc.types import Command
from ttempc.vehicle import Vehicle


def steering_of_circle(vehicle, radius_m):
    """Return both steering angles [rad] with which both axles are on a circle to the left."""
    model = Vehicle(
        wheelbase=vehicle.tractor.wheelbase_m,
        hitch_offset=vehicle.hitch.offset_m,
        drawbar_length=vehicle.drawbar.length_m,
        trailer_length=vehicle.trailer.length_m,
    )
    path = figure_eight(radius_m, centre_distance_m=3.0 * radius_m, blend_m=5.0)
    distance = np.linspace(0.0, 0.5 * path.lap_m, 500)
    middle = distance[path.curvature(distance) > 0.999 / radius_m].mean()
    posture = posture_on_path(path, model, middle)
    return float(posture.delta_t), float(posture.delta_i)


def steady_slips(plant, radius_m, speed):
    """Return side slip over lateral acceleration of both axles in a steady circle, (2,)."""
    vehicle = plant.vehicle
    plant.reset(0.0, -radius_m, 0.0, speed)
    front, trailer = steering_of_circle(vehicle, radius_m)
    command = Command(front, trailer, speed / vehicle.hydrostat.speed_gain_mps)
    seconds = 1.5 * math.pi * radius_m / speed
    plant.advance(command, round(seconds / plant.timestep_s))
    before = plant.truth()
    now = plant.advance(command, round(0.2 / plant.timestep_s))

    slips = []
    for first, last in ((before.tractor, now.tractor), (before.trailer, now.trailer)):
        heading = 0.5 * (first.yaw + last.yaw)
        motion = math.atan2(last.y - first.y, last.x - first.x)
        slip = math.remainder(motion - heading, math.tau)
        yaw_rate = (last.yaw - first.yaw) / (now.time_s - before.time_s)
        slips.append(-slip / (now.speed * yaw_rate))
    return np.array(slips)


@pytest.mark.parametrize("name", ["farm4500", "kayacan2016"])
def test_the_slip_of_a_steady_circle_is_that_of_the_file_times_v2_over_r(name):
    vehicle = read_vehicle(name)
    hydrostat = replace(vehicle.hydrostat, speed_gain_mps=6.0)  # fast enough to slip
    vehicle = replace(vehicle, hydrostat=hydrostat)
    plant = Plant(vehicle, terrain.flat((90.0, 90.0)), SoilMap(900.0))
    wide = steady_slips(plant, 25.0, 3.0)
    tight = steady_slips(plant, 18.0, 3.0)
    np.testing.assert_allclose(wide, tight, rtol=0.1)
    given = [vehicle.tractor.compliance_s2pm, vehicle.trailer.compliance_s2pm]
    np.testing.assert_allclose(wide, given, rtol=0.25)
