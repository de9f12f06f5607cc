"""Forces of the soil on the tools of an implement, in numpy: the reference of the compiled law.

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

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ..ground.ground import Ground
from .draft import draft_equation
from .implement import POINTS, Implement

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
