"""Left and right wheel see their own ground: what one side lies on tells in the whole vehicle."""

import math

import numpy as np
import pytest
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.features import Bump
from proving_ground.testbed.ground.soil import Gradient, SoilMap, Tracks, Tramlines
from proving_ground.testbed.simulation.plant import Plant
from proving_ground.testbed.truth import WHEELS
from proving_ground.testbed.vehicle.vehicle import read_vehicle

from ttempc.types import Command

LEFT = [WHEELS.index(name) for name in ("front_left", "rear_left", "trailer_left")]
RIGHT = [WHEELS.index(name) for name in ("front_right", "rear_right", "trailer_right")]
REAR_LEFT, REAR_RIGHT = WHEELS.index("rear_left"), WHEELS.index("rear_right")
ROLL = Command(0.0, 0.0, 0.7)


def edge(right, left):
    """Return a gradient so short that the cone index changes at y = 0."""
    return Gradient(from_kpa=right, to_kpa=left, distance_m=0.1, y_m=-0.05, towards_deg=90.0)


def driven(soil, ground=None, seconds=6.0):
    """Where a vehicle that starts eastwards on y = 0, steering straight, is after that time."""
    plant = Plant(read_vehicle(), ground or terrain.flat((40.0, 12.0)), soil)
    plant.reset(-10.0, 0.0, 0.0, 0.9)
    return plant.advance(ROLL, round(seconds / plant.timestep_s))


@pytest.mark.parametrize(("left", "right"), [(200.0, 1000.0), (1000.0, 200.0)])
def test_on_a_soil_boundary_each_side_has_its_own_soil_slip_and_resistance(left, right):
    truth = driven(SoilMap(1.0, (edge(right, left),)), seconds=3)
    wheels = truth.wheels
    np.testing.assert_allclose(wheels.cone_index[LEFT], left)
    np.testing.assert_allclose(wheels.cone_index[RIGHT], right)
    towards_soft = 1.0 if left < right else -1.0
    # an open differential gives both the same torque: the wheel on soft soil slips more for it
    assert towards_soft * (wheels.slip[REAR_LEFT] - wheels.slip[REAR_RIGHT]) > 0.005
    # and towed wheels are held back there, so that the vehicle turns to that side
    assert towards_soft * (wheels.force_long[LEFT] - wheels.force_long[RIGHT])[[0, 2]].max() < -20.0
    assert towards_soft * truth.tractor.yaw > 0.005


def test_wheels_feel_the_tramline_that_they_run_in():
    line = np.array([[-15.0, 0.0], [15.0, 0.0]])
    offset = line + np.array([0.0, 0.95])  # its right track is below the left rear wheel
    for lines, left, right in (((line,), 900.0, 900.0), ((offset,), 900.0, 600.0)):
        strength = driven(SoilMap(600.0, (Tramlines(lines, Tracks()),)), seconds=1)
        cone_index = strength.wheels.cone_index
        assert (cone_index[REAR_LEFT], cone_index[REAR_RIGHT]) == (left, right)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_bump_under_one_side_rolls_the_tractor_away_from_it(side):
    bump = Bump(x_m=0.0, y_m=side * 0.475, height_m=0.1, width_m=0.8, length_m=0.2)
    ground = terrain.flat((40.0, 12.0)).shaped((bump,))
    plant = Plant(read_vehicle(), ground, SoilMap(1000.0))
    plant.reset(0.0, 0.0, 0.0, 0.0)
    truth = plant.truth()
    # the rear axle stands with one wheel on top; roll is positive to the right
    expected = math.atan(0.1 / 0.95)
    assert side * truth.tractor.roll == pytest.approx(expected, rel=0.2)
    assert truth.wheels.ground[REAR_LEFT if side > 0 else REAR_RIGHT] == pytest.approx(
        0.1, abs=0.01
    )
