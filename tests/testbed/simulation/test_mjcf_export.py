"""Exported MJCF: it loads in MuJoCo alone, stands on its wheels, steers and drives."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.errors import InvalidPlant
from proving_ground.testbed.simulation.mjcf_export import mjcf_files

SHIPPED = Path(__file__).parents[3] / "mjcf" / "scene.xml"
FLAT = ["terrain.iso_class=flat", "plant.wheels=contact"]


@pytest.fixture(scope="module")
def shipped():
    return mujoco.MjModel.from_xml_path(str(SHIPPED))


@pytest.fixture(scope="module")
def rough(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mjcf") / "patchy"
    assert main(["mjcf", "patchy", "-o", str(folder)]) == 0
    return mujoco.MjModel.from_xml_path(str(folder / "scene.xml"))


def at_home(model):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    return data


def drive(model, data, duration_s):
    for _ in range(round(duration_s / model.opt.timestep)):
        mujoco.mj_step(model, data)


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
    assert np.abs(data.qpos[:3] - start).max() < 0.02


def test_it_drives_a_left_curve_of_its_wheelbase_and_steering_angle(shipped):
    data = at_home(shipped)
    angle = 0.15
    data.ctrl[:] = angle, 0.0, 0.3
    drive(shipped, data, 12.0)
    yaw_rate, speed = data.qvel[5], np.hypot(*data.qvel[:2])
    wheelbase = 1.4
    assert speed == pytest.approx(0.3 * 1.4, rel=0.05)  # K of Kayacan et al. 2016, sec. II
    assert yaw_rate == pytest.approx(speed * np.tan(angle) / wheelbase, rel=0.15)


def test_the_shipped_scene_is_what_the_command_writes(shipped):
    assembly = assemble(load("grass", FLAT)[1], 1)
    assembly.plant.restore(assembly.start)
    files = mjcf_files(assembly.plant)
    assert list(files) == ["scene.xml"]
    made = mujoco.MjModel.from_xml_string(files["scene.xml"].decode())
    for name in (
        "body_mass",
        "body_inertia",
        "body_pos",
        "jnt_range",
        "geom_size",
        "geom_friction",
        "dof_frictionloss",
        "actuator_gainprm",
        "actuator_biasprm",
        "actuator_ctrlrange",
    ):
        np.testing.assert_allclose(getattr(made, name), getattr(shipped, name), rtol=1e-6)


def test_wheels_on_soil_are_refused():
    with pytest.raises(InvalidPlant, match=r'plant\.wheels: must be "contact"'):
        mjcf_files(assemble(load("grass")[1], 1).plant)
