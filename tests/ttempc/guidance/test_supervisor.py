"""Supervisor: reactions, and the limits of a command."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.closed_loop import PERIOD_S, Supervised, seen_truth
from ttempc.detectors.interface import Alarm, Reaction
from ttempc.errors import ControllerFailed
from ttempc.guidance.controllers import make_controller
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import (
    Command,
    ControlStep,
    Diagnostics,
    Innovation,
    Sensor,
    SolverReport,
    State,
    TubeReport,
)
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
REFERENCE = Reference(figure_eight(), VEHICLE, ConstantSpeed(1.0))
SEEN = (Innovation(Sensor.GNSS_TRACTOR, 1.0, 2), Innovation(Sensor.ENCODER, 1.0, 1))
UNSEEN = (Innovation(Sensor.GNSS_TRACTOR, 99.0, 2, False), Innovation(Sensor.ENCODER, 1.0, 1))


def supervised(reference=REFERENCE, vehicle=VEHICLE):
    controller = make_controller("ttempc", vehicle, reference, PERIOD_S)
    return Supervised(controller, reference, PERIOD_S)


def on_reference(k, innovations=SEEN, reference=REFERENCE):
    state = reference.at(k * PERIOD_S).state
    return replace(seen_truth(state, k * PERIOD_S, VEHICLE), innovations=innovations)


def drive(supervisor, ticks, estimate):
    """Return commands (N, 3) and what was said, asserting the limits of every command."""
    steps = [supervisor.step(estimate(k), k, k * PERIOD_S) for k in range(ticks)]
    commands = np.array([step.command.as_array() for step in steps])
    assert np.all(np.isfinite(commands))
    assert np.all((commands >= VEHICLE.input_min) & (commands <= VEHICLE.input_max))
    assert np.all(np.abs(np.diff(commands, axis=0)) <= VEHICLE.input_rate * PERIOD_S + 1e-12)
    return commands, [step.diagnostics.fallback for step in steps]


def test_a_good_drive_is_passed_on_untouched():
    alone = make_controller("ttempc", VEHICLE, REFERENCE, PERIOD_S)
    commands, said = drive(supervised(), 100, on_reference)
    assert not any(said)
    expected = [alone.step(on_reference(k), k).command.as_array() for k in range(100)]
    np.testing.assert_array_equal(commands, expected)


@pytest.mark.parametrize("spoilt", ["state", "trailer_xy", "disturbance"])
def test_estimate_that_is_not_finite_holds_for_a_second_then_stops(spoilt):
    def estimate(k):
        good = on_reference(k)
        return good if k < 50 else replace(good, **{spoilt: getattr(good, spoilt) * np.nan})

    commands, said = drive(supervised(), 80, estimate)
    assert not any(said[:50])
    np.testing.assert_array_equal(commands[50:55], np.tile(commands[49], (5, 1)))
    assert "not finite: command held" in said[50]
    assert all("not finite for more than 1 s: stopped" in text for text in said[55:])
    assert commands[-1, 2] == 0.0
    np.testing.assert_array_equal(commands[-1, :2], commands[49, :2])


@pytest.mark.parametrize(
    "stale",
    [
        lambda k: on_reference(k, UNSEEN),  # GNSS there, but kept out by the gate
        lambda k: on_reference(k, ()),  # no samples at all
        lambda k: replace(on_reference(k), time_s=6.0, innovations=()),  # a dead estimator
    ],
)
def test_position_that_is_not_measured_slows_down_then_stops_then_goes_on(stale):
    start, end = 30, 110
    commands, said = drive(
        supervised(), 130, lambda k: stale(k) if start <= k < end else on_reference(k)
    )
    assert not any(said[: start + 51])
    assert "half speed" in said[start + 54]
    assert commands[start + 58, 2] == pytest.approx(0.5 * commands[0, 2], abs=0.03)
    assert "not measured for more than 12 s: stopped" in said[end - 1]
    assert commands[end - 1, 2] < 0.1
    assert not any(said[end:])


def test_uncertain_position_slows_down_then_stops():
    def estimate(k):
        return replace(on_reference(k), covariance=np.diag([(0.02 * k) ** 2, *np.zeros(6)]))

    commands, said = drive(supervised(), 60, estimate)
    assert not any(said[:13])
    assert "uncertain by more than 0.25 m: half speed" in said[13]
    assert "uncertain by more than 0.5 m: stopped" in said[26]
    assert commands[-1, 2] == 0.0


@pytest.mark.parametrize(
    ("entry", "error", "what"),
    [
        (State.Y, 3.2, "beside its reference"),
        (State.X, 1e300, "from its reference"),
        (State.PSI_I, 1.2, "trailer turned"),
    ],
)
def test_metres_of_error_stop_the_vehicle_for_good(entry, error, what):
    def estimate(k):
        state = REFERENCE.at(k * PERIOD_S).state
        state[entry] += error if 20 <= k < 30 else 0.0
        return replace(seen_truth(state, k * PERIOD_S, VEHICLE), innovations=SEEN)

    commands, said = drive(supervised(), 50, estimate)
    assert not any(said[:20])
    assert what in said[20]
    assert said[-1] == said[20]
    assert commands[-1, 2] == 0.0
    np.testing.assert_array_equal(commands[20:, :2], np.tile(commands[19, :2], (30, 1)))


@pytest.mark.parametrize(("rate", "stops"), [(-0.1, False), (0.1, True)])  # [m] in a period
def test_a_vehicle_from_beside_may_come_in_but_not_go_away(rate, stops):
    """From 2.4 m on it has half a metre to turn back, and again 2 m once it has been within."""

    def estimate(k):
        state = REFERENCE.at(k * PERIOD_S).state
        aside = 2.4 + rate * k
        aside = aside if aside > 1.0 else 2.2
        heading = state[State.PSI_T]
        state[State.X] -= aside * np.sin(heading)
        state[State.Y] += aside * np.cos(heading)
        return replace(seen_truth(state, k * PERIOD_S, VEHICLE), innovations=SEEN)

    _, said = drive(supervised(), 25, estimate)
    stopped = [k for k, text in enumerate(said) if "beside its reference: stopped" in text]
    assert stopped[0] == (6 if stops else 14)
    assert f"more than {2.9 if stops else 2:g} m" in said[stopped[0]]


@pytest.mark.parametrize("side", [1.0, -1.0])  # left, right
@pytest.mark.parametrize("away", [True, False])
def test_only_a_heading_away_from_the_path_gives_room_for_a_turn(side, away):
    """From 1.8 m on, out to 2.6 m: half a metre is for all, the turn for a heading away."""

    def estimate(k):
        state = REFERENCE.at(k * PERIOD_S).state
        aside, heading = side * (1.8 + 0.1 * min(k, 8)), state[State.PSI_T]
        state[State.X] -= aside * np.sin(heading)
        state[State.Y] += aside * np.cos(heading)
        state[[State.PSI_T, State.PSI_I]] += 0.5 * side * (1.0 if away else -1.0)
        return replace(seen_truth(state, k * PERIOD_S, VEHICLE), innovations=SEEN)

    _, said = drive(supervised(), 12, estimate)
    assert any("beside its reference: stopped" in text for text in said) == (not away)


ALARM = Alarm("front steering", "front steering does not follow its command", Reaction.STOP)


def test_an_alarm_stops_the_vehicle_and_the_reference_waits_for_it():
    """The vehicle stands 3 m behind, then 1 m ahead of the reference, and drives on in the end."""
    supervisor = supervised()
    for k in range(20):
        supervisor.step(on_reference(k), k, k * PERIOD_S)
        assert supervisor.reference_ticks == 1

    def standing(k):
        estimate = on_reference(k)
        return replace(estimate, state=estimate.state * [1, 1, 1, 1, 1, 1, 0])

    behind = supervisor.step(standing(10), 20, 4.0, [ALARM])
    assert behind.diagnostics.stopping
    assert behind.diagnostics.fallback == f"{ALARM.reason}: stopped"
    assert supervisor.reference_ticks == 0
    supervisor.step(standing(22), 20, 4.2, [ALARM])
    assert supervisor.reference_ticks == 1  # the reference catches up
    supervisor.step(standing(25), 20, 4.2, [ALARM])
    assert supervisor.reference_ticks == 2  # with a vehicle that runs away
    after = [supervisor.step(standing(20), 20, 4.2 + PERIOD_S * n) for n in range(1, 15)]
    stopping = [step.diagnostics.stopping for step in after]
    assert stopping == [True] * 9 + [False] * 5  # 2 s after the alarm
    assert supervisor.reference_ticks == 0  # until the vehicle is up to speed
    supervisor.step(replace(on_reference(19), time_s=8.0), 20, 8.0)
    assert supervisor.reference_ticks == 1


def stopping():
    """Return whether a fresh supervisor stops a vehicle at a speed and a time, under alarms."""
    supervisor = supervised()

    def stops(alarms, speed, time_s):
        estimate = on_reference(20)
        state = estimate.state * [1, 1, 1, 1, 1, 1, speed]
        step = supervisor.step(replace(estimate, state=state, time_s=time_s), 20, time_s, alarms)
        return step.diagnostics.stopping

    stops.resume = supervisor.resume
    return stops


def test_a_stop_is_held_until_the_vehicle_stands_and_the_alarm_is_two_seconds_old():
    stops = stopping()
    assert not stops((), 1.0, 0.0)
    assert stops((ALARM,), 1.0, 1.0)
    assert stops((), 1.0, 5.0)  # still rolls
    stops((ALARM,), 0.0, 6.0)
    assert stops((), 0.0, 7.9)
    assert not stops((), 0.0, 8.0)


def test_the_second_stop_within_a_minute_is_for_good_a_later_one_is_not():
    for pause_s, restarts in ((10.0, False), (70.0, True)):
        stops = stopping()
        stops((ALARM,), 1.0, 0.0)
        assert not stops((), 0.0, 2.0)
        stops((ALARM,), 1.0, pause_s)
        assert (not stops((), 0.0, pause_s + 60.0)) == restarts
        stops.resume()
        assert not stops((), 0.0, pause_s + 61.0)


def test_a_vehicle_that_makes_no_way_stops_and_steers_on_where_it_may():
    """A stop on the path leaves the steering to the controller, another one holds it."""
    for way, steers in ((Reaction.STOP_ON_PATH, True), (Reaction.STOP, False)):
        supervisor = Supervised(
            make_controller("pid", VEHICLE, REFERENCE, PERIOD_S), REFERENCE, PERIOD_S
        )
        commands = []
        for k in range(40, 80):  # into the first curve
            alarms = (Alarm("given", "given", way),) if k >= 50 else ()
            commands.append(supervisor.step(on_reference(k), k, k * PERIOD_S, alarms).command)
        hp = [command.hp for command in commands]
        assert hp[9] > 0.5
        assert hp[-1] == 0.0
        assert np.all(np.diff(hp[9:]) <= 0.0)
        assert (len({command.delta_t for command in commands[12:]}) > 1) is steers


EMPTY = Diagnostics(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3, dtype=bool))


class Returning:
    def __init__(self, answer):
        self.answer = answer

    def step(self, estimate, k):
        if isinstance(self.answer, BaseException):
            raise self.answer
        return self.answer


def guarded(answer, previous=None):
    """Return the guarded step of `answer`, where the command before was `previous`."""
    controller = Returning(previous or Command(0.0, 0.0, 0.0))
    supervisor = Supervised(controller, REFERENCE, PERIOD_S)
    if previous is not None:
        assert supervisor.step(on_reference(3), 3, 3 * PERIOD_S).command == previous
    controller.answer = answer
    return supervisor.step(on_reference(4), 4, 4 * PERIOD_S)


@pytest.mark.parametrize("junk", [float("nan"), float("inf"), -float("inf")])
def test_an_entry_that_is_not_finite_keeps_its_value_and_is_reported(junk):
    step = guarded(ControlStep(Command(junk, 0.1, junk), EMPTY), Command(0.2, 0.1, 0.6))
    assert step.command == Command(0.2, 0.1, 0.6)
    assert step.diagnostics.limited.tolist() == [True, False, True]
    expected = "the controller's delta_t not finite, hp not finite: cut"
    assert step.diagnostics.fallback == expected
    assert guarded(ControlStep(Command(junk, 0.1, junk), EMPTY)).command == Command(0.0, 0.1, 0.0)


def test_a_controller_without_a_finite_command_for_a_second_stops_the_vehicle_until_resumed():
    controller = Returning(Command(0.2, 0.1, 0.6))
    supervisor = Supervised(controller, REFERENCE, PERIOD_S)
    drive(supervisor, 10, on_reference)
    controller.answer = Command(0.2, 0.1, math.nan)
    steps = [supervisor.step(on_reference(k), k, k * PERIOD_S) for k in range(10, 40)]
    said = [step.diagnostics.fallback for step in steps]
    held = round(1.0 / PERIOD_S)
    assert {*said[:held]} == {"the controller's hp not finite: cut"}
    assert {*said[held + 1 :]} == {"no finite command of the controller for more than 1 s: stopped"}

    controller.answer = Command(0.2, 0.1, 0.6)
    last = supervisor.step(on_reference(40), 40, 40 * PERIOD_S)
    assert last.diagnostics.stopping
    assert last.command.hp == 0.0
    supervisor.resume()
    assert not supervisor.step(on_reference(41), 41, 41 * PERIOD_S).diagnostics.stopping


def test_an_unusable_step_fails_with_a_reason_and_its_cause():
    still, tube = Command(0.0, 0.0, 0.0), TubeReport(True, 0.5, np.zeros(9), np.zeros(9))
    for reason, step in {
        "tick 4.*NoneType": None,
        "got tuple": (0.0, 0.0, 0.0),
        "must hold Command": ControlStep((0.0, 0.0, 0.0), EMPTY),
        "not of numbers": ControlStep(Command(np.zeros(2), 0.0, 0.0), EMPTY),
        "and Diagnostics": ControlStep(still, None),
    }.items():
        with pytest.raises(ControllerFailed, match=reason):
            guarded(step)
    for name, value in (
        ("robust", np.zeros(2)),
        ("feedback", [0, 0, 0]),
        ("feedforward", np.array(["a", "b", "c"])),
        ("predicted_path", np.full((3, 4), np.nan)),
        ("predicted_path", np.zeros((10**7, 4), dtype=np.uint8)),
        ("fallback", "a\ud800"),
        ("tube", replace(tube, nominal=np.zeros(3))),
        ("tube", replace(tube, margin="a")),
        ("solver", SolverReport("solved", True, "many", 0.0, 0.0, 0.0)),
        ("learnt", (1,)),
    ):
        with pytest.raises(ControllerFailed, match=rf"diagnostics.*{name}") as failure:
            guarded(ControlStep(still, replace(EMPTY, **{name: value})))
        assert len(str(failure.value)) < 500
    for error in (ValueError("lost"), SystemExit(0), MemoryError()):
        with pytest.raises(ControllerFailed, match=rf"tick 4: {type(error).__name__}") as failure:
            guarded(error)
        assert failure.value.__cause__ is error
