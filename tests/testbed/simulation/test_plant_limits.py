"""Limits of the plant: roll-over, divergence, refusal, comparison of the wheel models."""

import math

import mujoco
import numpy as np
import pytest
from proving_ground.testbed.errors import InvalidPlant, PlantDiverged
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.truth import WHEELS

from tests.testbed.plants import ROLL, SMALL, STOP, axle_points, both_vehicles, changed, plant_on
from ttempc.types import Command

TOP_HEAVY = changed(SMALL, "load", mass_kg=400.0, height_m=1.3)
SIDE_SLOPE = math.radians(35.0)


def test_high_load_on_a_steep_side_slope_rolls_the_trailer_over():
    """Gravity turns, as it does for a vehicle that drives from level ground onto a side slope."""
    turned = 9.81 * np.array([0.0, -math.sin(SIDE_SLOPE), -math.cos(SIDE_SLOPE)])
    for vehicle, rolls_over in ((TOP_HEAVY, True), (SMALL, False)):
        plant = plant_on(soil=SoilMap(600.0), vehicle=vehicle)
        plant.reset(0.0, 10.0, 0.0, 0.0)
        plant.model.opt.gravity[:] = turned
        roll = max(plant.advance(STOP, 50).trailer.roll for _ in range(20))  # positive: left up
        assert roll > math.radians(60.0) if rolls_over else roll < math.radians(10.0)


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


def test_nan_raises_a_divergence(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes MUJOCO_LOG.TXT to the working directory
    plant = plant_on()
    plant.reset(0.0, 0.0, 0.0, 1.0)
    plant.data.qvel[0] = math.nan
    with pytest.raises(PlantDiverged):
        plant.advance(ROLL, 10)


def test_silent_reset_of_mujoco_raises_a_divergence(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plant = plant_on()
    plant.reset(0.0, 0.0, 0.0, 1.0)
    plant.advance(ROLL, 100)
    plant.data.qpos[0] = 1e12
    with pytest.raises(PlantDiverged, match=r"BADQPOS|time went|BADQACC"):
        plant.advance(ROLL, 10)


def test_command_that_is_not_finite_raises_a_divergence(tmp_path, monkeypatch):
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


def test_contact_wheels_agree_with_soil_wheels_on_firm_level_ground():
    truths = []
    for wheels in ("soil", "contact"):
        plant = plant_on(wheels=wheels)
        plant.reset(-10.0, 0.0, 0.0, 1.0)
        truths.append(plant.advance(Command(0.1, 0.0, 1.0 / 1.4), 2500))
    soil, contact = truths
    np.testing.assert_allclose(axle_points(contact), axle_points(soil), atol=0.25)
    assert contact.speed == pytest.approx(soil.speed, rel=0.04)
    assert contact.beta == pytest.approx(soil.beta, abs=0.02)
    assert np.isnan(contact.wheels.slip).all()
    assert np.isfinite(contact.wheels.load).all()


def test_wheels_are_reported_in_the_order_of_their_names():
    plant = plant_on()
    places = plant.reset(0.0, 0.0, 0.0, 0.0).body_xyz
    for wheel in WHEELS:
        x, y, _ = places[plant.body_names.index(wheel)]
        assert (y > 0.0) == wheel.endswith("left")
        assert (x > 1.0) == wheel.startswith("front")
        assert (x < -1.0) == wheel.startswith("trailer")
