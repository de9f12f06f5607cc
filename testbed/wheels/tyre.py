"""Law of a wheel on soil, in numpy: the reference of the compiled law.

A wheel is a disc above a Winkler bed: height look-ups under the disc give the normal force, and the
cone index gives traction, motion resistance and side force. All functions take n wheels along the
first axis and map state and motion to the new state and forces.

Sources: [B] W. W. Brixius, "Traction prediction equations for bias ply tires", ASAE paper
87-1622, 1987, in the form of the public MAVS simulator, whose lateral law is used as well;
[P] H. B. Pacejka, "Tire and Vehicle Dynamics", 3rd ed., 2012, ch. 7 (single-contact-point model).
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ..ground.terrain import Terrain


@dataclass(frozen=True, slots=True)
class SoilLaw:
    """Coefficients of the law: mobility and traction after [B], bias-ply; side force after MAVS.

    With width b, diameter d, section height h, deflection delta, load W, cone index CI, slip s and
    slip angle alpha:

        Cn = CI b d / W
        Bn = Cn (1 + mobility_deflection delta / h) / (1 + mobility_width b / d)
        Bn1 = Cn sqrt(d / h) / (1 + mobility_area b d)
        gross traction ratio     traction (1 - e^(-traction_bn Bn)) (1 - e^(-traction_slip s))
        motion resistance ratio  resistance_bn / Bn + resistance + resistance_slip s / sqrt(Bn)
        side force ratio         mu (1 - e^(-B |alpha|)),  mu = side + side_bn1 / Bn1,
                                 B mu = side_slope + side_slope_bn1 Bn1
    """

    mobility_deflection: float = 5.0  # weight of the relative deflection in Bn
    mobility_width: float = 3.0  # weight of width over diameter in Bn
    mobility_area: float = 0.5  # [1/m^2] weight of width times diameter in Bn1
    traction: float = 0.88  # limit of the gross traction ratio at full slip on firm soil
    traction_bn: float = 0.1
    traction_slip: float = 7.5
    resistance: float = 0.04  # limit of the motion resistance ratio without slip on firm soil
    resistance_bn: float = 1.0
    resistance_slip: float = 0.5
    side: float = 0.61  # limit of mu on firm soil
    side_bn1: float = 0.69
    side_slope: float = 2.34  # [1/rad] slope of the side force ratio at Bn1 = 0
    side_slope_bn1: float = 0.088  # [1/rad] its growth with Bn1

    def table(self) -> FloatArray:
        """Return the coefficients in the order of the fields, for the compiled law, (13,)."""
        return np.array(astuple(self))


LAW: Final = SoilLaw()

# The fan of look-ups: angles from straight down, denser in the contact area at rated deflection;
# each weight is the arc of its look-up. Columns across the section width.
FAN_ANGLES: Final = np.radians([-36.0, -18.0, -8.0, 0.0, 8.0, 18.0, 36.0])  # (7,)
FAN_ARCS: Final = np.array([9.0, 14.0, 9.0, 8.0, 9.0, 14.0, 9.0]) / 72.0  # (7,) sum 1
FAN_COLUMNS: Final = np.array([-1.0, 0.0, 1.0]) / 3.0  # (3,) of the section width

RELAXATION_LONG: Final = 0.15  # [m] sigma_x; assumed
RELAXATION_LAT: Final = 0.30  # [m] sigma_y; assumed
RELAXATION_ROLL: Final = 0.05  # [m] rolling distance over which motion resistance builds; assumed
TREAD_DAMPING_LONG: Final = 0.01  # [s] damps the bristles of a standing wheel; assumed
TREAD_DAMPING_LAT: Final = 0.02  # [s]

# Largest side force per load and slip angle [1/rad]. The soil term of the lateral law grows without
# bound with the cone index; on firm ground the carcass limits it. 6 per rad is about 0.1 per degree
# (assumed, the order of published tractor tyres on concrete).
LATERAL_STIFFNESS_LIMIT: Final = 6.0
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

    def table(self) -> FloatArray:
        """Return the parameters for the compiled law, (n, 6)."""
        return np.column_stack(
            [
                self.radius,
                self.width,
                self.section_height,
                self.relative_deflection,
                self.stiffness,
                self.damping,
            ]
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
    tyres: Tyres, load: FloatArray, cone_index: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the mobility numbers Bn [B] and Bn1 (MAVS), both (n,).

    `SoilLaw` has the equations.
    """
    b, d = tyres.width, 2.0 * tyres.radius
    cn = cone_index * b * d / (1e-3 * np.maximum(load, SMALLEST_LOAD))  # kPa m^2 / kN
    deflection = 1.0 + LAW.mobility_deflection * tyres.relative_deflection
    bn = cn * deflection / (1.0 + LAW.mobility_width * b / d)
    bn1 = cn * np.sqrt(d / tyres.section_height) / (1.0 + LAW.mobility_area * b * d)
    return bn, bn1


def largest_traction(bn: FloatArray, load: FloatArray | float = 1.0) -> FloatArray:
    """Return the gross traction at full slip under `load` [N], (n,) [N]. [B], bias-ply.

    The default load of 1 gives the ratio of traction to load.
    """
    return load * LAW.traction * (1.0 - np.exp(-LAW.traction_bn * bn))


def gross_traction_ratio(bn: FloatArray, slip: FloatArray) -> FloatArray:
    """Return driving force at the rim over load; odd in the slip. [B], bias-ply.

    `SoilLaw` has the equation.
    """
    developed = 1.0 - np.exp(-LAW.traction_slip * np.abs(slip))
    return np.sign(slip) * largest_traction(bn) * developed


def slip_at_traction(share: FloatArray) -> FloatArray:
    """Return the slip at which a wheel transmits this share of `largest_traction`, 0 <= share < 1.

    It inverts `gross_traction_ratio`.
    """
    return -np.log(1.0 - share) / LAW.traction_slip


def motion_resistance_ratio(bn: FloatArray, slip: FloatArray) -> FloatArray:
    """Return motion resistance over load. [B], bias-ply.

    `SoilLaw` has the equation.
    """
    by_slip = LAW.resistance_slip * np.abs(slip) / np.sqrt(bn)
    return LAW.resistance_bn / bn + LAW.resistance + by_slip


def largest_side_ratio(bn1: FloatArray) -> FloatArray:
    """Return mu of `SoilLaw`, the limit of side force over load at large slip angles. MAVS."""
    return LAW.side + LAW.side_bn1 / bn1


def lateral_ratio(bn1: FloatArray, slip_angle: FloatArray) -> FloatArray:
    """Return side force over load, against the slip angle [rad]. MAVS.

    `SoilLaw` has the equation; its initial slope is limited to `LATERAL_STIFFNESS_LIMIT`.
    """
    largest = largest_side_ratio(bn1)
    slope = np.minimum(LAW.side_slope + LAW.side_slope_bn1 * bn1, LATERAL_STIFFNESS_LIMIT)
    grip = largest * (1.0 - np.exp(-slope / largest * np.abs(slip_angle)))
    return -np.sign(slip_angle) * grip


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
    tyres: Tyres,
    terrain: Terrain,
    cone_index: FloatArray,
    motion: WheelMotion,
    deflection: FloatArray,
    dt: float,
) -> tuple[FloatArray, WheelForces]:
    """Return the tread deflections after `dt` [s] and the forces of the ground, for n wheels.

    Deflections u (n, 3) [m] - along, across, in rolling - are the state. They follow the sliding
    speed w and fade over the relaxation length sigma (single-contact-point model, [P] eq. (7.7)),

        du/dt = w - |V| / sigma u.

    u / sigma is the slip in steady rolling. At V = 0 it is a spring, so that a standing wheel holds
    on a slope. The law is the same in reverse. `cone_index` is (n,) [kPa] below each wheel.
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

    speeds = np.stack([rim - v_long, v_lat, 0.5 * (rim + v_long)], axis=1)  # (n, 3) w
    carried = np.stack([rolling, rolling, np.abs(speeds[:, 2])], axis=1)  # (n, 3) |V|
    lengths = np.array([RELAXATION_LONG, RELAXATION_LAT, RELAXATION_ROLL])
    damping = np.array([TREAD_DAMPING_LONG, TREAD_DAMPING_LAT, TREAD_DAMPING_LONG])
    after = (deflection + dt * speeds) / (1.0 + dt * carried / lengths)  # implicit Euler
    after = np.clip(after, -lengths, lengths)
    rate = (after - deflection) / dt
    slips = np.clip((after + damping * rate) / lengths, -1.0, 1.0)  # (n, 3)
    after = after * (load > 0.0)[:, None]

    bn, bn1 = mobility(tyres, load, cone_index)
    traction = load * gross_traction_ratio(bn, slips[:, 0])
    side = load * lateral_ratio(bn1, np.arctan(slips[:, 1]))
    # friction ellipse: traction and side force together stay within what the soil transmits
    used = np.hypot(traction / largest_traction(bn), side / largest_side_ratio(bn1))
    used = used / np.maximum(load, SMALLEST_LOAD)
    share = 1.0 / np.maximum(1.0, used)
    traction, side = share * traction, share * side
    pull = traction - load * motion_resistance_ratio(bn, slips[:, 0]) * slips[:, 2]

    force = load[:, None] * normal + pull[:, None] * ahead + side[:, None] * left
    moment = np.cross(arm, force)
    # the moment about the axle is that of gross traction; motion resistance acts on the hub
    about_axle = np.einsum("nk,nk->n", moment, motion.axle)
    moment = moment - (tyres.radius * traction + about_axle)[:, None] * motion.axle
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
