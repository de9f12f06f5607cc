"""Warm-up of every controller: it runs whole steps and changes no later command."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.closed_loop import seen_truth
from tests.ttempc.tubes import DESIGN, PERIOD_S, REFERENCE, VEHICLE
from ttempc.guidance.controllers import CONTROLLERS, make_controller
from ttempc.laws.tracking_controller import NoFeedback, TrackingController
from ttempc.vehicle import CommandLimits

TICKS = 30
NOISE = np.array([0.02, 0.02, 0.01, 0.01, 0.002, 0.002, 0.02])


def estimates():
    """Return estimates beside the reference, with disturbances."""
    generator = np.random.default_rng(71)
    for k in range(TICKS):
        state = REFERENCE.at(k * PERIOD_S).state + NOISE * generator.normal(size=7)
        disturbance = np.array([0.02, 0.01, -0.01, -0.02, 0.05])
        yield replace(seen_truth(state, k * PERIOD_S, VEHICLE), disturbance=disturbance)


def commands(name, warm_up_at):
    """Return the commands (N, 3) of a controller that is warmed up before some ticks."""
    controller = make_controller(name, VEHICLE, REFERENCE, PERIOD_S, DESIGN)
    assert isinstance(controller, TrackingController)
    sent = []
    for k, estimate in enumerate(estimates()):
        if k in warm_up_at:
            controller.warm_up()
        controller.prepare(k)
        sent.append(controller.step(estimate, k).command.as_array())
    return np.array(sent)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_warm_up_changes_no_bit_of_any_command(name):
    cold = commands(name, warm_up_at=())
    np.testing.assert_array_equal(commands(name, warm_up_at=(0,)), cold)
    np.testing.assert_array_equal(commands(name, warm_up_at=(0, 1, 10)), cold)


class Recorder(NoFeedback):
    """A law that counts its calls, and whose fresh copies count on the same list."""

    def __init__(self, calls):
        self.calls = calls

    def step(self, k, estimate, sent):
        self.calls.append(("step", k, float(np.abs(estimate.state).sum())))
        return super().step(k, estimate, sent)

    def prepare(self, k):
        self.calls.append(("prepare", k))

    def fresh(self):
        self.calls.append(("fresh",))
        return Recorder(self.calls)


def test_warm_up_runs_whole_steps_on_a_fresh_law():
    grid, calls = REFERENCE.on_grid(PERIOD_S), []
    controller = TrackingController(
        grid,
        grid.inputs,
        Recorder(calls),
        CommandLimits.of(VEHICLE, PERIOD_S),
        measured_hitch=False,
    )
    controller.warm_up()
    assert calls[0] == ("fresh",)
    assert [call[:2] for call in calls[1:]] == [
        ("prepare", 0),
        ("step", 0),
        ("prepare", 1),
        ("step", 1),
    ]
    assert all(np.isfinite(call[2]) for call in calls if call[0] == "step")
