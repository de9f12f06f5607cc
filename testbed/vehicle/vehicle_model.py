"""MuJoCo model of a vehicle on a field: the MJCF of `mjcf/`, scaled to the vehicle's file.

The lengths of the MJCF are read from its bodies and shapes. A group of shapes, which is a named
frame or a body, is moved to its position on the vehicle and scaled by the ratio of the vehicle's
lengths to those of the MJCF. Its masses are shares: they divide the mass of a body, or of a group
of bodies, over its shapes. The shapes also give the inertia where the file has none.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import math
import re
from collections.abc import Sequence
from typing import Any, Final

import mujoco
import numpy as np

from ttempc.types import FloatArray

from ..configuration.resources import resource
from ..errors import InvalidPlant
from ..ground.terrain import Terrain
from ..truth import WHEELS
from ..wheels.soil_law import SoilLaw
from .appearance import put_tyres
from .servos import put_servos
from .vehicle import PlantVehicle, knuckle_angle

_MJCF: Final = "tractor_trailer.xml"
_SAMPLES: Final = 201  # of the knuckle angle, for the fit of its quartic
_LOAD_DENSITY: Final = 700.0  # [kg/m^3] grain, assumed; sets the thickness of the load
_LOAD_SPREAD: Final = (0.67, 0.83)  # length and width of the load over those of the box; assumed
_FRONT_AXLE: Final = ("front_axle", "steer", "knuckle_left", "knuckle_right")
_SIDES: Final = (("left", 1.0), ("right", -1.0))
_SHORTEST_BRACKET_M: Final = 0.1  # of a hitch on the rear axle or before it
_GROUND_BASE_M: Final = 1.0  # thickness of the ground below its lowest point


Scale = tuple[float, float, float]  # of x, y, z


def build_spec(
    vehicle: PlantVehicle, terrain: Terrain, law: SoilLaw, timestep_s: float
) -> mujoco.MjSpec:
    """Return the model of the vehicle on this ground, ready to be compiled.

    The drive is calibrated by the `law` of wheels on soil.

    Raises:
        InvalidPlant: the time step is out of range, or the vehicle cannot drive.
    """
    if not 0.0 < timestep_s <= 0.004:  # front wheels shimmy at 0.008
        raise InvalidPlant(f"plant.timestep_s: got {timestep_s}, must be above 0, at most 0.004")
    spec = mujoco.MjSpec.from_file(str(resource("proving_ground.mjcf", _MJCF)))
    spec.option.timestep = timestep_s
    ratios = _Ratios(spec, vehicle)
    _fit_tractor(spec, vehicle, ratios)
    _fit_front_axle(spec, vehicle, ratios)
    _fit_trailer(spec, vehicle, ratios)
    for camera in spec.cameras:
        camera.pos = np.asarray(camera.pos) * ratios.wheelbase
    _set_inertials(spec, vehicle)
    _put_stops(spec, vehicle)
    _put_linkage(spec, vehicle)
    put_servos(spec, vehicle, law)
    _put_load(spec, vehicle)
    _put_ground(spec, terrain)
    put_tyres(spec, vehicle)
    return spec


def physics_model(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Return the model of a plant: without visual shapes, lights and cameras, 14 % of a step.

    A force of the plant couples the joints, see `steering_coupling`. The constraints that do it in
    a model by itself are inactive.
    """
    lean = spec.copy()
    lean.compiler.discardvisual = True
    for item in [*lean.cameras, *lean.lights]:
        lean.delete(item)
    for constraint in lean.equalities:
        constraint.active = False
    model = lean.compile()
    for body in range(1, model.nbody):
        _align_inertia(model, body)
    for same in (model.geom_sameframe, model.site_sameframe):  # as inertias that were turned
        same[same == mujoco.mjtSameFrame.mjSAMEFRAME_INERTIA] = 0
        same[same == mujoco.mjtSameFrame.mjSAMEFRAME_INERTIAROT] = 0
    return model


def _align_inertia(model: mujoco.MjModel, body: int) -> None:
    """Name the principal axes of a body by its frame where they are along it: one frame less."""
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, model.body_iquat[body])
    order = np.abs(axes.reshape(3, 3)).round(9)
    if np.isin(order, (0.0, 1.0)).all():
        model.body_inertia[body] = order @ model.body_inertia[body]
        model.body_iquat[body] = 1.0, 0.0, 0.0, 0.0
        kind = mujoco.mjtSameFrame
        moved = model.body_ipos[body].any()
        model.body_sameframe[body] = kind.mjSAMEFRAME_BODYROT if moved else kind.mjSAMEFRAME_BODY


def level_model(spec: mujoco.MjSpec) -> tuple[mujoco.MjModel, str]:
    """Return the whole model on level ground, and the MJCF of the model without heights.

    As text the heights are a hundred times as long as the rest. MuJoCo loads a ground without them
    as level.
    """
    level = spec.copy()
    ground = level.hfield("ground")
    grid = f'nrow="{ground.nrow}" ncol="{ground.ncol}"'
    ground.nrow = ground.ncol = 2
    ground.userdata = [0.0] * 4
    model = level.compile()
    text = re.sub(r'\s+elevation="[^"]*"', "", level.to_xml())
    return model, text.replace('nrow="2" ncol="2"', grid)


def linkage_polynomial(limit: float, wheelbase: float, kingpin_y: float) -> FloatArray:
    """Return the quartic in delta nearest to `knuckle_angle` over +-limit [rad], (5,).

    Order 0 first. MuJoCo couples joints by a quartic. The least-squares fit has no constant: at
    delta = 0 both wheels are straight.
    """
    delta = np.linspace(-limit, limit, _SAMPLES)
    powers = delta[:, None] ** np.arange(1, 5)  # (samples, 4)
    angle = knuckle_angle(delta, wheelbase, kingpin_y)
    return np.concatenate([[0.0], np.linalg.lstsq(powers, angle, rcond=None)[0]])


class _Ratios:
    """Lengths of the vehicle over those of the MJCF, which `spec` has before it is scaled."""

    def __init__(self, spec: mujoco.MjSpec, vehicle: PlantVehicle) -> None:
        tractor = vehicle.tractor
        axle = vehicle.front_axle
        box = vehicle.box
        rear_radius, rear_half = spec.geom("rear_left_tyre").size[:2]
        rear_y = spec.body("rear_left").pos[1]
        kingpin_y = spec.body("knuckle_left").pos[1]
        box_x, box_y, box_z = spec.geom("box").size
        self.wheelbase = tractor.wheelbase_m / spec.body("front_axle").pos[0]
        self.engine = (
            0.5 * tractor.engine_width_m / spec.geom("engine").size[1]
        )  # scale of the width
        self.rear = vehicle.rear_wheel.radius_m / rear_radius
        between = tractor.rear_track_m - vehicle.rear_wheel.width_m  # space between the rear tyres
        self.inside = 0.5 * between / (rear_y - rear_half)
        self.kingpins = 0.5 * axle.kingpin_track_m / kingpin_y
        self.front = vehicle.front_wheel.radius_m / spec.geom("front_left_tyre").size[0]
        self.front_track = 0.5 * axle.track_m / (kingpin_y + spec.body("front_left").pos[1])
        self.drawbar = vehicle.drawbar.length_m / -spec.site("rj2").pos[0]
        self.trailer = vehicle.trailer.length_m / spec.joint("rj2_yaw").pos[0]
        self.trailer_track = 0.5 * vehicle.trailer.track_m / spec.body("trailer_left").pos[1]
        self.towed = vehicle.trailer_wheel.radius_m / spec.geom("trailer_left_tyre").size[0]
        box_height = 0.5 * box.height_m / box_z
        self.box = 0.5 * box.length_m / box_x, 0.5 * box.width_m / box_y, box_height


def _fit_tractor(spec: mujoco.MjSpec, vehicle: PlantVehicle, by: _Ratios) -> None:
    tractor = vehicle.tractor
    hitch = vehicle.hitch
    wheel = vehicle.rear_wheel
    spec.body("tractor").pos = [0.0, 0.0, wheel.radius_m]
    hitch_z = hitch.height_m - wheel.radius_m
    deck = _frame(spec, "cab").pos[2] * by.rear
    _fit_frame(spec, "nose", (by.wheelbase, by.engine, by.rear), (0.0, 0.0, 0.0))
    _fit_frame(spec, "rear_axle", (by.rear, by.inside, by.rear), (0.0, 0.0, 0.0))
    # a person is not scaled: the cab has the same height on every tractor
    _fit_frame(spec, "cab", (by.wheelbase, by.inside, 1.0), (0.0, 0.0, deck))
    seat = _frame(spec, "driver").pos[0] * by.wheelbase
    _fit_frame(spec, "driver", (1.0, 1.0, 1.0), (seat, 0.0, deck))
    reach = max(hitch.offset_m, _SHORTEST_BRACKET_M) / -spec.site("rj1").pos[0]
    _fit_frame(spec, "bracket", (reach, by.rear, by.rear), (0.0, 0.0, hitch_z))
    spec.site("rj1").pos = [-hitch.offset_m, 0.0, hitch_z]
    across = 0.5 * wheel.width_m / spec.geom("rear_left_tyre").size[1]
    for side, sign in _SIDES:
        y = sign * 0.5 * tractor.rear_track_m
        _fit_frame(spec, f"fender_{side}", (by.rear, across, by.rear), (0.0, y, 0.0))
        _fit_wheel(spec, f"rear_{side}", y, wheel.radius_m, wheel.width_m)


def _fit_front_axle(spec: mujoco.MjSpec, vehicle: PlantVehicle, by: _Ratios) -> None:
    axle = vehicle.front_axle
    wheel = vehicle.front_wheel
    z = wheel.radius_m - vehicle.rear_wheel.radius_m
    spec.body("front_axle").pos = [vehicle.tractor.wheelbase_m, 0.0, z]
    beam = (by.front, by.kingpins, by.front)
    _fit_frame(spec, "beam", beam, (0.0, 0.0, 0.0))
    _fit_frame(spec, "guard", (by.front, by.front_track, by.front), (0.0, 0.0, 0.0))
    _scale_shapes(spec.body("steer").geoms, beam)
    spec.body("steer").pos = np.asarray(spec.body("steer").pos) * by.front
    for side, sign in _SIDES:
        knuckle = spec.body(f"knuckle_{side}")
        knuckle.pos[1] = sign * 0.5 * axle.kingpin_track_m
        _scale_shapes(knuckle.geoms, (by.front, by.front, by.front))
        arm = sign * 0.5 * (axle.track_m - axle.kingpin_track_m)
        _fit_wheel(spec, f"front_{side}", arm, wheel.radius_m, wheel.width_m)


def _fit_trailer(spec: mujoco.MjSpec, vehicle: PlantVehicle, by: _Ratios) -> None:
    hitch = vehicle.hitch
    trailer = vehicle.trailer
    box = vehicle.box
    wheel = vehicle.trailer_wheel
    length = vehicle.drawbar.length_m
    spec.body("drawbar").pos = spec.site("rj1").pos
    stout = by.box[1]
    _fit_frame(spec, "a_frame", (by.drawbar, stout, stout), (0.0, 0.0, 0.0))
    spec.site("rj2").pos[0] = -length
    drop = hitch.height_m - wheel.radius_m  # of the axle below the drawbar
    spec.body("trailer").pos = [-length - trailer.length_m, 0.0, -drop]
    spec.joint("rj2_yaw").pos = [trailer.length_m, 0.0, drop]
    _fit_frame(spec, "turntable", (stout, stout, stout), (trailer.length_m, 0.0, drop))
    _fit_frame(spec, "trailer_beam", (by.trailer, stout, stout), (0.0, 0.0, drop))
    _fit_frame(spec, "trailer_axle", (by.towed, by.trailer_track, by.towed), (0.0, 0.0, 0.0))
    floor = box.floor_m - wheel.radius_m
    _fit_frame(spec, "box", by.box, (box.forward_m, 0.0, floor))
    _fit_frame(spec, "mast", (1.0, 1.0, 1.0), (0.0, 0.0, floor))
    for side, sign in _SIDES:
        y = sign * 0.5 * trailer.track_m
        _fit_wheel(spec, f"trailer_{side}", y, wheel.radius_m, wheel.width_m)


def _fit_wheel(spec: mujoco.MjSpec, name: str, y: float, radius: float, width: float) -> None:
    mjcf_radius, mjcf_half_width = spec.geom(f"{name}_tyre").size[:2]
    around = radius / mjcf_radius
    across = 0.5 * width / mjcf_half_width
    body = spec.body(name)
    body.pos[1] = y
    _scale_shapes(body.geoms, (around, across, around))


def _frame(spec: mujoco.MjSpec, name: str) -> mujoco.MjsFrame:
    return next(frame for frame in spec.frames if frame.name == name)


def _fit_frame(
    spec: mujoco.MjSpec, name: str, scale: Scale, position: tuple[float, float, float]
) -> None:
    _frame(spec, name).pos = position
    _scale_shapes([g for g in spec.geoms if g.frame and g.frame.name == name], scale)
    for site in spec.sites:
        if site.frame and site.frame.name == name:
            site.pos = np.asarray(site.pos) * scale


def _scale_shapes(shapes: list[mujoco.MjsGeom], scale: Scale) -> None:
    """Scale shapes about the origin of their frame; circular sections stay circular."""
    factor = np.array(scale)
    mean = float(np.cbrt(factor.prod()))
    for shape in shapes:
        shape.pos = np.asarray(shape.pos) * factor
        if shape.type in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
            shape.size = np.asarray(shape.size) * factor
        elif not np.isnan(shape.fromto[0]):
            shape.fromto = np.asarray(shape.fromto) * np.tile(factor, 2)
            shape.size[0] *= mean
        else:
            along = 2
            if shape.alt.type == mujoco.mjtOrientation.mjORIENTATION_ZAXIS:
                along = int(np.argmax(np.abs(shape.alt.zaxis)))
            shape.size[1] *= factor[along]
            shape.size[0] *= float(np.sqrt(np.delete(factor, along).prod()))


def _set_inertials(spec: mujoco.MjSpec, vehicle: PlantVehicle) -> None:
    """Set the inertial properties of a spec whose shapes have their final sizes, in place.

    The file gives mass and centre of mass of tractor and trailer as a whole. The chassis gets the
    difference to axle and wheels.
    """
    for wheel in WHEELS:
        _divide_mass(spec, (wheel,), vehicle.wheels[wheel.split("_")[0]].mass_kg)
    _divide_mass(spec, _FRONT_AXLE, vehicle.front_axle.mass_kg)
    _divide_mass(spec, ("drawbar",), vehicle.drawbar.mass_kg)
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    for body, whole, parts, wheel in (
        ("tractor", vehicle.tractor, (*_FRONT_AXLE, *WHEELS[:4]), vehicle.rear_wheel),
        ("trailer", vehicle.trailer, WHEELS[4:], vehicle.trailer_wheel),
    ):
        ids = [model.body(part).id for part in parts]
        masses = model.body_mass[ids]  # (n,)
        moments = masses @ (data.xipos[ids] - data.xpos[model.body(body).id])  # (3,) [kg m]
        mass = whole.mass_kg - float(masses.sum())
        centre = np.array([whole.centre_forward_m, 0.0, whole.centre_height_m - wheel.radius_m])
        centre = (whole.mass_kg * centre - moments) / mass
        inertia = whole.chassis_inertia_kgm2
        _set_inertial(spec.body(body), model.body(body), mass, centre, inertia)
    middle = np.array([-0.5 * vehicle.drawbar.length_m, 0.0, 0.0])
    drawbar = spec.body("drawbar"), model.body("drawbar")
    _set_inertial(*drawbar, vehicle.drawbar.mass_kg, middle)


def _divide_mass(spec: mujoco.MjSpec, bodies: Sequence[str], mass: float) -> None:
    """Divide a mass [kg] over the shapes of some bodies by the shares of the MJCF."""
    shapes = [shape for body in bodies for shape in spec.body(body).geoms]
    total = sum(shape.mass for shape in shapes)
    for shape in shapes:
        shape.mass *= mass / total


def _set_inertial(
    body: mujoco.MjsBody,
    from_shapes: Any,  # noqa: ANN401 - a view of MuJoCo's model
    mass: float,
    centre: FloatArray,
    inertia: tuple[float, float, float] | None = None,
) -> None:
    """Set the inertial of a body; the default inertia [kg m^2] is that of its shapes, scaled."""
    body.explicitinertial = True
    body.mass = mass
    body.ipos = centre
    body.iquat = [1.0, 0.0, 0.0, 0.0] if inertia else from_shapes.iquat
    body.inertia = inertia or from_shapes.inertia * mass / float(from_shapes.mass[0])


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


def _put_linkage(spec: mujoco.MjSpec, vehicle: PlantVehicle) -> None:
    limit = math.radians(vehicle.front_steering.limit_deg)
    kingpin = 0.5 * vehicle.front_axle.kingpin_track_m
    for side, y in (("left", kingpin), ("right", -kingpin)):
        quartic = linkage_polynomial(limit, vehicle.tractor.wheelbase_m, y)
        spec.equality(f"ackermann_{side}").data[:5] = quartic


def _put_load(spec: mujoco.MjSpec, vehicle: PlantVehicle) -> None:
    """Put the load into the box as a separate body: the trailer's inertial does not change.

    It is as thick as grain, but its underside does not reach through the floor: the load is
    denser where its centre is too low for that. It touches nothing.
    """
    load = vehicle.load
    box = vehicle.box
    if load.mass_kg == 0.0:
        return
    half_x = 0.5 * _LOAD_SPREAD[0] * box.length_m
    half_y = 0.5 * _LOAD_SPREAD[1] * box.width_m
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
