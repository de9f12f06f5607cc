"""Truth estimator: its disturbances are those that the model needs to move as the plant does."""

import math

import numpy as np
import pytest
from proving_ground.testbed.sensing.truth_estimator import MEMORY_M, TruthEstimator

from tests.testbed.truths import truth
from ttempc.models.kinematics import articulated, trailer_point
from ttempc.types import Command, Disturbance, State
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle(trailer_turning_offset=0.25)
PERIOD_S = 0.2
COMMAND = Command(delta_t=0.1, delta_i=-0.05, hp=0.7)


def truth_of(state, time_s, rim):
    """Return the truth of a minimal state (7,) with a rim speed."""
    x_i, y_i = trailer_point(state, VEHICLE)
    return truth(
        {"x": state[State.X], "y": state[State.Y], "yaw": state[State.PSI_T]},
        {"x": x_i, "y": y_i, "yaw": state[State.PSI_I]},
        time_s=time_s,
        delta_t=state[State.DELTA_T],
        delta_i=state[State.DELTA_I],
        speed=state[State.V],
        wheel_speed=rim,
    )


def drive(disturbance, gear=1.0, metres=8.0 * MEMORY_M):
    """Return the estimate and the state after a drive of the model under constant disturbances."""
    hp = gear * COMMAND.hp
    command = Command(COMMAND.delta_t, COMMAND.delta_i, hp)
    state = np.zeros(len(State))
    state[State.DELTA_T], state[State.DELTA_I] = COMMAND.delta_t, COMMAND.delta_i
    state[State.V] = VEHICLE.speed_gain * hp
    present = truth_of(state, 0.0, state[State.V])
    estimator = TruthEstimator(lambda: present, VEHICLE)
    estimate = estimator.update(0.0, [], None)
    steps = 20
    for k in range(1, round(metres / abs(state[State.V]) / PERIOD_S)):
        for _ in range(steps):  # midpoint rule
            h, u = PERIOD_S / steps, command.as_array()
            middle = state + 0.5 * h * articulated(state, u, VEHICLE, disturbance)
            state = state + h * articulated(middle, u, VEHICLE, disturbance)
        rim = state[State.V] / (1.0 - disturbance[Disturbance.WHEEL])
        present = truth_of(state, k * PERIOD_S, rim)
        estimate = estimator.update(k * PERIOD_S, [], command)
    return estimate, state


@pytest.mark.parametrize("gear", [1.0, -1.0])
def test_constant_disturbances_of_the_model_are_found_again(gear):
    disturbance = np.array([0.04, -0.06, 0.02, -0.03, 0.1])
    estimate, state = drive(disturbance, gear)
    assert estimate.disturbance == pytest.approx(disturbance, abs=2e-3)
    assert estimate.state == pytest.approx(state, abs=2e-3)
    assert not estimate.covariance.any()


def test_the_memory_is_a_distance():
    disturbance = np.array([0.05, 0.0, 0.0, 0.0, 0.0])
    estimate, _ = drive(disturbance, metres=MEMORY_M)
    share = estimate.disturbance[Disturbance.SLIP_T] / 0.05
    assert share == pytest.approx(1.0 - math.exp(-1.0), abs=0.05)
