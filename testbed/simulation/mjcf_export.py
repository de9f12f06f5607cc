"""A plant as files of MuJoCo that load without this project: wheels in contact with the ground."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import struct
from typing import Final

import mujoco
import numpy as np

from ..errors import InvalidPlant
from ..ground.terrain import Terrain
from ..truth import WHEELS
from ..vehicle.vehicle_model import build_spec
from ..wheels.wheel_models import ContactWheels
from .plant import Plant

SCENE_FILE: Final = "scene.xml"
GROUND_FILE: Final = "ground.hf"


def mjcf_files(plant: Plant) -> dict[str, bytes]:
    """Return the files of a plant by their names: the scene and, where it is not level, its ground.

    The scene has the vehicle, MuJoCo's own contact of its wheels, light and ground. Friction and
    motion resistance are those of the soil under the wheels in the present state of the plant,
    and the same all over the field. The keyframe `home` is the present position at rest. Neither
    the soil's side force nor an implement's draft act.

    Raises:
        InvalidPlant: the wheels of the plant are not in contact with the ground.
    """
    if not isinstance(plant.wheels, ContactWheels):
        raise InvalidPlant('plant.wheels: must be "contact" for an export as MJCF')
    model = plant.model
    data = plant.data
    spec = build_spec(plant.vehicle, plant.terrain, "contact", plant.wheel_law, plant.timestep_s)
    for wheel in WHEELS:
        spec.geom(f"{wheel}_contact").friction[0] = model.geom(f"{wheel}_contact").friction[0]
        spec.joint(wheel).frictionloss = model.joint(wheel).frictionloss[0]
    files: dict[str, bytes] = {}
    if np.ptp(plant.terrain.heights) == 0.0:
        _put_plane(spec, plant.terrain)
    else:
        files[GROUND_FILE] = _put_heights(spec, plant.terrain)
    spec.add_key(name="home", qpos=data.qpos.copy(), ctrl=np.zeros(model.nu))
    spec.assets = files
    spec.compile()
    return {SCENE_FILE: spec.to_xml().encode(), **files}


def _put_plane(spec: mujoco.MjSpec, terrain: Terrain) -> None:
    size_x, size_y = terrain.size_m
    ground = spec.geom("ground")
    ground.type = mujoco.mjtGeom.mjGEOM_PLANE
    ground.hfieldname = ""
    ground.size = [0.5 * size_x, 0.5 * size_y, 1.0]
    ground.pos = [*terrain.centre, float(terrain.heights.flat[0])]
    spec.delete(spec.hfield("ground"))


def _put_heights(spec: mujoco.MjSpec, terrain: Terrain) -> bytes:
    """Let the ground refer to a file, and return the file: MuJoCo's format of height fields."""
    low = terrain.heights.min()
    rise = max(float(np.ptp(terrain.heights)), 1e-6)  # as of the field in the spec
    field = spec.hfield("ground")
    field.userdata = []
    field.file = GROUND_FILE
    field.content_type = "image/vnd.mujoco.hfield"
    heights = ((terrain.heights - low) / rise).astype("<f4")
    return struct.pack("<ii", *heights.shape) + heights.tobytes()
