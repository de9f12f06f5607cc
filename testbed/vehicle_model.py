"""The true vehicle and its MuJoCo model: mjcf, the field, what the scenario changes."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
import re
from dataclasses import dataclass, fields
from typing import Final, Literal, get_args

import mujoco
import numpy as np

from testbed.appearance import put_tyres
from testbed.errors import InvalidPlant
from testbed.resources import resource
from testbed.terrain import Terrain
from testbed.truth import WHEELS
from testbed.tyre import Tyres

WheelModel = Literal["soil", "contact"]

_MJCF: Final = "tractor_trailer.xml"
_DRAWN_DRAWBAR_M: Final = 0.8  # d for which the mjcf draws the A-frame
_LOAD_DENSITY: Final = 700.0  # [kg/m^3] grain, assumed; sets the size of the load that is drawn
_GROUND_BASE_M: Final = 1.0  # thickness of the ground below its lowest point


@dataclass(frozen=True, slots=True)
class PlantVehicle:
    """True values of the vehicle that a scenario may change; the rest stands in `mjcf/`.

    Raises:
        InvalidPlant: a value is not finite or out of its range.
    """

    hitch_offset_m: float = 0.3  # a, rear axle to RJ1; assumed, a + d = 1.1 m is the paper's
    drawbar_m: float = 0.8  # d, RJ1 to RJ2; assumed
    load_kg: float = 0.0  # in the trailer
    load_height_m: float = 0.55  # centre of the load above the trailer axle; assumed
    load_forward_m: float = 0.0  # centre of the load ahead of the trailer axle

    def __post_init__(self) -> None:
        allowed = {
            "hitch_offset_m": (0.1, 1.0),
            "drawbar_m": (0.3, 3.0),
            "load_kg": (0.0, 2000.0),
            "load_height_m": (0.2, 2.0),
            "load_forward_m": (-0.6, 0.6),
        }
        for item in fields(self):
            value, (low, high) = getattr(self, item.name), allowed[item.name]
            if not (math.isfinite(value) and low <= value <= high):
                raise InvalidPlant(
                    f"plant.vehicle.{item.name}: got {value}, must be in [{low}, {high}]"
                )


def build_spec(
    vehicle: PlantVehicle, terrain: Terrain, wheels: WheelModel, timestep_s: float
) -> mujoco.MjSpec:
    """Return the model of the vehicle on this ground, ready to be compiled.

    Raises:
        InvalidPlant: the wheel model has no such name, or the time step is out of range.
    """
    if wheels not in get_args(WheelModel):
        raise InvalidPlant(f"plant.wheels: got {wheels!r}, must be 'soil' or 'contact'")
    if not 0.0 < timestep_s <= 0.004:  # front wheels shimmy at 0.008
        raise InvalidPlant(f"plant.timestep_s: got {timestep_s}, must be above 0, at most 0.004")
    spec = mujoco.MjSpec.from_file(str(resource("mjcf", _MJCF)))
    spec.option.timestep = timestep_s
    _put_lengths(spec, vehicle)
    _put_load(spec, vehicle)
    _put_ground(spec, terrain)
    put_tyres(spec)
    if wheels == "contact":
        for wheel in WHEELS:
            geom = spec.geom(f"{wheel}_contact")
            geom.contype, geom.conaffinity = 2, 1
    radius = spec.numeric("tyre_rear").data[0]
    speed = spec.numeric("hydrostat_speed_gain").data[0]
    hydrostat = spec.actuator("hydrostat")
    wheel_speed = spec.numeric("hydrostat_calibration").data[0] * speed / radius  # [rad/s]
    hydrostat.gainprm[0] = -hydrostat.biasprm[2] * wheel_speed
    return spec


def physics_model(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Return the model without what is only seen: 85 shapes, 12 % of the time of a step."""
    lean = spec.copy()
    lean.compiler.discardvisual = True
    return lean.compile()


def mjcf_of(spec: mujoco.MjSpec) -> str:
    """Return the MJCF of the whole model without the heights of its ground.

    Written out, the heights are a hundred times as long as everything else; the loader takes a
    ground without them for a level one.
    """
    spec.compile()  # nothing can be written before
    return re.sub(r'\s+elevation="[^"]*"', "", spec.to_xml())


def tyres_of(model: mujoco.MjModel) -> Tyres:
    """Return the tyres of the model's wheels in the order of `WHEELS`."""
    rows = np.array([model.numeric(f"tyre_{wheel.split('_')[0]}").data for wheel in WHEELS])
    radius, width, section, relative, rated, damping = rows.T
    return Tyres(radius, width, section, relative, rated, damping)


def _put_lengths(spec: mujoco.MjSpec, vehicle: PlantVehicle) -> None:
    drawbar, trailer = spec.body("drawbar"), spec.body("trailer")
    stretch = vehicle.drawbar_m - _DRAWN_DRAWBAR_M
    drawbar.pos[0] = -vehicle.hitch_offset_m
    spec.site("rj1").pos[0] = -vehicle.hitch_offset_m
    trailer.pos[0] -= stretch
    spec.site("rj2").pos[0] -= stretch
    for geom in drawbar.geoms:
        if not math.isnan(geom.fromto[0]):
            for end in (0, 3):
                geom.fromto[end] *= vehicle.drawbar_m / _DRAWN_DRAWBAR_M


def _put_load(spec: mujoco.MjSpec, vehicle: PlantVehicle) -> None:
    if vehicle.load_kg == 0.0:
        return
    half_x, half_y = 0.6, 0.5
    half_z = vehicle.load_kg / _LOAD_DENSITY / (8.0 * half_x * half_y)
    spec.body("trailer").add_geom(
        spec.find_default("body"),
        name="load",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[vehicle.load_forward_m, 0.0, vehicle.load_height_m],
        size=[half_x, half_y, half_z],
        mass=vehicle.load_kg,
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
