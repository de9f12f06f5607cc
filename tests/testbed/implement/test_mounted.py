"""An implement on the trailer of a plant."""

from dataclasses import replace

import numpy as np
import pytest
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.ground.terrain import flat, rough
from proving_ground.testbed.implement.implement import Implement

from tests.testbed.plants import STOP, both_vehicles, plant_on, state_hash, top_speed
from ttempc.types import Command

MOIST = SoilMap(600.0)
LONG = flat((60.0, 10.0))
ROLL = Command(0.0, 0.0, 1.0 / 1.35)


def drive(ground=LONG, seconds=6.0, command=ROLL, **settings):
    plant = plant_on(ground, MOIST, implement=Implement(**settings))
    plant.reset(-20.0, 0.0, 0.0, 1.0)
    return plant, plant.advance(command, round(seconds / plant.timestep_s))


@both_vehicles
def test_tools_are_at_the_set_depth_where_the_vehicle_stands(vehicle):
    plant = plant_on(flat((30.0, 20.0)), vehicle=vehicle, implement=Implement(lift_s=0.5))
    plant.reset(0.0, 0.0, 0.0, 0.0)
    tool = plant.advance(STOP, 1500).tool
    assert tool.lowered == 1.0
    assert tool.depth == pytest.approx(0.05, abs=5e-4)
    assert np.abs(tool.draft).sum() < 0.01 * Implement().draft(1.0)


def test_the_wheels_pull_motion_resistance_and_draft():
    plant, truth = drive(seconds=10.0)
    tool = truth.tool
    assert truth.wheels.force_long.sum() == pytest.approx(tool.draft.sum(), rel=2e-3)
    deep = replace(plant.implement.settings, depth_m=float(tool.depth.mean()))
    assert tool.draft.sum() == pytest.approx(deep.draft(truth.speed), rel=2e-3)
    assert tool.depth == pytest.approx(0.05, abs=0.005)
    assert tool.side == pytest.approx(0.0, abs=1.0)
    assert truth.tool.distance == pytest.approx(truth.trailer.x + 20.0 + 2.4, abs=0.02)


def test_the_pull_of_the_soil_loads_the_wheels():
    """The wheels carry the weight and 0.5 of the draft, most of it at the trailer."""
    _, light = drive(seconds=10.0, vertical_share=0.0)
    _, heavy = drive(seconds=10.0, vertical_share=0.5)
    more = heavy.wheels.load - light.wheels.load
    assert more.sum() == pytest.approx(0.5 * heavy.tool.draft.sum(), rel=0.02)
    assert more[4:].sum() > more.sum()  # behind the axle: it lifts the hitch


def test_a_raised_implement_changes_no_bit():
    def run(implement):
        plant = plant_on(rough("B", np.random.default_rng(3), (30.0, 20.0)), implement=implement)
        plant.reset(-5.0, 0.0, 0.2, 1.0)
        plant.advance(Command(0.2, -0.1, 0.8), 1000)
        return state_hash(plant)

    assert run(Implement(work_m=((9e5, 1e6),))) == run(None)


def test_it_works_in_its_intervals_of_the_distance_driven():
    plant, _ = drive(seconds=0.02, work_m=((2.0, 5.0), (8.0, 99.0)), lift_s=1.0)
    tools = [plant.advance(ROLL, 50).tool for _ in range(100)]
    distance, lowered = np.array([(tool.distance, tool.lowered) for tool in tools]).T
    lag = 1.05  # [m] driven in the time of the lift
    for low, high, share in ((0.0, 2.0, 0.0), (2.0 + lag, 5.0, 1.0), (5.0 + lag, 8.0, 0.0)):
        inside = (distance > low) & (distance < high)
        assert inside.any()
        assert (lowered[inside] == share).all()
    assert all(tool.draft.any() == (tool.depth > 0.0).any() for tool in tools)


@both_vehicles
def test_a_steered_mirror_image_is_mirrored(vehicle):
    def run(sign):
        plant = plant_on(flat((60.0, 60.0)), SoilMap(900.0), vehicle=vehicle, implement=Implement())
        plant.reset(0.0, 0.0, 0.0, 1.0)
        return plant.advance(Command(0.2 * sign, 0.1 * sign, 0.9 / top_speed(vehicle)), 3000)

    left, right = run(1.0), run(-1.0)
    assert abs(left.tool.side.sum()) > 10.0
    assert right.tool.side.sum() == pytest.approx(-left.tool.side.sum(), rel=1e-4)
    assert right.tool.y == pytest.approx(-left.tool.y, abs=1e-5)
