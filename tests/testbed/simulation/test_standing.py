"""A run starts with a vehicle that stands on its wheels, or with a refusal that says why not."""

import math

import numpy as np
import pytest
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.scenario.scenario import load, shipped
from proving_ground.testbed.errors import InvalidPlant
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.features import Bump
from proving_ground.testbed.vehicle.vehicle import AxleLoads, overload_notes

from tests.testbed.plants import SMALL, both_vehicles, changed, plant_on, weight

OVER_THE_FRONT_AXLE = Bump(x_m=1.4, y_m=0.0, width_m=0.6, length_m=0.2, height_m=0.28)
GROUNDED = terrain.flat((60.0, 40.0), spacing_m=0.05).shaped([OVER_THE_FRONT_AXLE])
STEEP = terrain.flat((60.0, 40.0)).tilted(math.radians(35.0), math.radians(90.0))


@both_vehicles
@pytest.mark.parametrize("share", [0.5, 1.5])
def test_a_load_rests_on_the_wheels_alone(vehicle, share):
    """The wheels carry the weight, those of the trailer the share that the closed form gives."""
    loaded = changed(vehicle, "load", mass_kg=share * vehicle.trailer.mass_kg)
    plant = plant_on(vehicle=loaded)
    load = plant.reset(0.0, 0.0, 0.0, 0.0).wheels.load
    assert load[4:].sum() == pytest.approx(AxleLoads.of(loaded).trailer, rel=0.02)
    assert load.sum() == pytest.approx(weight(plant), rel=1e-3)


@both_vehicles
@pytest.mark.parametrize("mass_kg", [100.0, 5000.0])
def test_the_height_of_the_load_is_from_the_ground_and_its_underside_above_the_floor(
    vehicle, mass_kg
):
    height = vehicle.box.floor_m + 0.25
    plant = plant_on(vehicle=changed(vehicle, "load", mass_kg=mass_kg, height_m=height))
    model, data = plant.model, plant.data
    data.qpos[2] = vehicle.rear_wheel.radius_m  # unloaded tyres just touch level ground
    plant.restore(plant.snapshot())
    body = model.body("load")
    assert data.xipos[body.id, 2] == pytest.approx(height, abs=1e-6)
    # inertia of a box of thickness t: m/12 (w^2 + t^2) about x, m/12 (l^2 + t^2), m/12 (l^2 + w^2)
    about_x, about_y, about_z = np.sort(body.inertia)
    thickness = math.sqrt(6.0 / mass_kg * (about_x + about_y - about_z))
    assert 0.0 < 0.5 * thickness <= height - vehicle.box.floor_m + 1e-9


@pytest.mark.parametrize(
    ("ground", "kg", "cause"),
    [
        (
            None,
            6000.0,
            "the trailer_(left|right) tyre is pressed flat on its rim.* times its rated load",
        ),
        (GROUNDED, 0.0, "the front_axle touches the ground"),
        (STEEP, 1500.0, "the trailer.* touches the ground"),
    ],
)
def test_a_vehicle_that_does_not_stand_on_its_wheels_is_refused(ground, kg, cause):
    plant = plant_on(ground, vehicle=changed(SMALL, "load", mass_kg=kg))
    with pytest.raises(InvalidPlant, match=r"reset: at \(0\.0, 0\.0\) m " + cause):
        plant.reset(0.0, 0.0, 0.0, 0.0)


def test_a_vehicle_that_is_held_up_by_something_else_is_refused():
    """A tenth of the weight is taken off by a force from above."""
    plant = plant_on()
    settle = plant._settle

    def lifted(x, y):
        plant.data.xfrc_applied[plant.model.body("trailer").id, 2] = 0.1 * weight(plant)
        settle(x, y)
        plant.data.xfrc_applied[plant.model.body("trailer").id, 2] = 0.0

    plant._settle = lifted
    with pytest.raises(InvalidPlant, match="the ground carries 90% of its weight"):
        plant.reset(0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("name", shipped())
def test_every_shipped_scenario_starts(name):
    assemble(load(name)[1], seed=4)  # puts the vehicle to its start


@both_vehicles
def test_tyres_beyond_their_rated_load_are_named_with_their_share(vehicle):
    assert overload_notes(vehicle) == ()
    heavy = changed(vehicle, "load", mass_kg=2.0 * vehicle.trailer.mass_kg)
    share = 0.5 * AxleLoads.of(heavy).trailer / heavy.trailer_wheel.rated_load_n
    (note,) = overload_notes(heavy)
    assert note.startswith(f"trailer tyres overloaded: each carries {share:.1f} times")
