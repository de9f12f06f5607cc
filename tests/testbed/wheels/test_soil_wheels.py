"""Soil wheels of any MuJoCo model: closed forms, invariance, energy, hooks, refusals."""

import importlib.util
import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from proving_ground.testbed.errors import InvalidPlant
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.ground.terrain import flat, rough
from proving_ground.testbed.wheels.soil_law import SoilLaw
from proving_ground.testbed.wheels.soil_wheels import WheelsFile, write_wheels

from proving_ground import Ground, SoilWheels, Tyre

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"


def example(name):
    specification = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


RIG = example("wheel_rig")
ROVER = example("rover")


def coasting(data, speed=0.6):
    data.qvel[0] = speed
    data.qvel[6:] = speed / ROVER.TYRE.radius_m
    return data


def free_rover(**options):
    """Return a rover without motors that rolls, its data and its wheels."""
    model, wheels = ROVER.rover(**options)
    model.actuator_gainprm[:] = 0.0
    model.actuator_biasprm[:] = 0.0
    return model, coasting(mujoco.MjData(model)), wheels


def advance(model, data, wheels, seconds):
    for _ in range(round(seconds / model.opt.timestep)):
        wheels.apply(model, data)
        mujoco.mj_step(model, data)
    return np.concatenate([data.qpos, data.qvel])


# --- the law


def brixius(tyre, load_n, cone_index_kpa, slip):
    """W. W. Brixius, ASAE paper 87-1622, bias-ply tyres: net pull and torque over load."""
    width, diameter = tyre.width_m, 2.0 * tyre.radius_m
    cn = cone_index_kpa * 1e3 * width * diameter / load_n
    bn = cn * (1.0 + 5.0 * tyre.relative_deflection) / (1.0 + 3.0 * width / diameter)
    gross = 0.88 * (1.0 - math.exp(-0.1 * bn)) * (1.0 - math.exp(-7.5 * slip)) + 0.04
    return gross - (1.0 / bn + 0.04 + 0.5 * slip / math.sqrt(bn)), gross


@pytest.mark.parametrize("cone_index_kpa", [250.0, 900.0])
@pytest.mark.parametrize("slip", [0.05, 0.20])
def test_a_wheel_on_the_rig_pulls_by_brixius(slip, cone_index_kpa):
    load_n = 240.0 * 9.81  # carriage and wheel
    expected = brixius(RIG.TYRE, load_n, cone_index_kpa, slip)
    assert RIG.pull_at(slip, cone_index_kpa) == pytest.approx(expected, abs=1e-3)


def test_a_rover_climbs_with_the_slip_that_carries_its_weight():
    slope = math.radians(20.0)
    _, _, slip = ROVER.drive(slope, 4.0, 4.0)
    load_n = 58.0 * 9.81 * math.cos(slope) / 4.0
    pull, _ = brixius(ROVER.TYRE, load_n, 300.0, slip)
    assert pull == pytest.approx(math.tan(slope), rel=0.03)
    _, turned, _ = ROVER.drive(0.0, -1.0, 1.0)
    assert 0.5 < turned < 0.15 * 6.0 / 0.28  # it skids: less than by rolling on a circle


def test_the_ground_carries_the_weight_and_takes_the_momentum():
    model, data, wheels = free_rover()
    mass = model.body_mass.sum()
    start = mass * data.qvel[0]
    impulse = 0.0
    for _ in range(500):
        wheels.apply(model, data)
        impulse += model.opt.timestep * data.xfrc_applied[:, :3].sum(axis=0)
        mujoco.mj_step(model, data)
    mujoco.mj_subtreeVel(model, data)
    after = mass * data.subtree_linvel[0]
    gravity = mass * model.opt.gravity * data.time
    np.testing.assert_allclose(after - [start, 0.0, 0.0], impulse + gravity, atol=0.02 * start)
    assert wheels.report.load.sum() == pytest.approx(mass * 9.81, rel=0.01)


def test_a_wheel_of_any_model_holds_a_steering_axle_that_is_turned_on_the_spot():
    """The wheel of the rig on a vertical axle: torque of its drive by hand, none without boring."""
    turntable = RIG.RIG.replace('name="rail" type="slide" axis="1 0 0"', 'name="rail" axis="0 0 1"')
    load_n = 240.0 * 9.81
    give = 0.2 * 0.185 * load_n / RIG.TYRE.rated_load_n
    half_length = math.sqrt(give * (0.8 - give))
    ring = 2.0 / 3.0 * 0.5 * (half_length + 0.12)
    torques = []
    for bore in (0.0, 1.0):
        model = mujoco.MjModel.from_xml_string(turntable)
        data = mujoco.MjData(model)
        law = SoilLaw(bore=bore)
        wheels = SoilWheels(model, {"wheel": RIG.TYRE}, ground="bin", law=law)
        data.ctrl[0] = 2.0  # [rad/s]
        while data.time < 4.0:
            wheels.apply(model, data)
            mujoco.mj_step(model, data)
        torques.append(data.actuator_force[0])
    assert torques[0] == pytest.approx(0.0, abs=1e-3)
    firm = 0.61 + 0.69 / mobility_of_side(RIG.TYRE, load_n, 600.0)
    assert torques[1] == pytest.approx(ring * firm * load_n, rel=0.03)


def mobility_of_side(tyre, load_n, cone_index_kpa):
    """Mobility number of the US Army's Waterways Experiment Station."""
    diameter = 2.0 * tyre.radius_m
    cn = cone_index_kpa * 1e3 * tyre.width_m * diameter / load_n
    return cn * math.sqrt(tyre.relative_deflection) / (1.0 + 0.5 * tyre.width_m / diameter)


def test_without_motors_the_ground_only_takes_energy():
    model, data, wheels = free_rover()
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    advance(model, data, wheels, 1.0)  # down on its tyres
    coasting(data, 3.0)
    energies = []
    for _ in range(10):
        advance(model, data, wheels, 0.2)
        energies.append(data.energy.sum())
    assert (np.diff(energies) < 0.0).all()
    assert energies[-1] < 0.8 * energies[0]


def test_it_stands_on_a_slope_with_locked_wheels():
    model, wheels = ROVER.rover(math.radians(15.0))
    model.actuator_biasprm *= 100.0
    data = mujoco.MjData(model)
    advance(model, data, wheels, 2.0)
    before = data.qpos[:3].copy()
    advance(model, data, wheels, 2.0)
    assert np.abs(data.qpos[:3] - before).max() < 0.005


# --- invariance


def test_the_same_machine_in_another_frame_moves_the_same():
    """The wheel's body is rotated, its origin is beside the wheel, its axle is along z."""
    other = RIG.RIG.replace(
        '<body name="wheel">', '<body name="wheel" pos="0 0.3 0.1" euler="-90 0 0">'
    )
    other = other.replace('name="axle" axis="0 1 0"', 'name="axle" axis="0 0 1" pos="0 0.1 -0.3"')
    other = other.replace(
        'zaxis="0 1 0" mass="40"', 'zaxis="0 0 1" pos="0 0.1 -0.3" mass="40" name="tread"'
    )
    reports = []
    for text, name in ((RIG.RIG, "wheel"), (other, "wheel"), (other, "tread")):
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        wheels = SoilWheels(model, {name: RIG.TYRE}, ground="bin", cone_index_kpa=400.0)
        data.ctrl[:] = 1.0, 3.0
        advance(model, data, wheels, 1.0)
        reports.append([*np.concatenate(wheels.report), *data.qpos])
    np.testing.assert_allclose(reports[1], reports[0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(reports[2], reports[0], rtol=1e-9, atol=1e-9)


def test_a_rotated_scene_gives_rotated_motion():
    turn = 0.7
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    model, data, wheels = free_rover(cone_index_kpa=200.0)
    data.qvel[5] = 0.3
    advance(model, data, wheels, 2.0)
    turned_model, turned, turned_wheels = free_rover(cone_index_kpa=200.0)
    turned.qvel[:2] = rotation @ turned.qvel[:2]
    turned.qvel[5] = 0.3
    turned.qpos[3:7] = math.cos(0.5 * turn), 0.0, 0.0, math.sin(0.5 * turn)
    advance(turned_model, turned, turned_wheels, 2.0)
    np.testing.assert_allclose(turned.qpos[:2], rotation @ data.qpos[:2], atol=1e-9)
    np.testing.assert_allclose(turned_wheels.report.force_lat, wheels.report.force_lat, atol=1e-6)


def test_the_time_step_does_not_decide_the_path():
    """A spinning rover coasts over 4 m; shorter steps approach one end."""
    ends = []
    for timestep in (0.0005, 0.001, 0.004):
        model, data, wheels = free_rover()
        model.opt.timestep = timestep
        coasting(data, 2.0)
        data.qvel[5] = 0.5
        ends.append(advance(model, data, wheels, 4.0)[:2])
    fine, medium, coarse = ends
    assert fine[0] > 3.5
    assert math.dist(fine, coarse) < 0.010
    assert math.dist(fine, medium) < 0.3 * math.dist(fine, coarse)


def test_a_height_field_is_the_ground_that_it_draws():
    field = rough("E", np.random.default_rng(3), (12.0, 8.0))
    low, rise = field.heights.min(), np.ptp(field.heights)
    spec = mujoco.MjSpec.from_string(RIG.RIG)
    spec.delete(spec.geom("bin"))
    ny, nx = field.heights.shape
    spec.add_hfield(
        name="soil",
        nrow=ny,
        ncol=nx,
        size=[6.0, 4.0, rise, 1.0],
        userdata=((field.heights - low) / rise).ravel(),
    )
    spec.worldbody.add_geom(
        name="soil", type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="soil", pos=[0.0, 0.0, low]
    )
    spec.body("carriage").pos = [-3.0, 0.5, 0.4]
    reports = []
    for ground in ("soil", Ground(field, SoilMap(400.0).rasterised(field))):
        model = spec.compile()
        data = mujoco.MjData(model)
        data.ctrl[:] = 1.0, 2.6
        wheels = SoilWheels(model, {"wheel": RIG.TYRE}, ground=ground, cone_index_kpa=400.0)
        advance(model, data, wheels, 2.0)
        reports.append(np.concatenate(wheels.report))
    # MuJoCo has heights in single precision
    np.testing.assert_allclose(reports[0], reports[1], rtol=1e-4, atol=1e-4)


# --- hooks


@pytest.mark.parametrize("ruts", [False, True])
def test_a_second_call_changes_nothing(ruts):
    ends = []
    for calls in (1, 2):
        model = mujoco.MjModel.from_xml_string(RIG.RIG)
        data = mujoco.MjData(model)
        data.ctrl[:] = 1.0, 3.0
        ground = flat((8.0, 4.0))
        soil = Ground(ground, SoilMap(400.0).rasterised(ground), ruts=ruts)
        wheels = SoilWheels(model, {"wheel": RIG.TYRE}, ground=soil)
        for _ in range(400):
            for _ in range(calls):
                wheels.apply(model, data)
            mujoco.mj_step(model, data)
        ends.append(np.concatenate([data.qpos, data.qvel, wheels.state]))
    np.testing.assert_array_equal(*ends)


def test_every_way_into_a_step_gives_the_same_motion():
    model, data, wheels = free_rover()
    applied = advance(model, data, wheels, 0.5)

    model, data, wheels = free_rover()
    for _ in range(250):
        mujoco.mj_step1(model, data)
        wheels.apply(model, data)
        mujoco.mj_step2(model, data)
    np.testing.assert_array_equal(np.concatenate([data.qpos, data.qvel]), applied)

    model, data, wheels = free_rover()
    with wheels.install():
        for _ in range(25):
            mujoco.mj_step(model, data, nstep=10)
            mujoco.mj_forward(model, data)  # of a viewer or a sensor: it must not advance a tread
    np.testing.assert_allclose(np.concatenate([data.qpos, data.qvel]), applied, atol=1e-9)
    assert mujoco.get_mjcb_passive() is None


def test_a_reset_and_a_restored_state_repeat_the_motion():
    model, data, wheels = free_rover()
    first = advance(model, data, wheels, 0.5)
    mujoco.mj_resetData(model, data)
    coasting(data)
    np.testing.assert_array_equal(advance(model, data, wheels, 0.5), first)


def test_a_file_of_wheels_gives_the_same_wheels(tmp_path):
    model, data, wheels = free_rover(cone_index_kpa=200.0)
    file = tmp_path / "wheels.toml"
    file.write_text(
        write_wheels(WheelsFile(tyres=wheels.tyres, ground="slope", cone_index_kpa=200.0))
    )
    read = SoilWheels.from_file(model, file)
    again = coasting(mujoco.MjData(model))
    motion = advance(model, again, read, 0.2)
    np.testing.assert_array_equal(motion, advance(model, data, wheels, 0.2))


# --- refusals


def test_what_is_no_wheel_or_no_ground_is_refused_in_one_line(tmp_path):
    model, _ = ROVER.rover()
    tyre = ROVER.TYRE
    for tyres, ground, message in (
        ({"front_lef": tyre}, "slope", "'front_lef'.*front_left"),
        ({"rover": tyre}, "slope", "'rover'.*no hinge"),
        ({"front_left": tyre, "front_left_tyre": tyre}, "slope", "a body each"),
        ({}, "slope", "no name"),
        ({"front_left": tyre}, "field", "'field': no such geom"),
        ({"front_left": tyre}, "front_left_tyre", "geom of the world"),
    ):
        with pytest.raises(InvalidPlant, match=message) as refusal:
            SoilWheels(model, tyres, ground=ground)
        assert "\n" not in str(refusal.value)

    model.opt.timestep = 0.01
    with pytest.raises(InvalidPlant, match=r"timestep.*0\.004"):
        SoilWheels(model, {"front_left": tyre}, ground="slope")
    file = tmp_path / "wheels.toml"
    file.write_text('ground = "slope"\n[tyres.front_left]\nradius_m = -1.0\n')
    with pytest.raises(InvalidPlant, match="tyres"):
        SoilWheels.from_file(model, file)


def test_another_data_and_another_integrator_are_refused():
    model, data, wheels = free_rover()
    wheels.apply(model, data)
    with pytest.raises(InvalidPlant, match="first call"):
        wheels.apply(model, mujoco.MjData(model))
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    with pytest.raises(InvalidPlant, match="RK4"), wheels.install():
        pass


def test_a_tyre_out_of_range_is_refused():
    with pytest.raises(ValueError, match="relative_deflection"):
        Tyre(**{**vars(RIG.TYRE), "relative_deflection": 0.7})
