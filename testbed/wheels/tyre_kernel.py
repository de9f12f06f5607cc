"""Law of a wheel on soil, compiled: all wheels of a vehicle in one call, on MuJoCo's arrays.

A wheel is a disc above a Winkler bed: height look-ups under the disc give the normal force
(`tyre.contact`), and the cone index gives traction, motion resistance and side force (`soil_law`).

The state of a wheel are its tread deflections u: along, across, in rolling. They follow the sliding
speed w and fade over the relaxation length sigma (single-contact-point model, H. B. Pacejka, "Tire
and Vehicle Dynamics", 3rd ed., 2012, eq. (7.7)),

    du/dt = w - |V| / sigma u,

with |V| along the wheel that of rim or hub, whichever is faster, and across it that of the hub, or
of the sliding along the wheel where this is faster. u / sigma is the slip in steady rolling, across
the tangent of the slip angle. At V = 0 it is a spring, so that a standing wheel holds on a slope.
The law is the same in reverse. The third deflection follows the wheel's speed; over its short
length it is the sign of the speed, with which motion resistance acts. Its damping is near the
critical one of a vehicle at rest, so that a stop does not swing back.

Ruts: a wheel presses the ground to the depth at which the work of sinkage is the soil's resistance.
After M. G. Bekker ("Introduction to Terrain-Vehicle Systems", 1969, by J. Y. Wong's "Theory of
Ground Vehicles") pressure grows as z^n under a plate, and a strip of contact length l and width b
sinks by z_1, with

    p = W / (b l) at z_1,   b p z_1 / (n + 1) = W resistance_bn / Bn.

Passes add after Abebe, Tanaka and Yamazaki (J. Terramechanics 26 (1989) 139, from memory): equal
ones give z_N = z_1 N^(1/a), so that any wheel in a rut of depth z makes it (z^a + z_1^a)^(1/a)
deep, and only that much work resists it. The state is the height of the ground; it is pressed just
ahead of the contact, so that a wheel does not climb out of its own rut, and its sides are flanks of
the ground like any other.
"""

import math
from enum import IntEnum
from typing import Final

import numpy as np

from ttempc.jit import FAST, cached_njit
from ttempc.types import FloatArray

from . import tyre


class Output(IntEnum):
    """Column of each reported quantity in the kernel's output, see `testbed.truth.Wheels`."""

    LOAD = 0
    SLIP = 1
    SLIP_ANGLE = 2
    FORCE_LONG = 3
    FORCE_LAT = 4
    CONE_INDEX = 5
    GROUND = 6


# numba compiles module globals as constants; floats and tuples let it unroll the loops
_SIN: Final = tuple(np.sin(tyre.FAN_ANGLES).tolist())
_COS: Final = tuple(np.cos(tyre.FAN_ANGLES).tolist())
_ARCS: Final = tuple((tyre.FAN_ARCS / tyre.FAN_COLUMNS.size).tolist())
_COLUMNS: Final = tuple(tyre.FAN_COLUMNS.tolist())
_SMALLEST_LOAD: Final = tyre.SMALLEST_LOAD
_SMALL_SPEED: Final = tyre.SMALL_SPEED
_LEAST_UPRIGHT: Final = tyre.LEAST_UPRIGHT
# contact length over radius
_CONTACT: Final = float(2.0 * np.sin(tyre.FAN_ANGLES[-1]))


# exponent of pressure over sinkage: 0.62 on sandy loam of medium density, 0.42 to 0.89 of dense to
# loose (Cranfield, thesis of D. Ansorge, table 8)
_EXPONENT: Final = 0.62
_PASSES: Final = 3.0  # a: 2 to 3 on loose soil, up to 5 on firm soil
_PRESS: Final = 0.25  # of the grid's spacing: travel from press to press, distance of columns
# A rut is wider than its wheel by this part of the spacing, because points of the grid at its edges
# that are covered by a share f sink by f^(1/a): mean over all places of the edges.
_EDGES: Final = 2.0 / (1.0 + (_EXPONENT + 1.0) / _PASSES) - 1.0


@cached_njit(inline="always")
def grid_cell(coordinate: float, last: int) -> tuple[int, float]:
    """Return the grid cell and the place in it, 0 to 1; beyond the grid those of the border.

    The integer clamp also holds for NaN.

    Args:
        coordinate: along one axis of the grid, in cells.
        last: index of its last point.
    """
    coordinate = min(last, max(0.0, coordinate))
    index = max(0, min(int(coordinate), last - 1))
    return index, coordinate - index


@cached_njit(inline="always")
def _clip(value: float, limit: float) -> float:
    return min(limit, max(-limit, value))


@cached_njit(error_model="numpy", boundscheck=False)
def press(
    x: float,
    y: float,
    across: tuple[float, float],
    travel: float,
    sinkage: float,
    firm: FloatArray,
    grid: FloatArray,
    state: FloatArray,
    first: int,
) -> float:
    """Press the ground under a strip across a wheel and return the work over that on new soil.

    Args:
        x, y: middle of the strip [m].
        across: its width along both axes [m].
        travel: its length [m].
        sinkage: z_1 [m].
        firm: (ny, nx) [m] heights before any wheel.
        grid: of `wheel_step`.
        state: of `wheel_step`; the heights, from `first` on, are changed.
        first: place of the first height.
    """
    ny, nx = firm.shape
    width = math.hypot(across[0], across[1])
    points = math.ceil(width / (_PRESS * grid[2]))
    area = travel * width / (points * grid[2] ** 2)  # share of a grid point's area
    work = 0.0
    for k in range(points):
        place = (k + 0.5) / points - 0.5
        i, p = grid_cell((x + place * across[0] - grid[0]) / grid[2], nx - 1)
        j, q = grid_cell((y + place * across[1] - grid[1]) / grid[2], ny - 1)
        row, column = j + (q >= 0.5), i + (p >= 0.5)
        cell = first + row * nx + column
        before = (firm[row, column] - state[cell]) / sinkage
        after = (max(0.0, before) ** _PASSES + area) ** (1.0 / _PASSES)
        for depth, sign in ((before, -1.0), (after, 1.0)):  # the pressure is at most that at z_1
            virgin = min(1.0, depth)
            work += sign * (virgin ** (_EXPONENT + 1.0) + (_EXPONENT + 1.0) * (depth - virgin))
        state[cell] = firm[row, column] - after * sinkage
    return work * grid[2] ** 2 / (travel * (width + _EDGES * grid[2]))


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST)
def wheel_step(
    law: FloatArray,
    tyres: FloatArray,
    heights: FloatArray,
    cone_indices: FloatArray,
    grid: FloatArray,
    firm: FloatArray,
    bodies: np.ndarray,
    xpos: FloatArray,
    xmat: FloatArray,
    cvel: FloatArray,
    com: FloatArray,
    state: FloatArray,
    output: FloatArray,
    xfrc: FloatArray,
) -> None:
    """Advance the tread deflections of all wheels and write the forces of the ground.

    Args:
        law: (n, 23) `SoilLaw.table`.
        tyres: (n, 7) `Tyres.table`.
        heights: (ny, nx) [m] of the ground.
        cone_indices: (ny, nx) [kPa] on the same grid.
        grid: (4,) x and y [m] of the first grid point, spacing [m], time step [s].
        firm: (ny, nx) [m] heights before any wheel where wheels leave ruts, else (0, 0).
        bodies: (n,) body of each wheel.
        xpos: (nbody, 3) [m] MuJoCo's body positions.
        xmat: (nbody, 9) body axes, row major; the axle is the second column.
        cvel: (nbody, 6) rotation and velocity at `com`.
        com: (nbody, 3) [m] subtree centres of mass; row 1 is the vehicle's.
        state: (3 n,) [m] tread deflections, wheel by wheel, changed in place. With ruts, for each
            wheel also the travel [m] since it pressed, for each the part of the soil's resistance
            that it has more than on new soil, and `heights`: (5 n + ny nx,).
        output: (n, 7) see `Output`, written.
        xfrc: (nbody, 6) force and moment on each body, rows of wheels written.
    """
    count = bodies.size
    ruts = firm.size > 0
    ny, nx = heights.shape
    x0, y0, dt = grid[0], grid[1], grid[3]
    spacing = grid[2]
    per_metre = 1.0 / spacing
    for wheel in range(count):
        body = bodies[wheel]
        # the first three are in the table of the tyres
        traction_most, traction_bn, traction_slip = law[wheel, 3], law[wheel, 4], law[wheel, 5]
        resistance_tyre, resistance_bn = law[wheel, 6], law[wheel, 7]
        sigma_x, sigma_y, sigma_r = law[wheel, 16], law[wheel, 17], law[wheel, 19]
        tau_x, tau_y, tau_r = law[wheel, 20], law[wheel, 21], law[wheel, 22]
        radius, width = tyres[wheel, 0], tyres[wheel, 1]
        cx, cy, cz = xpos[body, 0], xpos[body, 1], xpos[body, 2]
        ax, ay, az = xmat[body, 1], xmat[body, 4], xmat[body, 7]
        wx, wy, wz = cvel[body, 0], cvel[body, 1], cvel[body, 2]
        lx, ly, lz = cx - com[1, 0], cy - com[1, 1], cz - com[1, 2]
        vx = cvel[body, 3] + wy * lz - wz * ly
        vy = cvel[body, 4] + wz * lx - wx * lz
        vz = cvel[body, 5] + wx * ly - wy * lx

        # the disc: up and ahead in its plane
        ux, uy, uz = -az * ax, -az * ay, 1.0 - az * az
        upright = math.sqrt(ux * ux + uy * uy + uz * uz)
        scale = 1.0 / max(upright, _LEAST_UPRIGHT)
        ux, uy, uz = ux * scale, uy * scale, uz * scale
        fx, fy, fz = ay * uz - az * uy, az * ux - ax * uz, ax * uy - ay * ux

        # Winkler bed under the fan of look-ups; the sums are about the wheel's centre, in cells
        total, ex, ey, px, py, pz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        cu, cv = (cx - x0) * per_metre, (cy - y0) * per_metre
        reach = (radius + width) * per_metre
        inside = reach <= cu < nx - 1 - reach and reach <= cv < ny - 1 - reach
        bu, bv, bz = width * ax * per_metre, width * ay * per_metre, width * az
        if upright > _LEAST_UPRIGHT:
            for a in range(7):
                sine, cosine = radius * _SIN[a], radius * _COS[a]
                ru = (sine * fx - cosine * ux) * per_metre
                rv = (sine * fy - cosine * uy) * per_metre
                rz = sine * fz - cosine * uz
                for c in range(3):
                    du, dv = ru + _COLUMNS[c] * bu, rv + _COLUMNS[c] * bv
                    dz = rz + _COLUMNS[c] * bz
                    if inside:
                        i, j = np.uintp(cu + du), np.uintp(cv + dv)
                        p, q = cu + du - i, cv + dv - j
                    else:
                        ci, p = grid_cell(cu + du, nx - 1)
                        cj, q = grid_cell(cv + dv, ny - 1)
                        i, j = np.uintp(ci), np.uintp(cj)
                    one = np.uintp(1)
                    south_west, north_west = heights[j, i], heights[j + one, i]
                    south_rise = heights[j, i + one] - south_west
                    north_rise = heights[j + one, i + one] - north_west
                    south = south_west + p * south_rise
                    rise = north_west + p * north_rise - south
                    height = south + q * rise - cz
                    if height > dz:
                        pressure = (height - dz) * _ARCS[a]
                        total += pressure
                        ex -= pressure * (south_rise + q * (north_rise - south_rise))
                        ey -= pressure * rise
                        px += pressure * du
                        py += pressure * dv
                        pz += pressure * height

        i, p = grid_cell(cu, nx - 1)
        j, q = grid_cell(cv, ny - 1)
        south = heights[j, i] + p * (heights[j, i + 1] - heights[j, i])
        north = heights[j + 1, i] + p * (heights[j + 1, i + 1] - heights[j + 1, i])
        row, column = j + (q >= 0.5), i + (p >= 0.5)
        cone_index = cone_indices[row, column]
        output[wheel, 5] = cone_index
        output[wheel, 6] = south + q * (north - south)

        nx_, ny_, nz_ = 0.0, 0.0, 1.0
        load = 0.0
        gx, gy, gz = 0.0, 0.0, 0.0  # arm from the wheel's centre to the centre of pressure
        if total > 0.0:
            ex, ey = ex * per_metre, ey * per_metre
            size = math.sqrt(ex * ex + ey * ey + total * total)
            nx_, ny_, nz_ = ex / size, ey / size, total / size
            approach = -(vx * nx_ + vy * ny_ + vz * nz_)
            load = tyres[wheel, 4] * size * max(0.0, 1.0 + tyres[wheel, 5] * approach)
            gx, gy, gz = px / total * spacing, py / total * spacing, pz / total

        # axes on the ground, speeds in them
        hx, hy, hz = ay * nz_ - az * ny_, az * nx_ - ax * nz_, ax * ny_ - ay * nx_
        scale = 1.0 / max(math.sqrt(hx * hx + hy * hy + hz * hz), _LEAST_UPRIGHT)
        hx, hy, hz = hx * scale, hy * scale, hz * scale
        sx, sy, sz = ny_ * hz - nz_ * hy, nz_ * hx - nx_ * hz, nx_ * hy - ny_ * hx
        v_long = vx * hx + vy * hy + vz * hz
        v_lat = (
            (vx + wy * gz - wz * gy) * sx
            + (vy + wz * gx - wx * gz) * sy
            + (vz + wx * gy - wy * gx) * sz
        )
        rim = radius * (wx * ax + wy * ay + wz * az)
        rolling = max(abs(rim), abs(v_long))
        output[wheel, 1] = (rim - v_long) / max(rolling, _SMALL_SPEED)
        output[wheel, 2] = math.atan(v_lat / max(abs(v_long), _SMALL_SPEED))

        pressure = 1e3 * cone_index / max(load, _SMALLEST_LOAD)
        bn, m = pressure * tyres[wheel, 2], pressure * tyres[wheel, 3]
        stiffness = min(law[wheel, 13] + law[wheel, 14] * m, law[wheel, 15])
        give = min(radius, max(load, _SMALLEST_LOAD) * tyres[wheel, 6])
        half = math.sqrt(give * (2.0 * radius - give))
        if sigma_y == 0.0:
            sigma_y = max(half, stiffness * give / law[wheel, 18])

        # tread deflections
        first = 3 * wheel
        u, w, r = state[first], state[first + 1], state[first + 2]
        u1 = _clip((u + dt * (rim - v_long)) / (1.0 + dt * rolling / sigma_x), sigma_x)
        travel = max(abs(v_long), abs(rim - v_long))
        w1 = _clip((w + dt * v_lat) / (1.0 + dt * travel / sigma_y), sigma_y)
        r1 = _clip((r + dt * v_long) / (1.0 + dt * abs(v_long) / sigma_r), sigma_r)
        slip = _clip((u1 + tau_x * (u1 - u) / dt) / sigma_x, 1.0)
        slip_lat = _clip((w1 + tau_y * (w1 - w) / dt) / sigma_y, 1.0)
        share_roll = _clip((r1 + tau_r * (r1 - r) / dt) / sigma_r, 1.0)

        if load == 0.0:
            state[first] = state[first + 1] = state[first + 2] = 0.0
            output[wheel, 0] = output[wheel, 3] = output[wheel, 4] = 0.0
            for k in range(6):
                xfrc[body, k] = 0.0
            continue
        state[first], state[first + 1], state[first + 2] = u1, w1, r1

        grip_long = traction_most * (1.0 - math.exp(-traction_bn * bn))
        sinking = 1.0
        if ruts:
            speed = math.sqrt(vx * vx + vy * vy)
            travel = state[3 * count + wheel] + speed * dt
            if travel > _PRESS * spacing:
                sinkage = 2.0 * half * (_EXPONENT + 1.0) * resistance_bn / bn
                ahead = (0.5 * _CONTACT * radius + spacing) / speed
                x, y = cx + ahead * vx, cy + ahead * vy
                across = (width * ax, width * ay)
                first = 5 * count
                more = press(x, y, across, travel, max(1e-6, sinkage), firm, grid, state, first)
                fading = min(1.0, 0.5 * travel / half)
                state[4 * count + wheel] += fading * (more - 1.0 - state[4 * count + wheel])
                travel = 0.0
            state[3 * count + wheel] = travel
            sinking += state[4 * count + wheel]
        borne = min(law[wheel, 11], law[wheel, 12] * grip_long)
        grip_lat = min(law[wheel, 9] + law[wheel, 10] / m, borne)
        x = traction_slip * slip
        y = stiffness / grip_lat * math.atan(slip_lat)
        rho = math.sqrt(x * x + y * y)
        share = -math.expm1(-rho) / rho if rho > 0.0 else 1.0
        traction = grip_long * share * x
        side = -grip_lat * share * y
        torque = traction + resistance_tyre * share_roll
        driving = max(0.0, slip * share_roll)
        resistance = sinking * resistance_bn / bn + law[wheel, 8] * driving / math.sqrt(bn)
        # traction and side force are inside their ellipse; a brake beyond the tyre's own resistance
        # takes over that of the soil where both together would leave it
        braked = -traction * share_roll - resistance_tyre
        if braked > 0.0:
            room = grip_long * math.sqrt(max(0.0, 1.0 - (side / grip_lat) ** 2)) - abs(traction)
            resistance = min(resistance, max(resistance - braked, room))
        pull, side = load * (traction - resistance * share_roll), load * side

        tx = load * nx_ + pull * hx + side * sx
        ty = load * ny_ + pull * hy + side * sy
        tz = load * nz_ + pull * hz + side * sz
        mx, my, mz = gy * tz - gz * ty, gz * tx - gx * tz, gx * ty - gy * tx
        excess = radius * load * torque + mx * ax + my * ay + mz * az
        xfrc[body, 0], xfrc[body, 1], xfrc[body, 2] = tx, ty, tz
        xfrc[body, 3] = mx - excess * ax
        xfrc[body, 4] = my - excess * ay
        xfrc[body, 5] = mz - excess * az
        output[wheel, 0], output[wheel, 3], output[wheel, 4] = load, pull, side
