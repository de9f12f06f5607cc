"""A trailer without steering, forwards in tight turns and in reverse with the tractor's alone."""

import numpy as np
import pytest
from proving_ground.experiments.errors import InvalidScenario
from proving_ground.experiments.run.assembly import check
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.vehicle.vehicle import read_vehicle

PLAIN = (
    "plant.vehicle.parts.trailer_steering.limit_deg=0.0",
    "controller.vehicle.trailer_limit_deg=0.0",
)
EIGHT = "path={radius_m=8.0,centre_distance_m=24.0,laps=1}"
U_TURN = "path={kind='headland',length_m=12.0,width_m=10.0,passes=2,radius_m=5.0}"
REVERSE = "path={kind='straight',length_m=30.0,reverse=true}"
CONTROLLERS = ("ttempc", "lqr", "pid")


def driven(controller, path, seed, *further):
    """Return summary and record of the paper's vehicle with a plain trailer on grass."""
    overrides = [*PLAIN, path, f"controller.name={controller}", *further]
    return simulate(*load("grass", overrides), seed)


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_the_front_steering_alone_pushes_a_plain_trailer_back(controller):
    """Over 30 m within 20 cm; the trailer would fold by itself."""
    summary, record = driven(controller, REVERSE, 4101)
    assert summary.status == "completed"
    assert summary.tracking.all.trailer.cross_p95_m < 0.2
    assert summary.tracking.all.trailer.max_m < 0.2
    assert np.abs(record["/control"]["delta_i_rad_command"]).max() == 0.0
    assert (
        np.abs(record["/state"]["delta_i_rad"]).max() < 0.01
    )  # a welded drawbar gives way a little


def test_a_plain_trailer_is_towed_round_a_u_turn_of_5_m():
    summary, _ = driven("ttempc", U_TURN, 4102)
    assert summary.status == "completed"
    assert summary.tracking.all.trailer.cross_p95_m < 0.1
    assert 0.4 < summary.line.trailer_reference.max_m < 0.5  # as geometry has it


@pytest.mark.slow
@pytest.mark.parametrize("seed", [4103, 4104, 4105])
@pytest.mark.parametrize("path", [EIGHT, U_TURN, REVERSE], ids=["eight", "u-turn", "reverse"])
@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_plain_trailer_is_driven_by_every_controller(controller, path, seed):
    summary, _ = driven(controller, path, seed)
    assert summary.status == "completed"
    assert summary.tracking.all.trailer.cross_p95_m < 0.2


@pytest.mark.parametrize(("offset", "yaw_limit"), [(0.0, 35.0), (-0.2, 25.0), (0.9, 70.0)])
def test_the_hitch_may_be_before_on_or_behind_the_axle(offset, yaw_limit):
    summary, _ = driven(
        "pid",
        "path={kind='straight',length_m=12.0}",
        4106,
        f"plant.vehicle.hitch_offset_m={offset}",
        f"controller.vehicle.hitch_offset_m={offset}",
        f"plant.vehicle.parts.hitch.yaw_limit_deg={yaw_limit}",
    )
    assert summary.status == "completed"
    assert summary.tracking.all.trailer.max_m < 0.15


def test_a_drawbar_that_meets_the_wheels_is_refused_with_the_cure():
    with pytest.raises(InvalidScenario, match=r"hitch\.yaw_limit_deg.*lower it.*height_m >= 0\.8"):
        load("grass", [*PLAIN, "plant.vehicle.hitch_offset_m=-0.3"])


def test_the_shipped_plain_vehicle_has_no_steering_and_its_scenario_is_driven():
    vehicle = read_vehicle("tipper4500")
    assert vehicle.trailer_steering.limit_deg == 0.0
    _, scenario = load("plain-trailer", ["path.laps=1"])
    assert scenario.vehicles().model.is_plain
    assert check(scenario) > 100
