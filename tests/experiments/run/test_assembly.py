"""What an assembly tells the guidance of the vehicle."""

import math

import pytest
from proving_ground.experiments.run.assembly import model_vehicle
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.vehicle.vehicle import GRAVITY, AxleLoads


def stiffness_left(name):
    """Return the share of the tyres' stiffness with which their force balances the tool's."""
    _, scenario = load(name)
    vehicles = scenario.vehicles()
    tool = scenario.implement
    behind = model_vehicle(scenario.mission(), scenario, vehicles).trailer_turning_offset
    mass = AxleLoads.of(vehicles.nominal).trailer / GRAVITY
    of_tyres = mass * behind / vehicles.nominal.trailer.compliance_s2pm
    per_degree = tool.side_stiffness_n_per_deg_m2 * tool.width_m * tool.depth_m
    return math.degrees(per_degree * (tool.behind_m - behind)) / of_tyres


def turning_offset(*overrides):
    _, scenario = load("work-passes", overrides)
    vehicles = scenario.vehicles()
    return model_vehicle(scenario.mission(), scenario, vehicles).trailer_turning_offset


def test_forces_balance_about_the_turning_place_with_one_share_for_any_vehicle():
    light, heavy = stiffness_left("cultivate"), stiffness_left("work-passes")
    assert light == pytest.approx(heavy)
    assert 0.0 < light <= 1.0


def test_a_trailer_turns_nearer_to_the_stiffer_of_tool_and_tyres():
    assert turning_offset("implement.side_stiffness_n_per_deg_m2=0") == 0.0
    wide, narrow = (turning_offset(f"implement.width_m={width}") for width in (2.0, 1.0))
    assert 0.0 < narrow < wide < 0.6


@pytest.mark.parametrize(
    "override", ["plant.vehicle.load_kg=500", "controller.vehicle.trailer_compliance_s2pm=0"]
)
def test_the_turning_place_is_that_of_the_vehicle_file(override):
    """A plant that differs from its file is not told, nor a slip of curves that is switched off."""
    assert turning_offset(override) == turning_offset()
