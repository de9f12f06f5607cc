"""What estimators believe of the vehicle: its state, and what disturbs it, slopes included."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from ..models.kinematics import articulated, hitch_angle, trailer_point
from ..types import Disturbance, Estimate, FloatArray, Innovation, Input, MapDisturbance, State
from ..vehicle import Vehicle


class Belief(IntEnum):
    """Index of each entry of a belief: `State` with the rim's speed, then what disturbs it.

    The hydrostat drives the wheels, not the vehicle: the rim follows it with the lag tau whatever
    the ground is like, and the ground takes its share of the rim's speed at once. What turns with
    the vehicle and what stays with the field are told apart, for on a curve a slope acts from
    another side at every moment.
    """

    X = 0  # [m] tractor point, map frame
    Y = 1  # [m]
    PSI_T = 2  # [rad]
    PSI_I = 3  # [rad]
    DELTA_T = 4  # [rad]
    DELTA_I = 5  # [rad]
    RIM = 6  # [m/s] speed of the rim of the driven wheels
    SLIP_T = 7  # [rad] side slip of the rear axle that turns with the vehicle
    SLIP_I = 8  # [rad] side slip of the trailer axle, likewise
    STEERING = 9  # [rad] front steering that acts beside the measured
    DRIVE = 10  # [m/s^2] acceleration of the rim beside the hydrostat's
    WHEEL = 11  # slip of the driven wheels, 1 - v / rim, likewise
    SIDE_X = 12  # [rad] course of both axles off their heading, as a vector of the map
    SIDE_Y = 13  # [rad]
    CLIMB_X = 14  # wheel slip on the way east
    CLIMB_Y = 15  # wheel slip on the way north


STATES: Final = len(State)
SIZE: Final = len(Belief)

LARGEST: Final[FloatArray] = np.array([0.3, 0.3, 0.15, 0.5, 0.5, 0.2, 0.2, 0.3, 0.3])
"""What a disturbance may be at most, (9,): twice what a vehicle that can be steered shows."""

AT_START: Final[FloatArray] = np.array([0.02, 0.02, 0.01, 0.03, 0.02, 0.01, 0.01, 0.03, 0.03])
"""How uncertain each is at the start, (9,), where nothing was seen of it; assumed."""

LEAST_ROUGHNESS: Final = 1e-3
MOST_ROUGHNESS: Final = 20.0
"""Range of the roughness that a filter learns, see `noise.ProcessNoise`; assumed."""


@dataclass(frozen=True, slots=True)
class Slips:
    """The slips that act at a belief, from what turns with the vehicle and what does not."""

    tractor: float  # [rad] side slip of the rear axle
    trailer: float  # [rad] side slip of the trailer axle
    wheel: float  # 1 - v / rim


def slips(belief: FloatArray) -> Slips:
    """Return s_t + n(psi_t)'g, s_i + n(psi_i)'g and s_w + e(psi_t)'c of a belief (16,).

    e is the unit vector along a heading, n the one to its left, g `SIDE_*` and c `CLIMB_*`; both
    change their signs in reverse, where the vehicle climbs with its back and drifts downhill all
    the same.
    """
    _, _, psi_t, psi_i, _, _, rim, slip_t, slip_i, _, _, wheel, gx, gy, cx, cy = belief.tolist()
    cos_t, sin_t, gear = math.cos(psi_t), math.sin(psi_t), math.copysign(1.0, rim)
    return Slips(
        tractor=slip_t + gear * (gy * cos_t - gx * sin_t),
        trailer=slip_i + gear * (gy * math.cos(psi_i) - gx * math.sin(psi_i)),
        wheel=wheel + gear * (cx * cos_t + cy * sin_t),
    )


def motion(belief: FloatArray, inputs: FloatArray, vehicle: Vehicle) -> FloatArray:
    """Return the time derivative of a belief under `inputs` (3,), (16,): the clear version.

    `articulated` with the slips of the moment, v = rim (1 - s) and rim' = (K hp - rim) / tau + w;
    disturbances stay. `ttempc.estimation.augmented_state_kernel` has the same in compiled form.
    """
    acting = slips(belief)
    state = belief[:STATES].copy()
    state[State.V] *= 1.0 - acting.wheel
    disturbance = np.zeros(len(Disturbance))
    disturbance[Disturbance.SLIP_T] = acting.tractor
    disturbance[Disturbance.SLIP_I] = acting.trailer
    disturbance[Disturbance.STEERING] = belief[Belief.STEERING]
    rate = np.zeros(SIZE)
    rate[:STATES] = articulated(state, inputs, vehicle, disturbance)
    wanted = vehicle.speed_gain * inputs[Input.HP]
    rate[Belief.RIM] = (wanted - belief[Belief.RIM]) / vehicle.speed_time_constant
    rate[Belief.RIM] += belief[Belief.DRIVE]
    return rate


def by_map(
    psi_t: float, psi_i: float, speed: float, yaw_rate: float, vehicle: Vehicle
) -> FloatArray:
    """Return what a map disturbance of one unit is as a `Disturbance`, (5, 4).

    In reverse with the other sign. With the wheel slip s = e(psi_t)'c the vehicle settles at
    rim - rim s and loses rim s' as it turns, so that to first order in s the drive disturbance is
    -v (s / tau + s').
    """
    cos, sin = math.cos(psi_t), math.sin(psi_t)
    tau = vehicle.speed_time_constant
    gain = np.zeros((len(Disturbance), len(MapDisturbance)))
    gain[Disturbance.SLIP_T, :2] = -sin, cos
    gain[Disturbance.SLIP_I, :2] = -math.sin(psi_i), math.cos(psi_i)
    gain[Disturbance.DRIVE, 2:] = (
        -speed * (cos / tau - yaw_rate * sin),
        -speed * (sin / tau + yaw_rate * cos),
    )
    gain[Disturbance.WHEEL, 2:] = cos, sin
    return math.copysign(1.0, speed) * gain


def map_gain(estimate: Estimate, vehicle: Vehicle) -> FloatArray:
    """Return `by_map` at an estimate: its map disturbance makes that much of its disturbance."""
    _, _, psi_t, psi_i, delta_t, _, v = estimate.state.tolist()
    angle = delta_t + estimate.disturbance[Disturbance.STEERING]
    return by_map(psi_t, psi_i, v, v * math.tan(angle) / vehicle.wheelbase, vehicle)


def estimate_of(
    belief: FloatArray,
    covariance: FloatArray,
    time_s: float,
    vehicle: Vehicle,
    innovations: tuple[Innovation, ...],
) -> Estimate:
    """Return what a controller may know of a belief (16,) with its covariance (16, 16)."""
    acting = slips(belief)
    state = belief[:STATES].copy()
    psi_t, delta_t, rim = (float(belief[i]) for i in (Belief.PSI_T, Belief.DELTA_T, Belief.RIM))
    bias, drive, climb_x, climb_y = (
        float(belief[i]) for i in (Belief.STEERING, Belief.DRIVE, Belief.CLIMB_X, Belief.CLIMB_Y)
    )
    cos, sin = math.cos(psi_t), math.sin(psi_t)
    v = rim * (1.0 - acting.wheel)
    state[State.V] = v
    gear = math.copysign(1.0, rim)
    by_heading = gear * (climb_y * cos - climb_x * sin)  # ds / d(psi_t)
    turning = by_heading * v * math.tan(delta_t + bias) / vehicle.wheelbase  # s' [1/s]
    to_state = np.eye(STATES, SIZE)
    to_state[State.V, Belief.PSI_T] = -rim * by_heading
    to_state[State.V, Belief.RIM] = 1.0 - acting.wheel
    to_state[State.V, Belief.WHEEL] = -rim
    to_state[State.V, Belief.CLIMB_X :] = -abs(rim) * cos, -abs(rim) * sin
    disturbance = np.array(
        [
            *(acting.tractor, acting.trailer, bias),
            drive - rim * (acting.wheel / vehicle.speed_time_constant + turning),
            acting.wheel / (1.0 - acting.wheel),
        ]
    )
    seen = to_state @ covariance @ to_state.T
    return Estimate(
        time_s=time_s,
        state=state,
        covariance=0.5 * (seen + seen.T),
        trailer_xy=trailer_point(state, vehicle),
        hitch_angle=hitch_angle(state),
        disturbance=disturbance,
        innovations=innovations,
        map_disturbance=belief[Belief.SIDE_X :].copy(),
    )
