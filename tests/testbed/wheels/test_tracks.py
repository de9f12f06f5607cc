"""Second pass: a wheel in a track of the run finds the soil changed."""

import numpy as np
import pytest
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.wheels.soil_law import SoilLaw
from proving_ground.testbed.wheels.tyre import mobility

from tests.testbed.plants import plant_on
from ttempc.types import Command

CONE_INDEX = 300.0
TRACKS = SoilLaw(second_pass=True)
AHEAD, BACK = Command(0.0, 0.0, 0.5), Command(0.0, 0.0, -0.5)


def plant_with(law):
    plant = plant_on(terrain.flat((24.0, 12.0)), SoilMap(CONE_INDEX), wheel_law=law)
    plant.reset(-4.0, 0.0, 0.0, 0.7)
    return plant


def resistance_over_law(plant, truth):
    """Motion resistance of the front wheels over that of untouched soil, (2,)."""
    load = truth.wheels.load
    bn, _ = mobility(plant.wheel_law, plant.tyres, load, np.full(6, CONE_INDEX))
    law = plant.wheel_law.motion_resistance_ratio(bn, np.zeros(6))
    return (-truth.wheels.force_long / load / law)[:2]


def test_untouched_soil_resists_as_ever_and_a_track_resists_less():
    """The front wheels run on untouched soil, and in their own track on the way back."""
    plant = plant_with(TRACKS)
    plant.advance(AHEAD, 2000)
    assert resistance_over_law(plant, plant.advance(AHEAD, 1)) == pytest.approx(1.0, abs=0.01)
    plant.advance(BACK, 5000)
    truth = plant.advance(BACK, 1)
    assert truth.speed < -0.5
    assert -resistance_over_law(plant, truth) == pytest.approx(0.89, abs=0.01)


def test_a_wheel_does_not_meet_its_own_contact():
    """Over less than the length of a contact the run is that without tracks, bit for bit."""
    ends = []
    for law in (SoilLaw(), TRACKS):
        plant = plant_with(law)
        plant.reset(0.0, 0.0, 0.0, 0.0)
        ends.append(plant.advance(Command(0.3, 0.1, 0.0), 500).body_xyz)
    np.testing.assert_array_equal(*ends)
    driven, tracks = plant.wheels.state[18], plant.wheels.state[19:]
    assert driven < 0.1
    assert np.count_nonzero(tracks) >= 6
