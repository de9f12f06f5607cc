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
from scipy.optimize import brentq, curve_fit

from testbed import terrain, tyre
from testbed.errors import InvalidPlant, PlantDiverged
from testbed.plant import Plant
from testbed.soil import SoilMap
from testbed.truth import WHEELS
from testbed.vehicle_model import PlantVehicle
from ttempc.types import Command
from ttempc.vehicle import Vehicle

ROOT = Path(__file__).parents[2]
HARD = SoilMap.named("hard")
STOP = Command(0.0, 0.0, 0.0)
ROLL = Command(0.0, 0.0, 1.0 / 1.4)
DRIVEN, TOWED = [2, 3], [0, 1, 4, 5]


def plant_on(ground=None, soil=HARD, vehicle=None, **options):
    return Plant(vehicle or PlantVehicle(), ground or terrain.flat((60.0, 40.0)), soil, **options)


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
def test_wheels_carry_the_weight_at_rest(slope_deg, uphill_deg, wheels):
    slope = math.radians(slope_deg)
    ground = terrain.flat((20.0, 20.0)).tilted(slope, math.radians(uphill_deg))
    plant = plant_on(ground, wheels=wheels)
    loads = plant.reset(0.0, 0.0, 0.0, 0.0).wheels.load
    assert loads.sum() == pytest.approx(weight(plant) * math.cos(slope), rel=0.005)
    assert (loads > 0.0).all()


def test_vehicle_weighs_what_the_brief_says_and_load_adds_to_the_trailer():
    empty, loaded = plant_on(), plant_on(vehicle=PlantVehicle(load_kg=300.0))
    before, after = (p.reset(0.0, 0.0, 0.0, 0.0).wheels.load for p in (empty, loaded))
    trailer = empty.model.body("drawbar").subtreemass[0]
    assert empty.model.body("tractor").subtreemass[0] - trailer == pytest.approx(750.0, rel=0.02)
    assert trailer == pytest.approx(500.0, rel=0.02)
    assert after.sum() - before.sum() == pytest.approx(300.0 * 9.81, rel=0.005)
    assert after[4:].sum() - before[4:].sum() == pytest.approx(300.0 * 9.81, rel=0.02)


def test_lengths_are_those_of_the_paper_and_of_the_scenario():
    for vehicle in (PlantVehicle(), PlantVehicle(hitch_offset_m=0.45, drawbar_m=1.2)):
        plant = plant_on(vehicle=vehicle)
        start = plant.reset(1.0, 2.0, 0.7, 0.0)
        assert (start.tractor.x, start.tractor.y) == pytest.approx((1.0, 2.0), abs=1e-9)
        assert start.tractor.yaw == pytest.approx(0.7, abs=1e-6)
        behind = np.hypot(*(axle_points(start)[:2] - axle_points(start)[2:]))
        expected = vehicle.hitch_offset_m + vehicle.drawbar_m + Vehicle().trailer_length
        assert behind == pytest.approx(expected, abs=0.005)
        front = start.body_xyz[plant.body_names.index("front_axle")]
        rear = start.body_xyz[plant.body_names.index("tractor")]
        assert np.hypot(*(front - rear)[:2]) == pytest.approx(Vehicle().wheelbase, abs=0.005)


def test_standing_on_a_side_slope_it_creeps_less_than_5_mm_in_30_s():
    ground = terrain.flat((20.0, 20.0)).tilted(math.radians(15.0), math.radians(90.0))
    plant = plant_on(ground, SoilMap(600.0))
    before = axle_points(plant.reset(0.0, 0.0, 0.0, 0.0))
    after = axle_points(plant.advance(STOP, 15_000))
    assert np.abs(after - before).max() < 0.005


# --- driving ---------------------------------------------------------------------------------


def test_hydrostat_step_identifies_the_gain_and_time_constant_of_the_paper():
    plant = plant_on(terrain.flat((60.0, 10.0)))
    plant.reset(-20.0, 0.0, 0.0, 0.0)
    truths = [plant.advance(Command(0.0, 0.0, 1.0), 25) for _ in range(250)]
    time = np.array([t.time_s for t in truths])
    speed = np.array([t.speed for t in truths])
    (gain, tau), _ = curve_fit(lambda t, k, T: k * (1.0 - np.exp(-t / T)), time, speed, (1.0, 1.0))
    assert gain == pytest.approx(Vehicle().speed_gain, rel=0.05)
    assert tau == pytest.approx(Vehicle().speed_time_constant, rel=0.05)
    # the encoder sees the rim, the ground sees less
    assert truths[-1].rim_speed > truths[-1].speed
    assert truths[-1].hp == pytest.approx(1.0, abs=0.01)


def test_hydrostat_calibration_is_what_the_traction_equation_asks_for():
    plant = plant_on()
    load = plant.reset(0.0, 0.0, 0.0, 0.0).wheels.load
    model = plant.model
    tyres = plant.tyres
    slip = equilibrium_slip(tyres, load, HARD.background, 0.0)
    bn, _ = tyre.mobility(tyres, load, np.full(6, HARD.background))
    torque = (load * tyre.gross_traction_ratio(bn, np.full(6, slip)) * tyres.radius)[DRIVEN].sum()
    servo = -model.actuator("hydrostat").biasprm[2]
    speed = model.numeric("hydrostat_speed_gain").data[0]
    droop = torque / servo * tyres.radius[2] / speed
    expected = 1.0 / (1.0 - slip) + droop
    assert model.numeric("hydrostat_calibration").data[0] == pytest.approx(expected, abs=0.002)


def equilibrium_slip(tyres, load, cone_index, pull):
    """Slip at which traction less all motion resistance equals the pull."""
    bn, _ = tyre.mobility(tyres, load, np.full(6, cone_index))

    def surplus(slip):
        slips = np.zeros(6)
        slips[DRIVEN] = slip
        net = tyre.gross_traction_ratio(bn, slips) - tyre.motion_resistance_ratio(bn, slips)
        return (load * net).sum() - pull

    return brentq(surplus, 0.0, 0.9)


@pytest.mark.parametrize("cone_index", [300.0, 900.0, 2000.0])
@pytest.mark.parametrize("pull", [0.0, 1000.0, 2000.0])
def test_slip_under_drawbar_pull_is_that_of_the_traction_equation(cone_index, pull):
    plant = plant_on(soil=SoilMap(cone_index))
    plant.reset(-20.0, 0.0, 0.0, 0.7)
    plant.data.xfrc_applied[plant.model.body("tractor").id, 0] = -pull
    plant.advance(Command(0.0, 0.0, 0.5), 5000)
    wheels = [plant.advance(Command(0.0, 0.0, 0.5), 25).wheels for _ in range(20)]
    load = np.mean([w.load for w in wheels], axis=0)
    slip = np.mean([w.slip for w in wheels], axis=0)
    assert slip[DRIVEN].mean() == pytest.approx(
        equilibrium_slip(plant.tyres, load, cone_index, pull), abs=0.005
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


def test_cornering_is_near_ackermann_on_firm_ground_and_falls_with_strength():
    radius, ratios = 10.0, []
    for cone_index in (2000.0, 600.0, 300.0, 150.0):
        plant = plant_on(terrain.flat((40.0, 40.0)), SoilMap(cone_index))
        plant.reset(0.0, -10.0, 0.0, 1.0)
        command = Command(math.atan(1.4 / radius), 0.0, 1.0 / 1.4)
        plant.advance(command, 7500)
        truth = plant.advance(command, 1)
        ratios.append(truth.yaw_rate_t / (truth.speed * math.tan(truth.delta_t) / 1.4))
    assert ratios[0] == pytest.approx(0.965, abs=0.015)
    assert all(firm > soft for firm, soft in itertools.pairwise(ratios))
    assert ratios[-1] > 0.8


@pytest.mark.parametrize("iso_class", ["D", "F"])
@pytest.mark.parametrize("timestep_s", [0.001, 0.004])
def test_rough_ground_keeps_loads_positive_at_every_time_step(iso_class, timestep_s):
    ground = terrain.rough(iso_class, np.random.default_rng(1), (30.0, 20.0))
    plant = plant_on(ground, SoilMap(600.0), timestep_s=timestep_s)
    plant.reset(-8.0, 0.0, 0.0, 1.0)
    steps = round(0.05 / timestep_s)
    loads = np.array([plant.advance(ROLL, steps).wheels.load for _ in range(200)])
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


def test_knuckles_follow_ackermann():
    plant = plant_on()
    for command in (-0.6, -0.3, 0.15, 0.5):
        plant.reset(0.0, 0.0, 0.0, 1.0)
        truth = plant.advance(Command(command, 0.0, 1.0 / 1.4), 1500)
        for side, name in ((1.0, "knuckle_left"), (-1.0, "knuckle_right")):
            half = side * plant.model.body(name).pos[1] * side
            tangent = math.tan(truth.delta_t)
            expected = math.atan2(1.4 * tangent, 1.4 - half * tangent)
            assert plant.data.joint(name).qpos[0] == pytest.approx(expected, abs=math.radians(0.1))


def test_hitch_kinematics_hold_with_the_sign_of_the_steering_rate():
    """The trailer axle rolls without side slip behind two hinges; lambda = psi_t - psi_i.

    psi_i' (L_i + d cos delta_i) = v sin lambda - a psi_t' cos lambda - d delta_i' cos delta_i
    """
    plant = plant_on(terrain.flat((60.0, 60.0)))
    plant.reset(-20.0, 0.0, 0.0, 1.0)
    rows = []
    for k in range(750):
        t = 0.02 * k
        command = Command(0.25 * math.sin(0.5 * t), 0.3 * math.sin(1.3 * t), 1.0 / 1.4)
        truth = plant.advance(command, 10)
        lam = truth.tractor.yaw - truth.trailer.yaw
        rows.append((truth.speed, lam, truth.delta_i, truth.yaw_rate_t, truth.yaw_rate_i))
    v, lam, delta_i, rate_t, rate_i = np.array(rows).T
    delta_i_rate = np.gradient(delta_i, 0.02)
    a, d, length = 0.3, 0.8, 1.3

    def residual(sign):
        numerator = (
            v * np.sin(lam) - a * rate_t * np.cos(lam) - sign * d * delta_i_rate * np.cos(delta_i)
        )
        error = rate_i - numerator / (length + d * np.cos(delta_i))
        return np.sqrt(np.mean(error[50:] ** 2))

    assert residual(1.0) < 0.01
    assert residual(1.0) < 0.1 * residual(-1.0)


# --- actuators -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "limit", "rate", "lag"),
    [("delta_t", 35.0, 55.0, 0.15), ("delta_i", 25.0, 35.0, 0.20)],
)
def test_steering_has_its_rate_its_lag_and_its_stop(name, limit, rate, lag):
    limit, rate = math.radians(limit), math.radians(rate)
    plant = plant_on()
    plant.reset(0.0, 0.0, 0.0, 1.0)
    command = dataclasses.replace(ROLL, **{name: 1.5})  # far beyond the stop
    angle = np.array([getattr(plant.advance(command, 5), name) for _ in range(200)])
    speed = np.diff(angle) / 0.01
    assert speed.max() == pytest.approx(rate, rel=0.05)
    assert angle[-1] == pytest.approx(limit, abs=math.radians(0.6))
    assert angle.max() < limit + math.radians(0.6)
    # behind a ramp a first-order lag trails by its time constant
    time = 0.01 * np.arange(1, 201)
    middle = np.searchsorted(angle, 0.7 * limit)
    assert time[middle] - angle[middle] / rate == pytest.approx(lag, rel=0.25)


def test_front_axle_pivots_within_its_stops():
    plant = plant_on()
    plant.reset(0.0, 0.0, 0.0, 0.0)
    assert plant.model.joint("front_axle_roll").range == pytest.approx(np.radians([-10.0, 10.0]))


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
    vehicle = PlantVehicle(load_kg=400.0, load_height_m=1.0)
    plant = plant_on(ground, SoilMap(600.0), vehicle)
    plant.reset(0.0, 10.0, 0.0, 0.0)
    rolls = [plant.advance(STOP, 50).trailer.roll for _ in range(20)]
    assert max(rolls) - math.radians(35.0) > math.radians(60.0)  # positive: left side up
    empty = plant_on(ground, SoilMap(600.0))
    empty.reset(0.0, 10.0, 0.0, 0.0)
    rolls = [empty.advance(STOP, 50).trailer.roll for _ in range(20)]
    assert max(rolls) - math.radians(35.0) < math.radians(10.0)


@pytest.mark.parametrize("wheels", ["soil", "contact"])
def test_tipped_past_its_balance_it_ends_on_its_side_and_stays_there(wheels):
    plant = plant_on(wheels=wheels)
    plant.reset(0.0, 0.0, 0.0, 0.0)
    half = 0.5 * math.radians(55.0)
    plant.data.qpos[2] += 0.45
    plant.data.qpos[3:7] = math.cos(half), math.sin(half), 0.0, 0.0
    mujoco.mj_step1(plant.model, plant.data)
    plant.advance(STOP, 2500)
    lying = plant.advance(STOP, 1)
    assert 60.0 < math.degrees(lying.tractor.roll) < 120.0
    assert np.abs(plant.data.qvel[:6]).max() < 0.2
    # what touches the ground does not sink into it
    depth = [contact.dist for contact in plant.data.contact]
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
        lambda: PlantVehicle(load_kg=-1.0),
        lambda: PlantVehicle(drawbar_m=math.nan),
        lambda: PlantVehicle(hitch_offset_m=0.0),
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
