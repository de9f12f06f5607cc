"""Ground of a MuJoCo model: a plane or a height field as a grid of heights."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from typing import Final

import mujoco
import numpy as np

from ttempc.types import FloatArray

from ..errors import InvalidPlant
from .ground import Ground
from .soil import SoilMap
from .terrain import Terrain

_PLANE_M: Final = 10_000.0  # length of the one cell that stands for a plane
_STEEPEST: Final = 1.2  # slope of a plane [rad], as of a tilted terrain
_SQUARE: Final = 1e-6  # largest relative difference of the sides of a cell


def ground_of_geom(model: mujoco.MjModel, name: str, cone_index_kpa: float) -> Ground:
    """Return the ground that a geom of the world draws, of one strength.

    A plane may be tilted; a height field must be level and have square cells. Between its points
    heights are bilinear, where MuJoCo's own collisions have two triangles.

    Raises:
        InvalidPlant: there is no such geom, or it is of another kind or form.
        InvalidField: the cone index is not above 0, or a height is out of range.
    """
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name)
    if index < 0:
        raise InvalidPlant(f"ground {name!r}: no such geom")
    if model.geom_bodyid[index] != 0:
        raise InvalidPlant(f"ground {name!r}: must be a geom of the world, which does not move")
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, model.geom_quat[index])
    axes = axes.reshape(3, 3)
    position = model.geom_pos[index]
    kind = model.geom_type[index]
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        terrain = _plane(name, position, axes[:, 2])
    elif kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        if not np.allclose(axes, np.eye(3)):
            raise InvalidPlant(f"ground {name!r}: a height field must not be rotated")
        terrain = _height_field(model, name, position, int(model.geom_dataid[index]))
    else:
        raise InvalidPlant(f"ground {name!r}: must be a plane or a height field")
    return Ground(terrain, SoilMap(cone_index_kpa).rasterised(terrain))


def _plane(name: str, position: FloatArray, normal: FloatArray) -> Terrain:
    if normal[2] < np.cos(_STEEPEST):
        raise InvalidPlant(f"ground {name!r}: must be less than {_STEEPEST} rad steep")
    slope_x, slope_y = -normal[:2] / normal[2]
    origin = position[:2] - 0.5 * _PLANE_M
    half = 0.5 * _PLANE_M * np.array([-1.0, 1.0])
    heights = position[2] + slope_x * half + slope_y * half[:, None]  # (2, 2)
    return Terrain(heights, _PLANE_M, (float(origin[0]), float(origin[1])))


def _height_field(model: mujoco.MjModel, name: str, position: FloatArray, field: int) -> Terrain:
    ny = int(model.hfield_nrow[field])
    nx = int(model.hfield_ncol[field])
    half_x, half_y, rise, _ = model.hfield_size[field]
    spacing_x = 2.0 * half_x / (nx - 1)
    spacing_y = 2.0 * half_y / (ny - 1)
    if abs(spacing_x - spacing_y) > _SQUARE * spacing_x:
        raise InvalidPlant(
            f"ground {name!r}: cells are {spacing_x:g} x {spacing_y:g} m, must be square"
        )
    first = int(model.hfield_adr[field])
    heights = position[2] + rise * model.hfield_data[first : first + nx * ny].reshape(ny, nx)
    origin = (float(position[0] - half_x), float(position[1] - half_y))
    return Terrain(heights.astype(float), float(spacing_x), origin)
