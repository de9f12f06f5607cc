"""Lower bound of the chassis' clearance over the ground.

Each tile of the field has a plane that no height in its window exceeds. The window
is the tile, widened by the reach of the largest shape of the chassis and by `MOTION_M`. A shape
with its centre in the tile is clear of the ground as long as it is above the plane, and stays so
while no point of the chassis has moved farther than it was above the plane, or than `MOTION_M`.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import math
from typing import Final, NamedTuple, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from ttempc.jit import cached_njit, record
from ttempc.types import FloatArray

from ...bodies import row_vector
from ...ground.ground import Ground
from ...ground.surface import Grid, Surface
from ...kernel_options import KERNEL

MOTION_M: Final = 0.2  # largest motion between two checks of the shapes
TILE_M: Final = 0.5
_ROUNDING_M: Final = 1e-3  # of the plane over the heights: MuJoCo keeps them in single precision

PLANE: Final = np.dtype(
    [
        ("slope_x", np.float64),
        ("slope_y", np.float64),
        ("height", np.float64),  # [m] at the middle of the tile
        ("known", np.float64),  # 1, or 0 where the plane is not computed yet
    ]
)
"""Plane above the ground of a tile."""

_kernel = cached_njit(**KERNEL)


class Chassis(NamedTuple):
    """Shapes of a vehicle that may touch the ground, n of them, and the ground's planes."""

    centres: FloatArray  # (ngeom, 3) [m] MuJoCo's `geom_xpos`
    axes: FloatArray  # (ngeom, 9) MuJoCo's `geom_xmat`
    shapes: NDArray[np.int64]  # (n,) indices of the shapes
    halves: FloatArray  # (n, 3) [m] half lengths of a box that, once rounded, holds the shape
    radii: FloatArray  # (n,) [m] by which the box is rounded
    reach: float  # [m] of the farthest point of any shape from its centre
    heights: FloatArray  # (ny, nx) [m] of the ground
    grid: Grid
    planes: FloatArray  # (ty, tx, 4) rows `PLANE` of the tiles, computed when they are needed

    @classmethod
    def of(cls, model: mujoco.MjModel, data: mujoco.MjData, ground: Ground) -> Self:
        """Return the shapes of a plant on its ground."""
        surface = Surface.of(ground)
        field = model.geom("ground").id
        shapes = np.flatnonzero(model.geom_conaffinity & model.geom_contype[field])
        boxes = [_rounded_box(model, shape, field) for shape in shapes.tolist()]
        rows, columns = (int(np.ceil(side / TILE_M)) for side in reversed(ground.terrain.size_m))
        return cls(
            centres=data.geom_xpos,
            axes=data.geom_xmat,
            shapes=shapes,
            halves=np.array([halves for halves, _ in boxes]),
            radii=np.array([radius for _, radius in boxes]),
            reach=float(model.geom_rbound[shapes].max()),
            heights=surface.heights,
            grid=surface.grid,
            planes=np.zeros((rows, columns, len(PLANE.names or ()))),
        )


@_kernel
def clearance(chassis: Chassis) -> float:
    """Return a lower bound of the distance that the chassis may move before it meets the ground.

    It is at most `MOTION_M` [m], 0 where the ground may be touched or a shape is beside the field.
    """
    least = MOTION_M
    for item in range(chassis.shapes.size):
        above = _clearance_of(chassis, item)
        if not above > 0.0:  # nor where it is not a number
            return 0.0
        least = min(least, above)
    return least


@_kernel
def _clearance_of(chassis: Chassis, item: int) -> float:
    """Return the distance of a rounded box from the plane of its tile [m], 0 beside the field."""
    shape = chassis.shapes[item]
    centre = row_vector(chassis.centres, shape)
    x = centre[0] - chassis.grid.x
    y = centre[1] - chassis.grid.y
    column = math.floor(x / TILE_M)
    row = math.floor(y / TILE_M)
    rows, columns, _ = chassis.planes.shape
    if not (0 <= column < columns and 0 <= row < rows):
        return 0.0
    plane = record(chassis.planes[row, column], PLANE)
    if plane.known == 0.0:
        _put_plane(chassis, row, column)

    # height of the lowest point of the box above the plane
    along_x = x - (column + 0.5) * TILE_M
    along_y = y - (row + 0.5) * TILE_M
    steepness = math.sqrt(plane.slope_x * plane.slope_x + plane.slope_y * plane.slope_y + 1.0)
    above = centre[2] - plane.height - plane.slope_x * along_x - plane.slope_y * along_y
    above -= chassis.radii[item] * steepness
    for axis in range(3):
        x_part = plane.slope_x * chassis.axes[shape, axis]
        y_part = plane.slope_y * chassis.axes[shape, 3 + axis]
        to_normal = chassis.axes[shape, 6 + axis] - x_part - y_part
        above -= abs(to_normal) * chassis.halves[item, axis]
    return above / steepness


@_kernel
def _put_plane(chassis: Chassis, row: int, column: int) -> None:
    """Write the plane of a tile: the mean slopes of its window, above all its heights."""
    heights = chassis.heights
    ny, nx = heights.shape
    spacing = chassis.grid.spacing
    middle_x = (column + 0.5) * TILE_M
    middle_y = (row + 0.5) * TILE_M
    half = 0.5 * TILE_M + chassis.reach + MOTION_M

    # outwards to the next points: a facet that is partly in the window is wholly below the plane
    left = max(0, math.floor((middle_x - half) / spacing))
    right = min(nx - 1, math.ceil((middle_x + half) / spacing))
    low = max(0, math.floor((middle_y - half) / spacing))
    high = min(ny - 1, math.ceil((middle_y + half) / spacing))

    # slopes by least squares
    sum_x = 0.0
    sum_y = 0.0
    square_x = 0.0
    square_y = 0.0
    for j in range(low, high + 1):
        for i in range(left, right + 1):
            from_middle_x = i - 0.5 * (left + right)
            from_middle_y = j - 0.5 * (low + high)
            sum_x += from_middle_x * heights[j, i]
            sum_y += from_middle_y * heights[j, i]
            square_x += from_middle_x * from_middle_x
            square_y += from_middle_y * from_middle_y
    slope_x = sum_x / (square_x * spacing)
    slope_y = sum_y / (square_y * spacing)

    top = -math.inf
    for j in range(low, high + 1):
        for i in range(left, right + 1):
            along_x = i * spacing - middle_x
            along_y = j * spacing - middle_y
            top = max(top, heights[j, i] - slope_x * along_x - slope_y * along_y)

    plane = record(chassis.planes[row, column], PLANE)
    plane.slope_x = slope_x
    plane.slope_y = slope_y
    plane.height = top + _ROUNDING_M
    plane.known = 1.0


def _rounded_box(
    model: mujoco.MjModel, shape: int, ground: int
) -> tuple[tuple[float, float, float], float]:
    """Return half lengths and radius of a rounded box that holds a shape [m]."""
    a, b, c = model.geom_size[shape].tolist()
    margin = float(model.geom_margin[shape] + model.geom_margin[ground])
    match model.geom_type[shape]:
        case mujoco.mjtGeom.mjGEOM_BOX:
            return (a, b, c), margin
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            return (0.0, 0.0, b), a + margin
        case _:
            return (0.0, 0.0, 0.0), float(model.geom_rbound[shape]) + margin


def reaches_of(model: mujoco.MjModel, shapes: NDArray[np.int64]) -> FloatArray:
    """Return how far a unit of each degree of freedom moves a point of the chassis at most, (nv,).

    A rotation moves it by its distance from the joint's anchor: at most the sum of the offsets
    between the bodies up to the root, and the reach of the shape.
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
