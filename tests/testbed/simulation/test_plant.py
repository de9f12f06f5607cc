"""The plant: at rest, driving, at its limits; a start on wheels alone; the same bits again."""

import math

import mujoco
import numpy as np
import pytest
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.scenario.scenario import load, shipped
from proving_ground.testbed.errors import InvalidPlant, PlantDiverged
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.features import Bump
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.truth import WHEELS

from tests.testbed.plants import (
    ROLL,
    SMALL,
    STOP,
    axle_points,
    both_vehicles,
    changed,
    plant_on,
    state_hash,
    top_speed,
    weight,
)
from ttempc.types import Command

SIDE_SLOPE = math.radians(35.0)
OVER_THE_FRONT_AXLE = Bump(x_m=1.4, y_m=0.0, width_m=0.6, length_m=0.2, height_m=0.28)
GROUNDED = terrain.flat((60.0, 40.0), spacing_m=0.05).shaped([OVER_THE_FRONT_AXLE])
STEEP = terrain.flat((60.0, 40.0)).tilted(SIDE_SLOPE, math.radians(90.0))


@pytest.mark.parametrize(("slope_deg", "uphill_deg"), [(0, 0), (15, 90), (10, 45), (12, 180)])
@both_vehicles
def test_wheels_carry_the_weight_at_rest(vehicle, slope_deg, uphill_deg):
    slope = math.radians(slope_deg)
    ground = terrain.flat((20.0, 20.0)).tilted(slope, math.radians(uphill_deg))
    plant = plant_on(ground, vehicle=vehicle)
    loads = plant.reset(0.0, 0.0, 0.0, 0.0).wheels.load
    assert loads.sum() == pytest.approx(weight(plant) * math.cos(slope), rel=0.005)
    assert (loads > 0.0).all()


@both_vehicles
def test_it_weighs_what_its_file_says_and_load_adds_to_the_trailer(vehicle):
    empty, loaded = (
        plant_on(vehicle=changed(vehicle, "load", mass_kg=mass)) for mass in (0.0, 300.0)
    )
    before, after = (p.reset(0.0, 0.0, 0.0, 0.0).wheels.load for p in (empty, loaded))
    towed = empty.model.body("drawbar").subtreemass[0]
    tractor = empty.model.body("tractor").subtreemass[0] - towed
    assert tractor == pytest.approx(vehicle.tractor.mass_kg)
    assert towed == pytest.approx(vehicle.trailer.mass_kg + vehicle.drawbar.mass_kg)
    assert after.sum() - before.sum() == pytest.approx(300.0 * 9.81, rel=0.005)
    assert after[4:].sum() - before[4:].sum() == pytest.approx(300.0 * 9.81, rel=0.1)


@both_vehicles
def test_lengths_are_those_of_the_file(vehicle):
    longer = changed(changed(vehicle, "hitch", offset_m=0.85), "drawbar", length_m=1.3)
    for each in (vehicle, longer):
        plant = plant_on(vehicle=each)
        start = plant.reset(1.0, 2.0, 0.7, 0.0)
        assert (start.tractor.x, start.tractor.y) == pytest.approx((1.0, 2.0), abs=1e-9)
        assert start.tractor.yaw == pytest.approx(0.7, abs=1e-6)
        behind = np.hypot(*(axle_points(start)[:2] - axle_points(start)[2:]))
        expected = each.hitch.offset_m + each.drawbar.length_m + each.trailer.length_m
        assert behind == pytest.approx(expected, abs=0.01)
        front = start.body_xyz[plant.body_names.index("front_axle")]
        rear = start.body_xyz[plant.body_names.index("tractor")]
        assert np.hypot(*(front - rear)[:2]) == pytest.approx(each.tractor.wheelbase_m, abs=0.005)


@pytest.mark.parametrize("iso_class", ["D", "F"])
@pytest.mark.parametrize("timestep_s", [0.001, 0.004])
@both_vehicles
def test_rough_ground_keeps_loads_positive_at_every_time_step(vehicle, iso_class, timestep_s):
    ground = terrain.rough(iso_class, np.random.default_rng(1), (40.0, 20.0))
    plant = plant_on(ground, SoilMap(600.0), vehicle, timestep_s=timestep_s)
    plant.reset(-8.0, 0.0, 0.0, 1.0)
    steps = round(0.05 / timestep_s)
    roll = Command(0.0, 0.0, 1.0 / top_speed(vehicle))
    loads = np.array([plant.advance(roll, steps).wheels.load for _ in range(200)])
    assert (loads >= 0.0).all()
    assert (loads == 0.0).mean() < 0.01
    assert loads.sum(axis=1).mean() == pytest.approx(weight(plant), rel=0.01)


# --- limits


@both_vehicles
def test_tipped_past_its_balance_it_ends_on_its_side_and_stays_there(vehicle):
    plant = plant_on(vehicle=vehicle)
    plant.reset(0.0, 0.0, 0.0, 0.0)
    half = 0.5 * math.radians(55.0)
    plant.data.qpos[2] += 1.1 * vehicle.rear_wheel.radius_m
    plant.data.qpos[3:7] = math.cos(half), math.sin(half), 0.0, 0.0
    mujoco.mj_step1(plant.model, plant.data)
    # the tumble is chaotic: with the last bits of another processor's BLAS kernels it takes 7 s
    plant.advance(STOP, 5000)
    depth, places, rolls = [], [], []
    for _ in range(50):
        rolls.append(math.degrees(plant.advance(STOP, 5).tractor.roll))
        places.append(plant.data.qpos[:3].copy())
        depth += [contact.dist for contact in plant.data.contact]
    assert 60.0 < min(rolls) <= max(rolls) < 120.0
    # it may shake on its corners
    assert np.ptp(places, axis=0).max() < 0.05
    assert np.ptp(rolls) < 1.0
    # what touches the ground does not sink into it
    assert depth
    assert min(depth) > -0.03


@pytest.mark.parametrize(
    "make",
    [
        lambda: plant_on(timestep_s=0.0),
        lambda: plant_on(timestep_s=0.1),
        lambda: plant_on(timestep_s=math.nan),
        lambda: plant_on().reset(math.nan, 0.0, 0.0, 0.0),
        lambda: plant_on().reset(500.0, 0.0, 0.0, 0.0),
    ],
)
def test_impossible_plants_are_refused(make):
    with pytest.raises(InvalidPlant):
        make()


def test_wheels_are_reported_in_the_order_of_their_names():
    plant = plant_on()
    places = plant.reset(0.0, 0.0, 0.0, 0.0).body_xyz
    for wheel in WHEELS:
        x, y, _ = places[plant.body_names.index(wheel)]
        assert (y > 0.0) == wheel.endswith("left")
        assert (x > 1.0) == wheel.startswith("front")
        assert (x < -1.0) == wheel.startswith("trailer")


def test_a_state_or_command_that_is_not_finite_is_a_divergence_and_a_reset_mends_it(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes MUJOCO_LOG.TXT to the working directory
    plant = plant_on()
    for place, value, command in (
        ("qvel", math.nan, ROLL),
        ("qpos", 1e12, ROLL),  # MuJoCo resets itself in silence
        ("qvel", 1.0, Command(math.nan, 0.0, 0.5)),
    ):
        plant.reset(0.0, 0.0, 0.0, 1.0)
        assert plant.advance(ROLL, 10).time_s == pytest.approx(0.02)
        getattr(plant.data, place)[0] = value
        with pytest.raises(PlantDiverged):
            plant.advance(command, 10)


# --- motion


def test_positive_front_steering_turns_left_and_angles_follow_their_definitions():
    plant = plant_on()
    plant.reset(0.0, 0.0, 0.0, 1.0)
    truth = plant.advance(Command(0.2, 0.1, 1.0 / 1.4), 1500)
    assert truth.tractor.y > 0.3
    assert truth.yaw_rate_t > 0.0
    assert truth.beta == pytest.approx(truth.tractor.yaw - truth.psi_d, abs=1e-3)
    assert truth.delta_i == pytest.approx(truth.psi_d - truth.trailer.yaw, abs=1e-3)
    assert truth.delta_t == pytest.approx(0.2, abs=2e-3)
    assert truth.delta_i == pytest.approx(0.1, abs=2e-3)


@both_vehicles
def test_knuckles_follow_ackermann(vehicle):
    plant, wheelbase = plant_on(vehicle=vehicle), vehicle.tractor.wheelbase_m
    for command in (-0.6, -0.3, 0.15, 0.5):
        plant.reset(0.0, 0.0, 0.0, 1.0)
        truth = plant.advance(Command(command, 0.0, 1.0 / top_speed(vehicle)), 1500)
        for side, name in ((1.0, "knuckle_left"), (-1.0, "knuckle_right")):
            half = side * plant.model.body(name).pos[1] * side
            tangent = math.tan(truth.delta_t)
            expected = math.atan2(wheelbase * tangent, wheelbase - half * tangent)
            assert plant.data.joint(name).qpos[0] == pytest.approx(expected, abs=math.radians(0.1))


def test_restored_snapshot_goes_on_as_before():
    ground = terrain.rough("E", np.random.default_rng(1), (30.0, 20.0))
    plant = plant_on(ground, SoilMap(300.0))
    plant.reset(-5.0, 0.0, 0.2, 1.0)
    command = Command(0.3, -0.1, 0.8)
    plant.advance(command, 500)
    snapshot = plant.snapshot()
    first = plant.advance(command, 500), state_hash(plant)
    plant.advance(Command(-0.3, 0.2, 0.1), 700)
    restored = plant.restore(snapshot)
    assert restored.time_s == pytest.approx(1.0)
    again = plant.advance(command, 500), state_hash(plant)
    assert again[1] == first[1]
    np.testing.assert_array_equal(again[0].wheels.load, first[0].wheels.load)
    np.testing.assert_array_equal(again[0].body_xyz, first[0].body_xyz)


@pytest.mark.parametrize(("cone_index", "timestep_s"), [(200.0, 0.004), (2000.0, 0.002)])
def test_a_coasting_vehicle_stops_without_rolling_back_or_rocking(cone_index, timestep_s):
    plant = plant_on(soil=SoilMap(cone_index), timestep_s=timestep_s)
    plant.reset(0.0, 0.0, 0.0, 0.5)
    plant.model.actuator("hydrostat").forcerange[:] = 0.0
    steps = round(0.02 / timestep_s)
    truths = [plant.advance(Command(0.0, 0.0, 0.0), steps) for _ in range(150)]
    x = np.array([(truth.tractor.x, truth.trailer.x) for truth in truths])
    assert (x.max(axis=0) - x[-1]).max() < 0.0015
    assert np.abs([truth.speed for truth in truths[-50:]]).max() < 1e-4


# --- the start


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
        # the trailer, on two wheels, tips over, so slowly that it is not down when the time is up
        (STEEP, 1500.0, "the vehicle does not come to rest on its wheels: the ground carries 1"),
    ],
)
def test_a_vehicle_that_does_not_stand_on_its_wheels_is_refused(ground, kg, cause):
    plant = plant_on(ground, vehicle=changed(SMALL, "load", mass_kg=kg))
    with pytest.raises(InvalidPlant, match=r"reset: at \(0\.0, 0\.0\) m " + cause):
        plant.reset(0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("name", shipped())
def test_every_shipped_scenario_starts(name):
    assemble(load(name)[1], seed=4)  # puts the vehicle to its start
