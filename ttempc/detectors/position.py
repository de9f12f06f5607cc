"""Detectors of a position that jumps against dead reckoning, and of one that is not known well.

Both have the same bound of what dead reckoning lets pass.
"""

import math
from typing import Final

import numpy as np

from ..layout import AlarmColumn
from ..sensors import SensorIndex
from ..types import Disturbance, FloatArray, State
from .board import WARN, Record, TickData, has_alarm
from .history import kernel
from .hitch import SETTLED_S
from .motion import wheels_spin
from .speeds import wheel_speed
from .table import DetectorIndex

LAST_ESTIMATE: Final = np.dtype(
    [
        ("time_s", "f8"),
        ("x", "f8"),  # [m] of the tractor point
        ("y", "f8"),
        ("yaw", "f8"),  # [rad]
        ("speed", "f8"),  # [m/s]
        ("sd_m", "f8"),  # standard deviation of the position, the larger one of both axes
        ("roughness", "f8"),  # mean of the learnt factor of roughness
    ]
)
"""The last estimate that was finite; NaN: none yet."""

POSITION: Final = np.dtype(
    [
        ("offset", "f8", 2),  # of the position from dead reckoning [m], map frame
        ("spun_s", "f8"),  # last time at which the wheels may have spun
    ]
)
"""Memory of the detector of jumps."""

_FLAT_BOUND_M: Final = 0.25  # of the distance on ground without bumps; by hand
_ROUGH_BOUND_M: Final = 0.12  # that a roughness of 1 adds; by hand
_UNSTATED: Final = 3.0  # times the bound, for an estimator that states no side slip; assumed
_MEMORY_S: Final = 10.0  # in which an offset from dead reckoning fades
_KNOWN_SD: Final = 4.0  # standard deviations of an error that the estimate has stated
_KNOWN_M: Final = 0.2  # four standard deviations of a position that is known
_ROUGHNESS_S: Final = 30.0  # mean of the learnt roughness
_LONGEST_TICK_S: Final = 1.0
_HELD: Final = 2.0  # factor of the ratio under an alarm
_SPUN_S: Final = 20.0  # that a vehicle takes to stand; assumed
_MOVING_MPS: Final = 0.1
_RISK_SD: Final = math.sqrt(2.0 * math.log(1e5))  # standard deviations at a risk of 1e-5 a tick


def new_last_estimate() -> FloatArray:
    """Return a record `LAST_ESTIMATE` before the first estimate, flat."""
    flat = np.full(LAST_ESTIMATE.itemsize // 8, math.nan)
    flat.view(LAST_ESTIMATE)[0]["roughness"] = 1.0
    return flat


def new_position() -> FloatArray:
    """Return a record `POSITION` before the first estimate, flat."""
    flat = np.zeros(POSITION.itemsize // 8)
    flat.view(POSITION)[0]["spun_s"] = -math.inf
    return flat


@kernel
def average_roughness(last: Record, board: Record, data: TickData) -> None:
    """Take the learnt factor of roughness into its mean.

    The factor follows a fault as it follows a rough field, so that its mean is taken, and held
    under an alarm of the position.
    """
    factor = data.estimate.noise_factors[0]
    if has_alarm(board, DetectorIndex.POSITION) or not factor >= 0.0:
        return
    if 0.0 < data.span_s <= _LONGEST_TICK_S:
        last.roughness += min(1.0, data.span_s / _ROUGHNESS_S) * (factor - last.roughness)


@kernel
def remember_estimate(last: Record, data: TickData) -> None:
    """Keep an estimate that is finite."""
    state = data.estimate.state
    covariance = data.estimate.covariance
    if not math.isfinite(state[State.X] + state[State.Y] + state[State.PSI_T] + state[State.V]):
        return
    last.time_s = data.now
    last.x = state[State.X]
    last.y = state[State.Y]
    last.yaw = state[State.PSI_T]
    last.speed = state[State.V]
    last.sd_m = math.sqrt(max(0.0, covariance[0, 0], covariance[1, 1]))


@kernel
def position_bound(last: Record, data: TickData) -> float:
    """Return the distance from dead reckoning that is no jump [m].

    With the mean learnt factor of roughness rho,

        0.25 + 0.12 sqrt(rho),

    three times as much for an estimator that states no side slip. By hand, above what drives
    without a fault reached.
    """
    slips = data.estimate.disturbance
    bound = _FLAT_BOUND_M + _ROUGH_BOUND_M * math.sqrt(last.roughness)
    if slips[Disturbance.SLIP_T] == 0.0 and slips[Disturbance.SLIP_I] == 0.0:
        bound *= _UNSTATED
    return bound


@kernel
def observe_position(
    memory: Record, last: Record, motion: Record, wheels: Record, board: Record, data: TickData
) -> None:
    """Compare the moves of the estimate with dead reckoning by its speed, yaw and side slip.

    With the position p, the distance v T along the mean yaw and speed of two ticks, and the side
    slip alpha to the left, a tick adds d to the offset o [m],

        d = p(k) - p(k-1) - v T (cos - alpha sin, sin + alpha cos),
        o <- exp(-T / 10 s) o + c d,   c = max(0, 1 - max(0, 4 sd - 0.2 m) / |d|).

    With c, what an estimate corrects of the error sd that it stated before, as after an outage,
    does not count. What the wheels have rolled beside v T is taken off d, see `_beyond_wheels`, and
    the distance that spinning wheels lose, see `_without_spin`.

    The statistic is |o| over `position_bound`, its limit 1; it is 0 in the first 8 s. Under an
    alarm both factors are 1 and the statistic is twice as large, so that a jump is not believed
    because it lasts: what is left must be below a quarter of the bound.

    Args:
        memory: record `POSITION`.
        last: record `LAST_ESTIMATE` of the tick before.
        motion: record `SPEED_SUMS` of the detector of motion.
        wheels: record `SPEED_SUMS` of the detector of wheels.
        board: record `BOARD`.
        data: of the tick.
    """
    index = DetectorIndex.POSITION
    held = has_alarm(board, index)
    state = data.estimate.state
    covariance = data.estimate.covariance

    yaw = 0.5 * (state[State.PSI_T] + last.yaw)
    distance = 0.5 * (state[State.V] + last.speed) * data.span_s
    slip = data.estimate.disturbance[Disturbance.SLIP_T]
    dx = state[State.X] - last.x - distance * (math.cos(yaw) - slip * math.sin(yaw))
    dy = state[State.Y] - last.y - distance * (math.sin(yaw) + slip * math.cos(yaw))

    of_wheels = board.alarms[DetectorIndex.WHEELS, AlarmColumn.REACTION]
    if board.excluded[SensorIndex.ENCODER] == 0.0 and of_wheels != WARN:
        dx, dy = _beyond_wheels(dx, dy, yaw, wheel_speed(data) * data.span_s - distance)
    if (of_wheels > WARN or has_alarm(board, DetectorIndex.MOTION)) and wheels_spin(motion, wheels):
        memory.spun_s = data.now
        dx, dy = _without_spin(dx, dy, yaw, distance)
    if data.span_s > 0.0 and math.isfinite(dx + dy):
        _move_offset(memory, data.span_s, dx, dy, last.sd_m, held)

    length = math.hypot(memory.offset[0], memory.offset[1])
    ratio = (_HELD if held else 1.0) * length / position_bound(last, data)
    is_truth = covariance[0, 0] + covariance[1, 1] == 0.0  # which moves as the vehicle does
    board.statistic[index] = ratio if data.now >= SETTLED_S and not is_truth else 0.0
    board.residual[index] = length
    board.proposed[index, AlarmColumn.FIRST] = length


@kernel
def _beyond_wheels(dx: float, dy: float, yaw: float, more: float) -> tuple[float, float]:
    """Return the offset of a tick [m] without what the wheels have rolled `more` than the estimate.

    A hydrostat that does not follow its command leaves the estimate slower or faster than the
    vehicle: what lies between both distances is no jump.
    """
    along = dx * math.cos(yaw) + dy * math.sin(yaw)
    explained = min(max(along, min(0.0, more)), max(0.0, more))
    return dx - explained * math.cos(yaw), dy - explained * math.sin(yaw)


@kernel
def _without_spin(dx: float, dy: float, yaw: float, distance: float) -> tuple[float, float]:
    """Return the offset of a tick [m] without what wheels lose that spin.

    That is its part against the motion, no more than all of the distance. GNSS that is faster than
    the wheels jumps.
    """
    lost = -math.copysign(1.0, distance) * (dx * math.cos(yaw) + dy * math.sin(yaw))
    lost = math.copysign(min(max(0.0, lost), abs(distance)), distance)
    return dx + lost * math.cos(yaw), dy + lost * math.sin(yaw)


@kernel
def _move_offset(
    memory: Record, span_s: float, dx: float, dy: float, sd_m: float, held: bool
) -> None:
    """Add the offset of a tick [m] to the sum of them; begin anew after a long gap."""
    if span_s > _LONGEST_TICK_S:
        if not held:
            memory.offset[0] = 0.0
            memory.offset[1] = 0.0
        return
    fading = 1.0
    share = 1.0
    if not held:
        fading = math.exp(-span_s / _MEMORY_S)
        length = math.hypot(dx, dy)
        stated = max(0.0, _KNOWN_SD * sd_m - _KNOWN_M)
        share = max(0.0, length - stated) / max(length, 1e-9)
    memory.offset[0] = fading * memory.offset[0] + share * dx
    memory.offset[1] = fading * memory.offset[1] + share * dy


@kernel
def observe_protection(memory: Record, last: Record, board: Record, data: TickData) -> None:
    """Bound the horizontal error of the tractor point while a sensor is not used.

    The position is Rayleigh distributed at most, along the worse axis of its covariance. With its
    larger eigenvalue s^2, the bound b of `position_bound` and the offset o under an alarm of the
    position, the protection level [m] at the risk of 1e-5 a tick is

        L = b + |o| + s sqrt(2 ln 1e5),

    as the horizontal protection level of RTCA DO-229, there for one axis. It is the residual, and
    the statistic as well while a sensor is excluded. The limit of 1.2 m is assumed. L holds without
    GNSS, and without a sensor that is left out; where both receivers lie alike (jump, drift, float)
    the error may be larger: the table of docs/appendix/reliability.md.

    Args:
        memory: record `POSITION`.
        last: record `LAST_ESTIMATE` of the tick before.
        board: record `BOARD`.
        data: of the tick.
    """
    index = DetectorIndex.PROTECTION
    covariance = data.estimate.covariance
    xx = covariance[0, 0]
    yy = covariance[1, 1]
    variance = 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), covariance[0, 1])

    jumped = has_alarm(board, DetectorIndex.POSITION)
    offset = math.hypot(memory.offset[0], memory.offset[1]) if jumped else 0.0
    level = position_bound(last, data) + offset + _RISK_SD * math.sqrt(max(0.0, variance))

    excluded = jumped or has_alarm(board, DetectorIndex.HITCH)
    excluded |= board.alarms[DetectorIndex.WHEELS, AlarmColumn.REACTION] == WARN
    for readings in range(DetectorIndex.STEERING_FRONT):
        excluded |= has_alarm(board, readings)
    board.statistic[index] = level if excluded and not math.isnan(level) else 0.0
    board.residual[index] = level
    board.proposed[index, AlarmColumn.FIRST] = level


@kernel
def excludes_gnss(memory: Record, last: Record, board: Record, confirmed: bool, now: float) -> bool:
    """Return whether GNSS is excluded: the position has jumped or drifts, and the vehicle rolls.

    It comes to rest on dead reckoning, not on the position that is wrong. Where the wheels may
    spin, dead reckoning is worse than GNSS. `confirmed` says that measured velocities of GNSS
    confirm the positions: then it is the estimate that has jumped.
    """
    trusts_wheels = now - memory.spun_s > _SPUN_S
    lies = has_alarm(board, DetectorIndex.POSITION) and not confirmed
    lies |= has_alarm(board, DetectorIndex.DRIFT_SURE)
    lies |= has_alarm(board, DetectorIndex.VELOCITY_SURE) or has_alarm(board, DetectorIndex.STEPS)
    return lies and trusts_wheels and abs(last.speed) > _MOVING_MPS
