"""Law of a wheel on soil, compiled: all wheels of a vehicle in one call, on MuJoCo's arrays.

A wheel is a disc above a Winkler bed: height look-ups under the disc give the normal force
(`tyre.contact`), and the cone index gives traction, motion resistance and side force (`soil_law`).
`ruts` has the ground that wheels press.

The states of a wheel are its tread deflections u: along, across, in rolling, in turning about the
normal. They follow the sliding speed w and fade over the relaxation length sigma
(single-contact-point model, H. B. Pacejka, "Tire and Vehicle Dynamics", 3rd ed., 2012, eq. (7.7)),

    du/dt = w - |V| / sigma u,

with |V| along the wheel that of wheel or hub, whichever is faster, and across it that of the hub,
or of the sliding along the wheel where this is faster. u / sigma is the slip in steady rolling,
across the tangent of the slip angle. At V = 0 it is a spring, so that a standing wheel holds on a
slope. The law is the same in reverse. The third deflection follows the wheel's speed; over its
short length it is the sign of the speed, with which motion resistance acts. Its damping is near the
critical one of a vehicle at rest, so that a stop does not swing back. The fourth slides at the
speed of the ring that stands for the contact where the wheel turns on the spot (`SoilLaw.bore`).
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ttempc.jit import FAST, cached_njit, record
from ttempc.types import FloatArray

from ..bodies import LEFT, Bodies, apply_wrench, axis_of, row_vector, velocity_of
from ..ground.soil import NAMED_SOILS
from ..ground.surface import Surface, grid_cell, ground_below
from ..kernel_options import INLINED, KERNEL
from ..truth import Wheels
from ..vectors import VERTICAL, ZERO, Vector, add, cross, dot, norm, scale
from . import tyre
from .ruts import PRESS, Ruts, press_strip, rolls_on, sinkage_of, strip_ahead
from .soil_law import SOIL
from .tyre import TYRE

WHEEL: Final = np.dtype([(name, np.float64) for name in Wheels._fields])
"""Report of a wheel."""

TREAD: Final = np.dtype(
    [
        ("along", np.float64),
        ("across", np.float64),
        ("rolling", np.float64),
        ("bore", np.float64),
    ]
)
"""Tread deflections of a wheel [m]."""

# numba compiles module globals as constants; floats and tuples let it unroll the loops
_SIN: Final = tuple(np.sin(tyre.FAN_ANGLES).tolist())
_COS: Final = tuple(np.cos(tyre.FAN_ANGLES).tolist())
_ARCS: Final = tuple((tyre.FAN_ARCS / tyre.FAN_COLUMNS.size).tolist())
_SPREADS: Final = tuple(tyre.FAN_SPREADS.tolist())
_COLUMNS: Final = tuple(tyre.FAN_COLUMNS.tolist())
_SMALLEST_LOAD: Final = tyre.SMALLEST_LOAD
_SMALL_SPEED: Final = tyre.SMALL_SPEED
_LEAST_UPRIGHT: Final = tyre.LEAST_UPRIGHT
_PA_PER_KPA: Final = 1e3
_HARD_KPA: Final = NAMED_SOILS["hard"]  # no cone penetrates it, no wheel presses it

_kernel = cached_njit(**KERNEL, fastmath=FAST)
_inlined = cached_njit(**INLINED, fastmath=FAST)


class WheelSet(NamedTuple):
    """The n wheels of a vehicle on their ground."""

    law: FloatArray  # (n, fields) rows `SOIL`
    tyres: FloatArray  # (n, fields) rows `TYRE`
    surface: Surface
    ruts: Ruts
    bodies: Bodies
    numbers: NDArray[np.int64]  # (n,) body of each wheel
    treads: FloatArray  # (n, 4) rows `TREAD`, changed in place
    output: FloatArray  # (n, 7) rows `WHEEL`, written
    timestep: float  # [s]


class Slips(NamedTuple):
    """Normalised tread deflections of a wheel, each -1 to 1."""

    along: float  # slip, driving positive
    across: float  # tangent of the slip angle
    rolling: float  # sign of the speed with which motion resistance acts
    bore: float  # of the ring in the contact, turning to the left positive


class Mobility(NamedTuple):
    """Properties of soil and tyre at the present load."""

    bn: float  # mobility number Bn, traction
    m: float  # mobility number M, side force
    side_stiffness: float  # [1/rad] initial slope of side force over load
    deflection: float  # [m] of the tyre
    half_length: float  # [m] of the contact
    bore_radius: float  # [m] of the ring that bores into the ground, see `SoilLaw`


class Ratios(NamedTuple):
    """Forces and torque of a wheel over its load."""

    pull: float  # along the wheel, at its hub
    side: float  # across the wheel, to its left
    torque: float  # against the wheel's turning, over its radius
    bore: float  # moment about the normal to the ground, over the radius of the ring


@_inlined
def _clip(value: float, limit: float) -> float:
    return min(limit, max(-limit, value))


@_inlined
def _disc_axes(axle: Vector) -> tuple[Vector, Vector, float]:
    """Return up and ahead in the plane of a disc, and the cosine of the disc to the vertical."""
    up = (-axle[2] * axle[0], -axle[2] * axle[1], 1.0 - axle[2] * axle[2])
    upright = norm(up)
    up = scale(1.0 / max(upright, _LEAST_UPRIGHT), up)
    return up, cross(axle, up), upright


@_inlined
def _depth_of_arc(touching: float, spread: float) -> float:
    """Return `tyre.depth_of_arc` of the depth of an arc's deepest point, above 0 [m]."""
    if touching < 2.0 * spread:
        return touching * touching / (4.0 * spread)
    return touching - spread


@_inlined
def _contact_patch(
    surface: Surface,
    centre: Vector,
    axle: Vector,
    radius: float,
    width: float,
) -> tuple[float, Vector, Vector]:
    """Return the Winkler bed under a disc: depth, force over its stiffness, first moment.

    The depth [m] is the mean over the fan of look-ups, and the moment [m2] the sum of depth times
    arm from the wheel's centre. The force over the
    stiffness [m], minus the gradient of the bed's energy, points out of the ground.
    """
    grid = surface.grid
    heights = surface.heights
    ny, nx = heights.shape
    per_metre = 1.0 / grid.spacing
    up, ahead, upright = _disc_axes(axle)

    # horizontal lengths are in cells of the grid up to the return
    centre_u = (centre[0] - grid.x) * per_metre
    centre_v = (centre[1] - grid.y) * per_metre
    reach = (radius + width) * per_metre
    inside = reach <= centre_u < nx - 1 - reach and reach <= centre_v < ny - 1 - reach

    depth = 0.0
    gradient_u = 0.0
    gradient_v = 0.0
    moment_u = 0.0
    moment_v = 0.0
    moment_z = 0.0
    if upright > _LEAST_UPRIGHT:
        for angle in range(len(_SIN)):
            forward = radius * _SIN[angle]
            upward = -radius * _COS[angle]
            spread = radius * _SPREADS[angle]
            spoke = add(scale(forward, ahead), scale(upward, up))
            for column in range(len(_COLUMNS)):
                point = add(spoke, scale(_COLUMNS[column] * width, axle))
                arm_u = point[0] * per_metre
                arm_v = point[1] * per_metre

                # cell and place in it; away from the border no index needs a clamp
                if inside:
                    i = np.uintp(centre_u + arm_u)
                    j = np.uintp(centre_v + arm_v)
                    p = centre_u + arm_u - i
                    q = centre_v + arm_v - j
                else:
                    cell_u, p = grid_cell(centre_u + arm_u, nx - 1)
                    cell_v, q = grid_cell(centre_v + arm_v, ny - 1)
                    i = np.uintp(cell_u)
                    j = np.uintp(cell_v)

                # bilinear height above the wheel's centre
                one = np.uintp(1)
                south_west = heights[j, i]
                north_west = heights[j + one, i]
                south_rise = heights[j, i + one] - south_west
                north_rise = heights[j + one, i + one] - north_west
                south = south_west + p * south_rise
                rise = north_west + p * north_rise - south
                height = south + q * rise - centre[2]

                touching = height - point[2] + spread
                if touching > 0.0:
                    part = _depth_of_arc(touching, spread) * _ARCS[angle]
                    depth += part
                    gradient_u -= part * (south_rise + q * (north_rise - south_rise))
                    gradient_v -= part * rise
                    moment_u += part * arm_u
                    moment_v += part * arm_v
                    moment_z += part * height

    gradient = (gradient_u * per_metre, gradient_v * per_metre, depth)
    return depth, gradient, (moment_u * grid.spacing, moment_v * grid.spacing, moment_z)


@_inlined
def _normal_contact(
    surface: Surface,
    tyre: Any,  # noqa: ANN401 - a record `TYRE`
    centre: Vector,
    axle: Vector,
    velocity: Vector,
) -> tuple[float, Vector, Vector]:
    """Return load [N], normal, and arm [m] from the wheel's centre to the centre of pressure.

    `tyre.contact` has the law.
    """
    depth, gradient, moment = _contact_patch(surface, centre, axle, tyre.radius, tyre.width)
    if depth > 0.0:
        size = norm(gradient)
        normal = scale(1.0 / size, gradient)
        approach = -dot(velocity, normal)
        load = tyre.stiffness * size * max(0.0, 1.0 + tyre.damping * approach)
        return load, normal, scale(1.0 / depth, moment)
    return 0.0, VERTICAL, ZERO


@_inlined
def _mobility(soil: Any, tyre: Any, load: float, cone_index: float) -> Mobility:  # noqa: ANN401
    """Return the mobility at a load [N] and a cone index [kPa]; `soil` and `tyre` are records."""
    borne = max(load, _SMALLEST_LOAD)
    pressure = _PA_PER_KPA * cone_index / borne
    m = pressure * tyre.m_area
    growth = soil.side_stiffness_mobility_per_rad * m
    deflection = min(tyre.radius, borne * tyre.compliance)
    half_length = math.sqrt(deflection * (2.0 * tyre.radius - deflection))
    return Mobility(
        bn=pressure * tyre.bn_area,
        m=m,
        side_stiffness=min(soil.side_stiffness_per_rad + growth, soil.side_stiffness_most_per_rad),
        deflection=deflection,
        half_length=half_length,
        bore_radius=soil.bore / 3.0 * (half_length + 0.5 * tyre.width),
    )


@_inlined
def _relaxed(
    deflection: float, sliding: float, speed: float, length: float, damping: float, timestep: float
) -> tuple[float, float]:
    """Return the next tread deflection [m] and its damped part of the relaxation length, -1 to 1.

    Args:
        deflection: present one [m].
        sliding: speed w [m/s].
        speed: |V| [m/s].
        length: relaxation length sigma [m].
        damping: over the stiffness of the tread [s].
        timestep: [s].
    """
    grown = (deflection + timestep * sliding) / (1.0 + timestep * speed / length)
    following = _clip(grown, length)
    rate = (following - deflection) / timestep
    return following, _clip((following + damping * rate) / length, 1.0)


@_inlined
def _deflect_tread(
    tread: Any,  # noqa: ANN401 - a record `TREAD`
    soil: Any,  # noqa: ANN401 - a record `SOIL`
    mobility: Mobility,
    speeds: tuple[float, float, float, float],
    timestep: float,
) -> Slips:
    """Advance the tread deflections by a time step and return the slips.

    Args:
        tread: record `TREAD`, changed in place.
        soil: record `SOIL`.
        mobility: of the wheel at its load.
        speeds: of the wheel, of its hub along the wheel, of the contact across it, of the ring in
            the contact [m/s].
        timestep: [s].
    """
    wheel_speed, along, across, boring = speeds
    sliding = wheel_speed - along

    length = soil.relaxation_long_m
    rolling = max(abs(wheel_speed), abs(along))
    damping = soil.damping_long_s
    tread.along, slip = _relaxed(tread.along, sliding, rolling, length, damping, timestep)

    length = soil.relaxation_lat_m
    if length == 0.0:  # by tyre, load and soil: `SoilLaw`
        by_carcass = mobility.side_stiffness * mobility.deflection / soil.carcass_lat
        length = max(mobility.half_length, by_carcass)
    passing = max(abs(along), abs(sliding))
    damping = soil.damping_lat_s
    tread.across, slip_across = _relaxed(tread.across, across, passing, length, damping, timestep)
    tread.bore, bore = _relaxed(tread.bore, boring, passing, length, damping, timestep)

    length = soil.relaxation_roll_m
    damping = soil.damping_roll_s
    tread.rolling, sign = _relaxed(tread.rolling, along, abs(along), length, damping, timestep)
    return Slips(slip, slip_across, sign, bore)


@_inlined
def _soil_ratios(
    soil: Any,  # noqa: ANN401 - a record `SOIL`
    mobility: Mobility,
    slips: Slips,
    rut_resistance_factor: float,
) -> Ratios:
    """Return forces and torque over the load: Brixius along, Gee-Clough and Sommer across.

    `SoilLaw` has the equations.
    """
    bn = mobility.bn
    largest_traction = soil.traction * (1.0 - math.exp(-soil.traction_bn * bn))
    side_limit = min(soil.side_most, soil.side_bearing * largest_traction)
    largest_side = min(soil.side + soil.side_mobility / mobility.m, side_limit)

    # combined slip: under the tyre one vector (x, y, z) of length rho, inside the ellipsoid of all
    # limits; beside it the slip angle alone
    x = soil.traction_slip * slips.along
    steepness = mobility.side_stiffness / largest_side
    y = steepness * math.atan(slips.across)
    z = steepness * slips.bore
    rho = math.sqrt(x * x + y * y + z * z)
    share = -math.expm1(-rho) / rho if rho > 0.0 else 1.0
    traction = largest_traction * share * x
    under = share * y
    side = -largest_side * under
    beside = -math.expm1(-((soil.side_beside_bn / bn) ** 2))
    if beside > 0.0:
        alone = math.copysign(math.expm1(-abs(y)), y)
        side -= largest_side * beside * (alone - under)

    torque = traction + soil.resistance_tyre * slips.rolling
    driving = max(0.0, slips.along * slips.rolling)
    on_new_soil = soil.resistance_bn / bn
    growth = soil.resistance_slip * driving / math.sqrt(bn)
    resistance = rut_resistance_factor * on_new_soil + growth

    # the forces under the tyre are inside their ellipse; a brake beyond the tyre's own resistance
    # takes over that of the soil where both together would leave it
    braked = -traction * slips.rolling - soil.resistance_tyre
    if braked > 0.0:
        spare = largest_traction * math.sqrt(max(0.0, 1.0 - under**2)) - abs(traction)
        resistance = min(resistance, max(resistance - braked, spare))
    bore = -largest_side * share * z
    return Ratios(traction - resistance * slips.rolling, side, torque, bore)


@_inlined
def _roll_rut(
    wheels: WheelSet,
    wheel: int,
    load: float,
    cone_index: float,
    motion: tuple[Vector, Vector, Vector, Vector],
) -> float:
    """Let a wheel press its rut and return its resistance over that of new soil.

    Args:
        wheels: with the ruts, changed in place.
        wheel: number of the wheel.
        load: of the wheel [N].
        cone_index: of the soil below it [kPa].
        motion: centre [m], axle, velocity [m/s] and rotation [rad/s] of the wheel.
    """
    ruts = wheels.ruts
    soil = record(wheels.law[wheel], SOIL)
    tyre = record(wheels.tyres[wheel], TYRE)
    press = record(ruts.presses[wheel], PRESS)

    # what is left of the soil's resistance on hard ground is no work of sinkage
    sinking = max(0.0, 1.0 - cone_index / _HARD_KPA)
    velocity = motion[2]
    if rolls_on(ruts, wheel, load, wheels.timestep * math.hypot(velocity[0], velocity[1])):
        usual = _mobility(soil, tyre, press.load, cone_index)
        resistance = sinking * soil.resistance_bn / usual.bn
        sinkage = sinkage_of(usual.half_length, tyre.width, resistance)
        strip = strip_ahead(ruts, wheel, tyre, motion)
        press_strip(ruts, wheels.surface.grid, wheel, strip, usual.half_length, sinkage)
    return 1.0 + sinking * press.excess


@_inlined
def _step_wheel(wheels: WheelSet, wheel: int) -> None:
    """Advance the tread of one wheel by a time step and write the wrench of the ground on it."""
    soil = record(wheels.law[wheel], SOIL)
    tyre = record(wheels.tyres[wheel], TYRE)
    tread = record(wheels.treads[wheel], TREAD)
    report = record(wheels.output[wheel], WHEEL)
    surface = wheels.surface
    bodies = wheels.bodies
    body = wheels.numbers[wheel]

    # position and motion of the wheel, in the map frame
    centre = row_vector(bodies.positions, body)
    axle = axis_of(bodies.axes, body, LEFT)
    rotation = row_vector(bodies.velocities, body)
    velocity = velocity_of(bodies, body)

    # normal force and strength of the soil
    load, normal, arm = _normal_contact(surface, tyre, centre, axle, velocity)
    ground, cone_index = ground_below(surface, centre[0], centre[1])
    report.ground = ground
    report.cone_index = cone_index

    # axes of the wheel on the ground, and speeds along them
    ahead = cross(axle, normal)
    ahead = scale(1.0 / max(norm(ahead), _LEAST_UPRIGHT), ahead)
    left = cross(normal, ahead)
    along = dot(velocity, ahead)
    across = dot(add(velocity, cross(rotation, arm)), left)
    wheel_speed = tyre.radius * dot(rotation, axle)
    rolling = max(abs(wheel_speed), abs(along))
    report.slip = (wheel_speed - along) / max(rolling, _SMALL_SPEED)
    report.slip_angle = math.atan(across / max(abs(along), _SMALL_SPEED))

    if load == 0.0:
        tread.along = tread.across = tread.rolling = tread.bore = 0.0
        report.load = report.force_long = report.force_lat = 0.0
        apply_wrench(bodies, body, ZERO, ZERO)
        return

    # treads and ruts, then the law
    mobility = _mobility(soil, tyre, load, cone_index)
    turning = dot(rotation, normal) - dot(rotation, axle) * dot(axle, normal)
    speeds = (wheel_speed, along, across, mobility.bore_radius * turning)
    slips = _deflect_tread(tread, soil, mobility, speeds, wheels.timestep)
    rut_resistance_factor = 1.0
    if wheels.ruts.firm.size > 0:
        motion = (centre, axle, velocity, rotation)
        rut_resistance_factor = _roll_rut(wheels, wheel, load, cone_index, motion)
    ratios = _soil_ratios(soil, mobility, slips, rut_resistance_factor)
    report.load = load
    report.force_long = load * ratios.pull
    report.force_lat = load * ratios.side

    # The force acts at the centre of pressure, with the moment of boring about the normal. About
    # the axle the law's torque counts instead of both.
    force = add(
        scale(load, normal),
        add(scale(report.force_long, ahead), scale(report.force_lat, left)),
    )
    boring = mobility.bore_radius * load * ratios.bore
    moment = add(cross(arm, force), scale(boring, normal))
    excess = tyre.radius * load * ratios.torque + dot(moment, axle)
    apply_wrench(bodies, body, force, add(moment, scale(-excess, axle)))


@_kernel
def wheel_step(wheels: WheelSet) -> None:
    """Advance the tread deflections of all wheels and write the forces of the ground."""
    for wheel in range(wheels.numbers.size):
        _step_wheel(wheels, wheel)
