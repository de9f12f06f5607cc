"""MuJoCo model of a vehicle on a field."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
import re
from typing import Final

import mujoco

from ..configuration.resources import resource
from ..errors import InvalidPlant
from ..ground.terrain import Terrain
from ..wheels.soil_law import SoilLaw
from ..wheels.wheel_models import wheel_model
from .appearance import put_tyres
from .inertials import set_inertials
from .linkage import linkage_polynomial
from .scale_mjcf import scale_to_vehicle
from .servos import SteeringServo, drive_servo, steering_servos
from .vehicle import PlantVehicle

_MJCF: Final = "tractor_trailer.xml"
_LOAD_DENSITY: Final = 700.0  # [kg/m^3] grain, assumed; sets the thickness of the load
_LOAD_SPREAD: Final = (0.67, 0.83)  # length and width of the load over those of the box; assumed
_GROUND_BASE_M: Final = 1.0  # thickness of the ground below its lowest point


def build_spec(
    vehicle: PlantVehicle, terrain: Terrain, wheels: str, law: SoilLaw, timestep_s: float
) -> mujoco.MjSpec:
    """Return the model of the vehicle on this ground, ready to be compiled.

    Args:
        vehicle: the true vehicle.
        terrain: shape of the ground.
        wheels: name of the wheel model.
        law: of the wheels on soil, by which the drive is calibrated.
        timestep_s: of the physics.

    Raises:
        InvalidPlant: there is no wheel model of that name, the time step is out of range, or the
            vehicle cannot drive.
    """
    adapt = wheel_model(wheels).adapt
    if not 0.0 < timestep_s <= 0.004:  # front wheels shimmy at 0.008
        raise InvalidPlant(f"plant.timestep_s: got {timestep_s}, must be above 0, at most 0.004")
    spec = mujoco.MjSpec.from_file(str(resource("proving_ground.mjcf", _MJCF)))
    spec.option.timestep = timestep_s
    scale_to_vehicle(spec, vehicle)
    set_inertials(spec, vehicle)
    _put_stops(spec, vehicle)
    _put_actuators(spec, vehicle, law)
    _put_load(spec, vehicle)
    _put_ground(spec, terrain)
    put_tyres(spec, vehicle)
    adapt(spec)
    return spec


def physics_model(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Return the model without its visual shapes: 85 shapes, 12 % of the time of a step."""
    lean = spec.copy()
    lean.compiler.discardvisual = True
    return lean.compile()


def level_model(spec: mujoco.MjSpec) -> tuple[mujoco.MjModel, mujoco.MjSpec]:
    """Return the whole model on level ground, and its spec."""
    level = spec.copy()
    ground = level.hfield("ground")
    ground.nrow = ground.ncol = 2
    ground.userdata = [0.0] * 4
    return level.compile(), level


def level_mjcf(level: mujoco.MjSpec, grid: tuple[int, int]) -> str:
    """Return the MJCF of the spec of `level_model`, with ground of a `grid` (rows, columns).

    The heights are left out: as text they are a hundred times as long as the rest. MuJoCo loads a
    ground without heights as level.
    """
    text = re.sub(r'\s+elevation="[^"]*"', "", level.to_xml())
    return text.replace('nrow="2" ncol="2"', f'nrow="{grid[0]}" ncol="{grid[1]}"')


def _put_stops(spec: mujoco.MjSpec, vehicle: PlantVehicle) -> None:
    hitch = vehicle.hitch
    for joint, limit_deg in (
        ("front_axle_roll", vehicle.front_axle.pivot_limit_deg),
        ("steer", vehicle.front_steering.limit_deg),
        ("rj1_yaw", hitch.yaw_limit_deg),
        ("rj1_pitch", hitch.pitch_limit_deg),
        ("rj1_roll", hitch.roll_limit_deg),
        ("rj2_yaw", vehicle.trailer_steering.limit_deg),
    ):
        spec.joint(joint).range = [-limit_deg, limit_deg]  # the MJCF's angles are degrees


def _put_actuators(spec: mujoco.MjSpec, vehicle: PlantVehicle, law: SoilLaw) -> None:
    front, trailer = steering_servos(vehicle)
    _put_steering(spec.actuator("steer"), front)
    _put_steering(spec.actuator("rj2"), trailer)
    spec.joint("steer").armature = front.linkage_inertia
    limit = math.radians(vehicle.front_steering.limit_deg)
    kingpin = 0.5 * vehicle.front_axle.kingpin_track_m
    for side, y in (("left", kingpin), ("right", -kingpin)):
        quartic = linkage_polynomial(limit, vehicle.tractor.wheelbase_m, y)
        spec.equality(f"ackermann_{side}").data[:5] = quartic
    drive, hydrostat = drive_servo(vehicle, law), spec.actuator("hydrostat")
    hydrostat.dynprm[0] = drive.lag
    hydrostat.gainprm[0] = drive.damping * drive.wheel_speed
    hydrostat.biasprm[2] = -drive.damping
    hydrostat.forcerange = [-drive.torque, drive.torque]


def _put_steering(actuator: mujoco.MjsActuator, servo: SteeringServo) -> None:
    actuator.dyntype = mujoco.mjtDyn.mjDYN_PID
    actuator.dynprm[1] = servo.rate
    actuator.biasprm[1], actuator.biasprm[2] = -servo.stiffness, -servo.damping
    actuator.ctrlrange = [-servo.limit, servo.limit]
    actuator.forcerange = [-servo.torque, servo.torque]


def _put_load(spec: mujoco.MjSpec, vehicle: PlantVehicle) -> None:
    """Put the load into the box as a separate body: the trailer's inertial does not change.

    It is as thick as grain, but its underside does not reach through the floor: the load is
    denser where its centre is too low for that. It touches nothing.
    """
    load, box = vehicle.load, vehicle.box
    if load.mass_kg == 0.0:
        return
    half_x, half_y = 0.5 * _LOAD_SPREAD[0] * box.length_m, 0.5 * _LOAD_SPREAD[1] * box.width_m
    half_z = load.mass_kg / _LOAD_DENSITY / (8.0 * half_x * half_y)
    half_z = min(half_z, load.height_m - box.floor_m)
    above_axle = load.height_m - vehicle.trailer_wheel.radius_m
    body = spec.body("trailer").add_body(name="load", pos=[load.forward_m, 0.0, above_axle])
    body.add_geom(
        spec.find_default("shape"),
        name="load",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[half_x, half_y, half_z],
        mass=load.mass_kg,
        material="load",
    )


def _put_ground(spec: mujoco.MjSpec, terrain: Terrain) -> None:
    ny, nx = terrain.heights.shape
    size_x, size_y = terrain.size_m
    low = float(terrain.heights.min())
    rise = max(float(terrain.heights.max()) - low, 1e-6)
    spec.add_hfield(
        name="ground",
        nrow=ny,
        ncol=nx,
        size=[0.5 * size_x, 0.5 * size_y, rise, _GROUND_BASE_M],
        userdata=((terrain.heights - low) / rise).ravel(),
    )
    spec.worldbody.add_geom(
        name="ground",
        type=mujoco.mjtGeom.mjGEOM_HFIELD,
        hfieldname="ground",
        pos=[*terrain.centre, low],
        material="ground",
        contype=1,
        conaffinity=0,
    )
