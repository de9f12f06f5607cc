"""What does the vehicle look like on its field?  Draws the picture in README.

    MUJOCO_GL=egl python -m experiments.studies.portrait docs/tractor.jpg [SCENARIO] [CAMERA]

Drives the scenario for some seconds and takes a picture off-screen. Needs a GL library: `libegl1`
and `libgl1` on Debian; no GPU, no screen.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import sys

import mujoco
from PIL import Image

from experiments.assembly import assemble
from experiments.scenario import load
from testbed.loop import drive
from testbed.record import Recorder

TICKS = 85  # 17 s: in the middle of the first curve
SIZE = (540, 960)


def main(file: str, scenario: str = "grass", camera: str = "chase") -> None:
    """Drive and draw."""
    assembly = assemble(load(scenario)[1], seed=1)
    drive(assembly.rig(Recorder()), TICKS)
    model = assembly.plant.drawn_model()
    data = mujoco.MjData(model)
    data.qpos[:] = assembly.plant.data.qpos
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, *SIZE) as renderer:
        renderer.update_scene(data, camera=camera)
        Image.fromarray(renderer.render()).save(file, quality=88)


if __name__ == "__main__":
    main(*sys.argv[1:])
