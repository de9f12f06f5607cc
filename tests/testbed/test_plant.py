import dataclasses
import hashlib
import itertools
import math
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.optimize import curve_fit

from testbed import terrain
from testbed.errors import InvalidPlant, PlantDiverged
from testbed.plant import Plant
from testbed.servos import equilibrium_slip, wheel_loads
from testbed.soil import SoilMap
from testbed.truth import WHEELS
from testbed.vehicle_file import read_vehicle, shipped_vehicles
from ttempc.types import Command

ROOT = Path(__file__).parents[2]
HARD = SoilMap.named("hard")
SIDES = ("left", "right")
STOP = Command(0.0, 0.0, 0.0)
ROLL = Command(0.0, 0.0, 1.0 / 1.4)
SMALL = read_vehicle()
both_vehicles = pytest.mark.parametrize(
    "vehicle", [read_vehicle(name) for name in shipped_vehicles()], ids=shipped_vehicles()
)
DRIVEN, TOWED = [2, 3], [0, 1, 4, 5]


def plant_on(ground=None, soil=HARD, vehicle=None, **options):
    return Plant(vehicle or SMALL, ground or terrain.flat((60.0, 40.0)), soil, **options)


def changed(vehicle, table, **keys):
    """Return the vehicle with some keys of one table of its file changed."""
    return dataclasses.replace(
        vehicle, **{table: dataclasses.replace(getattr(vehicle, table), **keys)}
    )


def as_strong(cone_index, vehicle):
    """Return the soil whose cone index over ground pressure is what `cone_index` is to SMALL."""
    large, small = (
        (wheel_loads(each)[4:].sum()) / (each.trailer_wheel.width_m * each.trailer_wheel.radius_m)
        for each in (vehicle, SMALL)
    )
    return SoilMap(cone_index * large / small)


def top_speed(vehicle):
    return vehicle.hydrostat.speed_gain_mps


def weight(plant):
    return -plant.model.opt.gravity[2] * plant.model.body_mass.sum()


def axle_points(truth):
    return np.array([truth.tractor.x, truth.tractor.y, truth.trailer.x, truth.trailer.y])


def state_hash(plant):
    snapshot = plant.snapshot()
    return hashlib.sha256(snapshot.physics.tobytes() + snapshot.deflection.tobytes()).hexdigest()


def rough_run(seed, steps=1000):
    plant = plant_on(terrain.rough("E", np.random.default_rng(seed), (30.0, 20.0)), SoilMap(300.0))
    plant.reset(-5.0, 0.0, 0.2, 1.0)
    plant.advance(Command(0.2, -0.1, 0.8), steps)
    return plant


# --- at rest ---------------------------------------------------------------------------------


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


# --- driving ---------------------------------------------------------------------------------


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
        equilibrium_slip(plant.tyres, load, soil.background, pull), abs=0.005
    )
    assert np.abs(slip[TOWED]).max() < 0.005


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
def test_cornering_is_near_ackermann_on_firm_ground_and_falls_with_strength(vehicle):
    wheelbase, ratios = vehicle.tractor.wheelbase_m, []
    radius = wheelbase / 0.14
    for cone_index in (2000.0, 600.0, 300.0, 150.0):
        soil = as_strong(cone_index, vehicle)
        plant = plant_on(terrain.flat((60.0, 60.0)), soil, vehicle)
        plant.reset(0.0, -radius, 0.0, 1.0)
        command = Command(math.atan(wheelbase / radius), 0.0, 1.0 / top_speed(vehicle))
        plant.advance(command, 7500)
        truth = plant.advance(command, 1)
        ratios.append(truth.yaw_rate_t / (truth.speed * math.tan(truth.delta_t) / wheelbase))
    assert ratios[0] == pytest.approx(0.96, abs=0.02)
    assert all(firm > soft for firm, soft in itertools.pairwise(ratios))
    assert ratios[-1] > 0.8


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


# --- geometry and signs ----------------------------------------------------------------------


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


def test_positive_trailer_steering_moves_the_trailer_to_the_right_first():
    plant = plant_on()
    plant.reset(0.0, 0.0, 0.0, 1.0)
    truths = [plant.advance(Command(0.0, 0.2, 1.0 / 1.4), 25) for _ in range(100)]
    offset = np.array([t.trailer.y for t in truths])
    assert offset[:20].min() < -0.01
    assert offset[:20].max() < 1e-3


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


@both_vehicles
def test_hitch_kinematics_hold_with_the_sign_of_the_steering_rate(vehicle):
    """The trailer axle rolls without side slip behind two hinges; lambda = psi_t - psi_i.

    psi_i' (L_i + d cos delta_i) = v sin lambda - a psi_t' cos lambda - d delta_i' cos delta_i
    """
    plant = plant_on(terrain.flat((60.0, 60.0)), vehicle=vehicle)
    plant.reset(-20.0, 0.0, 0.0, 1.0)
    rows = []
    for k in range(750):
        t = 0.02 * k
        command = Command(
            0.25 * math.sin(0.5 * t), 0.3 * math.sin(1.3 * t), 1.0 / top_speed(vehicle)
        )
        truth = plant.advance(command, 10)
        lam = truth.tractor.yaw - truth.trailer.yaw
        rows.append((truth.speed, lam, truth.delta_i, truth.yaw_rate_t, truth.yaw_rate_i))
    v, lam, delta_i, rate_t, rate_i = np.array(rows).T
    delta_i_rate = np.gradient(delta_i, 0.02)
    a, d, length = (
        *(vehicle.hitch.offset_m, vehicle.drawbar.length_m),
        vehicle.trailer.length_m,
    )

    def residual(sign):
        numerator = (
            v * np.sin(lam) - a * rate_t * np.cos(lam) - sign * d * delta_i_rate * np.cos(delta_i)
        )
        error = rate_i - numerator / (length + d * np.cos(delta_i))
        return np.sqrt(np.mean(error[50:] ** 2))

    assert residual(1.0) < 0.01
    assert residual(1.0) < 0.1 * residual(-1.0)


# --- actuators -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["delta_t", "delta_i"])
@both_vehicles
def test_steering_has_its_rate_its_lag_and_its_stop(vehicle, name):
    steering = vehicle.front_steering if name == "delta_t" else vehicle.trailer_steering
    limit, rate = math.radians(steering.limit_deg), math.radians(steering.rate_degps)
    plant = plant_on(vehicle=vehicle)
    plant.reset(0.0, 0.0, 0.0, 1.0)
    command = dataclasses.replace(
        Command(0.0, 0.0, 1.0 / top_speed(vehicle)), **{name: 1.5}
    )  # far beyond the stop
    angle = np.array([getattr(plant.advance(command, 5), name) for _ in range(400)])
    speed = np.diff(angle) / 0.01
    assert speed.max() == pytest.approx(rate, rel=0.05)
    assert angle[-1] == pytest.approx(limit, abs=math.radians(0.6))
    assert angle.max() < limit + math.radians(0.6)
    # behind a ramp a first-order lag trails by its time constant
    time = 0.01 * np.arange(1, 401)
    middle = np.searchsorted(angle, 0.7 * limit)
    assert time[middle] - angle[middle] / rate == pytest.approx(steering.lag_s, rel=0.25)


@both_vehicles
def test_joints_have_the_stops_of_the_file(vehicle):
    model = plant_on(vehicle=vehicle).model
    for joint, limit_deg in (
        ("front_axle_roll", vehicle.front_axle.pivot_limit_deg),
        ("rj1_yaw", vehicle.hitch.yaw_limit_deg),
        ("rj1_pitch", vehicle.hitch.pitch_limit_deg),
        ("rj2_yaw", vehicle.trailer_steering.limit_deg),
    ):
        assert model.joint(joint).range == pytest.approx(np.radians([-limit_deg, limit_deg]))


# --- reproducibility -------------------------------------------------------------------------


def test_same_seed_gives_the_same_bits_in_another_process():
    here = state_hash(rough_run(7))
    code = "import tests.testbed.test_plant as t; print(t.state_hash(t.rough_run(7)))"
    there = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    assert there.stdout.strip() == here
    assert state_hash(rough_run(8)) != here


@pytest.mark.parametrize("wheels", ["soil", "contact"])
def test_restored_snapshot_goes_on_as_before(wheels):
    ground = terrain.rough("E", np.random.default_rng(1), (30.0, 20.0))
    plant = plant_on(ground, SoilMap(300.0), wheels=wheels)
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


def test_advancing_in_pieces_is_advancing():
    whole, pieces = rough_run(3, 600), rough_run(3, 0)
    for steps in (1, 99, 500):
        pieces.advance(Command(0.2, -0.1, 0.8), steps)
    assert state_hash(pieces) == state_hash(whole)


def test_truth_is_a_copy():
    plant = plant_on()
    before = plant.reset(0.0, 0.0, 0.0, 1.0)
    kept = before.body_xyz.copy(), before.wheels.load.copy()
    plant.advance(Command(0.3, 0.0, 0.7), 200)
    np.testing.assert_array_equal(before.body_xyz, kept[0])
    np.testing.assert_array_equal(before.wheels.load, kept[1])


# --- what goes wrong -------------------------------------------------------------------------


def test_high_load_on_a_steep_side_slope_rolls_the_trailer_over():
    ground = terrain.flat((40.0, 40.0)).tilted(math.radians(35.0), math.radians(90.0))
    vehicle = changed(SMALL, "load", mass_kg=400.0, height_m=1.0)
    plant = plant_on(ground, SoilMap(600.0), vehicle)
    plant.reset(0.0, 10.0, 0.0, 0.0)
    rolls = [plant.advance(STOP, 50).trailer.roll for _ in range(20)]
    assert max(rolls) - math.radians(35.0) > math.radians(60.0)  # positive: left side up
    empty = plant_on(ground, SoilMap(600.0))
    empty.reset(0.0, 10.0, 0.0, 0.0)
    rolls = [empty.advance(STOP, 50).trailer.roll for _ in range(20)]
    assert max(rolls) - math.radians(35.0) < math.radians(10.0)


@pytest.mark.parametrize("wheels", ["soil", "contact"])
@both_vehicles
def test_tipped_past_its_balance_it_ends_on_its_side_and_stays_there(vehicle, wheels):
    plant = plant_on(vehicle=vehicle, wheels=wheels)
    plant.reset(0.0, 0.0, 0.0, 0.0)
    half = 0.5 * math.radians(55.0)
    plant.data.qpos[2] += 1.1 * vehicle.rear_wheel.radius_m
    plant.data.qpos[3:7] = math.cos(half), math.sin(half), 0.0, 0.0
    mujoco.mj_step1(plant.model, plant.data)
    plant.advance(STOP, 2500)
    depth = []
    for _ in range(50):
        lying = plant.advance(STOP, 5)
        assert 60.0 < math.degrees(lying.tractor.roll) < 120.0
        assert np.abs(plant.data.qvel[:6]).max() < 0.3
        depth += [contact.dist for contact in plant.data.contact]
    # what touches the ground does not sink into it
    assert depth
    assert min(depth) > -0.03


def test_nan_is_told_as_a_divergence(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its own log beside the user
    plant = plant_on()
    plant.reset(0.0, 0.0, 0.0, 1.0)
    plant.data.qvel[0] = math.nan
    with pytest.raises(PlantDiverged):
        plant.advance(ROLL, 10)


def test_silent_reset_of_mujoco_is_told_as_a_divergence(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plant = plant_on()
    plant.reset(0.0, 0.0, 0.0, 1.0)
    plant.advance(ROLL, 100)
    plant.data.qpos[0] = 1e12
    with pytest.raises(PlantDiverged, match=r"BADQPOS|time went|BADQACC"):
        plant.advance(ROLL, 10)


def test_command_that_is_not_finite_is_told_as_a_divergence(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plant = plant_on()
    plant.reset(0.0, 0.0, 0.0, 1.0)
    with pytest.raises(PlantDiverged):
        plant.advance(Command(math.nan, 0.0, 0.5), 10)


def test_guard_passes_after_reset(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plant = plant_on()
    plant.reset(0.0, 0.0, 0.0, 1.0)
    plant.data.qvel[0] = math.nan
    with pytest.raises(PlantDiverged):
        plant.advance(ROLL, 10)
    plant.reset(0.0, 0.0, 0.0, 1.0)
    assert plant.advance(ROLL, 10).time_s == pytest.approx(0.02)


@pytest.mark.parametrize(
    "make",
    [
        lambda: plant_on(timestep_s=0.0),
        lambda: plant_on(timestep_s=0.1),
        lambda: plant_on(timestep_s=math.nan),
        lambda: plant_on(wheels="tracks"),
        lambda: plant_on().reset(math.nan, 0.0, 0.0, 0.0),
        lambda: plant_on().reset(500.0, 0.0, 0.0, 0.0),
    ],
)
def test_impossible_plants_are_refused(make):
    with pytest.raises(InvalidPlant):
        make()


# --- the second wheel model ------------------------------------------------------------------


def test_native_wheels_agree_with_soil_wheels_on_firm_level_ground():
    truths = []
    for wheels in ("soil", "contact"):
        plant = plant_on(wheels=wheels)
        plant.reset(-10.0, 0.0, 0.0, 1.0)
        truths.append(plant.advance(Command(0.1, 0.0, 1.0 / 1.4), 2500))
    soil, native = truths
    np.testing.assert_allclose(axle_points(native), axle_points(soil), atol=0.25)
    assert native.speed == pytest.approx(soil.speed, rel=0.04)
    assert native.beta == pytest.approx(soil.beta, abs=0.02)
    assert np.isnan(native.wheels.slip).all()
    assert np.isfinite(native.wheels.load).all()


def test_wheels_are_reported_in_the_order_of_their_names():
    plant = plant_on()
    places = plant.reset(0.0, 0.0, 0.0, 0.0).body_xyz
    for wheel in WHEELS:
        x, y, _ = places[plant.body_names.index(wheel)]
        assert (y > 0.0) == wheel.endswith("left")
        assert (x > 1.0) == wheel.startswith("front")
        assert (x < -1.0) == wheel.startswith("trailer")
