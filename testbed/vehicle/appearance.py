"""Appearance of the model: lugged tyres and a shaded ground, without effect on the physics."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import math
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ..ground.terrain import Terrain
from ..truth import WHEELS
from .vehicle import PlantVehicle

_AROUND: Final = 80  # vertices around a tyre
_LUGS: Final = 20  # on each half, in two rows that form arrows
_LUG_LEAD: Final = 0.75  # lead of a lug from shoulder to centre, over its pitch

# Strength on a logarithmic scale: the same factor has the same contrast on any soil.
_STRENGTHS: Final = np.log([100.0, 700.0, 2000.0])  # cone index [kPa]
_COLOURS: Final = np.array(
    [
        [0.36, 0.28, 0.19],  # mud: soil that does not carry
        [0.43, 0.53, 0.25],  # grass on firm ground
        [0.66, 0.62, 0.47],  # bare, dry and hard
    ]
)


def put_tyres(spec: mujoco.MjSpec, vehicle: PlantVehicle) -> None:
    """Add lugged tyres over the plain cylinders of the MJCF, which keep the mass."""
    for kind, wheel in vehicle.wheels.items():
        vertices, faces = tyre_mesh(wheel.radius_m, wheel.width_m, wheel.section_height_m)
        spec.add_mesh(name=f"tyre_{kind}", uservert=vertices.ravel(), userface=faces.ravel())
    for wheel in WHEELS:
        spec.geom(f"{wheel}_tyre").group = 4
        spec.body(wheel).add_geom(
            spec.find_default("shape"),
            name=f"{wheel}_lugs",
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=f"tyre_{wheel.split('_')[0]}",
            material="rubber",
        )


def tyre_mesh(
    radius: float, width: float, section_height: float
) -> tuple[FloatArray, NDArray[np.int32]]:
    """Return vertices (n, 3) [m] and faces (m, 3) of a tyre around y, closed, arrows forward."""
    rim = radius - section_height
    half = 0.5 * width
    lug = 0.16 * section_height
    across = np.array(
        [-1.0, -0.8, -0.55, -0.3, -0.05, 0.05, 0.3, 0.55, 0.8, 1.0]
    )  # profile across the tread
    crown = radius - 0.06 * section_height * across**2
    # profile (y, r) once around the section: rim, sidewall, tread, sidewall, rim
    y = np.concatenate([[-0.7, -1.0], 0.95 * across, [1.0, 0.7]]) * half
    wall = rim + 0.5 * section_height
    r = np.concatenate([[rim, wall], crown, [wall, rim]])
    angle = 2.0 * math.pi * np.arange(_AROUND) / _AROUND  # (around,)
    turn = np.where(across < 0.0, 0.0, 0.5) - _LUG_LEAD * (1.0 - np.abs(across))  # (tread,)
    phase = (_LUGS * angle[:, None] / (2.0 * math.pi) + turn) % 1.0  # (around, tread)
    ring = np.tile(r, (_AROUND, 1))  # (around, profile)
    ring[:, 2:-2] -= np.where(phase < 0.5, 0.0, lug)
    x = ring * np.sin(angle)[:, None]
    z = ring * np.cos(angle)[:, None]
    vertices = np.stack([x, np.broadcast_to(y, ring.shape), z], axis=-1).reshape(-1, 3)
    n = y.size
    here = np.arange(_AROUND)[:, None] * n + np.arange(n)  # (around, profile)
    ahead = np.roll(here, -1, axis=0)
    beside = np.roll(here, -1, axis=1)
    corner = np.roll(ahead, -1, axis=1)
    corners = (here, ahead, beside), (beside, ahead, corner)
    faces = [np.stack(each, axis=-1).reshape(-1, 3) for each in corners]
    return vertices, np.concatenate(faces).astype(np.int32)


def paint_ground(model: mujoco.MjModel, terrain: Terrain, cone_indices: FloatArray) -> None:
    """Paint light, height and strength of the ground into its texture: a plain one looks flat."""
    texture = model.texture("ground")
    columns = texture.width[0]
    rows = texture.height[0]
    colours = ground_colours(terrain, cone_indices, rows, columns)
    # the first row of a texture lies at the far side of a height field
    texture.data[:] = (255.0 * colours[::-1]).astype(np.uint8)


def ground_colours(
    terrain: Terrain, cone_indices: FloatArray, rows: int, columns: int
) -> FloatArray:
    """Return the colours of the ground from above, (rows, columns, 3) in 0..1, south first."""
    x = terrain.origin[0] + terrain.size_m[0] * np.arange(columns) / (columns - 1)
    y = terrain.origin[1] + terrain.size_m[1] * np.arange(rows) / (rows - 1)
    height = terrain.height(x, y[:, None])  # (rows, columns)
    slope_y, slope_x = np.gradient(height, y[1] - y[0], x[1] - x[0])
    slope_x = slope_x - slope_x.mean()
    slope_y = slope_y - slope_y.mean()
    # light from the north-west, steepened until the roughest tenth spans the range
    shade = slope_x - slope_y
    shade = np.clip(shade / max(4.0 * float(shade.std()), 0.05), -1.0, 1.0)
    # smoothed over a cell of the grid: otherwise the edge of a patch is a staircase
    from PIL import Image  # which a run without pictures does not load

    strengths = Image.fromarray(np.log(cone_indices).astype(np.float32))
    strength = np.asarray(strengths.resize((columns, rows), Image.Resampling.BILINEAR))
    colour = np.stack([np.interp(strength, _STRENGTHS, part) for part in _COLOURS.T], axis=-1)
    grain = np.random.default_rng(0).normal(
        0.0, 0.04, (rows, columns)
    )  # noise that looks like grass
    return np.clip(colour * (1.0 + 0.28 * shade + grain)[..., None], 0.0, 1.0)
