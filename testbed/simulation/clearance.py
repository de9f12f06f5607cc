"""Lower bound of the chassis' clearance over the ground.

Each tile of the field has a plane that no height in its window exceeds. The window
is the tile, widened by the reach of the largest shape of the chassis and by `MOTION_M`. A shape
with its centre in the tile is clear of the ground as long as it is above the plane, and stays so
while no point of the chassis has moved farther than it was above the plane, or than `MOTION_M`.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import math
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from ttempc.jit import cached_njit
from ttempc.types import FloatArray

from ..ground.ground import Ground

MOTION_M: Final = 0.2  # largest motion from one look at the shapes to the next
TILE_M: Final = 0.5
# of the plane over the heights: MuJoCo keeps them in single precision
_ROUNDING_M: Final = 1e-3


def chassis_arguments(
    model: mujoco.MjModel, data: mujoco.MjData, ground: Ground
) -> tuple[tuple[Any, ...], FloatArray]:
    """Return the arguments of `clearance`, and the reaches (nv,) of a chassis' motion.

    A reach is the largest distance by which a unit of a degree of freedom moves a point of the
    chassis, [m] or [m/m].
    """
    terrain, field = ground.terrain, model.geom("ground").id
    shapes: NDArray[np.int64] = np.flatnonzero(model.geom_conaffinity & model.geom_contype[field])
    rows, columns = (int(np.ceil(side / TILE_M)) for side in reversed(terrain.size_m))
    arguments = (
        data.geom_xpos,
        data.geom_xmat,
        shapes,
        np.array([_half_lengths(model, shape, field) for shape in shapes.tolist()]),
        float(model.geom_rbound[shapes].max()),
        terrain.heights,
        np.array([*terrain.origin, terrain.spacing_m]),
        np.zeros((rows, columns, 4)),
    )
    return arguments, _reaches(model, shapes)


@cached_njit(error_model="numpy", boundscheck=False)
def clearance(
    centres: FloatArray,
    axes: FloatArray,
    shapes: np.ndarray,
    halves: FloatArray,
    reach: float,
    heights: FloatArray,
    grid: FloatArray,
    planes: FloatArray,
) -> float:
    """Return a lower bound of the distance that the chassis may move before it meets the ground.

    It is at most `MOTION_M` [m], 0 where the ground may be touched or a shape is beside the field.

    Args:
        centres, axes: MuJoCo's `geom_xpos`, (ngeom, 3) [m], and `geom_xmat`, (ngeom, 9).
        shapes: (n,) indices of the shapes of the chassis.
        halves: (n, 4) [m] half lengths of a box along its axes, then the radius by which it is
            rounded.
        reach: [m] of the farthest point of any shape from its centre.
        heights: (ny, nx) [m] of the ground.
        grid: (3,) x and y [m] of the first grid point, spacing [m].
        planes: (ty, tx, 4) slopes along x and y, height [m] at the middle of the tile, and 1;
            tiles that were not used yet are zeros, and are written.
    """
    least = MOTION_M
    for item in range(shapes.size):
        shape = shapes[item]
        x, y, z = centres[shape, 0], centres[shape, 1], centres[shape, 2]
        column, row = math.floor((x - grid[0]) / TILE_M), math.floor((y - grid[1]) / TILE_M)
        if not (0 <= column < planes.shape[1] and 0 <= row < planes.shape[0]):
            return 0.0
        if planes[row, column, 3] == 0.0:
            _put_plane(planes[row, column], column, row, reach, heights, grid)
        px, py, height = planes[row, column, 0], planes[row, column, 1], planes[row, column, 2]
        along_x = x - (grid[0] + (column + 0.5) * TILE_M)
        along_y = y - (grid[1] + (row + 0.5) * TILE_M)
        steepness = math.sqrt(px * px + py * py + 1.0)
        above = z - height - px * along_x - py * along_y - halves[item, 3] * steepness
        for axis in range(3):
            to_normal = axes[shape, 6 + axis] - px * axes[shape, axis] - py * axes[shape, 3 + axis]
            above -= abs(to_normal) * halves[item, axis]
        if not above > 0.0:  # nor where it is not a number
            return 0.0
        least = min(least, above / steepness)
    return least


@cached_njit(error_model="numpy", boundscheck=False)
def _put_plane(
    plane: FloatArray, column: int, row: int, reach: float, heights: FloatArray, grid: FloatArray
) -> None:
    """Write the plane of a tile, (4,): the mean slopes of its window, above all its heights."""
    ny, nx = heights.shape
    spacing = grid[2]
    middle_x, middle_y = (column + 0.5) * TILE_M, (row + 0.5) * TILE_M
    half = 0.5 * TILE_M + reach + MOTION_M
    # outwards to the next points: a facet that is partly in the window is wholly below the plane
    left = max(0, math.floor((middle_x - half) / spacing))
    right = min(nx - 1, math.ceil((middle_x + half) / spacing))
    low = max(0, math.floor((middle_y - half) / spacing))
    high = min(ny - 1, math.ceil((middle_y + half) / spacing))
    mid_column, mid_row = 0.5 * (left + right), 0.5 * (low + high)
    sum_x, sum_y, square_x, square_y = 0.0, 0.0, 0.0, 0.0
    for j in range(low, high + 1):
        for i in range(left, right + 1):
            u, v = i - mid_column, j - mid_row
            sum_x += u * heights[j, i]
            sum_y += v * heights[j, i]
            square_x += u * u
            square_y += v * v
    px, py = sum_x / (square_x * spacing), sum_y / (square_y * spacing)
    top = -math.inf
    for j in range(low, high + 1):
        for i in range(left, right + 1):
            along_x, along_y = i * spacing - middle_x, j * spacing - middle_y
            top = max(top, heights[j, i] - px * along_x - py * along_y)
    plane[0], plane[1], plane[2], plane[3] = px, py, top + _ROUNDING_M, 1.0


def _half_lengths(model: mujoco.MjModel, shape: int, ground: int) -> list[float]:
    """Return half lengths and radius of a rounded box that holds a shape, (4,) [m]."""
    a, b, c = model.geom_size[shape].tolist()
    margin = float(model.geom_margin[shape] + model.geom_margin[ground])
    match model.geom_type[shape]:
        case mujoco.mjtGeom.mjGEOM_BOX:
            return [a, b, c, margin]
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            return [0.0, 0.0, b, a + margin]
        case _:
            return [0.0, 0.0, 0.0, float(model.geom_rbound[shape]) + margin]


def _reaches(model: mujoco.MjModel, shapes: NDArray[np.int64]) -> FloatArray:
    """Return how far a unit of each degree of freedom moves a point of the chassis at most, (nv,).

    A rotation moves it by its distance from the joint's anchor: at most the sum of the offsets
    between the bodies on the way, and the reach of the shape.
    """
    reaches = np.zeros(model.nv)
    for shape in shapes:
        body = int(model.geom_bodyid[shape])
        distance = float(np.linalg.norm(model.geom_pos[shape]) + model.geom_rbound[shape])
        while body:
            first = int(model.body_jntadr[body])
            for joint in range(first, first + int(model.body_jntnum[body])):
                distance += 2.0 * float(np.linalg.norm(model.jnt_pos[joint]))
            for dof in np.flatnonzero(model.dof_bodyid == body):
                joint = model.dof_jntid[dof]
                free = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE
                slides = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
                unit = slides or (free and dof < model.jnt_dofadr[joint] + 3)
                reaches[dof] = max(reaches[dof], 1.0 if unit else distance)
            distance += float(np.linalg.norm(model.body_pos[body]))
            body = int(model.body_parentid[body])
    return reaches
