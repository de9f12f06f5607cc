"""Deadline of a step: commands that come late, and steps that do not return."""

import signal
import time
from dataclasses import replace

import numpy as np
import pytest
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.run.simulate import drive_into
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.recording.channels import STATE
from proving_ground.testbed.recording.record import Recorder
from proving_ground.testbed.simulation.deadline import Deadline

from ttempc.types import Command


def busy():
    while True:
        pass


def test_a_part_that_computes_or_sleeps_for_ever_is_ended_in_the_main_thread():
    before, deadline = signal.getsignal(signal.SIGALRM), Deadline(0.05)
    for part, limit in (
        (busy, r"0\.05 s of processor time"),
        (lambda: time.sleep(60.0), r"0\.5 s$"),
    ):
        begun = time.monotonic()
        with pytest.raises(TimeoutError, match=limit), deadline.watch(), deadline:
            part()
        assert time.monotonic() - begun < 5.0
    with deadline.watch():
        time.sleep(0.8)  # between two parts
        with deadline:
            time.sleep(0.3)  # waiting is no work
    assert signal.getsignal(signal.SIGALRM) is before


class SlowOnce:
    """Steps to the left at tick 5, after a pause."""

    def __init__(self, pause):
        self.pause = pause

    def step(self, estimate, k):
        if k == 5:
            self.pause()
        return Command(0.15 if k >= 5 else 0.0, 0.0, 0.6)


def slow_run(pause, *overrides):
    scenario = load("pavement", ["path={kind='straight', length_m=12.0}", *overrides])[1]
    assembly = assemble(
        scenario, 1, lambda vehicle, reference, period_s, **options: SlowOnce(pause)
    )
    recorder = Recorder()
    outcome = drive_into(recorder, replace(assembly, ticks=9), prepared=False)
    return outcome, recorder.record()


def test_a_slow_step_is_an_event_and_acts_late_only_if_asked():
    _, prompt = slow_run(lambda: None)
    _, late = slow_run(lambda: time.sleep(0.3))
    _, realtime = slow_run(lambda: time.sleep(0.3), "control.realtime=true")
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
    outcome, _ = slow_run(busy, "control.step_limit_s=1.0")
    assert outcome.status == "invalid"
    assert "TimeoutError: did not return within 1 s" in (outcome.failure or "")
