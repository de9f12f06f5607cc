"""Deadline of a step: commands that come late, and steps that do not return."""

import time
from dataclasses import replace

import numpy as np
import pytest
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.run.simulate import drive_into
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.recording.channels import STATE
from proving_ground.testbed.recording.record import Recorder
from proving_ground.testbed.simulation.deadline import CommandQueue, time_limit

from ttempc.types import Command


def test_commands_act_from_their_steps_on_and_never_overtake():
    queue = CommandQueue()
    first, late, prompt = (Command(0.0, 0.0, hp) for hp in (0.1, 0.2, 0.3))
    queue.send(first, 50)
    assert queue.acting(0) is first
    queue.send(late, 230)
    queue.send(prompt, 200)
    assert [queue.acting(step) for step in (100, 229, 230)] == [first, first, prompt]


def test_a_call_that_does_not_return_is_ended_in_the_main_thread():
    def never():
        while True:
            pass

    begun = time.monotonic()
    with pytest.raises(TimeoutError, match=r"did not return within 0\.05 s"), time_limit(0.05):
        never()
    assert time.monotonic() - begun < 5.0
    with time_limit(0.05):
        pass
    time.sleep(0.1)  # no alarm is left over


class SlowOnce:
    """Steps to the left at tick 5, after a pause."""

    def __init__(self, pause_s):
        self.pause_s = pause_s

    def step(self, estimate, k):
        if k == 5:
            time.sleep(self.pause_s)
        return Command(0.15 if k >= 5 else 0.0, 0.0, 0.6)


def slow_run(pause_s, *overrides):
    scenario = load("pavement", ["path={kind='straight', length_m=12.0}", *overrides])[1]
    assembly = assemble(
        scenario, 1, lambda vehicle, reference, period_s, **options: SlowOnce(pause_s)
    )
    recorder = Recorder()
    outcome = drive_into(recorder, replace(assembly, ticks=9), prepared=False)
    return outcome, recorder.record()


def test_a_slow_step_is_an_event_and_acts_late_only_if_asked():
    _, prompt = slow_run(0.0)
    _, late = slow_run(0.3)
    _, realtime = slow_run(0.3, "control.realtime=true")
    np.testing.assert_array_equal(prompt[STATE].values, late[STATE].values)
    for record in (late, realtime):
        (event,) = [event for event in record.events if event.text.startswith("overrun")]
        assert event.time_s == pytest.approx(1.0)
    turned = prompt[STATE]["delta_t_rad"] != realtime[STATE]["delta_t_rad"]
    assert prompt[STATE].time_s[np.argmax(turned)] == pytest.approx(1.04)
    begun = realtime[STATE].time_s[np.argmax(realtime[STATE]["delta_t_rad"] > 0.02)]
    before = prompt[STATE].time_s[np.argmax(prompt[STATE]["delta_t_rad"] > 0.02)]
    assert begun - before >= 0.3 - 0.04


def test_a_step_that_never_returns_ends_the_run_as_invalid():
    outcome, _ = slow_run(1e6, "control.step_limit_s=1.0")
    assert outcome.status == "invalid"
    assert "TimeoutError: did not return within 1 s" in (outcome.failure or "")
