"""Steering and standstill: valves that follow their commands, and that do not."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.detectors.observed import (
    PERIOD_S,
    VEHICLE,
    Alone,
    angles,
    observation,
    observed,
    valve,
)
from ttempc.detectors.interface import Reaction
from ttempc.detectors.monitors import Monitors
from ttempc.detectors.table import BUILT_IN, DetectorIndex
from ttempc.types import Command, Sensor

AXES = {
    "front": (DetectorIndex.STEERING_FRONT, Sensor.STEERING_TRACTOR),
    "trailer": (DetectorIndex.STEERING_TRAILER, Sensor.STEERING_TRAILER),
}
LAGS = {"front": VEHICLE.steering_lag_t, "trailer": VEHICLE.steering_lag_i}
DELAY_S = {"front": 1.0, "trailer": 1.4}  # of an alarm: the trailer's valve has a longer lag


def steered(axis, command):
    """Return the command that steers one axis."""
    return Command(command, 0.0, 0.7) if axis == "front" else Command(0.0, command, 0.7)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("detector", ["follows", "standstill"])
@pytest.mark.parametrize("sd_deg", [1.0, 10.0])
def test_a_valve_that_follows_is_no_fault_however_noisy_its_sensor(axis, detector, sd_deg):
    index, sensor = AXES[axis]
    index = DetectorIndex(index + 2) if detector == "standstill" else index
    rng, monitor = np.random.default_rng(1), Alone(index)
    commands = 0.3 * np.sin(0.15 * np.arange(600))
    for k in range(600):
        recent = max(0, k - 30)  # a step of 30 periods before has no effect on the angle

        def angle(time_s, k=k, recent=recent):
            since_s = time_s - recent * PERIOD_S
            return valve(commands[recent : k + 1], since_s, LAGS[axis])

        samples = angles(k, angle, rng, sd_deg, sensor)
        sent = steered(axis, float(commands[k - 1])) if k else None
        assert not monitor.alarm(observation(k, samples, sent))


@pytest.mark.parametrize(("dead_time", "believed"), [(0.0, 0.0), (0.3, 0.0), (0.1, 0.7)])
def test_a_dead_time_that_is_not_known_is_no_fault(dead_time, believed):
    rng, monitor = np.random.default_rng(2), Alone(DetectorIndex.STEERING_FRONT)
    vehicle = replace(VEHICLE, dead_time_t=believed)
    commands = 0.25 * np.sin(0.2 * np.arange(200))
    for k in range(200):
        samples = angles(k, lambda t, k=k: valve(commands[: k + 1], t - dead_time), rng)
        sent = Command(float(commands[k - 1]), 0.0, 0.7) if k else None
        assert not monitor.alarm(observation(k, samples, sent, vehicle=vehicle))


def test_play_is_no_fault():
    """A wheel that lags its cylinder by 1 deg either way, as play of 2 deg."""
    rng, monitor = np.random.default_rng(4), Alone(DetectorIndex.STEERING_FRONT)
    commands, wheel, play = 0.25 * np.sin(0.1 * np.arange(600)), 0.0, math.radians(1.0)
    for k in range(600):
        cylinder = valve(commands[max(0, k - 30) : k + 1], min(k, 30) * PERIOD_S)
        wheel = min(max(wheel, cylinder - play), cylinder + play)
        samples = angles(k, lambda t, angle=wheel: angle, rng)
        sent = Command(float(commands[k - 1]), 0.0, 0.7) if k else None
        assert not monitor.alarm(observation(k, samples, sent))


@pytest.mark.parametrize("axis", AXES)
def test_a_stuck_valve_is_noticed_soon_after_a_command_that_leaves_it(axis):
    index, sensor = AXES[axis]
    rng, monitor, noticed = np.random.default_rng(1), Alone(index), []
    for k in range(80):
        command = 0.0 if k < 50 else 0.14  # 8 deg: the curve of radius 10 m
        samples = angles(k, lambda t: 0.0, rng, sensor=sensor)
        alarm = monitor.alarm(observation(k, samples, steered(axis, command)))
        noticed += [k] if alarm else []
    assert 50 < noticed[0] <= 50 + round(DELAY_S[axis] / PERIOD_S)
    assert alarm.reaction is Reaction.STOP_ON_PATH


@pytest.mark.parametrize("axis", AXES)
def test_a_valve_that_stands_still_is_noticed_before_one_that_does_not_follow(axis):
    index, sensor = AXES[axis]
    rng, monitors = np.random.default_rng(1), Monitors()
    follows, standstill = BUILT_IN[index].name, BUILT_IN[DetectorIndex(index + 2)].name
    commands, first = 0.25 * np.sin(0.2 * np.arange(140)), {}
    for k in range(140):
        stuck = valve(commands[:101], 100 * PERIOD_S, LAGS[axis]) if k > 100 else None

        def angle(time_s, k=k, stuck=stuck):
            return valve(commands[: k + 1], time_s, LAGS[axis]) if stuck is None else stuck

        sent = steered(axis, float(commands[k - 1])) if k else None
        samples = angles(k, angle, rng, sensor=sensor)
        for alarm in observed(monitors, observation(k, samples, sent)):
            first.setdefault(alarm.detector, ((k - 100) * PERIOD_S, alarm.reaction))
    assert 0.0 < first[standstill][0] <= DELAY_S[axis] < first[follows][0]
    assert first[standstill][1] is Reaction.SLOW
