"""Force that couples the steering: a potential with a damper, and the constraints' steering."""

import mujoco
import numpy as np
import pytest
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.simulation.plant import Plant
from proving_ground.testbed.vehicle.steering_coupling import Coupling, couple_joints

from tests.testbed.plants import SMALL
from ttempc.types import Command

QUARTIC = (0.01, 0.9, 0.2, -0.3, 0.1)
K, C = 3e4, 150.0
PAIR = np.array([[1, 0, 2, 1, *QUARTIC, K, C]])  # leader: position 0, velocity 1


def gap(delta, theta):
    return np.polyval(QUARTIC[::-1], delta) - theta


@pytest.mark.parametrize("delta", [-0.6, 0.0, 0.4])
def test_the_force_at_rest_is_that_of_the_spring_and_the_damper_only_takes_energy(delta):
    theta, h = 0.2, 1e-6
    force = np.zeros(3)
    couple_joints(Coupling(PAIR, np.array([delta, theta]), np.zeros(3), force))
    energy = [
        0.5 * K * gap(delta + a, theta + b) ** 2 for a, b in ((h, 0), (-h, 0), (0, h), (0, -h))
    ]
    expected = [0.0, (energy[1] - energy[0]) / (2 * h), (energy[3] - energy[2]) / (2 * h)]
    np.testing.assert_allclose(force, expected, rtol=1e-5, atol=1e-3)
    speeds, moved = np.array([0.0, 0.3, -0.7]), np.zeros(3)
    couple_joints(Coupling(PAIR, np.array([delta, theta]), speeds, moved))
    rate = (gap(delta + h * 0.3, theta) - gap(delta - h * 0.3, theta)) / (2 * h) + 0.7
    assert speeds @ (moved - force) == pytest.approx(-C * rate**2, rel=1e-6)


@pytest.mark.parametrize("timestep_s", [0.001, 0.004])
def test_wheels_are_steered_as_by_the_constraints_of_the_exported_model(timestep_s):
    ground = terrain.flat((60.0, 40.0))
    plant = Plant(SMALL, ground, SoilMap(600.0), timestep_s=timestep_s)
    plant.reset(-10.0, 0.0, 0.0, 1.0)
    plant.advance(Command(0.4, 0.0, 0.7), round(3.0 / timestep_s))
    model = mujoco.MjModel.from_xml_string(plant.mjcf)
    assert model.eq_active0.all()
    assert not plant.model.eq_active0.any()
    for side in ("left", "right"):
        quartic = model.equality(f"ackermann_{side}").data[4::-1]
        angle = plant.data.joint(f"knuckle_{side}").qpos[0]
        assert angle == pytest.approx(np.polyval(quartic, plant.truth().delta_t), abs=0.002)
