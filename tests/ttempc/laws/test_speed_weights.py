"""Weights of the steering over speed: continuous, as given at 1 m/s, and borne delays."""

from __future__ import annotations

import math
from dataclasses import asdict

import numpy as np
import pytest
import scipy.linalg

from ttempc.guidance.controllers import make_controller
from ttempc.laws.options import ArticulatedOptions, MpcOptions, NominalOptions
from ttempc.reference.path import straight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Command, Estimate, Input, State
from ttempc.vehicle import Vehicle

PERIOD_S = 0.2
FARM = Vehicle(
    wheelbase=2.4,
    hitch_offset=0.8,
    drawbar_length=1.0,
    trailer_length=2.6,
    speed_gain=6.0,
    speed_time_constant=2.4,
    steering_lag_t=0.2,
    steering_lag_i=0.3,
    steering_rate_t=math.radians(35.0),
    steering_rate_i=math.radians(20.0),
)


@pytest.mark.parametrize("vehicle", [Vehicle(), FARM], ids=["paper", "farm"])
def test_weights_are_continuous_in_the_speed_and_as_given_up_to_1_mps(vehicle):
    speeds = np.linspace(0.3, 5.0, 471)
    options = [ArticulatedOptions().for_vehicle(vehicle, v, PERIOD_S) for v in speeds.tolist()]
    for name in ("step_weight", "input_weight"):
        weights = np.array([getattr(item, name) for item in options])[:, : Input.HP]
        given = np.array(getattr(ArticulatedOptions(), name))[: Input.HP]
        np.testing.assert_allclose(weights[speeds <= 1.0], np.tile(given, (71, 1)))
        # By the speed to a power of 12 at most, and nowhere by a jump
        growth = np.diff(np.log(weights), axis=0) / np.diff(np.log(speeds))[:, None]
        assert (growth >= -1e-9).all()
        assert growth.max() < 13.0


def test_in_reverse_steps_of_the_trailer_weigh_as_at_1_mps():
    vehicle = Vehicle(reverse=True)
    fast, slow = (MpcOptions().for_vehicle(vehicle, v, PERIOD_S) for v in (2.5, 1.0))
    assert fast.step_weight[Input.DELTA_I] == slow.step_weight[Input.DELTA_I]


def first_move_gains(name, speed, options):
    """Return the gains of the front and trailer steering by differences, (2, 7) and (2, 3).

    They are those of state and previous command, on a straight in steady motion.
    """
    reference = Reference(straight(60.0 * speed), FARM, ConstantSpeed(speed))
    grid = reference.on_grid(PERIOD_S, beyond=1)
    k = 40
    step = 1e-4

    def command(state_error, sent_error):
        controller = make_controller(name, FARM, reference, PERIOD_S, options=options)
        sent = Command(*(grid.inputs[k] + sent_error).tolist())
        controller._previous = sent.as_array()
        state = grid.state[k] + state_error
        hitch = float(state[State.PSI_T] - state[State.PSI_I] - state[State.DELTA_I])
        estimate = Estimate(k * PERIOD_S, state, np.zeros((7, 7)), np.zeros(2), hitch)
        return controller.step(estimate, k).command.as_array()[: Input.HP]

    still = command(np.zeros(7), np.zeros(3))
    by_state = [command(row, np.zeros(3)) - still for row in step * np.eye(7)]
    by_sent = [command(np.zeros(7), row) - still for row in step * np.eye(3)]
    return np.array(by_state).T / step, np.array(by_sent).T / step


def largest_eigenvalue(gains, speed, delay_s):
    """Return the spectral radius of the sampled loop of exact kinematics with a delay of commands.

    Straight motion: y' = v psi, psi' = v delta / L, the trailer by its lengths, both steerings with
    their lags. Nothing of it is code of the library.
    """
    by_state, by_sent = gains
    y, psi, psi_i, front, trailer = range(5)
    rate = np.zeros((7, 7))  # the last two are the commands that act
    rate[y, psi] = speed
    rate[psi, front] = speed / FARM.wheelbase
    rate[front, [front, 5]] = np.array([-1.0, 1.0]) / FARM.steering_lag_t
    rate[trailer, [trailer, 6]] = np.array([-1.0, 1.0]) / FARM.steering_lag_i
    rate[psi_i, [psi, psi_i]] = speed, -speed
    rate[psi_i] -= FARM.hitch_offset * rate[psi] + FARM.drawbar_length * rate[trailer]
    rate[psi_i] /= FARM.drawbar_length + FARM.trailer_length

    whole = int(delay_s / PERIOD_S)
    part_s = delay_s - whole * PERIOD_S
    held = whole + 1  # commands that are remembered
    size = 5 + 2 * held
    law = np.zeros((2, size))
    law[:, :5] = by_state[:, [State.Y, State.PSI_T, State.PSI_I, State.DELTA_T, State.DELTA_I]]
    law[:, 5:7] = by_sent[:, : Input.HP]

    def sent(before):
        """Return the command of `before` ticks ago by the state, (2, size)."""
        return law if before == 0 else np.eye(size)[3 + 2 * before : 5 + 2 * before]

    motion = np.eye(size)[:5]
    for span_s, acting in ((part_s, sent(whole + 1)), (PERIOD_S - part_s, sent(whole))):
        motion = (scipy.linalg.expm(rate * span_s) @ np.vstack([motion, acting]))[:5]
    older = np.eye(size)[5 : size - 2]
    return np.abs(np.linalg.eigvals(np.vstack([motion, law, older]))).max()


@pytest.mark.parametrize("speed", [2.0, 3.0, 4.2])
@pytest.mark.parametrize("name", ["ttempc", "lqr"])
def test_the_loop_of_exact_kinematics_bears_a_delay_of_0_2_s_at_speed(name, speed):
    options = {"robust": False} if name == "ttempc" else {}
    gains = first_move_gains(name, speed, options)
    assert largest_eigenvalue(gains, speed, 0.0) < 1.0
    assert largest_eigenvalue(gains, speed, 0.2) < 1.0


def test_without_the_rule_the_loop_does_not_bear_it():
    """The weights of 1 m/s at 4.2 m/s, so that the test above can fail."""
    front, trailer, hp = NominalOptions().step_weight
    ruled = NominalOptions().for_vehicle(FARM, 4.2, PERIOD_S).step_weight
    options = asdict(NominalOptions())
    options["step_weight"] = (front**2 / ruled[0], trailer**2 / ruled[1], hp)
    gains = first_move_gains("ttempc-nominal", 4.2, options)
    assert largest_eigenvalue(gains, 4.2, 0.2) > 1.0
