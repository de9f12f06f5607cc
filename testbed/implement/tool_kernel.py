"""Forces of the soil on the tools of an implement, compiled: all points in one call.

The tools are points across the width, fixed to the trailer. Each has a depth d below the ground,
perpendicular to the trailer, and a velocity (u, w) along and across the trailer:

    draft      F_i (A + B |u| + C u^2) d    against u, times tanh(|u| / 0.1 m/s)   (ASABE D497)
    side       -s a d tanh(k alpha / (s a)),  alpha = atan(w / max(|u|, 0.3 m/s))

with a the draft per depth at speed 0, s = `side_limit` and k the side force per depth and slip
angle. Side force is proportional to lateral velocity in measurements on implements (Pearson and
Bevly 2007, Journal of Terramechanics 44, 439-450); its limit is assumed. Both forces oppose the
velocity and vanish with it: an implement never gives energy to the vehicle. There is no vertical
force.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from typing import Any, Final

import mujoco
import numpy as np

from ttempc.jit import cached_njit
from ttempc.types import FloatArray

from ..ground.ground import Ground
from ..wheels.tyre_kernel import grid_cell
from .implement import POINTS, Implement, draft_equation

DRAFT_SPEED: Final = 0.1  # [m/s] below which the draft fades; assumed
SIDE_SPEED: Final = 0.3  # [m/s] floor of the forward speed in the slip angle; assumed


@dataclass(frozen=True, slots=True)
class ToolLaw:
    """Constants of one implement on one trailer; forces are those of one point."""

    behind: float  # [m] distance of the points behind the axle
    frame: float  # [m] height of the trailer's frame above level ground, at the points
    depth: float  # [m] of the lowered points
    clearance: float  # [m] of the raised points
    lift_rate: float  # [1/s] of the lowered share
    draft: float  # [N/m] per depth, at speed 0
    draft_speed: float  # [N s/m^2]
    draft_square: float  # [N s^2/m^3]
    side: float  # [N/m] per depth and radian of slip angle
    side_limit: float  # [N/m] per depth
    exponent: float  # of the strength
    background: float  # [kPa] cone index to which a strength is compared

    @classmethod
    def of(cls, implement: Implement, frame: float, background: float) -> ToolLaw:
        """Return the constants of an implement.

        Args:
            implement: settings.
            frame: height of the trailer's frame at rest on level ground, at the points [m].
            background: cone index of the field without its layers [kPa].
        """
        share = implement.size / POINTS
        equation = draft_equation(implement.type).coefficients(implement.texture)
        a, b, c = (share * coefficient for coefficient in equation)
        stiffness = implement.side_stiffness_n_per_deg_m2 * math.degrees(1.0)
        return cls(
            behind=implement.behind_m,
            frame=frame,
            depth=implement.depth_m,
            clearance=implement.clearance_m,
            lift_rate=1.0 / implement.lift_s,
            draft=a,
            draft_speed=b,
            draft_square=c,
            side=stiffness * implement.width_m / POINTS,
            side_limit=implement.side_limit * a,
            exponent=implement.strength_exponent,
            background=background,
        )

    def table(self) -> FloatArray:
        """Return the constants in the order of the fields, for the compiled law, (12,)."""
        return np.array(astuple(self))


@cached_njit(error_model="numpy", boundscheck=False)
def tool_step(
    law: FloatArray,
    offsets: FloatArray,
    work: FloatArray,
    heights: FloatArray,
    cone_indices: FloatArray,
    grid: FloatArray,
    body: int,
    xpos: FloatArray,
    xmat: FloatArray,
    xipos: FloatArray,
    cvel: FloatArray,
    com: FloatArray,
    lift: FloatArray,
    output: FloatArray,
    xfrc: FloatArray,
) -> None:
    """Advance distance and lift by a physics step and write the forces of the soil.

    Args:
        law: (12,) `ToolLaw.table`.
        offsets: (n,) [m] of the points to the left.
        work: (k, 2) [m] intervals of the distance driven.
        heights: (ny, nx) [m] of the ground.
        cone_indices: (ny, nx) [kPa] on the same grid.
        grid: (4,) x and y [m] of the first grid point, spacing [m], time step [s].
        body: the trailer.
        xpos: (nbody, 3) [m] MuJoCo's body positions.
        xmat: (nbody, 9) body axes, row major.
        xipos: (nbody, 3) [m] centres of mass, to which `xfrc` refers.
        cvel: (nbody, 6) rotation and velocity at `com`.
        com: (nbody, 3) [m] subtree centres of mass; row 1 is the vehicle's.
        lift: (2,) state, changed in place: lowered share, distance driven [m].
        output: (n, 3) depth [m], draft [N], side force [N], written.
        xfrc: (nbody, 6) force and moment on each body, row of the trailer written.
    """
    behind, frame, depth, clearance, lift_rate = law[0], law[1], law[2], law[3], law[4]
    draft0, draft1, draft2, stiffness, limit = law[5], law[6], law[7], law[8], law[9]
    exponent, background = law[10], law[11]
    ny, nx = heights.shape
    x0, y0, per_metre, dt = grid[0], grid[1], 1.0 / grid[2], grid[3]
    ax, ay, az = xpos[body, 0], xpos[body, 1], xpos[body, 2]
    fx, lx, ux = xmat[body, 0], xmat[body, 1], xmat[body, 2]
    fy, ly, uy = xmat[body, 3], xmat[body, 4], xmat[body, 5]
    fz, lz, uz = xmat[body, 6], xmat[body, 7], xmat[body, 8]
    wx, wy, wz = cvel[body, 0], cvel[body, 1], cvel[body, 2]
    rx, ry, rz = ax - com[1, 0], ay - com[1, 1], az - com[1, 2]
    vx = cvel[body, 3] + wy * rz - wz * ry
    vy = cvel[body, 4] + wz * rx - wx * rz
    vz = cvel[body, 5] + wx * ry - wy * rx

    distance = lift[1] + dt * abs(vx * fx + vy * fy + vz * fz)
    works = work.shape[0] == 0
    for k in range(work.shape[0]):
        works = works or work[k, 0] <= distance < work[k, 1]
    step = lift_rate * dt
    lowered = min(1.0, lift[0] + step) if works else max(0.0, lift[0] - step)
    lift[0], lift[1] = lowered, distance

    drop = frame + lowered * depth - (1.0 - lowered) * clearance
    tx, ty, tz, mx, my, mz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for point in range(offsets.size):
        offset = offsets[point]
        rx = -behind * fx + offset * lx - drop * ux
        ry = -behind * fy + offset * ly - drop * uy
        rz = -behind * fz + offset * lz - drop * uz
        px, py, pz = ax + rx, ay + ry, az + rz
        i, p = grid_cell((px - x0) * per_metre, nx - 1)
        j, q = grid_cell((py - y0) * per_metre, ny - 1)
        south = heights[j, i] + p * (heights[j, i + 1] - heights[j, i])
        north = heights[j + 1, i] + p * (heights[j + 1, i + 1] - heights[j + 1, i])
        deep = max(0.0, south + q * (north - south) - pz) * uz
        output[point, 0] = deep
        if deep <= 0.0:
            output[point, 1] = output[point, 2] = 0.0
            continue
        if exponent > 0.0:
            strength = (cone_indices[j + (q >= 0.5), i + (p >= 0.5)] / background) ** exponent
        else:
            strength = 1.0
        sx, sy, sz = vx + wy * rz - wz * ry, vy + wz * rx - wx * rz, vz + wx * ry - wy * rx
        along = sx * fx + sy * fy + sz * fz
        across = sx * lx + sy * ly + sz * lz
        speed = abs(along)
        bulk = deep * strength
        draft = bulk * (draft0 + (draft1 + draft2 * speed) * speed)
        draft *= math.tanh(along / DRAFT_SPEED)
        angle = math.atan(across / max(speed, SIDE_SPEED))
        side = -bulk * limit * math.tanh(stiffness / limit * angle)
        output[point, 1], output[point, 2] = draft, side
        gx, gy, gz = side * lx - draft * fx, side * ly - draft * fy, side * lz - draft * fz
        tx, ty, tz = tx + gx, ty + gy, tz + gz
        rx, ry, rz = px - xipos[body, 0], py - xipos[body, 1], pz - xipos[body, 2]
        mx += ry * gz - rz * gy
        my += rz * gx - rx * gz
        mz += rx * gy - ry * gx
    xfrc[body, 0], xfrc[body, 1], xfrc[body, 2] = tx, ty, tz
    xfrc[body, 3], xfrc[body, 4], xfrc[body, 5] = mx, my, mz


def tool_arguments(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    ground: Ground,
    law: FloatArray,
    offsets: FloatArray,
    work: FloatArray,
    lift: FloatArray,
    output: FloatArray,
) -> tuple[Any, ...]:
    """Return the arguments of `tool_step`: its arrays, and views of MuJoCo's."""
    terrain = ground.terrain
    return (
        *(law, offsets, work, terrain.heights, ground.cone_index),
        np.array([*terrain.origin, terrain.spacing_m, model.opt.timestep]),
        int(model.body("trailer").id),
        *(data.xpos, data.xmat, data.xipos, data.cvel, data.subtree_com),
        *(lift, output, data.xfrc_applied),
    )
