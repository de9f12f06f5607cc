"""Tyres of the default vehicle for the tests of wheels."""

import pytest
from proving_ground.testbed.vehicle.servos import tyres_of
from proving_ground.testbed.vehicle.vehicle import read_vehicle


@pytest.fixture(scope="module")
def tyres():
    return tyres_of(read_vehicle())
