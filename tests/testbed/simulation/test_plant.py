"""The plant at rest and driving: loads, drive, traction, cornering."""

import itertools
import math

import mujoco
import numpy as np
import pytest
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.validation.bench import nominal
from proving_ground.testbed.validation.steady_motion import Planar, steady_motion
from proving_ground.testbed.vehicle.servos import equilibrium_slip, wheel_loads
from proving_ground.testbed.wheels.tyre import mobility
from scipy.optimize import curve_fit

from tests.testbed.plants import (
    DRIVEN,
    ROLL,
    SIDES,
    SMALL,
    STOP,
    TOWED,
    as_strong,
    axle_points,
    both_vehicles,
    changed,
    plant_on,
    top_speed,
    weight,
)
from ttempc.types import Command


@pytest.mark.parametrize(("slope_deg", "uphill_deg"), [(0, 0), (15, 90), (10, 45), (12, 180)])
@pytest.mark.parametrize("wheels", ["soil", "contact"])
@both_vehicles
def test_wheels_carry_the_weight_at_rest(vehicle, slope_deg, uphill_deg, wheels):
    slope = math.radians(slope_deg)
    ground = terrain.flat((20.0, 20.0)).tilted(slope, math.radians(uphill_deg))
    plant = plant_on(ground, vehicle=vehicle, wheels=wheels)
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
def test_axles_carry_what_the_moments_of_the_file_say(vehicle):
    plant = plant_on(vehicle=vehicle)
    plant.reset(0.0, 0.0, 0.0, 0.0)
    data, model = plant.data, plant.model
    mujoco.mj_comPos(model, data)
    tractor = model.body("tractor").id
    towed = model.body("drawbar").id
    whole, behind = model.body_subtreemass[tractor], model.body_subtreemass[towed]
    moment = whole * data.subtree_com[tractor] - behind * data.subtree_com[towed]
    centre = moment / (whole - behind) - data.xpos[tractor]
    assert centre[0] == pytest.approx(vehicle.tractor.centre_forward_m, abs=0.01)  # it has sunk in
    height = vehicle.tractor.centre_height_m - vehicle.rear_wheel.radius_m
    assert centre[2] == pytest.approx(height, abs=0.02)
    loads = plant.advance(STOP, 1000).wheels.load
    np.testing.assert_allclose(loads, wheel_loads(vehicle), rtol=0.05)


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


@both_vehicles
def test_wheels_are_as_large_as_apart_and_as_heavy_as_the_file_says(vehicle):
    plant = plant_on(vehicle=vehicle)
    start = plant.reset(0.0, 0.0, 0.0, 0.0)
    drawn = plant.drawn_model()
    tracks = (vehicle.front_axle.track_m, vehicle.tractor.rear_track_m, vehicle.trailer.track_m)
    for (pair, wheel), track in zip(vehicle.wheels.items(), tracks, strict=True):
        left, right = (start.body_xyz[plant.body_names.index(f"{pair}_{side}")] for side in SIDES)
        assert np.hypot(*(left - right)[:2]) == pytest.approx(track, abs=0.005)
        for side in SIDES:
            radius, half_width = drawn.geom(f"{pair}_{side}_tyre").size[:2]
            assert radius == pytest.approx(wheel.radius_m)
            assert half_width == pytest.approx(0.5 * wheel.width_m)
            assert plant.model.body(f"{pair}_{side}").mass[0] == pytest.approx(wheel.mass_kg)


def test_an_inertia_in_the_file_is_that_of_the_chassis():
    vehicle = changed(SMALL, "tractor", chassis_inertia_kgm2=(80.0, 190.0, 210.0))
    body = plant_on(vehicle=vehicle).model.body("tractor")
    assert sorted(body.inertia) == pytest.approx([80.0, 190.0, 210.0])


@both_vehicles
def test_standing_on_a_side_slope_it_creeps_less_than_5_mm_in_30_s(vehicle):
    ground = terrain.flat((20.0, 20.0)).tilted(math.radians(15.0), math.radians(90.0))
    plant = plant_on(ground, SoilMap(600.0), vehicle)
    before = axle_points(plant.reset(0.0, 0.0, 0.0, 0.0))
    after = axle_points(plant.advance(STOP, 15_000))
    assert np.abs(after - before).max() < 0.005


@both_vehicles
def test_hydrostat_step_identifies_the_gain_and_time_constant_of_the_file(vehicle):
    plant = plant_on(terrain.flat((90.0, 10.0)), vehicle=vehicle)
    plant.reset(-35.0, 0.0, 0.0, 0.0)
    truths = [plant.advance(Command(0.0, 0.0, 1.0), 25) for _ in range(250)]
    time = np.array([t.time_s for t in truths])
    speed = np.array([t.speed for t in truths])
    (gain, tau), _ = curve_fit(lambda t, k, T: k * (1.0 - np.exp(-t / T)), time, speed, (1.0, 1.0))
    assert gain == pytest.approx(vehicle.hydrostat.speed_gain_mps, rel=0.05)
    assert tau == pytest.approx(vehicle.hydrostat.time_constant_s, rel=0.05)
    # the encoder sees the rim, the ground sees less
    assert truths[-1].rim_speed > truths[-1].speed
    assert truths[-1].hp == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("cone_index", [300.0, 900.0, 2000.0])
@pytest.mark.parametrize("share", [0.0, 0.08])
@both_vehicles
def test_slip_under_drawbar_pull_is_that_of_the_traction_equation(vehicle, cone_index, share):
    soil = as_strong(cone_index, vehicle)
    plant = plant_on(terrain.flat((80.0, 20.0)), soil, vehicle)
    plant.reset(-30.0, 0.0, 0.0, 0.5 * top_speed(vehicle))
    pull = share * weight(plant)
    plant.data.xfrc_applied[plant.model.body("tractor").id, 0] = -pull
    plant.advance(Command(0.0, 0.0, 0.5), 5000)
    wheels = [plant.advance(Command(0.0, 0.0, 0.5), 25).wheels for _ in range(20)]
    load = np.mean([w.load for w in wheels], axis=0)
    slip = np.mean([w.slip for w in wheels], axis=0)
    assert slip[DRIVEN].mean() == pytest.approx(
        equilibrium_slip(plant.wheel_law, plant.tyres, load, soil.background, pull), abs=0.005
    )
    bn, _ = mobility(plant.wheel_law, plant.tyres, load, np.full(6, soil.background))
    # a towed wheel turns by its skid
    np.testing.assert_allclose(slip[TOWED], plant.wheel_law.towed_slip(bn)[TOWED], atol=0.001)


def test_wheels_spin_on_soil_too_weak_to_carry_it():
    plant = plant_on(soil=SoilMap(60.0))
    plant.reset(0.0, 0.0, 0.0, 0.0)
    stuck = plant.advance(Command(0.0, 0.0, 1.0), 5000)
    assert stuck.speed < 0.05
    assert stuck.rim_speed > 1.0


def test_reset_starts_rolling_steadily():
    plant = plant_on()
    start = plant.reset(0.0, 0.0, 0.0, 1.0)
    assert start.time_s == 0.0
    assert start.speed == pytest.approx(1.0, abs=1e-9)
    assert start.rim_speed == pytest.approx(1.0, abs=1e-9)
    speeds = [plant.advance(ROLL, 50).speed for _ in range(50)]
    assert np.ptp([1.0, *speeds]) < 0.04  # while tread and traction build up


@both_vehicles
def test_cornering_is_the_planar_force_balance_and_the_yaw_rate_falls_with_strength(vehicle):
    wheelbase, ratios = vehicle.tractor.wheelbase_m, []
    radius = wheelbase / 0.14
    for cone_index in (2000.0, 600.0, 300.0, 150.0):
        soil = as_strong(cone_index, vehicle)
        plant = plant_on(terrain.flat((60.0, 60.0)), soil, vehicle)
        plant.reset(0.0, 0.0, 0.0, 0.0)
        planar = Planar.of(nominal(vehicle), plant)
        plant.reset(0.0, -radius, 0.0, 1.0)
        command = Command(math.atan(wheelbase / radius), 0.0, 1.0 / top_speed(vehicle))
        plant.advance(command, 7500)
        truth = plant.advance(command, 1)
        ackermann = truth.speed * math.tan(truth.delta_t) / wheelbase
        balance = steady_motion(
            planar, truth.delta_t, truth.speed, truth.wheels.load, soil.background
        )
        assert truth.yaw_rate_t == pytest.approx(balance.yaw_rate, abs=0.02 * ackermann)
        ratios.append(truth.yaw_rate_t / ackermann)
    assert all(firm > soft for firm, soft in itertools.pairwise(ratios))
    assert ratios[-1] > 0.7


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


def test_end_point_does_not_depend_on_the_time_step():
    ends = []
    for timestep_s in (0.001, 0.002):
        ground = terrain.rough("E", np.random.default_rng(2), (40.0, 20.0))
        plant = plant_on(ground, SoilMap(600.0), timestep_s=timestep_s)
        plant.reset(-12.0, 0.0, 0.0, 1.0)
        ends.append(axle_points(plant.advance(Command(0.03, 0.0, 0.7), round(15.0 / timestep_s))))
    np.testing.assert_allclose(*ends, atol=0.02)
