"""Model of the augmented state in plain numpy, to which tests hold the compiled kernels."""

from __future__ import annotations

from math import copysign, cos, nan, sin
from typing import NamedTuple

import numpy as np

from ttempc.estimation.noise import ProcessNoise, SensorNoise
from ttempc.layout import ESTIMATE, estimate_view
from ttempc.models.augmented_state import (
    SIZE,
    STATES,
    AugmentedState,
    vehicle_parameters,
    write_estimate,
)
from ttempc.models.kinematics import articulated
from ttempc.models.measurement import measure
from ttempc.sensors import SensorIndex
from ttempc.types import Disturbance, Estimate, FloatArray, Input, Sensor, State
from ttempc.vehicle import Vehicle


class Slips(NamedTuple):
    """Total slips of an augmented state: body-fixed and map-fixed parts together."""

    tractor: float  # [rad] side slip of the rear axle
    trailer: float  # [rad] side slip of the trailer axle
    wheel: float  # wheel slip 1 - v / wheel_speed


def slips(augmented: FloatArray) -> Slips:
    """Return s_t + n(psi_t)'g, s_i + n(psi_i)'g and s_w + e(psi_t)'c of an augmented state (24,).

    e is the unit vector along a heading, n the one to its left, g `SIDE_*` and c `CLIMB_*`.
    """
    _, _, psi_t, psi_i, _, _, wheel_speed, slip_t, slip_i, _, _, wheel, gx, gy, cx, cy = augmented[
        :16
    ]
    gear = copysign(1.0, wheel_speed)
    return Slips(
        tractor=slip_t + gear * (gy * cos(psi_t) - gx * sin(psi_t)),
        trailer=slip_i + gear * (gy * cos(psi_i) - gx * sin(psi_i)),
        wheel=wheel + gear * (cx * cos(psi_t) + cy * sin(psi_t)),
    )


def estimate_of(
    augmented: FloatArray, covariance: FloatArray, time_s: float, vehicle: Vehicle
) -> Estimate:
    """Return the estimate of an augmented state (24,) with its covariance (24, 24)."""
    row = np.full(ESTIMATE.itemsize // 8, nan)
    write_estimate(augmented, covariance, vehicle_parameters(vehicle), row)
    row.view(ESTIMATE)["time_s"] = time_s
    return estimate_view(row)


def augmented_rate(augmented: FloatArray, inputs: FloatArray, vehicle: Vehicle) -> FloatArray:
    """Return the time derivative (18,) of an augmented state (18,) under `inputs` (3,).

    `articulated` with the total slips, v = v_w (1 - s) and v_w' = (K hp - v_w) / tau + w;
    disturbances are constant.
    """
    total = slips(augmented)
    state = augmented[:STATES].copy()
    state[State.V] *= 1.0 - total.wheel
    disturbance = np.zeros(len(Disturbance))
    disturbance[Disturbance.SLIP_T] = total.tractor
    disturbance[Disturbance.SLIP_I] = total.trailer
    disturbance[Disturbance.STEERING] = augmented[AugmentedState.STEERING]
    rate = np.zeros(SIZE)
    rate[:STATES] = articulated(state, inputs, vehicle, disturbance)
    wheel_speed, drive = augmented[AugmentedState.WHEEL_SPEED], augmented[AugmentedState.DRIVE]
    steady = vehicle.speed_gain * inputs[Input.HP]
    rate[AugmentedState.WHEEL_SPEED] = (steady - wheel_speed) / vehicle.speed_time_constant + drive
    return rate


def predicted_measurement(
    sensor: Sensor, augmented: FloatArray, vehicle: Vehicle, joint: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Return the noise-free reading h (m,) of `sensor` and its Jacobian (m, 24)."""
    reading, jacobian = np.zeros(2), np.zeros((2, SIZE))
    parameters, index = vehicle_parameters(vehicle, joint), int(SensorIndex[sensor.name])
    m = measure(index, augmented, parameters, 0.0, reading, jacobian)
    return reading[:m], jacobian[:m]


def density(
    noise: ProcessNoise, x: FloatArray, scales: FloatArray, vehicle: Vehicle, sensors: SensorNoise
) -> FloatArray:
    """Return the covariance (24, 24) that `x` (24,) gathers per second at the factors `scales`.

    A joint RJ2 that turns by w beside its model turns the trailer by
    -w d cos(delta_i) / (L_i + d cos(delta_i)), as in `articulated`.
    """
    psi_t, rate = x[AugmentedState.PSI_T], noise.rates(sensors)
    rate = np.array([1.0, *scales]) @ (rate[0] + abs(x[AugmentedState.WHEEL_SPEED]) * rate[1])
    acts_on = np.eye(SIZE)
    acts_on[:2, :2] = [[cos(psi_t), -sin(psi_t)], [sin(psi_t), cos(psi_t)]]
    drawbar = vehicle.drawbar_length * cos(x[AugmentedState.DELTA_I])
    length_i = vehicle.trailer_length + vehicle.trailer_turning_offset
    acts_on[AugmentedState.PSI_I, AugmentedState.DELTA_I] = -drawbar / (length_i + drawbar)
    return acts_on * rate @ acts_on.T
