"""Exported MJCF: it stands and steers in MuJoCo alone; with its soil wheels it is the testbed."""

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.simulation.mjcf_export import mjcf_files
from proving_ground.testbed.truth import WHEELS
from proving_ground.testbed.vehicle.vehicle_model import build_spec
from proving_ground.testbed.wheels.tyre import Tyre

from proving_ground import SoilWheels
from ttempc.types import Command

SHIPPED = Path(__file__).parents[3] / "mjcf"
FLAT = ["terrain.iso_class=flat"]


@pytest.fixture(scope="module")
def shipped():
    return mujoco.MjModel.from_xml_path(str(SHIPPED / "scene.xml"))


@pytest.fixture(scope="module")
def patchy(tmp_path_factory):
    """A folder with rough ground and soil that varies."""
    folder = tmp_path_factory.mktemp("mjcf") / "patchy"
    assert main(["mjcf", "patchy", "-o", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def rough(patchy):
    return mujoco.MjModel.from_xml_path(str(patchy / "scene.xml"))


def at_home(model):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    return data


def drive(model, data, duration_s):
    for _ in range(round(duration_s / model.opt.timestep)):
        mujoco.mj_step(model, data)


def slalom(time_s):
    return 0.25 * math.sin(0.8 * time_s), 0.0, 0.6


def plant_at_rest(name, overrides=()):
    """Return the plant of a scenario at its start, at rest."""
    assembly = assemble(load(name, list(overrides))[1], 1)
    plant = assembly.plant
    plant.restore(assembly.start)
    plant.data.qvel[:] = 0.0
    plant.data.act[:] = 0.0
    mujoco.mj_step1(plant.model, plant.data)
    return plant


def motion_of(model, data, wheels, seconds):
    """Return positions and velocities after a slalom on soil."""
    for _ in range(round(seconds / model.opt.timestep)):
        data.ctrl[:] = slalom(data.time)
        wheels.apply(model, data)
        mujoco.mj_step(model, data)
    return data.qpos.copy(), data.qvel.copy()


@pytest.mark.parametrize("name", ["shipped", "rough"])
def test_it_stands_on_its_wheels(name, request):
    model = request.getfixturevalue(name)
    data = at_home(model)
    start = data.qpos[:3].copy()
    drive(model, data, 2.0)
    loads, wrench = {}, np.zeros(6)
    for index in range(data.ncon):
        mujoco.mj_contactForce(model, data, index, wrench)
        wheel = model.geom(int(data.contact.geom[index].max())).name
        loads[wheel] = loads.get(wheel, 0.0) + wrench[0]
    assert len(loads) == 6
    assert sum(loads.values()) == pytest.approx(
        -model.opt.gravity[2] * model.body_mass.sum(), rel=0.01
    )
    moved = data.qpos[:3] - start
    assert np.abs(moved[:2]).max() < 0.02
    # its contacts are stiffer than the tyres, whose deflection `home` has
    deflection = 0.2 * 0.185  # of the rear tyre, vehicles/kayacan2016.toml
    assert 0.0 < moved[2] < 1.2 * deflection


def test_it_drives_a_left_curve_of_its_wheelbase_and_steering_angle(shipped):
    data = at_home(shipped)
    angle = 0.15
    data.ctrl[:] = angle, 0.0, 0.3
    drive(shipped, data, 12.0)
    yaw_rate, speed = data.qvel[5], np.hypot(*data.qvel[:2])
    wheelbase = 1.4
    assert speed == pytest.approx(0.3 * 1.4, rel=0.05)  # K of Kayacan et al. 2016, sec. II
    assert yaw_rate == pytest.approx(speed * np.tan(angle) / wheelbase, rel=0.15)
    # its sensors: what an IMU and encoders on such a machine would tell
    assert data.sensor("imu_rotation").data[2] == pytest.approx(yaw_rate, rel=0.01)
    assert data.sensor("steer_angle").data[0] == pytest.approx(angle, abs=0.01)
    apart = data.sensor("gnss_tractor").data - data.sensor("gnss_trailer").data
    assert 1.5 < math.hypot(*apart[:2]) < 1.4 + 0.3 + 0.8 + 1.3


def test_with_its_soil_wheels_it_is_the_testbed_after_20_s_of_slalom(patchy, rough):
    data = at_home(rough)
    plant = plant_at_rest("patchy")
    wheels = SoilWheels.from_file(rough, patchy / "wheels.toml")
    qpos, _ = motion_of(rough, data, wheels, 20.0)
    steps = round(20.0 / plant.timestep_s)
    for step in range(steps):
        plant.advance(Command(*slalom(step * plant.timestep_s)), 1)
    assert math.dist(qpos[:2], plant.data.qpos[:2]) < 0.01
    joints = rough.joint("rj1_yaw").qposadr[0], rough.joint("rj2_yaw").qposadr[0]
    for joint in joints:
        assert qpos[joint] == pytest.approx(plant.data.qpos[joint], abs=math.radians(0.2))


def test_soil_wheels_and_the_testbed_are_one_law():
    """Before a file rounds the model, both have the same bits to rounding."""
    plant = plant_at_rest("patchy")
    spec = build_spec(plant.vehicle, plant.terrain, plant.soil_law, plant.timestep_s)
    for constraint in spec.equalities:
        constraint.active = False
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = plant.data.qpos
    keys = Tyre.__dataclass_fields__
    tyres = {}
    for name in WHEELS:
        wheel = plant.vehicle.wheels[name.split("_")[0]]
        tyres[name] = Tyre(**{key: getattr(wheel, key) for key in keys})
    wheels = SoilWheels(model, tyres, ground=plant.ground, law=plant.soil_law)
    plant.wheels.state[:] = 0.0
    plant.coupling.pairs[:, -2:] = 0.0  # no coupling of the front wheels on either side
    _, qvel = motion_of(model, data, wheels, 1.0)
    for step in range(round(1.0 / plant.timestep_s)):
        plant.advance(Command(*slalom(step * plant.timestep_s)), 1)
    np.testing.assert_allclose(qvel, plant.data.qvel, atol=1e-9)


def test_the_shipped_files_are_what_the_command_writes(shipped):
    assembly = assemble(load("grass", FLAT)[1], 1)
    assembly.plant.restore(assembly.start)
    files = mjcf_files(assembly.plant)
    assert sorted(files) == ["drive.py", "scene.xml", "wheels.toml"]
    assert files["wheels.toml"] == (SHIPPED / "wheels.toml").read_bytes()
    made = mujoco.MjModel.from_xml_string(files["scene.xml"].decode())
    for name in (
        "body_mass",
        "body_inertia",
        "body_pos",
        "jnt_range",
        "geom_size",
        "geom_friction",
        "actuator_gainprm",
        "actuator_biasprm",
        "actuator_ctrlrange",
    ):
        np.testing.assert_allclose(getattr(made, name), getattr(shipped, name), rtol=1e-6)
    assert made.nsensor == shipped.nsensor


def test_the_shipped_driver_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(SHIPPED)
    source = (SHIPPED / "drive.py").read_text()
    exec(compile(source.replace("20.0", "1.0"), "drive.py", "exec"), {})
    assert "[" in capsys.readouterr().out
    code = [
        line for line in source.splitlines() if line and not line.startswith(("import", "from"))
    ]
    assert len(code) <= 15
