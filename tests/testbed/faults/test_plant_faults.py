"""Faults of the plant, held to statics and momentum."""

import math

import numpy as np
import pytest
from proving_ground.testbed.faults.kinds import KINDS
from proving_ground.testbed.truth import WHEELS

from tests.testbed.plants import SMALL, STOP, changed, plant_on

LEFT, RIGHT = WHEELS.index("trailer_left"), WHEELS.index("trailer_right")


def attached(plant, **keys):
    fault = KINDS[keys["kind"]](start_s=0.0, **keys)
    return fault.row.effect(fault, plant)


def at_rest(plant, steps=1000):
    return plant.advance(STOP, steps)


@pytest.fixture(scope="module")
def plant():
    return plant_on(vehicle=changed(SMALL, "load", mass_kg=300.0))


@pytest.fixture
def standing(plant):
    plant.reset(0.0, 0.0, 0.0, 0.0)
    return at_rest(plant)


def test_the_moment_of_a_shifted_load_is_carried_by_the_trailers_wheels(plant, standing):
    shift = 0.1
    effect = attached(plant, kind="load_shift", left_m=shift)
    effect(1.0)
    load = at_rest(plant).wheels.load
    effect(0.0)
    again = at_rest(plant).wheels.load
    moved = (load - standing.wheels.load)[[LEFT, RIGHT]]
    expected = 300.0 * 9.81 * shift / SMALL.trailer.track_m
    np.testing.assert_allclose(moved, [expected, -expected], rtol=0.1)
    np.testing.assert_allclose(again[[LEFT, RIGHT]], standing.wheels.load[[LEFT, RIGHT]], rtol=0.01)


def test_a_flat_tyre_lowers_its_side(plant, standing):
    effect = attached(plant, kind="tyre_flat", wheel="trailer_left", stiffness_factor=1.0)
    # Roll and sway of the loaded trailer have 1.2 Hz and a damping ratio of 0.14: 1 % after 4 s.
    effect(1.0)
    roll = at_rest(plant, 2000).trailer.roll
    effect(0.0)
    expected = -0.05 / SMALL.trailer.track_m  # the loss of radius over the track
    assert roll - standing.trailer.roll == pytest.approx(expected, rel=0.06)
    assert at_rest(plant, 2000).trailer.roll == pytest.approx(standing.trailer.roll, abs=5e-4)


def test_a_free_cylinder_has_no_torque(plant, standing):
    servo = plant.model.actuator("trailer_steer").id
    effect = attached(plant, kind="trailer_steering_free")
    push = attached(plant, kind="gust", body="trailer", force_n=1500.0, direction_deg=90.0)

    def turned():
        plant.reset(0.0, 0.0, 0.0, 1.0)
        plant.data.qfrc_applied[:] = 0.0
        push(1.0)
        angle = abs(plant.advance(STOP, 500).delta_i)
        plant.data.qfrc_applied[:] = 0.0
        return angle, abs(plant.data.actuator_force[servo])

    held, torque = turned()
    effect(1.0)
    free, none = turned()
    effect(0.0)
    assert torque > 0.0
    assert none == 0.0
    assert free > 3.0 * held


def test_a_gust_adds_its_force_and_its_share(plant, standing):
    effect = attached(plant, kind="gust", body="tractor", force_n=800.0, direction_deg=30.0)
    plant.data.qfrc_applied[:] = 0.0
    effect(0.5)
    force = plant.data.qfrc_applied[:3].copy()  # of the free joint: that of the whole vehicle
    plant.data.qfrc_applied[:] = 0.0
    direction = math.radians(30.0)
    expected = [400.0 * math.cos(direction), 400.0 * math.sin(direction), 0.0]
    np.testing.assert_allclose(force, expected, atol=1e-9)


def test_the_force_of_a_stone_times_its_time_is_its_impulse(plant, standing):
    effect = attached(plant, kind="stone", wheel="front_left", impulse_ns=100.0)
    plant.data.qfrc_applied[:] = 0.0
    effect(0.5)  # 0.1 s in a period of 0.2 s
    force = plant.data.qfrc_applied[:3].copy()
    plant.data.qfrc_applied[:] = 0.0
    assert 0.2 * np.linalg.norm(force) == pytest.approx(100.0)
    np.testing.assert_allclose(0.2 * force, [-100.0, 0.0, 0.0], atol=3.0)  # heading east, level
