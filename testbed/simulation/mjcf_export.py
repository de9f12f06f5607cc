"""A plant as files for MuJoCo: its scene, its wheels on soil, and a program that drives it.

The scene loads in MuJoCo alone; its wheels then have MuJoCo's contact with Coulomb friction. With
the file of the wheels, `SoilWheels` puts the soil law of the proving ground in its place.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import struct
from dataclasses import fields
from typing import Final

import mujoco
import numpy as np

from ..configuration.resources import resource
from ..foreign_files import read_bounded
from ..ground.ground import GROUND_FILE
from ..ground.terrain import Terrain
from ..truth import WHEELS
from ..vehicle.vehicle_model import build_spec
from ..wheels.soil_wheels import WheelsFile, write_wheels
from ..wheels.tyre import Tyre, mobility
from .plant import Plant

SCENE_FILE: Final = "scene.xml"
HEIGHTS_FILE: Final = "ground.hf"
WHEELS_FILE: Final = "wheels.toml"
DRIVER_FILE: Final = "drive.py"

_IMU_M: Final = (0.0, 0.0, 0.3)  # of the IMU on the tractor, above its rear axle; assumed
_SITE: Final = mujoco.mjtObj.mjOBJ_SITE
_JOINT: Final = mujoco.mjtObj.mjOBJ_JOINT


def mjcf_files(plant: Plant) -> dict[str, bytes]:
    """Return the files of a plant by their names.

    They are the scene, the heights where the ground is not level, the wheels, the soil where its
    strength is not the same everywhere, and a program that drives a slalom. The keyframe `home` is
    the present position at rest; the file of the wheels has the deflection of the treads there. An
    implement's draft, ruts so far and the imperfections of actuators and sensors are not in them.
    """
    spec = build_spec(plant.vehicle, plant.terrain, plant.wheel_law, plant.timestep_s)
    _put_contacts(spec, plant)
    _put_sensors(spec)
    content: dict[str, bytes] = {}
    if np.ptp(plant.terrain.heights) == 0.0:
        _put_plane(spec, plant.terrain)
    else:
        content[HEIGHTS_FILE] = _put_heights(spec, plant.terrain)
    spec.add_key(name="home", qpos=plant.data.qpos.copy(), ctrl=np.zeros(plant.model.nu))
    spec.assets = content
    spec.compile()
    content[SCENE_FILE] = spec.to_xml().encode()
    content[WHEELS_FILE] = write_wheels(_wheels(plant)).encode()
    if np.ptp(plant.ground.cone_index) > 0.0:
        content[GROUND_FILE] = plant.ground.to_npz()
    content[DRIVER_FILE] = read_bounded(resource("proving_ground.mjcf", DRIVER_FILE))
    return content


def _wheels(plant: Plant) -> WheelsFile:
    keys = [each.name for each in fields(Tyre)]
    settled = plant.wheels.treads.round(9)  # [m] the file has no number below 1e-12
    tyres: dict[str, Tyre] = {}
    treads: dict[str, tuple[float, float, float, float]] = {}
    for name, (along, across, rolling, bore) in zip(WHEELS, settled.tolist(), strict=True):
        wheel = plant.vehicle.wheels[name.split("_")[0]]
        tyres[name] = Tyre(**{key: getattr(wheel, key) for key in keys})
        treads[name] = (along, across, rolling, bore)
    uniform = np.ptp(plant.ground.cone_index) == 0.0
    return WheelsFile(
        tyres=tyres,
        ground="ground" if uniform else "",
        cone_index_kpa=float(plant.ground.cone_index.flat[0]),
        ruts=plant.ground.ruts,
        treads_m=treads,
        law=plant.soil_law,
    )


def _put_contacts(spec: mujoco.MjSpec, plant: Plant) -> None:
    """Let the wheels collide with the ground, for a viewer without the soil law.

    The coefficient of friction is the largest traction ratio of the soil under the wheel.
    """
    tyres = plant.tyres
    report = plant.wheels.report
    bn, _ = mobility(plant.wheel_law, tyres, report.load, report.cone_index)
    friction = plant.wheel_law.largest_traction_ratio(bn)
    for wheel, coefficient in zip(WHEELS, friction, strict=True):
        geom = spec.geom(f"{wheel}_contact")
        geom.contype = 2
        geom.conaffinity = 1
        geom.friction[0] = coefficient


def _put_sensors(spec: mujoco.MjSpec) -> None:
    """Add GNSS antennas, an IMU on the tractor and the angles of the joints."""
    spec.body("tractor").add_site(name="imu", pos=_IMU_M, size=[0.01, 0.01, 0.01])
    kind = mujoco.mjtSensor
    for name, sensor, object_kind, on in (
        ("gnss_tractor", kind.mjSENS_FRAMEPOS, _SITE, "antenna_tractor"),
        ("gnss_tractor_velocity", kind.mjSENS_FRAMELINVEL, _SITE, "antenna_tractor"),
        ("gnss_trailer", kind.mjSENS_FRAMEPOS, _SITE, "antenna_trailer"),
        ("gnss_trailer_velocity", kind.mjSENS_FRAMELINVEL, _SITE, "antenna_trailer"),
        ("imu_acceleration", kind.mjSENS_ACCELEROMETER, _SITE, "imu"),
        ("imu_rotation", kind.mjSENS_GYRO, _SITE, "imu"),
        ("steer_angle", kind.mjSENS_JOINTPOS, _JOINT, "steer"),
        ("hitch_angle", kind.mjSENS_JOINTPOS, _JOINT, "rj1_yaw"),
        ("trailer_steer_angle", kind.mjSENS_JOINTPOS, _JOINT, "rj2_yaw"),
        ("rear_left_speed", kind.mjSENS_JOINTVEL, _JOINT, "rear_left"),
        ("rear_right_speed", kind.mjSENS_JOINTVEL, _JOINT, "rear_right"),
    ):
        spec.add_sensor(name=name, type=sensor, objtype=object_kind, objname=on)


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
    field.file = HEIGHTS_FILE
    field.content_type = "image/vnd.mujoco.hfield"
    heights = ((terrain.heights - low) / rise).astype("<f4")
    return struct.pack("<ii", *heights.shape) + heights.tobytes()
