"""The plant in motion: geometry, signs, actuators, repeatability."""

import dataclasses
import math
import subprocess
import sys

import numpy as np
import pytest
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import SoilMap

from tests.testbed.plants import (
    ROOT,
    both_vehicles,
    plant_on,
    rough_run,
    state_hash,
    top_speed,
)
from ttempc.types import Command


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
    a, d = vehicle.hitch.offset_m, vehicle.drawbar.length_m
    length = vehicle.trailer.length_m

    def residual(sign):
        numerator = (
            v * np.sin(lam) - a * rate_t * np.cos(lam) - sign * d * delta_i_rate * np.cos(delta_i)
        )
        error = rate_i - numerator / (length + d * np.cos(delta_i))
        return np.sqrt(np.mean(error[50:] ** 2))

    assert residual(1.0) < 0.01
    assert residual(1.0) < 0.1 * residual(-1.0)


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


def test_same_seed_gives_the_same_bits_in_another_process():
    here = state_hash(rough_run(7))
    code = "import tests.testbed.plants as t; print(t.state_hash(t.rough_run(7)))"
    process = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    assert process.stdout.strip() == here
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
