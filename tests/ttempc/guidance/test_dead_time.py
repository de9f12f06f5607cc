"""Compensation of dead times against the closed loop of a vehicle without them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ttempc.guidance.controllers import make_controller
from ttempc.guidance.dead_time import DeadTimeCompensation, compensated, lead_s
from ttempc.models.augmented_state import (
    SIZE,
    STATES,
    advance_augmented_state,
    estimate_of,
    vehicle_parameters,
)
from ttempc.models.rows import WIDTH
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Command, Disturbance, MapDisturbance, State
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


def loop(controller, vehicle, augmented, first, ticks, waiting):
    """Drive the filter's model from tick `first` on; `waiting` commands are under way.

    Returns the augmented states at the ticks (ticks, 18) and the commands (ticks, 3).
    """
    delays = np.round(vehicle.dead_times / SUBSTEP_S).astype(int)
    sent = np.repeat(waiting, round(PERIOD_S / SUBSTEP_S), axis=0)  # of every substep
    augmented, valves = augmented.copy(), np.full(2, np.nan)
    valves[:] = [sent[-1 - delay, j] for j, delay in enumerate(delays[:2])]
    transition, states, commands = np.empty((SIZE, WIDTH)), [], []
    for k in range(first, first + ticks):
        states.append(augmented.copy())
        estimate = estimate_of(augmented, np.zeros((SIZE, SIZE)), k * PERIOD_S, vehicle, ())
        step = controller.step(estimate, k)
        command = step if isinstance(step, Command) else step.command
        commands.append(command.as_array())
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
    states, commands = loop(controller, vehicle, off_the_path(), first, 40, np.tile(start, (5, 1)))
    ahead = replace(reference_of(PROMPT), lead_s=0.4)
    same = make_controller(name, PROMPT, ahead, PERIOD_S)
    expected_states, expected = loop(
        same, PROMPT, states[lead], first, 40 - lead, np.tile(start, (1, 1))
    )
    np.testing.assert_allclose(states[lead:], expected_states, atol=1e-9)
    for j, dead_time in enumerate(dead_times):  # a shorter dead time: sent that much later
        later = round((0.4 - dead_time) / PERIOD_S)
        np.testing.assert_allclose(
            commands[later:38, j], expected[: 38 - later, j], atol=1e-9, err_msg=str(j)
        )


@pytest.mark.parametrize("dead_times", [(0.4, 0.4, 0.4), (0.2, 0.8, 0.0), (0.0, 0.4, 0.6)])
def test_the_controller_gets_the_state_at_which_its_command_acts(dead_times):
    vehicle = replace(PROMPT, **dict(zip(NAMES, dead_times, strict=True)))
    reference = reference_of(vehicle)
    generator, estimates, command = np.random.default_rng(3), [], np.array([0.0, 0.0, 0.7])

    class Recorder:
        def step(self, estimate, k):
            estimates.append(estimate)
            nonlocal command
            step = generator.uniform(-1.0, 1.0, 3) * PROMPT.input_rate * PERIOD_S
            command = np.clip(command + step, PROMPT.input_min, PROMPT.input_max)
            return Command(*command.tolist())

    controller = DeadTimeCompensation(Recorder(), reference, PERIOD_S)
    start = reference.at(0.0).inputs
    states, _ = loop(controller, vehicle, off_the_path(), 60, 30, np.tile(start, (6, 1)))
    lead = round(lead_s(vehicle) / PERIOD_S)
    for k in range(30 - lead):
        actual = estimate_of(states[k + lead], np.zeros((SIZE, SIZE)), 0.0, vehicle, ())
        np.testing.assert_allclose(estimates[k].state, actual.state, atol=1e-9)


def test_a_command_of_another_takes_the_place_of_the_controllers_own():
    vehicle = replace(PROMPT, dead_time_t=0.4, dead_time_i=0.4, dead_time_hp=0.4)
    reference = reference_of(vehicle)
    estimate = estimate_of(off_the_path(), np.zeros((SIZE, SIZE)), 0.0, vehicle, ())

    class Recorder:
        def __init__(self):
            self.estimates = []

        def step(self, estimate, k):
            self.estimates.append(estimate)
            return Command(0.1, -0.1, 0.5)

    def predicted(stop_asked, stop):
        recorder = Recorder()
        controller = DeadTimeCompensation(recorder, reference, PERIOD_S)
        for k in range(4):
            if k < 3 and stop and not stop_asked:
                controller.record(Command(0.0, 0.0, 0.0))
                continue
            step = controller.step(estimate, k)
            controller.record(Command(0.0, 0.0, 0.0) if stop and k < 3 else step.command)
        return recorder.estimates[-1].state

    np.testing.assert_array_equal(predicted(True, True), predicted(False, True))
    assert predicted(True, True)[State.V] < predicted(True, False)[State.V] - 0.05
