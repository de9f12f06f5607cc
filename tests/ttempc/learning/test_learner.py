"""Learner: it never waits unless it is asked to, and a copy or a fork of it goes on alike."""

import copy
import os
import pickle
import subprocess
import sys
from dataclasses import dataclass, field, replace
from threading import Event

import numpy as np
import pytest

from ttempc.layout import sample_rows
from ttempc.learning.learner import Identification, Learner, ParameterChange
from ttempc.learning.window import RecordedTick, Recorder, Window
from ttempc.types import Command, Measurement, Sensor
from ttempc.vehicle import Vehicle

PERIOD_S = 0.2
DUE = 40  # an attempt at 6 s, its exchange 2 s later


def tick(k, command=True):
    samples = (
        Measurement(k * PERIOD_S, Sensor.GNSS_TRACTOR, (1.0 * k, -1.0)),
        Measurement(k * PERIOD_S + 0.01, Sensor.IMU_TRAILER, (0.1, 0.2, 0.3)),
    )[: 1 + k % 2]
    return RecordedTick(k * PERIOD_S, samples, Command(0.1, 0.2, 0.3) if command else None, (k, 0))


class Wheelbase:
    """Finds a wheelbase that tells the window; waits for an event first, if there is one."""

    event: Event | None = None

    def identify(self, window, vehicle):
        if self.event is not None:
            self.event.wait()
        after = 1.0 + 1e-3 * window[-1].time_s + 1e-6 * len(window)
        change = ParameterChange("wheelbase", vehicle.wheelbase, after, 0.01)
        return Identification(replace(vehicle, wheelbase=after), (change,))


@dataclass
class Parts:
    vehicle: Vehicle
    received: list[float] = field(default_factory=list)


class Builder:
    def build(self, vehicle):
        return Parts(vehicle)

    def replay(self, parts, window):
        parts.received += [tick.time_s for tick in window]


def blocked(event):
    identifier = Wheelbase()
    identifier.event = event
    return identifier


def made(identifier):
    return Learner([identifier], Vehicle(), PERIOD_S, Builder())


def sent(recorded):
    """Return the command of a recorded tick, NaN where there was none."""
    return np.full(3, np.nan) if recorded.command is None else recorded.command.as_array()


def drive(learner, ticks, wait=True):
    learnt = {}
    for k in ticks:
        if wait:
            learner.wait(k)
        if (result := learner.exchange(k)) is not None:
            learnt[k] = result
        recorded = tick(k, command=k > 0)
        rows = sample_rows(recorded.samples)
        learner.record(k, recorded.time_s, rows, sent(recorded), *recorded.headings)
    return learnt


def test_a_window_gives_back_what_was_recorded():
    recorder, ticks = Recorder(50), [tick(k, command=k > 0) for k in range(500)]
    for n, item in enumerate(ticks, 1):
        recorder.append(item.time_s, sample_rows(item.samples), sent(item), *item.headings)
        for since in (n - 50, n - 7, n):
            assert list(recorder.since(since)) == ticks[max(since, 0) : n]
    assert recorder.since(495)[-2:] == ticks[498:]
    assert list(Window.of(ticks)) == ticks


def test_with_waiting_the_exchange_is_at_its_tick_and_new_parts_have_received_every_tick():
    learnt = drive(made(Wheelbase()), range(DUE + 1))
    assert list(learnt) == [DUE]
    assert learnt[DUE].parts.received == pytest.approx(PERIOD_S * np.arange(DUE))
    assert len(learnt[DUE].sent) == DUE - 31


def test_without_waiting_a_blocked_identifier_blocks_nothing_and_is_taken_when_it_is_done():
    """Exact: while the identifier is blocked, every call returns."""
    event = Event()
    learner = made(blocked(event))
    told = []
    for k in range(400):
        assert drive(learner, [k], wait=False) == {}
        told += [k] * learner.overdue(k)
    assert told == [330]  # a minute after the beginning, once
    event.set()
    learner.wait(400)
    (learnt,) = drive(learner, [400], wait=False).values()
    assert learnt.parts.received == pytest.approx(PERIOD_S * np.arange(400))


@pytest.mark.parametrize("k", [20, 35, DUE, DUE + 1])
@pytest.mark.parametrize(
    "copied", [copy.deepcopy, lambda learner: pickle.loads(pickle.dumps(learner))]
)
def test_a_copy_goes_on_alike(copied, k):
    """Also in the middle of an attempt: the copy begins it anew from its recorded window."""
    learner = made(Wheelbase())
    drive(learner, range(k))
    other = copied(learner)
    ours, theirs = drive(learner, range(k, 120)), drive(other, range(k, 120))
    assert list(ours) == list(theirs) != []
    for learnt, again in zip(ours.values(), theirs.values(), strict=True):
        assert learnt.changes == again.changes
        assert learnt.parts == again.parts


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no fork")
def test_the_child_of_a_fork_learns_alike():
    """The thread is blocked in the parent at the fork; the child has none and makes one."""
    event = Event()
    learner = made(identifier := blocked(event))
    drive(learner, range(35))
    reader, writer = os.pipe()
    if not (child := os.fork()):
        try:
            identifier.event = None
            learnt = drive(learner, range(35, DUE + 1))[DUE]
            os.write(writer, repr(learnt.parts).encode())
        finally:
            os._exit(0)
    os.close(writer)
    event.set()
    with os.fdopen(reader) as pipe:
        theirs = pipe.read()
    os.waitpid(child, 0)
    assert theirs == repr(drive(learner, range(35, DUE + 1))[DUE].parts)


def test_a_process_ends_while_an_identifier_does_not():
    code = (
        "from tests.ttempc.learning.test_learner import Event, blocked, drive, made\n"
        "drive(made(blocked(Event())), range(60), wait=False)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60.0)
