"""Compiled physics steps: the motion of MuJoCo's own steps, and no contact is missed."""

import mujoco
import numpy as np
import pytest
from proving_ground.testbed.actuation.actuators import ActuatorSpecification, SteeringValve
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.implement.implement import Implement
from proving_ground.testbed.simulation.fast_mujoco.clearance import MOTION_M, clearance
from proving_ground.testbed.simulation.fast_mujoco.library import disable_flags
from proving_ground.testbed.simulation.plant import Plant

from tests.testbed.plants import SMALL
from ttempc.types import Command

SOIL = SoilMap(300.0)


def rough_slope(seed, letter="E", slope=0.15):
    return terrain.rough(letter, np.random.default_rng(seed), (30.0, 20.0)).tilted(slope, 0.7)


def watch_of(plant):
    """Return the watch over the contacts of a plant with compiled steps."""
    return plant._steps.machine.contacts


def pair(ground, **options):
    """Return two plants in one state; the second takes its steps in Python."""
    plants = [Plant(SMALL, ground, SOIL, **options) for _ in range(2)]
    for plant in plants:
        plant.reset(-5.0, 0.0, 0.2, 1.0)
    plants[1]._steps = plants[1]._plain
    return plants


@pytest.mark.parametrize("implement", [None, Implement(width_m=0.6)])
def test_a_period_in_one_call_has_the_moments_of_its_parts_and_of_mujocos_steps(implement):
    valve = SteeringValve(dead_time_s=0.03, dead_band_deg=0.3, backlash_deg=0.5)
    specification = ActuatorSpecification(front=valve, trailer=valve)
    plants = pair(rough_slope(1), implement=implement, actuators=specification)
    start, command = plants[0].snapshot(), Command(0.2, -0.1, 0.8)
    whole = plants[0].drive(command, 5, 80)
    plants[0].restore(start)
    for plant, tolerance in zip(plants, (0.0, 1e-9), strict=True):
        parts = [plant.drive(command, 1, 80) for _ in range(5)]
        for name, array in whole._asdict().items():
            found = np.concatenate([getattr(part, name) for part in parts])
            np.testing.assert_allclose(found, array, rtol=tolerance, atol=tolerance)


def test_the_view_of_the_flags_is_that_of_the_model():
    model = pair(rough_slope(4))[0].model
    given = model.opt.disableflags
    disable_flags(model)[0] = given | 16
    assert model.opt.disableflags == given | 16


def test_a_vehicle_that_falls_over_touches_the_ground_as_in_python():
    """Each step from one state: over many, last bits decide which wheel takes off first.

    The solver of contacts starts from the acceleration before, of which MuJoCo keeps another one.
    """
    compiled, plain = pair(rough_slope(2))
    plain.data.qvel[3] = 6.2  # [rad/s] roll
    mujoco.mj_step1(plain.model, plain.data)
    touched = 0
    for _ in range(1200):
        compiled.restore(plain.snapshot())
        for plant in (compiled, plain):
            plant.advance(Command(0.0, 0.0, 0.5), 1)
        assert compiled.data.ncon == plain.data.ncon
        np.testing.assert_allclose(compiled.data.qvel, plain.data.qvel, atol=1e-9)
        touched += plain.data.ncon > 0
    assert 0 < touched < 1200


def test_the_clearance_bounds_every_motion_without_a_contact():
    plant, _ = pair(rough_slope(5, "F", 0.3))
    model, data = plant.model, plant.data
    chassis = watch_of(plant).chassis
    rng = np.random.default_rng(6)
    start, seen, near = data.qpos.copy(), 0, 0
    for _ in range(1500):
        data.qpos[:] = start
        data.qpos[:2] = rng.uniform((-12.0, -7.0), (12.0, 7.0))
        data.qpos[2] = plant.terrain.height(*data.qpos[:2]) + rng.uniform(0.0, 1.2)
        mujoco.mju_euler2Quat(
            data.qpos[3:7], rng.uniform((-0.5, -0.5, 0.0), (0.5, 0.5, 6.0)), "XYZ"
        )
        mujoco.mj_kinematics(model, data)
        free = clearance(chassis)
        assert free <= MOTION_M
        if free == 0.0:
            continue
        seen += 1
        near += free < MOTION_M
        direction = rng.normal(size=3)
        direction[2] = -abs(direction[2])
        data.qpos[:3] += free * direction / np.linalg.norm(direction)
        mujoco.mj_step1(model, data)
        assert data.ncon == 0
    assert seen > 200
    assert near > 50


def test_a_unit_of_each_degree_of_freedom_moves_no_point_farther_than_its_reach():
    plant, _ = pair(rough_slope(7))
    model, data = plant.model, plant.data
    shapes = watch_of(plant).chassis.shapes
    reaches = watch_of(plant).reaches
    rng, jacobian = np.random.default_rng(8), np.zeros((3, model.nv))
    for _ in range(50):
        mujoco.mj_integratePos(model, data.qpos, rng.uniform(-0.5, 0.5, model.nv), 1.0)
        mujoco.mj_step1(model, data)
        for shape in shapes:
            direction = rng.normal(size=3)
            point = data.geom_xpos[shape] + (
                model.geom_rbound[shape] * direction / np.linalg.norm(direction)
            )
            mujoco.mj_jac(model, data, jacobian, None, point, model.geom_bodyid[shape])
            assert (np.linalg.norm(jacobian, axis=0) <= reaches + 1e-9).all()
