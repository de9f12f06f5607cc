"""Forces of the soil on the tools of an implement, compiled: all points in one call.

The tools are points across the width, fixed to the trailer. Each has a depth d below the ground,
perpendicular to the trailer, and a velocity (u, w) along and across the trailer:

    draft      F_i (A + B |u| + C u^2) d    against u, times tanh(|u| / 0.1 m/s)   (ASABE D497)
    side       -s a d tanh(k alpha / (s a)),  alpha = atan(w / max(|u|, 0.3 m/s))

with a the draft per depth at speed 0, s = `side_limit` and k the side force per depth and slip
angle. Side force is proportional to lateral velocity in measurements on implements (Pearson and
Bevly 2007, Journal of Terramechanics 44, 439-450); its limit is assumed. Both forces oppose the
velocity and vanish with it: in the plane of the trailer an implement never gives energy. A part of
the draft, without its sign, also pulls the tools down (`vertical_share`): it loads the wheels of
the trailer, or lifts them. All forces of a point are multiplied by the soil's strength there.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, fields
from typing import Any, Final, NamedTuple

import numpy as np

from ttempc.jit import cached_njit, record
from ttempc.types import FloatArray

from ..bodies import AHEAD, LEFT, UP, Bodies, apply_wrench, axis_of, row_vector, velocity_of
from ..ground.ground import Ground
from ..ground.soil import RandomField
from ..ground.surface import Surface, ground_below
from ..kernel_options import INLINED, KERNEL
from ..vectors import ZERO, Vector, add, cross, dot, scale, subtract
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
    vertical: float  # downward force over the draft

    @classmethod
    def of(cls, implement: Implement, frame: float) -> ToolLaw:
        """Return the constants of an implement.

        Args:
            implement: settings.
            frame: height of the trailer's frame at rest on level ground, at the points [m].
        """
        share = implement.draft_factor * implement.size / POINTS
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
            vertical=implement.vertical_share or 0.0,
        )

    def row(self) -> FloatArray:
        """Return the constants for the compiled law, a row `TOOL_LAW`."""
        return np.array(astuple(self))


TOOL_LAW: Final = np.dtype([(each.name, np.float64) for each in fields(ToolLaw)])
"""Constants of one implement, fields of `ToolLaw`."""

LIFT: Final = np.dtype([("lowered", np.float64), ("distance", np.float64)])
"""Lowered share, distance driven by the trailer point [m]."""

POINT: Final = np.dtype([("depth", np.float64), ("draft", np.float64), ("side", np.float64)])
"""Report of a point: depth [m], draft [N] backward, side force [N] to the left."""


class Tools(NamedTuple):
    """The n points of an implement in the soil."""

    law: FloatArray  # row `TOOL_LAW`
    offsets: FloatArray  # (n,) [m] of the points to the left
    work: FloatArray  # (k, 2) [m] intervals of the distance driven; without any, tools always work
    surface: Surface  # its cone indices over that of usual soil, see `tool_surface`
    bodies: Bodies
    trailer: int  # number of the body
    lift: FloatArray  # row `LIFT`, changed in place
    output: FloatArray  # (n, 3) rows `POINT`, written
    timestep: float  # [s]


def tool_surface(
    implement: Implement, ground: Ground, background: float, variation: RandomField | None = None
) -> Surface:
    """Return shape of the ground and strength of its soil over that of usual soil.

    Args:
        implement: settings.
        ground: shape and cone index.
        background: cone index of the field without its layers [kPa].
        variation: of the draft by place; None: none.
    """
    strength = (ground.cone_index / background) ** implement.strength_exponent
    if variation is not None:
        strength *= variation.values
    return Surface.of(ground)._replace(cone_indices=strength)


@cached_njit(**KERNEL)
def tool_step(tools: Tools) -> None:
    """Advance distance and lift by a time step and write the forces of the soil on the trailer."""
    law = record(tools.law, TOOL_LAW)
    bodies = tools.bodies
    trailer = tools.trailer

    # position and motion of the trailer, in the map frame
    axle = row_vector(bodies.positions, trailer)
    axes = (
        axis_of(bodies.axes, trailer, AHEAD),
        axis_of(bodies.axes, trailer, LEFT),
        axis_of(bodies.axes, trailer, UP),
    )
    ahead, left, up = axes
    rotation = row_vector(bodies.velocities, trailer)
    velocity = velocity_of(bodies, trailer)
    mass_centre = row_vector(bodies.mass_centres, trailer)

    lowered = _move_lift(tools, law, abs(dot(velocity, ahead)))
    drop = law.frame + lowered * law.depth - (1.0 - lowered) * law.clearance

    force = ZERO
    moment = ZERO
    for point in range(tools.offsets.size):
        arm = scale(-law.behind, ahead)
        arm = subtract(add(arm, scale(tools.offsets[point], left)), scale(drop, up))
        place = add(axle, arm)
        height, strength = ground_below(tools.surface, place[0], place[1])
        depth = max(0.0, height - place[2]) * up[2]
        point_velocity = add(velocity, cross(rotation, arm))

        report = record(tools.output[point], POINT)
        report.depth = depth
        report.draft, report.side = _soil_forces(law, depth, strength, point_velocity, axes)

        on_point = subtract(scale(report.side, left), scale(report.draft, ahead))
        on_point = subtract(on_point, scale(law.vertical * abs(report.draft), up))
        force = add(force, on_point)
        moment = add(moment, cross(subtract(place, mass_centre), on_point))
    apply_wrench(bodies, trailer, force, moment)


@cached_njit(**INLINED)
def _move_lift(tools: Tools, law: Any, speed: float) -> float:  # noqa: ANN401 - a record `TOOL_LAW`
    """Advance distance and lift by a time step and return the lowered share.

    Args:
        tools: the lift is changed in place.
        law: record `TOOL_LAW`.
        speed: along the trailer, without its sign [m/s].
    """
    lift = record(tools.lift, LIFT)
    distance = lift.distance + tools.timestep * speed
    works = tools.work.shape[0] == 0
    for interval in range(tools.work.shape[0]):
        begin = tools.work[interval, 0]
        end = tools.work[interval, 1]
        works = works or begin <= distance < end

    step = law.lift_rate * tools.timestep
    lowered = min(1.0, lift.lowered + step) if works else max(0.0, lift.lowered - step)
    lift.lowered = lowered
    lift.distance = distance
    return lowered


@cached_njit(**INLINED)
def _soil_forces(
    law: Any,  # noqa: ANN401 - a record `TOOL_LAW`
    depth: float,
    strength: float,
    velocity: Vector,
    axes: tuple[Vector, Vector, Vector],
) -> tuple[float, float]:
    """Return draft and side force on a point [N].

    Args:
        law: record `TOOL_LAW`.
        depth: of the point [m].
        strength: of the soil over that of usual soil.
        velocity: of the point [m/s].
        axes: of the trailer.
    """
    draft = 0.0
    side = 0.0
    if depth > 0.0:
        ahead, left, _ = axes
        along = dot(velocity, ahead)
        across = dot(velocity, left)
        speed = abs(along)
        bulk = depth * strength

        draft = bulk * (law.draft + (law.draft_speed + law.draft_square * speed) * speed)
        draft *= math.tanh(along / DRAFT_SPEED)
        angle = math.atan(across / max(speed, SIDE_SPEED))
        side = -bulk * law.side_limit * math.tanh(law.side / law.side_limit * angle)
    return draft, side
