"""Forces of the soil on the tools of an implement in numpy: the twin of `tool_kernel`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from proving_ground.testbed.ground.ground import Ground
from proving_ground.testbed.implement.tool_kernel import DRAFT_SPEED, SIDE_SPEED, ToolLaw

from ttempc.types import FloatArray


@dataclass(frozen=True, slots=True)
class TrailerMotion:
    """Position and motion of the trailer, map frame; vectors are (3,)."""

    axle: FloatArray  # [m] centre of the axle
    axes: FloatArray  # (3, 3) columns: ahead, left, up
    velocity: FloatArray  # [m/s] of the centre of the axle
    rotation: FloatArray  # [rad/s]


@dataclass(frozen=True, slots=True)
class ToolForces:
    """Forces of the soil on n points of an implement, in the trailer's axes."""

    depth: FloatArray  # (n,) [m]
    draft: FloatArray  # (n,) [N] backward positive
    side: FloatArray  # (n,) [N] to the left positive
    points: FloatArray  # (n, 3) [m] map frame, where the forces act
    velocity: FloatArray  # (n, 3) [m/s] of the points, map frame
    force: FloatArray  # (n, 3) [N] map frame


def forces(
    law: ToolLaw, offsets: FloatArray, ground: Ground, motion: TrailerMotion, lowered: float
) -> ToolForces:
    """Return the forces on the points of an implement.

    Args:
        law: constants.
        offsets: places of the points to the left of the trailer's middle [m], (n,).
        ground: shape and strength.
        motion: of the trailer.
        lowered: 1 in working position, 0 raised.
    """
    drop = law.frame + lowered * law.depth - (1.0 - lowered) * law.clearance
    local = np.column_stack(
        [np.full_like(offsets, -law.behind), offsets, np.full_like(offsets, -drop)]
    )
    arms = local @ motion.axes.T
    points = motion.axle + arms
    velocity = motion.velocity + np.cross(motion.rotation, arms)
    height = ground.terrain.height(points[:, 0], points[:, 1])
    depth = np.maximum(0.0, height - points[:, 2]) * motion.axes[2, 2]
    along, across = (velocity @ motion.axes)[:, :2].T
    cone_index = ground.cone_index_at(points[:, 0], points[:, 1])
    bulk = depth * (cone_index / law.background) ** law.exponent
    speed = np.abs(along)
    resistance = law.draft + law.draft_speed * speed + law.draft_square * speed**2
    draft = bulk * resistance * np.tanh(along / DRAFT_SPEED)
    slip_angle = np.arctan(across / np.maximum(speed, SIDE_SPEED))
    side = -bulk * law.side_limit * np.tanh(law.side / law.side_limit * slip_angle)
    force = -draft[:, None] * motion.axes[:, 0] + side[:, None] * motion.axes[:, 1]
    return ToolForces(depth, draft, side, points, velocity, force)


def lowered_after(
    law: ToolLaw, work: FloatArray, lowered: float, distance: float, dt: float
) -> float:
    """Return the lowered share after `dt` [s] at a distance driven [m].

    `work` is (k, 2) [m], the intervals of work; without any the tools always work.
    """
    works = not len(work) or bool(((work[:, 0] <= distance) & (distance < work[:, 1])).any())
    step = law.lift_rate * dt
    return min(1.0, lowered + step) if works else max(0.0, lowered - step)
