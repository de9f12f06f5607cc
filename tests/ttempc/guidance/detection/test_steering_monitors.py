"""Monitors of a steering valve: silence with noise, dead time and play, delay when it is stuck."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.guidance.detection.observations import PERIOD_S, VEHICLE, angles, observation
from ttempc.guidance.detection import Reaction, StandstillMonitor, SteeringMonitor, SteeringResponse
from ttempc.types import Command, Input


def valve(commands, time_s, lag=VEHICLE.steering_lag_t):
    """Return the angle of a valve that follows steps at the ticks with a lag, in closed form."""
    angle = commands[0]
    for k, command in enumerate(commands):
        span = min(max(time_s - k * PERIOD_S, 0.0), PERIOD_S)
        angle = command + (angle - command) * math.exp(-span / lag)
    return angle


@pytest.mark.parametrize("sd_deg", [1.0, 10.0])
def test_a_valve_that_follows_is_no_fault_however_noisy_its_sensor(sd_deg):
    rng, monitor = np.random.default_rng(1), SteeringMonitor(Input.DELTA_T)
    commands = 0.3 * np.sin(0.15 * np.arange(3000))
    for k in range(3000):
        recent = max(0, k - 30)  # a step of 30 periods before has no effect on the angle
        samples = angles(
            k, lambda t, k=k, n=recent: valve(commands[n : k + 1], t - n * PERIOD_S), rng, sd_deg
        )
        sent = Command(float(commands[k - 1]), 0.0, 0.7) if k else None
        monitor.observe(observation(k, samples, sent))
        assert monitor.statistic < monitor.limit


@pytest.mark.parametrize(("dead_time", "believed"), [(0.0, 0.0), (0.3, 0.0), (0.1, 0.7)])
def test_a_dead_time_that_is_not_known_is_no_fault(dead_time, believed):
    rng, monitor = np.random.default_rng(2), SteeringMonitor(Input.DELTA_T)
    vehicle = replace(VEHICLE, dead_time_t=believed)
    commands = 0.25 * np.sin(0.2 * np.arange(200))
    for k in range(200):
        samples = angles(k, lambda t, k=k: valve(commands[: k + 1], t - dead_time), rng)
        sent = Command(float(commands[k - 1]), 0.0, 0.7) if k else None
        monitor.observe(observation(k, samples, sent, vehicle=vehicle))
        assert monitor.statistic < monitor.limit


def test_play_is_no_fault():
    """A wheel that lags its cylinder by 1 deg either way, as play of 2 deg."""
    rng, monitor = np.random.default_rng(4), SteeringMonitor(Input.DELTA_T)
    commands, wheel, play = 0.25 * np.sin(0.1 * np.arange(600)), 0.0, math.radians(1.0)
    for k in range(600):
        cylinder = valve(commands[max(0, k - 30) : k + 1], min(k, 30) * PERIOD_S)
        wheel = min(max(wheel, cylinder - play), cylinder + play)
        samples = angles(k, lambda t, angle=wheel: angle, rng)
        sent = Command(float(commands[k - 1]), 0.0, 0.7) if k else None
        monitor.observe(observation(k, samples, sent))
        assert monitor.statistic < monitor.limit


def test_a_stuck_valve_is_noticed_within_a_second_of_a_command_that_leaves_it():
    rng, monitor = np.random.default_rng(1), SteeringMonitor(Input.DELTA_T)
    noticed = []
    for k in range(80):
        command = 0.0 if k < 50 else 0.14  # 8 deg: the curve of radius 10 m
        monitor.observe(observation(k, angles(k, lambda t: 0.0, rng), Command(command, 0.0, 0.7)))
        noticed += [k] if monitor.statistic > monitor.limit else []
    assert 50 < noticed[0] <= 50 + round(1.0 / PERIOD_S)
    assert monitor.alarm().reaction is Reaction.STOP


def test_a_valve_that_stands_still_is_noticed_before_one_that_does_not_follow():
    rng, response = np.random.default_rng(1), SteeringResponse(Input.DELTA_T)
    standstill, follows = (
        kind(Input.DELTA_T, response) for kind in (StandstillMonitor, SteeringMonitor)
    )
    commands, first = 0.25 * np.sin(0.2 * np.arange(140)), {}
    for k in range(140):
        stuck = valve(commands[:101], 100 * PERIOD_S) if k > 100 else None
        samples = angles(
            k, lambda t, k=k, s=stuck: valve(commands[: k + 1], t) if s is None else s, rng
        )
        sent = Command(float(commands[k - 1]), 0.0, 0.7) if k else None
        for monitor in (standstill, follows):
            monitor.observe(observation(k, samples, sent))
            if monitor.statistic > monitor.limit:
                first.setdefault(monitor.name, (k - 100) * PERIOD_S)
    assert 0.0 < first[standstill.name] <= 1.0 < first[follows.name]
    assert standstill.alarm().reaction is Reaction.SLOW


@pytest.mark.parametrize("offset_s", [-3.0, 0.5, 50.0])
def test_samples_of_a_time_without_a_response_are_left_out(offset_s):
    rng, monitor = np.random.default_rng(5), SteeringMonitor(Input.DELTA_T)
    for k in range(60):
        samples = [
            replace(item, time_s=item.time_s + offset_s) for item in angles(k, lambda t: 0.5, rng)
        ]
        monitor.observe(observation(k, samples, Command(0.0, 0.0, 0.7) if k else None))
        assert monitor.statistic == 0.0


def test_a_shorter_dead_time_may_be_learnt_at_any_time():
    """The only interval that the valve has not contradicted is gone then."""
    rng, monitor = np.random.default_rng(6), StandstillMonitor(Input.DELTA_T)
    commands = 0.25 * np.sin(0.4 * np.arange(200))
    for k in range(200):
        vehicle = replace(VEHICLE, dead_time_t=0.6 if k < 150 else 0.0)
        samples = angles(k, lambda t, k=k: valve(commands[: k + 1], t - 1.15), rng)
        sent = Command(float(commands[k - 1]), 0.0, 0.7) if k else None
        monitor.observe(observation(k, samples, sent, vehicle=vehicle))
        assert k >= 150 or monitor.statistic < monitor.limit
