"""Model of the augmented state in plain numpy, to which tests hold the compiled kernels."""

from __future__ import annotations

import numpy as np

from ttempc.models.augmented_state import SIZE, STATES, AugmentedState, slips
from ttempc.models.kinematics import articulated
from ttempc.types import Disturbance, FloatArray, Input, State
from ttempc.vehicle import Vehicle


def augmented_rate(augmented: FloatArray, inputs: FloatArray, vehicle: Vehicle) -> FloatArray:
    """Return the time derivative (18,) of an augmented state (18,) under `inputs` (3,).

    `articulated` with the total slips, v = rim (1 - s) and rim' = (K hp - rim) / tau + w;
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
    rim, drive = augmented[AugmentedState.RIM], augmented[AugmentedState.DRIVE]
    steady = vehicle.speed_gain * inputs[Input.HP]
    rate[AugmentedState.RIM] = (steady - rim) / vehicle.speed_time_constant + drive
    return rate
