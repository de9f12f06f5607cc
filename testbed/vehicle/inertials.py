"""Inertial properties of the bodies: mass, centre of mass and inertia from the vehicle's file.

The masses in `mjcf/` are shares: they divide the mass of a body, or of a group of bodies, over its
shapes. The shapes also give the inertia where the file has none.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np

from ..truth import WHEELS
from .vehicle import PlantVehicle
from .vehicle_parts import Tractor, Trailer

_FRONT_AXLE: Final = ("front_axle", "steer", "knuckle_left", "knuckle_right")


def set_inertials(spec: mujoco.MjSpec, vehicle: PlantVehicle) -> None:
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
    radius = vehicle.rear_wheel.radius_m
    tractor_parts = (*_FRONT_AXLE, *WHEELS[:4])
    _set_chassis(spec, data, "tractor", vehicle.tractor, tractor_parts, radius)
    radius = vehicle.trailer_wheel.radius_m
    _set_chassis(spec, data, "trailer", vehicle.trailer, WHEELS[4:], radius)
    centre = np.array([-0.5 * vehicle.drawbar.length_m, 0.0, 0.0])
    _set_inertial(spec, model, "drawbar", vehicle.drawbar.mass_kg, centre, None)


def _divide_mass(spec: mujoco.MjSpec, bodies: Sequence[str], mass: float) -> None:
    """Divide a mass [kg] over the shapes of some bodies by the shares of the MJCF."""
    shapes = [shape for body in bodies for shape in spec.body(body).geoms]
    total = sum(shape.mass for shape in shapes)
    for shape in shapes:
        shape.mass *= mass / total


def _set_chassis(
    spec: mujoco.MjSpec,
    data: mujoco.MjData,
    body: str,
    whole: Tractor | Trailer,
    parts: Sequence[str],
    axle_height: float,
) -> None:
    model = data.model
    ids = [model.body(part).id for part in parts]
    masses = model.body_mass[ids]  # (n,)
    origin = data.xpos[model.body(body).id]
    moments = masses @ (data.xipos[ids] - origin)  # (3,) [kg m]
    mass = whole.mass_kg - float(masses.sum())
    centre = np.array([whole.centre_forward_m, 0.0, whole.centre_height_m - axle_height])
    centre = (whole.mass_kg * centre - moments) / mass
    _set_inertial(spec, model, body, mass, centre, whole.chassis_inertia_kgm2)


def _set_inertial(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    name: str,
    mass: float,
    centre: np.ndarray,
    inertia: tuple[float, float, float] | None,
) -> None:
    """Set the inertial of a body; the default inertia [kg m^2] is that of its shapes, scaled."""
    body, from_shapes = spec.body(name), model.body(name)
    body.explicitinertial = True
    body.mass = mass
    body.ipos = centre
    body.iquat = [1.0, 0.0, 0.0, 0.0] if inertia else from_shapes.iquat
    body.inertia = inertia or from_shapes.inertia * mass / float(from_shapes.mass[0])
