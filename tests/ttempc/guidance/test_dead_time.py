"""Compensation of dead times against the closed loop of a vehicle without them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.reference.estimation.augmented_state import estimate_of
from tests.ttempc.closed_loop import Supervised
from ttempc.detectors.interface import Alarm, Reaction
from ttempc.guidance.controllers import make_controller
from ttempc.guidance.dead_time import DeadTimeCompensation, compensated, lead_s
from ttempc.guidance.safety import SafetyLimits
from ttempc.jit.rows import WIDTH
from ttempc.models.augmented_state import (
    SIZE,
    STATES,
    advance_augmented_state,
    vehicle_parameters,
)
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Command, Controller, Disturbance, MapDisturbance, State
from ttempc.vehicle import Vehicle

PERIOD_S = 0.2
SUBSTEP_S = 0.05
PROMPT = Vehicle()
NAMES = ("dead_time_t", "dead_time_i", "dead_time_hp")


def reference_of(vehicle):
    return Reference(figure_eight(laps=1), vehicle, ConstantSpeed(1.0))


def off_the_path():
    augmented = np.zeros(SIZE)
    augmented[:STATES] = reference_of(PROMPT).at(12.0).state
    augmented[State.Y] += 0.3
    augmented[STATES:] = 0.01
    augmented[STATES + len(Disturbance) + len(MapDisturbance) :] = 0.0  # of GNSS
    return augmented


def loop(supervisor, vehicle, augmented, first, ticks, waiting, stopped=()):
    """Drive the filter's model from tick `first` on; `waiting` commands are under way.

    At the ticks `stopped` there is an alarm: the hydrostat goes to 0, and the controller steers.

    Returns the augmented states at the ticks (ticks, 18) and the commands (ticks, 3).
    """
    delays = np.round(vehicle.dead_times / SUBSTEP_S).astype(int)
    sent = np.repeat(waiting, round(PERIOD_S / SUBSTEP_S), axis=0)  # of every substep
    augmented, valves = augmented.copy(), np.full(2, np.nan)
    valves[:] = [sent[-1 - delay, j] for j, delay in enumerate(delays[:2])]
    transition, states, commands = np.empty((SIZE, WIDTH)), [], []
    for k in range(first, first + ticks):
        states.append(augmented.copy())
        estimate = estimate_of(augmented, np.zeros((SIZE, SIZE)), k * PERIOD_S, vehicle)
        alarms = [Alarm("given", "given", Reaction.STOP_ON_PATH)] if k - first in stopped else []
        commands.append(supervisor.step(estimate, k, alarms=alarms).command.as_array())
        for _ in range(round(PERIOD_S / SUBSTEP_S)):
            sent = np.vstack([sent, commands[-1]])
            acting = np.array([sent[-1 - delay, j] for j, delay in enumerate(delays)])
            advance_augmented_state(
                augmented,
                valves,
                acting,
                vehicle_parameters(vehicle),
                np.zeros(2 * (SIZE - STATES)),
                SUBSTEP_S,
                transition,
            )
    return np.array(states), np.array(commands)


@pytest.mark.parametrize("name", ["ttempc", "lqr", "pid"])
@pytest.mark.parametrize("dead_times", [(0.4, 0.4, 0.4), (0.2, 0.0, 0.4)])
def test_the_loop_is_that_without_dead_times_once_the_commands_under_way_have_acted(
    name, dead_times
):
    vehicle = replace(PROMPT, **dict(zip(NAMES, dead_times, strict=True)))
    reference, first, lead = reference_of(vehicle), 60, 2
    controller = compensated(
        lambda model, ahead: make_controller(name, model, ahead, PERIOD_S), reference, PERIOD_S
    )
    start = reference.at(0.0).inputs
    supervisor = Supervised(controller, reference, PERIOD_S)
    states, commands = loop(supervisor, vehicle, off_the_path(), first, 40, np.tile(start, (5, 1)))
    ahead = replace(reference_of(PROMPT), lead_s=0.4)
    same = make_controller(name, PROMPT, ahead, PERIOD_S)
    expected_states, expected = loop(
        Supervised(same, ahead, PERIOD_S), PROMPT, states[lead], first, 40 - lead, start[None]
    )
    np.testing.assert_allclose(states[lead:], expected_states, atol=1e-9)
    for j, dead_time in enumerate(dead_times):  # a shorter dead time: sent that much later
        later = round((0.4 - dead_time) / PERIOD_S)
        np.testing.assert_allclose(
            commands[later:38, j], expected[: 38 - later, j], atol=1e-9, err_msg=str(j)
        )


@pytest.mark.parametrize(
    ("dead_times", "stopped"),
    [
        ((0.4, 0.4, 0.4), ()),
        ((0.2, 0.8, 0.0), ()),
        ((0.0, 0.4, 0.6), ()),
        ((0.4, 0.4, 0.4), range(12, 20)),
    ],
)
def test_the_controller_gets_the_state_at_which_its_command_acts(dead_times, stopped):
    """Also where another than its command was sent."""
    vehicle = replace(PROMPT, **dict(zip(NAMES, dead_times, strict=True)))
    reference = reference_of(vehicle)
    generator, estimates, command = np.random.default_rng(3), [], np.array([0.0, 0.0, 0.7])

    class Recorder(Controller):
        def step(self, estimate, k):
            estimates.append(estimate)
            nonlocal command
            step = generator.uniform(-1.0, 1.0, 3) * PROMPT.input_rate * PERIOD_S
            command = np.clip(command + step, PROMPT.input_min, PROMPT.input_max)
            return Command(*command.tolist())

    controller = DeadTimeCompensation(Recorder(), reference, PERIOD_S)
    far = SafetyLimits(cross_m=1e9, distance_m=1e9, yaw=1e9, jump_m=1e9)
    supervisor = Supervised(controller, reference, PERIOD_S, far)
    start = reference.at(0.0).inputs
    states, _ = loop(supervisor, vehicle, off_the_path(), 60, 30, np.tile(start, (6, 1)), stopped)
    lead = round(lead_s(vehicle) / PERIOD_S)
    for k in range(30 - lead):
        actual = estimate_of(states[k + lead], np.zeros((SIZE, SIZE)), 0.0, vehicle)
        np.testing.assert_allclose(estimates[k].state, actual.state, atol=1e-9)


def test_a_time_of_whole_periods_has_no_rest():
    """Although 0.6 / 0.2 is less than 3 in floating point."""
    vehicle = replace(PROMPT, dead_time_t=0.6, dead_time_i=0.3, dead_time_hp=0.0)
    reference = reference_of(vehicle)
    controller = make_controller("pid", PROMPT, reference, PERIOD_S)
    compensation = DeadTimeCompensation(controller, reference, PERIOD_S)
    np.testing.assert_allclose(compensation.hold_back, [[0, 0.0], [1, 0.1], [3, 0.0]], atol=1e-12)
