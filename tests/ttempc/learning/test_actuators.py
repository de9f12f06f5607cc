"""Identification of actuators against simulated ones with known dead time, lag and backlash."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ttempc.learning.actuators import ActuatorIdentifier, ActuatorModel, fit_actuator, respond
from ttempc.learning.window import RecordedTick
from ttempc.types import Command, Input, Measurement, Sensor
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
PERIOD_S, SAMPLE_S, STEP_S = 0.2, 0.04, 0.01
RATES = VEHICLE.input_rate[:2]
SENSORS = (Sensor.STEERING_TRACTOR, Sensor.STEERING_TRAILER, Sensor.ENCODER)
SD = np.array([math.radians(1.0), math.radians(1.0), 0.1])  # of the sensors


def response(times, starts, commands, dead_time=0.0, lag=0.2, backlash=0.0, rate=math.inf):
    result = np.empty(len(times))
    model = ActuatorModel(dead_time, lag, backlash, rate)
    respond(np.array(starts, float), np.array(commands, float), times, model, result)
    return result


def drive(
    seed, dead_times=(0.0, 0.0, 0.0), lags=(0.15, 0.20, 2.05), backlash=0.0, seconds=30.0, sd=1.0
):
    """Return recorded ticks: commands that walk at random, and noisy samples of their response."""
    generator = np.random.default_rng(seed)
    ticks = round(seconds / PERIOD_S)
    steps = sd * generator.normal(size=(ticks, 3)) * [math.radians(1.5), math.radians(1.0), 0.04]
    commands = np.empty((ticks, 3))
    walk = np.array([0.0, 0.0, 0.7])
    for k in range(ticks):
        walk = np.array([0.0, 0.0, 0.7]) + 0.9 * (walk - [0.0, 0.0, 0.7]) + steps[k]
        commands[k] = walk
    output, cylinder, valves = np.array([0.0, 0.0, 1.4 * 0.7]), np.zeros(2), np.zeros(2)
    window, samples = [RecordedTick(0.0, (), None, (0.0, 0.0))], []
    for n in range(1, round(seconds / STEP_S) + 1):
        sent = np.floor(((n - 1) * STEP_S - np.array(dead_times)) / PERIOD_S + 1e-9).astype(int)
        acting = commands[np.maximum(sent, 0), range(3)]
        cylinder = np.clip(cylinder, acting[:2] - backlash, acting[:2] + backlash)
        valves += np.clip(cylinder - valves, -RATES * STEP_S, RATES * STEP_S)
        target = np.array([*valves, 1.4 * acting[2]])
        output = target + (output - target) * np.exp(-STEP_S / np.array(lags))
        if n % round(SAMPLE_S / STEP_S) == 0:
            noisy = output + SD * generator.normal(size=3)
            samples += [
                Measurement(n * STEP_S, sensor, (float(value),))
                for sensor, value in zip(SENSORS, noisy, strict=True)
            ]
        if n % round(PERIOD_S / STEP_S) == 0:
            command = Command(*commands[round(n * STEP_S / PERIOD_S) - 1].tolist())
            window.append(RecordedTick(n * STEP_S, tuple(samples), command, (0.0, 0.0)))
            samples = []
    return window


def fitted(window, actuator):
    fit = fit_actuator(window, VEHICLE, actuator)
    assert fit is not None
    return fit


def test_a_step_is_answered_by_an_exponential_after_the_dead_time():
    times = np.arange(0.0, 3.0, 0.04)
    since = np.maximum(times - 1.0 - 0.33, 0.0)
    np.testing.assert_allclose(
        response(times, [0.0, 1.0], [0.0, 0.1], dead_time=0.33, lag=0.2),
        0.1 * (1.0 - np.exp(-since / 0.2)),
        atol=1e-12,
    )


def test_backlash_holds_the_output_back_and_the_rate_limit_makes_a_ramp_of_a_step():
    times = np.arange(0.0, 4.0, 0.04)
    result = response(times, [0.0, 1.0, 2.0], [0.0, 0.5, 0.35], lag=0.01, backlash=0.1, rate=1.0)
    assert result[times > 1.8] == pytest.approx(0.4, abs=1e-6)  # a reversal within the backlash
    ramp = (times > 1.1) & (times < 1.35)
    np.testing.assert_allclose(np.diff(result[ramp]), 0.04, atol=1e-3)


@pytest.mark.parametrize("dead_times", [(0.0, 0.0, 0.0), (0.13, 0.31, 0.5), (0.5, 0.07, 0.2)])
def test_errors_of_the_dead_times_are_as_large_as_their_deviations(dead_times):
    normalised = []
    for seed in range(6):
        window = drive(seed, dead_times)
        for actuator in Input:
            fit = fitted(window, actuator)
            normalised.append((fit.dead_time - dead_times[actuator]) / fit.dead_time_sd)
            assert fit.dead_time_sd < (0.03, 0.03, 0.2)[actuator]
    assert max(map(abs, normalised)) < 4.0
    assert float(np.sqrt(np.mean(np.square(normalised)))) < 1.5


def test_a_right_vehicle_stays_as_it_is():
    for seed in range(20, 30):
        assert ActuatorIdentifier().identify(drive(seed), VEHICLE).vehicle is VEHICLE
    known = replace(VEHICLE, dead_time_t=0.3, dead_time_i=0.2, dead_time_hp=0.1)
    for seed in range(30, 36):
        assert ActuatorIdentifier().identify(drive(seed, (0.3, 0.2, 0.1)), known).vehicle is known


def test_backlash_does_not_pass_for_dead_time():
    backlash = math.radians(1.0)
    for seed in range(4):
        window = drive(seed, (0.15, 0.15, 0.0), backlash=backlash)
        for actuator in (Input.DELTA_T, Input.DELTA_I):
            fit = fitted(window, actuator)
            assert fit.dead_time == pytest.approx(0.15, abs=4.0 * fit.dead_time_sd)
            assert fit.backlash == pytest.approx(backlash, rel=0.3)


@pytest.mark.parametrize("unit", [1e-7, 1e7])
def test_the_fit_of_the_hydrostat_does_not_depend_on_the_unit_of_its_command(unit):
    """Its gain is fitted too."""
    window = drive(2, (0.0, 0.0, 0.3))
    in_unit = [
        tick
        if tick.command is None
        else replace(tick, command=replace(tick.command, hp=unit * tick.command.hp))
        for tick in window
    ]
    expected = fitted(window, Input.HP)
    fit = fitted(in_unit, Input.HP)
    assert fit.dead_time == pytest.approx(expected.dead_time, abs=1e-6)
    assert fit.lag == pytest.approx(expected.lag, rel=1e-6)
    assert fit.dead_time_sd == pytest.approx(expected.dead_time_sd, rel=1e-3)


def test_a_wrong_lag_is_corrected_and_its_reason_told():
    result = ActuatorIdentifier().identify(
        drive(3, (0.2, 0.0, 0.0), lags=(0.5, 0.2, 2.05), seconds=60.0), VEHICLE
    )
    assert {change.name for change in result.changes} == {"steering_lag_t", "dead_time_t"}
    assert result.vehicle.steering_lag_t == pytest.approx(0.5, abs=0.06)
    assert result.vehicle.dead_time_t == pytest.approx(0.2, abs=0.05)
    assert str(result.changes[1]).startswith("vehicle.steering_lag_t 0.15 -> 0.")


def test_a_dead_time_of_the_hydrostat_at_the_end_of_its_range_is_none():
    """Those of the steerings count: their gain is known."""
    result = ActuatorIdentifier().identify(drive(4, (1.3, 1.3, 1.3), seconds=60.0), VEHICLE)
    assert {change.name for change in result.changes} >= {"dead_time_t", "dead_time_i"}
    assert result.vehicle.dead_time_hp == VEHICLE.dead_time_hp


def test_without_excitation_nothing_is_known_and_nothing_changes():
    window = drive(1, (0.5, 0.5, 0.5), sd=0.0)
    assert ActuatorIdentifier().identify(window, VEHICLE).changes == ()
    for actuator in Input:
        assert not fitted(window, actuator).dead_time_sd < 0.2
