"""Augmented state of the estimators: the vehicle's state and its persistent disturbances."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np

from ..models.kinematics import hitch_angle, trailer_point
from ..types import Disturbance, Estimate, FloatArray, Innovation, MapDisturbance, State
from ..vehicle import Vehicle
from .estimate_kernel import state_covariance


class AugmentedState(IntEnum):
    """Index of each entry of an augmented state: `State` with the rim speed, then disturbances.

    The hydrostat drives the wheels, not the vehicle: the rim speed follows the hydrostat with the
    lag tau on any ground, and wheel slip lowers the vehicle's speed without delay. Disturbances
    that turn with the vehicle and disturbances that are fixed in the map have entries of their
    own, because a slope acts on a turning vehicle from a direction that changes all the time.
    """

    X = 0  # [m] tractor point, map frame
    Y = 1  # [m]
    PSI_T = 2  # [rad] yaw of the tractor
    PSI_I = 3  # [rad] yaw of the trailer
    DELTA_T = 4  # [rad] steering angle of the front wheels
    DELTA_I = 5  # [rad] steering angle of the trailer at RJ2
    RIM = 6  # [m/s] speed of the rim of the driven wheels
    SLIP_T = 7  # [rad] side slip of the rear axle, the part that turns with the vehicle
    SLIP_I = 8  # [rad] side slip of the trailer axle, likewise
    STEERING = 9  # [rad] front steering beside the measured angle
    DRIVE = 10  # [m/s^2] acceleration of the rim beside the hydrostat's
    WHEEL = 11  # wheel slip, see `Disturbance`, the part that turns with the vehicle
    SIDE_X = 12  # [rad] side slip of both axles, a vector in the map frame: east
    SIDE_Y = 13  # [rad] north
    CLIMB_X = 14  # wheel slip on the way east
    CLIMB_Y = 15  # wheel slip on the way north
    GNSS_X = 16  # [m] half the slow error of the trailer's receiver less the tractor's: east
    GNSS_Y = 17  # [m] north
    GYRO_T = 18  # [rad/s] bias of the tractor's gyro
    GYRO_I = 19  # [rad/s] bias of the trailer's
    PAST_T = 20  # [rad] yaw of the tractor at the last sample of its gyro
    PAST_I = 21  # [rad] the same of the trailer


STATES: Final = len(State)
SIZE: Final = len(AugmentedState)

DISTURBANCE_BOUND: Final[FloatArray] = np.array(
    [0.3, 0.3, 0.15, 0.5, 0.5, 0.2, 0.2, 0.3, 0.3, 1.0, 1.0, 0.1, 0.1, math.inf, math.inf]
)
"""Largest magnitude of each disturbance, (15,): twice that of a vehicle that can be steered; of
GNSS and gyros, more than any sensor in order has; none of the past yaw."""

_V_DEPENDS_ON: Final = (
    int(AugmentedState.PSI_T),
    int(AugmentedState.RIM),
    int(AugmentedState.WHEEL),
    int(AugmentedState.CLIMB_X),
    int(AugmentedState.CLIMB_Y),
)
_NOTHING: Final = np.zeros(STATES)

INITIAL_SD: Final[FloatArray] = np.array([0.02, 0.02, 0.01, 0.03, 0.02, 0.01, 0.01, 0.03, 0.03])
"""Standard deviation of each disturbance of the vehicle before the first sample, (9,); assumed."""


class Slips(NamedTuple):
    """Total slips of an augmented state: body-fixed and map-fixed parts together."""

    tractor: float  # [rad] side slip of the rear axle
    trailer: float  # [rad] side slip of the trailer axle
    wheel: float  # wheel slip 1 - v / rim


def slips(augmented: FloatArray) -> Slips:
    """Return s_t + n(psi_t)'g, s_i + n(psi_i)'g and s_w + e(psi_t)'c of an augmented state (22,).

    e is the unit vector along a heading, n the one to its left, g `SIDE_*` and c `CLIMB_*`. Both
    map-fixed terms change their sign in reverse, where the vehicle climbs with its back and still
    drifts downhill.
    """
    _, _, psi_t, psi_i, _, _, rim, slip_t, slip_i, _, _, wheel, *of_map = augmented.tolist()
    gx, gy, cx, cy = of_map[: len(MapDisturbance)]
    cos_t, sin_t, gear = math.cos(psi_t), math.sin(psi_t), math.copysign(1.0, rim)
    return Slips(
        tractor=slip_t + gear * (gy * cos_t - gx * sin_t),
        trailer=slip_i + gear * (gy * math.cos(psi_i) - gx * math.sin(psi_i)),
        wheel=wheel + gear * (cx * cos_t + cy * sin_t),
    )


def map_disturbance_gain(
    psi_t: float, psi_i: float, speed: float, yaw_rate: float, vehicle: Vehicle
) -> FloatArray:
    """Return d `Disturbance` / d `MapDisturbance`, (5, 4), at headings [rad] and speed [m/s].

    The signs change in reverse. With the wheel slip s = e(psi_t)'c the vehicle settles at
    rim - rim s and loses rim s' as it turns, so that to first order in s the drive disturbance is
    -v (s / tau + s'). `yaw_rate` is that of the tractor [rad/s].
    """
    cos, sin = math.cos(psi_t), math.sin(psi_t)
    tau = vehicle.speed_time_constant
    by_climb = -speed * (cos / tau - yaw_rate * sin), -speed * (sin / tau + yaw_rate * cos)
    gain = [  # rows in the order of `Disturbance`
        [-sin, cos, 0.0, 0.0],
        [-math.sin(psi_i), math.cos(psi_i), 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, *by_climb],
        [0.0, 0.0, cos, sin],
    ]
    return math.copysign(1.0, speed) * np.array(gain)


def map_gain(estimate: Estimate, vehicle: Vehicle) -> FloatArray:
    """Return `map_disturbance_gain` (5, 4) at the state of an estimate."""
    _, _, psi_t, psi_i, delta_t, _, v = estimate.state.tolist()
    angle = delta_t + estimate.disturbance[Disturbance.STEERING]
    yaw_rate = v * math.tan(angle) / vehicle.wheelbase
    return map_disturbance_gain(psi_t, psi_i, v, yaw_rate, vehicle)


def augmented_of(estimate: Estimate, vehicle: Vehicle) -> FloatArray:
    """Return the augmented state (18,) of which `estimate_of` makes this estimate.

    What an estimate does not have, the error of GNSS, is 0.
    """
    _, _, psi_t, _, delta_t, _, v = estimate.state.tolist()
    slip_t, slip_i, bias, drive_v, wheel = estimate.disturbance.tolist()
    rim = v / (1.0 - wheel)
    augmented = np.zeros(SIZE)
    augmented[:STATES] = estimate.state
    augmented[AugmentedState.RIM] = rim
    augmented[AugmentedState.SIDE_X : AugmentedState.GNSS_X] = estimate.map_disturbance
    of_map = slips(augmented)  # the part of the map alone
    _, _, climb_x, climb_y = estimate.map_disturbance.tolist()
    turning = math.copysign(1.0, rim) * (climb_y * math.cos(psi_t) - climb_x * math.sin(psi_t))
    slip_rate = turning * v * math.tan(delta_t + bias) / vehicle.wheelbase  # s' [1/s]
    augmented[STATES : AugmentedState.SIDE_X] = (
        slip_t - of_map.tractor,
        slip_i - of_map.trailer,
        bias,
        drive_v + rim * (wheel / vehicle.speed_time_constant + slip_rate),
        wheel - of_map.wheel,
    )
    return augmented


def estimate_of(
    augmented: FloatArray,
    covariance: FloatArray,
    time_s: float,
    vehicle: Vehicle,
    innovations: tuple[Innovation, ...],
    unfollowed: FloatArray = _NOTHING,
    noise_factors: FloatArray | None = None,
) -> Estimate:
    """Return the estimate for a controller from an augmented state (22,).

    `covariance` (22, 22) is carried to the state (7, 7) to first order; the
    variances `unfollowed` (7,) of what no state follows are added. The drive disturbance of
    the estimate moves v as the rim speed, its disturbance and the wheel slip do together.
    `noise_factors` (3,) are handed on.
    """
    total = slips(augmented)
    state = augmented[:STATES].copy()
    _, _, psi_t, _, delta_t, _, rim, _, _, bias, drive, _, *others = augmented.tolist()
    of_map = others[: len(MapDisturbance)]
    _, _, climb_x, climb_y = of_map
    cos, sin = math.cos(psi_t), math.sin(psi_t)
    v = rim * (1.0 - total.wheel)
    state[State.V] = v
    gear = math.copysign(1.0, rim)
    slip_by_heading = gear * (climb_y * cos - climb_x * sin)  # ds / d(psi_t)
    slip_rate = slip_by_heading * v * math.tan(delta_t + bias) / vehicle.wheelbase  # s' [1/s]
    by_entry = (  # d v / d augmented
        -rim * slip_by_heading,
        1.0 - total.wheel,
        -rim,
        -abs(rim) * cos,
        -abs(rim) * sin,
    )
    drive_v = drive - rim * (total.wheel / vehicle.speed_time_constant + slip_rate)
    of_state = np.empty((STATES, STATES))
    state_covariance(covariance, _V_DEPENDS_ON, by_entry, unfollowed, of_state)
    return Estimate(
        time_s=time_s,
        state=state,
        covariance=of_state,
        trailer_xy=trailer_point(state, vehicle),
        hitch_angle=hitch_angle(state),
        disturbance=np.array([total.tractor, total.trailer, bias, drive_v, total.wheel]),
        innovations=innovations,
        map_disturbance=np.array(of_map),
        noise_factors=noise_factors,
    )
