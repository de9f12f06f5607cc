"""Whatever a controller returns or raises, what reaches the plant can be driven and logged."""

from dataclasses import replace

import numpy as np
import pytest

from proving_ground.testbed.errors import ControllerFailed
from proving_ground.testbed.simulation.command_guard import Border
from ttempc.types import Command, ControlStep, Diagnostics, Estimate
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
BORDER = Border(VEHICLE, 0.2)
ESTIMATE = Estimate(0.0, np.zeros(7), np.zeros((7, 7)), np.zeros(2), 0.0)
SAID = Diagnostics(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3, dtype=bool))


class Returning:
    def __init__(self, made):
        self.made = made

    def step(self, estimate, k):
        if isinstance(self.made, Exception):
            raise self.made
        return self.made


def ask(made, previous=None):
    return BORDER.ask(Returning(made), ESTIMATE, 4, previous)


def test_a_command_inside_the_limits_passes_as_it_is():
    made = ControlStep(Command(0.1, -0.1, 0.5), SAID)
    assert ask(made) is made
    assert ask(made, Command(0.1, -0.1, 0.45)) is made


def test_random_commands_come_out_inside_amplitude_and_rate_and_nearest():
    rng = np.random.default_rng(5)
    previous = Command(0.0, 0.0, 0.5)
    for wanted in rng.normal(scale=2.0, size=(200, 3)):
        sent = ask(ControlStep(Command(*wanted), SAID), previous).command.as_array()
        low = np.maximum(VEHICLE.input_min, previous.as_array() - 0.2 * VEHICLE.input_rate)
        high = np.minimum(VEHICLE.input_max, previous.as_array() + 0.2 * VEHICLE.input_rate)
        assert np.array_equal(sent, np.clip(wanted, low, high))
        previous = Command(*sent)


@pytest.mark.parametrize("junk", [float("nan"), float("inf"), -float("inf")])
def test_what_is_no_number_stays_what_it_was_and_is_said(junk):
    made = ask(ControlStep(Command(junk, 0.1, junk), SAID), Command(0.2, 0.1, 0.6))
    assert made.command == Command(0.2, 0.1, 0.6)
    assert made.diagnostics.limited.tolist() == [True, False, True]
    assert "delta_t, hp" in made.diagnostics.fallback
    assert ask(ControlStep(Command(junk, 0.1, junk), SAID)).command == Command(0.0, 0.1, 0.0)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (None, "returned NoneType at tick 4"),
        (Command(0.0, 0.0, 0.0), "returned Command"),
        (ControlStep((0.0, 0.0, 0.0), SAID), "must hold a Command"),
        (ControlStep(Command("a", 0.0, 0.0), SAID), "not of numbers"),
        (ControlStep(Command(np.zeros(2), 0.0, 0.0), SAID), "not of numbers"),
        (ControlStep(Command(0.0, 0.0, 0.0), None), "must hold a Command and Diagnostics"),
        (ControlStep(Command(0.0, 0.0, 0.0), replace(SAID, robust=np.zeros(2))), "robust"),
        (ControlStep(Command(0.0, 0.0, 0.0), replace(SAID, feedback=[0, 0, 0])), "feedback"),
        (
            ControlStep(Command(0.0, 0.0, 0.0), replace(SAID, predicted_path=np.zeros((5, 2)))),
            "predicted_path",
        ),
        (ControlStep(Command(0.0, 0.0, 0.0), replace(SAID, fallback=None)), "fallback text"),
        (ValueError("lost"), "raised at tick 4: ValueError: lost"),
    ],
)
def test_what_is_no_step_fails_with_a_reason(made, said):
    with pytest.raises(ControllerFailed, match=said):
        ask(made)
