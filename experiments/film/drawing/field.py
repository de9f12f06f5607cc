"""Mesh of the field, fine near the vehicle and coarse far away, with a meadow around it."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from ttempc.types import FloatArray

from ....testbed.ground.terrain import Terrain
from .ribbon import MeshView, add_mesh, strip_faces

_FINE_M: Final = 0.15  # spacing of the grid near its centre
_REACH_M: Final = 9.0  # of the fine part, from the centre to each side
_GROWTH: Final = 1.17  # ratio of successive spacings beyond the fine part
_SNAP_M: Final = 1.5  # step of the centre, a multiple of `_FINE_M`; continuous motion flickers
_MEADOW_M: Final = 220.0  # extent of the meadow beyond the field
_LEVEL_M: Final = 8.0  # decay length from the height at the field's edge to the plane
_FAR_M: Final = 60.0  # decay length of the field's slope: a level horizon behind a slope
_SWATH_M: Final = 3.0  # width of the stripes that a mower leaves
_SWATH_SHADE: Final = 0.055  # of their brightness
_EDGE_M: Final = 0.35  # width of the bare strip along the edge of the field
_STAKE_M: Final = 10.0  # between stakes on the edge
_STAKE_HEIGHT_M: Final = 0.9
_BARE: Final = np.array([0.36, 0.30, 0.20])
_STRIP_M: Final = 0.3  # depth of the meadow's inner edge below the field
_STEP_M: Final = 0.1  # of the central differences of the slope


class FieldMesh:
    """Ground of one run on a graded grid.

    On the grid of the simulation, a field of 80 x 50 m has 800 000 triangles, most of them smaller
    than a pixel, and a picture takes four times as long.
    """

    NAME: Final = "field"

    def __init__(self, terrain: Terrain, unit: float) -> None:
        self._terrain = terrain
        self._offsets = _offsets(unit, max(terrain.size_m))  # (n,)
        self._snap = _SNAP_M * unit
        self._centre = (np.nan, np.nan)

    def add_to(self, spec: mujoco.MjSpec) -> None:
        """Replace the ground of the simulation by field and meadow."""
        spec.delete(spec.geom("ground"))
        spec.delete(spec.hfield("ground"))
        x, y = np.meshgrid(self._offsets, self._offsets)
        # Not planar: the compiler needs principal axes of inertia.
        vertices = np.stack([x, 0.5 * y, 0.01 * np.sin(x + y)], axis=-1).reshape(-1, 3)
        n = len(self._offsets)
        add_mesh(spec, self.NAME, vertices, strip_faces(n, n), material="ground")
        meadow, faces = _meadow(self._terrain)
        add_mesh(spec, "meadow", meadow, faces, material="meadow")
        for number, (east, north) in enumerate(_stakes(self._terrain)):
            ground = float(self._terrain.height(east, north))
            spec.worldbody.add_geom(
                name=f"stake_{number}",
                type=mujoco.mjtGeom.mjGEOM_CYLINDER,
                pos=[east, north, ground + 0.5 * _STAKE_HEIGHT_M],
                size=[0.03, 0.5 * _STAKE_HEIGHT_M, 0.0],
                rgba=(0.93, 0.92, 0.88, 1.0),
                contype=0,
                conaffinity=0,
            )

    def lay_meadow(self, mesh: MeshView) -> None:
        """Set the vertices of the meadow."""
        mesh.vertices[:], _ = _meadow(self._terrain)

    def lay(self, mesh: MeshView, x: float, y: float) -> bool:
        """Centre the mesh near (x, y) [m] and return whether it changed."""
        centre = (self._snap * round(x / self._snap), self._snap * round(y / self._snap))
        if centre == self._centre:
            return False
        self._centre = centre
        terrain = self._terrain
        (x0, y0), (width, depth) = terrain.origin, terrain.size_m
        east, north = np.meshgrid(
            np.clip(centre[0] + self._offsets, x0, x0 + width),
            np.clip(centre[1] + self._offsets, y0, y0 + depth),
        )
        mesh.vertices[:] = np.stack([east, north, terrain.height(east, north)], axis=-1).reshape(
            -1, 3
        )
        mesh.normals[:] = _normals(terrain, east, north).reshape(-1, 3)
        texture = np.stack([(east - x0) / width, (north - y0) / depth], axis=-1)
        mesh.texture_coordinates[:] = texture.reshape(-1, 2)
        return True


def _offsets(unit: float, end_m: float) -> FloatArray:
    """Return the symmetric grid lines relative to the centre [m], (n,)."""
    spacing = _FINE_M * unit
    lines = list(np.arange(0.0, _REACH_M * unit, spacing))
    while lines[-1] < end_m:
        spacing *= _GROWTH
        lines.append(lines[-1] + spacing)
    outwards = np.array(lines)
    return np.concatenate([-outwards[:0:-1], outwards])


def _normals(terrain: Terrain, x: FloatArray, y: FloatArray) -> FloatArray:
    slope_x = terrain.height(x + _STEP_M, y) - terrain.height(x - _STEP_M, y)
    slope_y = terrain.height(x, y + _STEP_M) - terrain.height(x, y - _STEP_M)
    up = np.full_like(slope_x, 2.0 * _STEP_M)
    normal = np.stack([-slope_x, -slope_y, up], axis=-1)
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def _meadow(terrain: Terrain) -> tuple[FloatArray, np.ndarray]:
    """Return vertices (n, 3) [m] and faces (m, 3) of the ground around the field.

    Its height is that of the field at the edge, decays outwards to a plane fitted to the field, and
    farther off to a level: the horizon tells how the field lies.
    """
    outwards = np.array([0.0, 1.0, 2.5, 5.0, 10.0, 20.0, 40.0, 80.0, 140.0, _MEADOW_M])
    (x0, y0), (width, depth) = terrain.origin, terrain.size_m
    x, y = (
        np.concatenate([start - outwards[:0:-1], np.arange(start, end, 1.0), end + outwards])
        for start, end in ((x0, x0 + width), (y0, y0 + depth))
    )
    east, north = np.meshgrid(x, y)
    grid_x, grid_y = np.broadcast_arrays(*terrain.points())
    design = np.column_stack([grid_x.ravel(), grid_y.ravel(), np.ones(grid_x.size)])
    plane = np.linalg.lstsq(design, terrain.heights.ravel(), rcond=None)[0]
    beyond = np.hypot(
        np.maximum(np.maximum(x0 - east, east - x0 - width), 0.0),
        np.maximum(np.maximum(y0 - north, north - y0 - depth), 0.0),
    )
    near = np.exp(-beyond / _LEVEL_M)
    mid_x, mid_y = x0 + 0.5 * width, y0 + 0.5 * depth
    slope = plane[0] * (east - mid_x) + plane[1] * (north - mid_y)
    level = plane[0] * mid_x + plane[1] * mid_y + plane[2] + np.exp(-beyond / _FAR_M) * slope
    height = near * terrain.height(east, north) + (1.0 - near) * level
    # A strip continues below the field, since a gap would open between meshes that only touch.
    height = np.where(terrain.inside(east, north, 0.5), height - _STRIP_M, height)
    vertices = np.stack([east, north, height], axis=-1).reshape(-1, 3)
    faces = strip_faces(len(y), len(x))
    middle = vertices[faces].mean(axis=1)  # (m, 3)
    return vertices, faces[~terrain.inside(middle[:, 0], middle[:, 1], 2.0)]


def mown(colours: FloatArray, terrain: Terrain) -> FloatArray:
    """Return the colours of the field with the stripes of a mower and a bare edge.

    Args:
        colours: of the ground from above, (rows, columns, 3) in 0..1, south first.
        terrain: of the field.
    """
    rows, columns, _ = colours.shape
    width, depth = terrain.size_m
    x, y = width * np.arange(columns) / (columns - 1), depth * np.arange(rows) / (rows - 1)
    swath = np.tanh(4.0 * np.sin(np.pi * y / _SWATH_M))  # soft edges: no flicker far off
    to_edge = np.minimum.outer(np.minimum(y, depth - y), np.minimum(x, width - x))
    bare = np.clip(1.5 - to_edge / _EDGE_M, 0.0, 1.0)[..., None]
    striped = colours * (1.0 + _SWATH_SHADE * swath[:, None, None])
    return np.clip((1.0 - 0.6 * bare) * striped + 0.6 * bare * _BARE, 0.0, 1.0)


def _stakes(terrain: Terrain) -> list[tuple[float, float]]:
    """Return the places of stakes around the field [m], its corners among them."""
    (x0, y0), (width, depth) = terrain.origin, terrain.size_m
    columns, rows = (max(1, round(side / _STAKE_M)) for side in (width, depth))
    x, y = np.linspace(x0, x0 + width, columns + 1), np.linspace(y0, y0 + depth, rows + 1)
    along = [(float(east), north) for east in x for north in (y0, y0 + depth)]
    return along + [(east, float(north)) for north in y[1:-1] for east in (x0, x0 + width)]
