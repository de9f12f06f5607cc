"""Faults that sensors have in common: steps of both receivers, gyros, stamps, noise."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.detectors.observed import PERIOD_S, VEHICLE, moving, observation, observed
from ttempc.detectors.board import NO_ALARM
from ttempc.detectors.interface import Observation, Reaction
from ttempc.detectors.kernel import DETECTORS
from ttempc.detectors.monitors import Monitors
from ttempc.detectors.table import BUILT_IN, DetectorIndex
from ttempc.layout import AlarmColumn
from ttempc.types import Estimate, Measurement, Sensor

STEPS = BUILT_IN[DetectorIndex.STEPS].name
GYROS = [BUILT_IN[index].name for index in (DetectorIndex.GYRO_TRACTOR, DetectorIndex.GYRO_TRAILER)]
CLOCK = BUILT_IN[DetectorIndex.CLOCK].name
NOISE = BUILT_IN[DetectorIndex.MANY].name
RADIUS_M = 10.0


def circling(
    monitors,
    seconds,
    wrong=lambda time_s: 0.0,
    rate=lambda true, time_s: true,
    wheels=lambda time_s: 1.0,
):
    """Drive in a circle at 1 m/s; return the begin of each alarm [s] by name.

    `wrong` is an offset of both positions east [m], `rate` the yaw rate that both IMUs say,
    `wheels` the speed that the encoder says.
    """
    rng = np.random.default_rng(4)
    begins = {}
    for k in range(round(seconds / PERIOD_S)):
        time_s = k * PERIOD_S
        angle = time_s / RADIUS_M
        place = RADIUS_M * np.array([math.cos(angle), math.sin(angle)])
        speed = wheels(time_s) + rng.normal(0.0, 0.03)
        samples = [Measurement(time_s, Sensor.ENCODER, (speed,))]
        for body in ("tractor", "trailer"):
            at = place + rng.normal(0.0, 0.03, 2) + (wrong(time_s), 0.0)
            samples.append(Measurement(time_s, Sensor(f"gnss_{body}"), tuple(at), 1))
            turn = rate(1.0 / RADIUS_M, time_s)
            samples.append(Measurement(time_s, Sensor(f"imu_{body}"), (turn, 0.0, 0.0)))
        yaw = angle + 0.5 * math.pi
        state = np.array([*place, yaw, yaw, 0.0, 0.0, 1.0])
        estimate = Estimate(time_s, state, 1e-4 * np.eye(7), place, 0.0)
        for alarm in observed(monitors, Observation(time_s, samples, None, estimate, VEHICLE)):
            begins.setdefault(alarm.detector, time_s)
    return begins


def test_a_step_of_both_receivers_is_not_believed_and_small_ones_add_up():
    begins = circling(Monitors(["drift", STEPS]), 40.0, lambda t: 0.4 * (t > 30.0))
    assert 30.0 < min(begins.values()) < 33.0
    begins = circling(Monitors(["drift", STEPS]), 240.0, lambda t: 0.1 * (t // 30.0))
    assert begins[STEPS] > 60.0  # not the first one
    assert not circling(Monitors(["drift", STEPS]), 120.0)


def test_a_step_that_goes_back_is_none():
    monitors = Monitors(["drift", STEPS])
    circling(monitors, 80.0, lambda t: 0.15 * (30.0 < t < 50.0))
    assert not any(alarm.detector == STEPS for alarm in monitors.alarms)


@pytest.mark.parametrize("share", [-0.2, -0.1, 0.1, 0.2])
def test_a_wrong_encoder_is_a_rate_and_no_stairs(share):
    begins = circling(Monitors(["drift", STEPS]), 120.0, wheels=lambda t: 1.0 + share * (t > 30.0))
    assert STEPS not in begins


@pytest.mark.parametrize(
    "rate",
    [
        lambda true, t: -true,
        lambda true, t: 0.7 * true,
        lambda true, t: 0.0,
        lambda true, t: math.degrees(true),
        lambda true, t: true + math.radians(0.05) * t,
    ],
    ids=["sign", "scale", "axis", "unit", "ramp"],
)
def test_gyros_that_are_wrong_alike_are_left_out_by_name(rate):
    monitors = Monitors(GYROS)
    assert set(circling(monitors, 50.0, rate=rate)) == set(GYROS)
    assert {sensor for alarm in monitors.alarms for sensor in alarm.unused} == {
        Sensor.IMU_TRACTOR,
        Sensor.IMU_TRAILER,
    }
    assert all(alarm.reaction is Reaction.WARN for alarm in monitors.alarms)


def test_a_gyro_with_a_bias_and_a_step_of_the_positions_are_no_fault_of_the_gyro():
    assert not circling(Monitors(GYROS), 60.0, rate=lambda true, t: true + math.radians(0.1))
    assert not circling(Monitors(GYROS), 60.0, wrong=lambda t: 0.3 * (t > 30.0))


HITCH = BUILT_IN[DetectorIndex.HITCH].name
TURN_RADPS = math.tan(0.25) / VEHICLE.wheelbase  # at 1 m/s


def contradicted_hitch(gyro, offset=0.0, names=(HITCH, *GYROS), front=lambda k: 0.25):
    """Drive a curve whose hitch angle contradicts the estimate from 22 s on; return the alarms.

    From 20 s on both IMUs report `gyro(rate)` in place of the true yaw rate; None: there is no IMU.
    From 22 s on the hitch angle has an `offset` [rad]. `front(k)` is the reading of the front
    steering [rad], None: there is none. `names` are the detectors that run.
    """
    monitors = Monitors([*names])
    rng = np.random.default_rng(6)
    for k in range(116):
        late = k >= 110
        seen = moving(k, k * PERIOD_S, whitened=rng.normal(6.0 * late, 1.0, 5))
        samples = [
            Measurement(seen.time_s, Sensor.STEERING_TRAILER, (0.0,)),
            Measurement(seen.time_s, Sensor.HITCH, (0.4 + offset * late,)),
        ]
        if front(k) is not None:
            samples.append(Measurement(seen.time_s, Sensor.STEERING_TRACTOR, (front(k),)))
        if gyro is not None:
            rate = gyro(TURN_RADPS) if k >= 100 else TURN_RADPS
            for sensor in (Sensor.IMU_TRACTOR, Sensor.IMU_TRAILER):
                samples.append(Measurement(seen.time_s, sensor, (rate, 0.0, 0.0)))
        alarms = observed(monitors, replace(seen, samples=samples))
    return alarms


@pytest.mark.parametrize(
    "gyro",
    [lambda true: -true, lambda true: 0.7 * true, lambda true: 0.0, lambda true: true + 0.1],
    ids=["sign", "scale", "axis", "bias"],
)
def test_gyros_that_contradict_the_wheels_are_named_in_place_of_the_hitch_angle(gyro):
    alarms = contradicted_hitch(gyro)
    assert {alarm.detector for alarm in alarms} == set(GYROS)
    assert {sensor for alarm in alarms for sensor in alarm.unused} == {
        Sensor.IMU_TRACTOR,
        Sensor.IMU_TRAILER,
    }


@pytest.mark.parametrize("offset", [0.0, 0.15])
@pytest.mark.parametrize("gyro", [None, lambda true: 1.03 * true], ids=["none", "right"])
def test_the_hitch_angle_is_named_where_no_gyro_contradicts_the_wheels(gyro, offset):
    alarms = contradicted_hitch(gyro, offset)
    assert [alarm.detector for alarm in alarms] == [HITCH]


def test_a_front_steering_that_is_not_measured_blames_no_gyro():
    alarms = contradicted_hitch(lambda true: true, front=lambda k: None)
    assert [alarm.detector for alarm in alarms] == [HITCH]


def test_a_front_steering_that_repeats_one_reading_blames_no_gyro():
    """It stands at 0 from 18 s on, while the vehicle turns and its other readings have noise."""
    stuck = BUILT_IN[DetectorIndex.READINGS_STEERING_TRACTOR].name
    noise = np.random.default_rng(8).normal(0.0, 0.01, 200)
    alarms = contradicted_hitch(
        lambda true: true,
        names=(HITCH, *GYROS, stuck),
        front=lambda k: 0.25 + noise[k] if k < 90 else 0.0,
    )
    assert {alarm.detector for alarm in alarms} == {HITCH, stuck}


@pytest.mark.parametrize("only", GYROS)
def test_a_gyro_whose_detector_does_not_run_has_no_alarm(only):
    alarms = contradicted_hitch(lambda true: -true, names=(HITCH, only))
    assert [alarm.detector for alarm in alarms] == [only]


def stamped(stamp, seconds=80.0):
    """Return the begin of the alarm of stamps [s], NaN without one, and its words."""
    monitors = Monitors([CLOCK])
    for k in range(round(seconds / PERIOD_S)):
        time_s = k * PERIOD_S
        samples = [Measurement(stamp(time_s), Sensor.GNSS_TRACTOR, (0.0, 0.0))]
        if alarms := observed(monitors, observation(k, samples)):
            return time_s, alarms[0].reason
    return math.nan, ""


def test_stamps_of_a_delay_that_grows_run_late_and_constant_or_jittering_ones_do_not():
    begin_s, words = stamped(lambda t: t + 0.015 * max(0.0, t - 30.0))
    assert 30.0 < begin_s < 45.0
    assert "gnss_tractor" in words
    rng = np.random.default_rng(3)
    for stamp in (
        lambda t: t + 0.3,
        lambda t: 1.0001 * t,
        lambda t: t + rng.uniform(0.0, 0.03),
        lambda t: t + 5.0 * (t > 40.0),
    ):
        assert math.isnan(stamped(stamp)[0])


def test_one_sensor_that_contradicts_is_no_noise_of_all():
    for count, expected in ((1, False), (3, True)):
        monitors = Monitors([NOISE])
        board = monitors.record.view(DETECTORS)[0]["board"]
        first = DetectorIndex.INNOVATIONS_GNSS_TRACTOR
        board["statistic"][first : first + count] = 100.0
        monitors.record.view(DETECTORS)[0]["last"]["time_s"] = 0.0
        for k in range(100):
            alarms = observed(monitors, observation(k))
        assert any(alarm.detector == NOISE for alarm in alarms) is expected
        assert board["alarms"][first, AlarmColumn.REACTION] > NO_ALARM
