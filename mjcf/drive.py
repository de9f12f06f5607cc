"""Drive a slalom on soil: `python drive.py` beside scene.xml and wheels.toml."""

# pyright: reportAttributeAccessIssue=false

import math

import mujoco

from proving_ground import SoilWheels

model = mujoco.MjModel.from_xml_path("scene.xml")
data = mujoco.MjData(model)
mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
wheels = SoilWheels.from_file(model, "wheels.toml")

while data.time < 20.0:
    data.ctrl[:] = 0.25 * math.sin(0.8 * data.time), 0.0, 0.6
    wheels.apply(model, data)
    mujoco.mj_step(model, data)
mujoco.mj_forward(model, data)
print(data.sensor("gnss_tractor").data, data.sensor("gnss_trailer").data)
