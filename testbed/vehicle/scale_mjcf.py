"""MJCF scaling: positions of bodies and joints, and sizes of shapes, from the vehicle's file.

The lengths of the model in `mjcf/` are read from its bodies and shapes. A group of shapes, which is
a named frame or a body, is moved to its position on the vehicle and scaled by the ratio of the
vehicle's lengths to those of the MJCF.
"""

from __future__ import annotations

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false
from dataclasses import dataclass

import mujoco
import numpy as np

from .vehicle import PlantVehicle

Scale = tuple[float, float, float]  # of x, y, z
_SIDES = (("left", 1.0), ("right", -1.0))


@dataclass(frozen=True, slots=True)
class _Ratios:
    """Lengths of the vehicle over those of the MJCF."""

    wheelbase: float
    engine: float  # width
    rear: float  # wheel radius
    inside: float  # between the rear tyres
    kingpins: float
    front: float  # wheel radius
    front_track: float
    drawbar: float
    trailer: float  # length
    trailer_track: float
    towed: float  # trailer wheel radius
    box: Scale

    @classmethod
    def of(cls, spec: mujoco.MjSpec, vehicle: PlantVehicle) -> _Ratios:
        tractor, axle = vehicle.tractor, vehicle.front_axle
        rear_radius, rear_half = spec.geom("rear_left_tyre").size[:2]
        rear_y, kingpin_y = spec.body("rear_left").pos[1], spec.body("knuckle_left").pos[1]
        box = spec.geom("box").size
        return cls(
            wheelbase=tractor.wheelbase_m / spec.body("front_axle").pos[0],
            engine=0.5 * tractor.engine_width_m / spec.geom("engine").size[1],
            rear=vehicle.rear_wheel.radius_m / rear_radius,
            inside=0.5 * (tractor.rear_track_m - vehicle.rear_wheel.width_m) / (rear_y - rear_half),
            kingpins=0.5 * axle.kingpin_track_m / kingpin_y,
            front=vehicle.front_wheel.radius_m / spec.geom("front_left_tyre").size[0],
            front_track=0.5 * axle.track_m / (kingpin_y + spec.body("front_left").pos[1]),
            drawbar=vehicle.drawbar.length_m / -spec.site("rj2").pos[0],
            trailer=vehicle.trailer.length_m / spec.joint("rj2_yaw").pos[0],
            trailer_track=0.5 * vehicle.trailer.track_m / spec.body("trailer_left").pos[1],
            towed=vehicle.trailer_wheel.radius_m / spec.geom("trailer_left_tyre").size[0],
            box=(
                0.5 * vehicle.box.length_m / box[0],
                0.5 * vehicle.box.width_m / box[1],
                0.5 * vehicle.box.height_m / box[2],
            ),
        )


def scale_to_vehicle(spec: mujoco.MjSpec, vehicle: PlantVehicle) -> None:
    """Scale the model, as read from `mjcf/`, to the vehicle, in place."""
    ratios = _Ratios.of(spec, vehicle)
    _fit_tractor(spec, vehicle, ratios)
    _fit_front_axle(spec, vehicle, ratios)
    _fit_trailer(spec, vehicle, ratios)
    for camera in spec.cameras:
        camera.pos = np.asarray(camera.pos) * ratios.wheelbase


def _fit_tractor(spec: mujoco.MjSpec, vehicle: PlantVehicle, by: _Ratios) -> None:
    tractor, hitch, wheel = vehicle.tractor, vehicle.hitch, vehicle.rear_wheel
    spec.body("tractor").pos = [0.0, 0.0, wheel.radius_m]
    hitch_z = hitch.height_m - wheel.radius_m
    deck = _frame(spec, "cab").pos[2] * by.rear
    _fit_frame(spec, "nose", (by.wheelbase, by.engine, by.rear), (0.0, 0.0, 0.0))
    _fit_frame(spec, "rear_axle", (by.rear, by.inside, by.rear), (0.0, 0.0, 0.0))
    # a person is not scaled: the cab has the same height on every tractor
    _fit_frame(spec, "cab", (by.wheelbase, by.inside, 1.0), (0.0, 0.0, deck))
    seat = _frame(spec, "driver").pos[0] * by.wheelbase
    _fit_frame(spec, "driver", (1.0, 1.0, 1.0), (seat, 0.0, deck))
    reach = hitch.offset_m / -spec.site("rj1").pos[0]
    _fit_frame(spec, "bracket", (reach, by.rear, by.rear), (0.0, 0.0, hitch_z))
    spec.site("rj1").pos = [-hitch.offset_m, 0.0, hitch_z]
    across = 0.5 * wheel.width_m / spec.geom("rear_left_tyre").size[1]
    for side, sign in _SIDES:
        y = sign * 0.5 * tractor.rear_track_m
        _fit_frame(spec, f"fender_{side}", (by.rear, across, by.rear), (0.0, y, 0.0))
        _fit_wheel(spec, f"rear_{side}", y, wheel.radius_m, wheel.width_m)


def _fit_front_axle(spec: mujoco.MjSpec, vehicle: PlantVehicle, by: _Ratios) -> None:
    axle, wheel = vehicle.front_axle, vehicle.front_wheel
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
    hitch, trailer, box = vehicle.hitch, vehicle.trailer, vehicle.box
    wheel, length = vehicle.trailer_wheel, vehicle.drawbar.length_m
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
    around, across = radius / mjcf_radius, 0.5 * width / mjcf_half_width
    body = spec.body(name)
    body.pos[1] = y
    _scale_shapes(body.geoms, (around, across, around))


def _frame(spec: mujoco.MjSpec, name: str) -> mujoco.MjsFrame:
    return next(frame for frame in spec.frames if frame.name == name)


def _fit_frame(
    spec: mujoco.MjSpec, name: str, scale: Scale, position: tuple[float, float, float]
) -> None:
    """Move a named frame to its position and scale its shapes and sites."""
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
