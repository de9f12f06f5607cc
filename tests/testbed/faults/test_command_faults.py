"""Faults of the command path, held to closed forms."""

import math

import numpy as np
import pytest
from proving_ground.testbed.actuation.actuators import Actuators, ActuatorSpecification
from proving_ground.testbed.faults.fault import Window
from proving_ground.testbed.faults.faulty import FaultyActuators
from proving_ground.testbed.faults.kinds import KINDS
from proving_ground.testbed.vehicle.vehicle import read_vehicle

from ttempc.types import Command

DT, START_S, END_S = 0.01, 0.2, 0.6
STOPS = (math.radians(40.0), math.radians(20.0))
TIMES = DT * np.arange(100)
INSIDE = (TIMES > START_S - 1e-6) & (TIMES < END_S - 1e-6)


def command(time_s):
    """A ramp of the steering, with the hydrostat at 0.5, then at 0.8 from 0.3 s on."""
    return Command(0.2 * time_s, -0.1 * time_s, 0.5 if time_s < 0.295 else 0.8)


def set_points(*faults):
    """Return the set points (n, 3) for perfect servos, with faults from 0.2 to 0.6 s."""
    window = Window(START_S, END_S)
    tables = [KINDS[keys["kind"]](start_s=START_S, **keys) for keys in faults]
    vehicle = read_vehicle()
    steering = vehicle.front_steering, vehicle.trailer_steering
    path = Actuators(ActuatorSpecification(), DT, steering)
    actuators = FaultyActuators(path, [(table, window) for table in tables], DT, STOPS)
    state, rows = actuators.start(0.5), []
    for time_s in TIMES:
        delta_t, delta_i, _ = state.set_points
        state = actuators.step(state, command(time_s), delta_t, delta_i)
        rows.append(state.set_points)
    return np.array(rows)


SENT = np.array([command(time_s).as_array() for time_s in TIMES])


@pytest.mark.parametrize(
    ("kind", "axis", "keys"),
    [
        ("front_steering_stuck", 0, {}),
        ("trailer_steering_stuck", 1, {}),
        ("hydrostat_stuck", 2, {}),
        ("front_steering_hard_over", 0, {"side": "left"}),
        ("trailer_steering_hard_over", 1, {"side": "right"}),
        ("front_steering_slow", 0, {"rate_degps": 3.0}),
        ("trailer_steering_slow", 1, {"rate_degps": 3.0}),
        ("front_steering_play", 0, {"backlash_deg": 1.0}),
        ("trailer_steering_play", 1, {"backlash_deg": 1.0}),
        ("hydrostat_cut", 2, {}),
        ("hydrostat_sluggish", 2, {"time_constant_s": 0.5}),
    ],
)
def test_a_valve_fault_changes_its_axis_in_its_window_alone(kind, axis, keys):
    moved = set_points({"kind": kind, **keys})
    assert not np.allclose(moved[INSIDE, axis], SENT[INSIDE, axis])
    np.testing.assert_array_equal(moved[~INSIDE], SENT[~INSIDE])
    others = [k for k in range(3) if k != axis]
    np.testing.assert_array_equal(moved[:, others], SENT[:, others])


def test_valves_have_their_closed_forms():
    held = set_points({"kind": "front_steering_stuck"}, {"kind": "hydrostat_stuck"})
    np.testing.assert_allclose(held[INSIDE, 0], 0.2 * (START_S - DT))
    np.testing.assert_array_equal(held[INSIDE, 2], 0.5)
    over = set_points({"kind": "trailer_steering_hard_over", "side": "right"})
    np.testing.assert_array_equal(over[INSIDE, 1], -STOPS[1])
    slow = set_points({"kind": "front_steering_slow", "rate_degps": 3.0})  # 0.2 rad/s asked for
    np.testing.assert_allclose(np.diff(slow[INSIDE, 0]) / DT, math.radians(3.0))
    behind = (SENT - set_points({"kind": "front_steering_play", "backlash_deg": 1.0}))[INSIDE, 0]
    np.testing.assert_allclose(behind[10:], math.radians(0.5))
    assert not set_points({"kind": "hydrostat_cut"})[INSIDE, 2].any()


def test_a_sluggish_hydrostat_answers_a_step_exponentially():
    moved = set_points({"kind": "hydrostat_sluggish", "time_constant_s": 0.1})
    after = INSIDE & (TIMES > 0.295)
    elapsed = TIMES[after] - 0.3 + DT
    np.testing.assert_allclose(moved[after, 2], 0.8 - 0.3 * np.exp(-elapsed / 0.1))


def test_lost_commands_leave_the_last_one():
    moved = set_points({"kind": "commands_lost"})
    np.testing.assert_allclose(moved[INSIDE], [command(START_S - DT).as_array()] * INSIDE.sum())
    np.testing.assert_array_equal(moved[~INSIDE], SENT[~INSIDE])


def test_late_commands_are_those_of_before():
    moved, late = set_points({"kind": "commands_late", "delay_s": 0.1}), 10
    from_then = INSIDE & (TIMES > START_S + 0.095)
    np.testing.assert_array_equal(moved[from_then], SENT[np.flatnonzero(from_then) - late])
    waiting = INSIDE & ~from_then
    np.testing.assert_array_equal(moved[waiting, 0], SENT[INSIDE.argmax() - 1, 0])
