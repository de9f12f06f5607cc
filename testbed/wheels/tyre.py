"""Law of a wheel on soil, in numpy: the reference of the compiled law.

A wheel is a disc above a Winkler bed: height look-ups under the disc give the normal force, and the
cone index gives traction, motion resistance and side force after `soil_law`. All functions take n
wheels along the first axis and map state and motion to the new state and forces.

Source: [P] H. B. Pacejka, "Tire and Vehicle Dynamics", 3rd ed., 2012, ch. 7 (single-contact-point
model).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ..ground.terrain import Terrain
from .soil_law import SoilLaw

# The fan of look-ups: angles from straight down, denser in the contact area at rated deflection;
# each weight is the arc of its look-up. Columns across the section width.
FAN_ANGLES: Final = np.radians([-36.0, -18.0, -8.0, 0.0, 8.0, 18.0, 36.0])  # (7,)
FAN_ARCS: Final = np.array([9.0, 14.0, 9.0, 8.0, 9.0, 14.0, 9.0]) / 72.0  # (7,) sum 1
FAN_COLUMNS: Final = np.array([-1.0, 0.0, 1.0]) / 3.0  # (3,) of the section width

SMALLEST_LOAD: Final = 50.0  # [N] floor of the load in divisions
SMALL_SPEED: Final = 0.05  # [m/s] floor in the reported slips (the forces need none)
LEAST_UPRIGHT: Final = 0.3  # cosine of disc to vertical below which a wheel lies on its side


@dataclass(frozen=True, slots=True)
class Tyres:
    """Parameters of n tyres; every array is (n,)."""

    radius: FloatArray  # [m] unloaded, also the rolling radius
    width: FloatArray  # [m] section width b
    section_height: FloatArray  # [m] h
    relative_deflection: FloatArray  # delta / h at the rated load
    rated_load: FloatArray  # [N]
    damping: FloatArray  # [s/m] relative growth of the normal force per speed of approach

    @property
    def stiffness(self) -> FloatArray:
        """Winkler stiffness [N/m] that gives rated load at rated deflection, (n,)."""
        deflection = self.relative_deflection * self.section_height  # (n,)
        rise = self.radius[:, None] * (1.0 - np.cos(FAN_ANGLES))  # (n, 7) over the lowest point
        depth = np.maximum(0.0, deflection[:, None] - rise) @ FAN_ARCS  # (n,)
        return self.rated_load / depth

    def mobility_areas(self, law: SoilLaw) -> FloatArray:
        """Return the mobility numbers Bn and M for a cone index equal to the load [m^2], (n, 2)."""
        area, slenderness = 2.0 * self.radius * self.width, 0.5 * self.width / self.radius
        bn = area * (1.0 + law.mobility_deflection * self.relative_deflection)
        m = area * np.sqrt(self.relative_deflection)
        return np.column_stack(
            [
                bn / (1.0 + law.mobility_width * slenderness),
                m / (1.0 + law.mobility_side_width * slenderness),
            ]
        )

    def table(self, law: SoilLaw) -> FloatArray:
        """Return the parameters for the compiled law, (n, 6)."""
        return np.column_stack(
            [self.radius, self.width, self.mobility_areas(law), self.stiffness, self.damping]
        )


@dataclass(frozen=True, slots=True)
class WheelMotion:
    """Position and motion of n wheels, map frame; vectors are (n, 3)."""

    centre: FloatArray  # [m]
    axle: FloatArray  # unit vector along the axle, to the wheel's left
    velocity: FloatArray  # [m/s] of the centre
    rotation: FloatArray  # [rad/s] angular velocity of the wheel


@dataclass(frozen=True, slots=True)
class Contact:
    """Normal contact of n wheels with the ground."""

    load: FloatArray  # (n,) [N] normal, never negative
    normal: FloatArray  # (n, 3) unit vector out of the ground
    point: FloatArray  # (n, 3) [m] centre of pressure


@dataclass(frozen=True, slots=True)
class WheelForces:
    """Forces of the ground on n wheels, and the quantities that determine them."""

    force: FloatArray  # (n, 3) [N] on the wheel, map frame
    moment: FloatArray  # (n, 3) [N m] about the wheel's centre
    load: FloatArray  # (n,) [N]
    slip: FloatArray  # (n,)
    slip_angle: FloatArray  # (n,) [rad]
    force_long: FloatArray  # (n,) [N]
    force_lat: FloatArray  # (n,) [N]
    cone_index: FloatArray  # (n,) [kPa]
    ground: FloatArray  # (n,) [m]


def mobility(
    law: SoilLaw, tyres: Tyres, load: FloatArray, cone_index: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the mobility numbers Bn (traction) and M (side force), both (n,).

    `SoilLaw` has the equations. `load` is in N, `cone_index` in kPa.
    """
    pressure = 1e3 * cone_index / np.maximum(load, SMALLEST_LOAD)  # [1/m^2]
    bn, m = tyres.mobility_areas(law).T
    return pressure * bn, pressure * m


def contact(tyres: Tyres, terrain: Terrain, motion: WheelMotion) -> Contact:
    """Return the normal contact of a disc with a Winkler bed.

    The elastic force is minus the gradient of the energy sum(k w d^2 / 2) over the fan, with d the
    depth of each point below the ground. It is therefore conservative on rough ground. Its
    direction is the normal. Damping after Hunt and Crossley (1975) is proportional to the force,
    so that the load neither jumps at touch-down nor becomes negative.
    """
    vertical = np.array([0.0, 0.0, 1.0])
    up = vertical - motion.axle[:, 2:] * motion.axle  # (n, 3) in the disc
    upright = np.linalg.norm(up, axis=1)  # (n,)
    up = up / np.maximum(upright, LEAST_UPRIGHT)[:, None]
    ahead = np.cross(motion.axle, up)  # (n, 3)
    rim = np.sin(FAN_ANGLES)[:, None] * ahead[:, None] - np.cos(FAN_ANGLES)[:, None] * up[:, None]
    points = (  # (n, 7, 3, 3): wheel, angle, column, xyz
        motion.centre[:, None, None]
        + tyres.radius[:, None, None, None] * rim[:, :, None]
        + (tyres.width[:, None] * FAN_COLUMNS)[:, None, :, None] * motion.axle[:, None, None]
    )
    height, slope_x, slope_y = _surface(terrain, points[..., 0], points[..., 1])  # (n, 7, 3)
    depth = np.maximum(0.0, height - points[..., 2]) * (upright > LEAST_UPRIGHT)[:, None, None]
    pressure = depth * FAN_ARCS[:, None] / FAN_COLUMNS.size  # (n, 7, 3)
    gradient = np.stack([-slope_x, -slope_y, np.ones_like(height)], axis=-1)
    elastic = tyres.stiffness[:, None] * np.einsum("nij,nijk->nk", pressure, gradient)  # (n, 3)
    size = np.linalg.norm(elastic, axis=1)  # (n,)
    touching = size > 0.0
    normal = np.where(touching[:, None], elastic / np.where(touching, size, 1.0)[:, None], vertical)
    points[..., 2] = height
    total = np.where(touching, pressure.sum(axis=(1, 2)), 1.0)
    centre = np.einsum("nij,nijk->nk", pressure, points) / total[:, None]
    approach = -np.einsum("nk,nk->n", motion.velocity, normal)
    load = size * np.maximum(0.0, 1.0 + tyres.damping * approach)
    return Contact(load, normal, np.where(touching[:, None], centre, motion.centre))


def step(
    law: SoilLaw,
    tyres: Tyres,
    terrain: Terrain,
    cone_index: FloatArray,
    motion: WheelMotion,
    deflection: FloatArray,
    dt: float,
    in_track: np.ndarray | bool = False,
) -> tuple[FloatArray, WheelForces]:
    """Return the tread deflections after `dt` [s] and the forces of the ground, for n wheels.

    Deflections u (n, 3) [m] - along, across, in rolling - are the state. They follow the sliding
    speed w and fade over the relaxation length sigma (single-contact-point model, [P] eq. (7.7)),

        du/dt = w - |V| / sigma u,

    with |V| along the wheel that of rim or hub, whichever is faster, and across it that of the hub,
    or of the sliding along the wheel where this is faster. u / sigma is the slip in steady rolling,
    across the tangent of the slip angle. At V = 0 it is a spring, so that a standing wheel holds
    on a slope. The law is the same in reverse. The third one follows the wheel's speed; over its
    short length it is the sign of the speed, with which motion resistance acts. Its damping is
    near the critical one of a vehicle at rest, so that a stop does not swing back.

    `cone_index` is (n,) [kPa] below each wheel; `in_track` (n,) tells which wheels are on a second
    pass.
    """
    ground = terrain.height(motion.centre[:, 0], motion.centre[:, 1])
    touch = contact(tyres, terrain, motion)
    load, normal = touch.load, touch.normal
    ahead = np.cross(motion.axle, normal)
    ahead = ahead / np.maximum(np.linalg.norm(ahead, axis=1), LEAST_UPRIGHT)[:, None]
    left = np.cross(normal, ahead)
    arm = touch.point - motion.centre
    v_long = np.einsum("nk,nk->n", motion.velocity, ahead)
    sliding = motion.velocity + np.cross(motion.rotation, arm)
    v_lat = np.einsum("nk,nk->n", sliding, left)
    rim = tyres.radius * np.einsum("nk,nk->n", motion.rotation, motion.axle)
    rolling = np.maximum(np.abs(rim), np.abs(v_long))

    speeds = np.stack([rim - v_long, v_lat, v_long], axis=1)  # (n, 3) w
    travel = np.maximum(np.abs(v_long), np.abs(rim - v_long))
    carried = np.stack([rolling, travel, np.abs(v_long)], axis=1)  # (n, 3) |V|
    lengths = np.array([law.relaxation_long_m, law.relaxation_lat_m, law.relaxation_roll_m])
    damping = np.array([law.damping_long_s, law.damping_lat_s, law.damping_roll_s])
    after = (deflection + dt * speeds) / (1.0 + dt * carried / lengths)  # implicit Euler
    after = np.clip(after, -lengths, lengths)
    rate = (after - deflection) / dt
    slips = np.clip((after + damping * rate) / lengths, -1.0, 1.0)  # (n, 3)
    after = after * (load > 0.0)[:, None]

    bn, m = mobility(law, tyres, load, cone_index)
    firmer = np.where(in_track, law.second_pass_traction, 1.0)
    freer = np.where(in_track, law.second_pass_resistance, 1.0)
    traction, side = law.combined_ratios(bn, m, slips[:, 0], np.arctan(slips[:, 1]))
    traction = firmer * traction
    torque = traction + freer * law.resistance_tyre * slips[:, 2]
    driving = slips[:, 0] * slips[:, 2]  # slip in the direction of travel
    pull = traction - freer * law.soil_resistance_ratio(bn, driving) * slips[:, 2]
    # friction ellipse: the resistance of the soil is one of its forces, also under a braked wheel
    used = np.hypot(
        pull / (firmer * law.largest_traction_ratio(bn)), side / law.largest_side_ratio(m)
    )
    share = load / np.maximum(1.0, used)
    pull, side = share * pull, share * side

    force = load[:, None] * normal + pull[:, None] * ahead + side[:, None] * left
    moment = np.cross(arm, force)
    # the moment about the axle is that of traction and tyre; the soil's resistance acts on the hub
    about_axle = np.einsum("nk,nk->n", moment, motion.axle)
    moment = moment - (tyres.radius * load * torque + about_axle)[:, None] * motion.axle
    return after, WheelForces(
        force=force,
        moment=moment,
        load=load,
        slip=(rim - v_long) / np.maximum(rolling, SMALL_SPEED),
        slip_angle=np.arctan2(v_lat, np.maximum(np.abs(v_long), SMALL_SPEED)),
        force_long=pull,
        force_lat=side,
        cone_index=cone_index,
        ground=ground,
    )


def _surface(
    terrain: Terrain, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return height [m] and both slopes of the bilinear surface at (x, y)."""
    grid, spacing = terrain.heights, terrain.spacing_m
    ny, nx = grid.shape
    u = np.clip((x - terrain.origin[0]) / spacing, 0.0, nx - 1.0)
    v = np.clip((y - terrain.origin[1]) / spacing, 0.0, ny - 1.0)
    i = np.minimum(u.astype(np.int64), nx - 2)
    j = np.minimum(v.astype(np.int64), ny - 2)
    p, q = u - i, v - j
    south_west, south_east = grid[j, i], grid[j, i + 1]
    north_west, north_east = grid[j + 1, i], grid[j + 1, i + 1]
    south = south_west + p * (south_east - south_west)
    north = north_west + p * (north_east - north_west)
    slope_x = ((1.0 - q) * (south_east - south_west) + q * (north_east - north_west)) / spacing
    return south + q * (north - south), slope_x, (north - south) / spacing
