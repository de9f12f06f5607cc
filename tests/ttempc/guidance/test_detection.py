"""Detectors: closed forms, silence without a fault, delay with one."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.sensed_drive import SensedDrive
from ttempc.detectors.interface import (
    MONITORS,
    Alarm,
    Detector,
    DetectorIndex,
    Monitors,
    Observation,
    Reaction,
    _median,
)
from ttempc.layout import estimate_row, innovation_rows, measurements_of, sample_rows
from ttempc.models.augmented_state import SensorIndex
from ttempc.types import Command, Estimate, Innovation, Measurement, Sensor
from ttempc.vehicle import Vehicle

PERIOD_S = 0.2
VEHICLE = Vehicle()


def observation(k, samples=(), command=None, innovations=(), vehicle=VEHICLE):
    nothing = np.zeros(2)
    estimate = Estimate(
        k * PERIOD_S, np.zeros(7), 1e-4 * np.eye(7), nothing, 0.0, innovations=tuple(innovations)
    )
    return Observation(k * PERIOD_S, samples, command, estimate, vehicle)


def observed(monitors, seen):
    """Return the alarms that stand after the data of an observation."""
    sent = np.full(3, math.nan) if seen.command is None else seen.command.as_array()
    innovations = innovation_rows(seen.estimate.innovations)
    rows, view = sample_rows(seen.samples), lambda: seen.estimate
    row = estimate_row(seen.estimate)
    monitors.observe(rows, seen.time_s, sent, row, innovations, seen.vehicle, view)
    return monitors.alarms


class Watched(Monitors):
    """All built-in detectors, of which one is looked at."""

    def __init__(self, index):
        super().__init__()
        self.name, self.index = self.detectors[index].name, index

    def alarm(self, *given, **named):
        """Return the alarm of that one after the data of a tick, None if there is none."""
        alarms = observed(self, observation(*given, **named))
        return next((alarm for alarm in alarms if alarm.detector == self.name), None)


def angles(k, value, rng, sd_deg=1.0, sensor=Sensor.STEERING_TRACTOR):
    """Return the samples of the period before tick `k`, of an angle as a function of time."""
    times = k * PERIOD_S - 0.04 * np.arange(5)[::-1]
    noise = rng.normal(0.0, math.radians(sd_deg), 5)
    values = [float(value(t)) + n for t, n in zip(times, noise, strict=True)]
    return [Measurement(t, sensor, (item,)) for t, item in zip(times, values, strict=True)]


class Given(Detector):
    """A user's detector: given values of its statistic, a sensor that its alarm rules out."""

    def __init__(self, values, unused=(), name="given"):
        super().__init__(name, 4.0)
        self.values, self.unused, self.seen = values, frozenset(unused), []

    def observe(self, observation):
        self.statistic = self.values.pop(0)
        self.seen.append(observation.samples)

    def alarm(self):
        return Alarm(self.name, f"{self.statistic}", Reaction.STOP, self.unused)


def test_an_alarm_lasts_until_half_the_limit():
    monitors = Monitors([Given([3.9, 4.1, 5.0, 2.1, 1.9, 3.9])], built_in=False)
    alarms = [observed(monitors, observation(k)) for k in range(6)]
    assert [len(item) for item in alarms] == [0, 1, 1, 1, 0, 0]
    assert alarms[3][0].reason == "4.1"


def test_a_detector_of_ones_own_sees_what_no_alarm_of_a_built_in_one_rules_out():
    rng, own = np.random.default_rng(8), Given([0.0] * 20 + [5.0] * 2, [Sensor.ENCODER])
    monitors = Monitors([own])
    for k in range(20):
        observed(monitors, observation(k, readings(k, rng.normal(0.0, 0.01, 5))))
    stuck = [*readings(20, [0.1] * 5), *readings(20, [1.0, 1.1], Sensor.ENCODER)]
    alarms = observed(monitors, observation(20, stuck))
    assert [alarm.unused for alarm in alarms] == [{Sensor.HITCH}, {Sensor.ENCODER}]
    assert [sample.sensor for sample in own.seen[-1]] == [Sensor.ENCODER] * 2
    assert not len(monitors.usable(sample_rows(stuck)))
    assert len(observed(monitors, observation(21, readings(21, [0.2])))) == 1


@pytest.mark.parametrize("count", [1, 2, 3, 10, 15, 21])
def test_the_median_is_that_of_numpy(count):
    rng = np.random.default_rng(count)
    for values in (rng.normal(size=count), rng.integers(0, 3, count).astype(float)):
        assert _median(values.copy(), count) == np.median(values)


def test_the_statistic_of_consistent_innovations_is_standard_normal():
    """Chi-square sums of a second, 5 samples of two entries; the negative half counts as 0."""
    rng = np.random.default_rng(3)
    monitor, values = Watched(DetectorIndex.INNOVATIONS), []
    for k in range(40_000):
        square = float(rng.chisquare(2))
        monitor.alarm(k, innovations=[Innovation(Sensor.GNSS_TRACTOR, square, 2)])
        values.append(monitor.record.view(MONITORS)["statistic"][0, monitor.index])
    for level, share in ((1.0, 0.1587), (2.0, 0.02275), (3.0, 0.00135)):
        assert np.mean(np.array(values[5:]) > level) == pytest.approx(share, rel=0.25, abs=4e-4)


def speeds(k, encoder, ground, rng):
    """Return the samples of a tick: five of the encoder, one of each receiver on a straight."""
    times = k * PERIOD_S - 0.04 * np.arange(5)[::-1]
    wheels = [Measurement(t, Sensor.ENCODER, (encoder + rng.normal(0.0, 0.1),)) for t in times]
    places = [
        Measurement(k * PERIOD_S, sensor, (ground + rng.normal(0.0, 0.03), rng.normal(0.0, 0.03)))
        for sensor in (Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER)
    ]
    return [*wheels, *places]


@pytest.mark.parametrize(
    ("encoder", "ground_mps", "planned", "reaction"),
    [
        (1.0, 0.85, 1.0, None),
        (1.0, 0.0, 1.0, Reaction.STOP_ON_PATH),
        (2.0, 1.1, 2.0, Reaction.SLOW),
        (2.0, 1.1, 1.0, "no encoder"),
        (0, 1, 1.0, "no encoder"),
        (-1.0, 1.0, 1.0, "no encoder"),
    ],
)
def test_wheels_against_gnss(encoder, ground_mps, planned, reaction):
    """From 4 s on the wheels and the vehicle go at the given speeds, before at 1 m/s both.

    The encoder is wrong where the other speed is the one that was asked for.
    """
    rng, monitor = np.random.default_rng(5), Watched(DetectorIndex.WHEELS)
    place, first = 0.0, None
    for k in range(60):
        place += PERIOD_S * (1.0 if k < 20 else ground_mps)
        samples = speeds(k, 1.0 if k < 20 else encoder, place, rng)
        command = Command(0.0, 0.0, planned / VEHICLE.speed_gain)
        alarm = monitor.alarm(k, samples, command)
        if first is None and alarm is not None:
            first = k, "no encoder" if alarm.unused == {Sensor.ENCODER} else alarm.reaction
    assert (first and first[1]) == reaction
    assert first is None or first[0] <= 20 + round(2.0 / PERIOD_S)


def test_a_vehicle_that_does_not_obey_its_hydrostat():
    rng, monitor, place = np.random.default_rng(6), Watched(DetectorIndex.MOTION), 0.0
    hp, noticed = 1.0 / VEHICLE.speed_gain, []
    for k in range(60):
        place += PERIOD_S * 1.0
        command = Command(0.0, 0.0, hp if k < 30 else 0.0)
        noticed += [k] if monitor.alarm(k, speeds(k, 1.0, place, rng), command) else []
    assert 30 < noticed[0] < 30 + round(4.0 / PERIOD_S)  # the lag of the hydrostat is 2 s


def test_a_drive_without_faults_is_silent():
    monitors = Monitors()
    drive = SensedDrive(seed=4)
    drive.run(250)
    for k, ((samples, command), estimate) in enumerate(
        zip(drive.received, drive.estimates, strict=True)
    ):
        now = Observation(k * PERIOD_S, samples, command, estimate, VEHICLE)
        assert not observed(monitors, now)


def readings(k, values, sensor=Sensor.HITCH):
    """Return the samples of one tick, one every 0.04 s."""
    return [Measurement(k * PERIOD_S + 0.04 * n, sensor, (v,)) for n, v in enumerate(values)]


def test_a_sensor_that_repeats_itself_is_not_used_until_it_changes():
    """Three repetitions in succession; duplicates under one stamp are none."""
    rng, monitors = np.random.default_rng(8), Monitors()
    for k in range(20):
        samples = readings(k, rng.normal(0.0, 0.01, 5))
        assert not observed(monitors, observation(k, [*samples, *samples]))
    last = samples[-1].value[0]
    assert not observed(monitors, observation(20, readings(20, [last, last])))
    stuck = readings(21, [last])
    (alarm,) = observed(monitors, observation(21, stuck))
    assert alarm.reaction is Reaction.WARN
    other = Measurement(4.2, Sensor.ENCODER, (1.0,))
    assert measurements_of(monitors.usable(sample_rows([*stuck, other]))) == [other]
    changed = readings(22, [last + 1e-9])
    assert not observed(monitors, observation(22, changed))
    assert measurements_of(monitors.usable(sample_rows(changed))) == changed


def valve(commands, time_s, lag=VEHICLE.steering_lag_t):
    """Return the angle of a valve that follows steps at the ticks with a lag, in closed form."""
    angle = commands[0]
    for k, command in enumerate(commands):
        span = min(max(time_s - k * PERIOD_S, 0.0), PERIOD_S)
        angle = command + (angle - command) * math.exp(-span / lag)
    return angle


@pytest.mark.parametrize("sd_deg", [1.0, 10.0])
def test_a_valve_that_follows_is_no_fault_however_noisy_its_sensor(sd_deg):
    rng, monitor = np.random.default_rng(1), Watched(DetectorIndex.STEERING)
    commands = 0.3 * np.sin(0.15 * np.arange(3000))
    for k in range(3000):
        recent = max(0, k - 30)  # a step of 30 periods before has no effect on the angle
        samples = angles(
            k, lambda t, k=k, n=recent: valve(commands[n : k + 1], t - n * PERIOD_S), rng, sd_deg
        )
        sent = Command(float(commands[k - 1]), 0.0, 0.7) if k else None
        assert not monitor.alarm(k, samples, sent)


@pytest.mark.parametrize(("dead_time", "believed"), [(0.0, 0.0), (0.3, 0.0), (0.1, 0.7)])
def test_a_dead_time_that_is_not_known_is_no_fault(dead_time, believed):
    rng, monitor = np.random.default_rng(2), Watched(DetectorIndex.STEERING)
    vehicle = replace(VEHICLE, dead_time_t=believed)
    commands = 0.25 * np.sin(0.2 * np.arange(200))
    for k in range(200):
        samples = angles(k, lambda t, k=k: valve(commands[: k + 1], t - dead_time), rng)
        sent = Command(float(commands[k - 1]), 0.0, 0.7) if k else None
        assert not monitor.alarm(k, samples, sent, vehicle=vehicle)


def test_play_is_no_fault():
    """A wheel that lags its cylinder by 1 deg either way, as play of 2 deg."""
    rng, monitor = np.random.default_rng(4), Watched(DetectorIndex.STEERING)
    commands, wheel, play = 0.25 * np.sin(0.1 * np.arange(600)), 0.0, math.radians(1.0)
    for k in range(600):
        cylinder = valve(commands[max(0, k - 30) : k + 1], min(k, 30) * PERIOD_S)
        wheel = min(max(wheel, cylinder - play), cylinder + play)
        samples = angles(k, lambda t, angle=wheel: angle, rng)
        sent = Command(float(commands[k - 1]), 0.0, 0.7) if k else None
        assert not monitor.alarm(k, samples, sent)


def test_a_stuck_valve_is_noticed_within_a_second_of_a_command_that_leaves_it():
    rng, monitor = np.random.default_rng(1), Watched(DetectorIndex.STEERING)
    noticed = []
    for k in range(80):
        command = 0.0 if k < 50 else 0.14  # 8 deg: the curve of radius 10 m
        alarm = monitor.alarm(k, angles(k, lambda t: 0.0, rng), Command(command, 0.0, 0.7))
        noticed += [k] if alarm else []
    assert 50 < noticed[0] <= 50 + round(1.0 / PERIOD_S)
    assert alarm.reaction is Reaction.STOP_ON_PATH


def test_a_valve_that_stands_still_is_noticed_before_one_that_does_not_follow():
    rng, monitors = np.random.default_rng(1), Monitors()
    follows, standstill = (
        monitors.detectors[n].name for n in (DetectorIndex.STEERING, DetectorIndex.STANDSTILL)
    )
    commands, first = 0.25 * np.sin(0.2 * np.arange(140)), {}
    for k in range(140):
        stuck = valve(commands[:101], 100 * PERIOD_S) if k > 100 else None
        samples = angles(
            k, lambda t, k=k, s=stuck: valve(commands[: k + 1], t) if s is None else s, rng
        )
        sent = Command(float(commands[k - 1]), 0.0, 0.7) if k else None
        for alarm in observed(monitors, observation(k, samples, sent)):
            first.setdefault(alarm.detector, ((k - 100) * PERIOD_S, alarm.reaction))
    assert 0.0 < first[standstill][0] <= 1.0 < first[follows][0]
    assert first[standstill][1] is Reaction.SLOW


@pytest.mark.parametrize(
    ("resolution_deg", "noise_deg"), [(0.0, 0.02), (0.01, 0.0), (0.1, 0.0), (0.25, 0.0), (0.1, 0.1)]
)
def test_an_angle_that_has_lost_its_noise_is_not_used(resolution_deg, noise_deg):
    """A sensor of 1 deg noise, stuck from 60 s on; with less than a tenth of its noise at most."""
    rng, monitor = np.random.default_rng(9), Watched(SensorIndex.HITCH)
    step, first = math.radians(resolution_deg), None
    for k in range(1, 320):
        stuck = k >= 300
        noise = noise_deg if stuck else 1.0
        values = rng.normal(0.1 if stuck else 0.2 * math.sin(0.04 * k), math.radians(noise), 5)
        if step and not stuck:
            values = step * np.round(values / step)
        alarm = monitor.alarm(k, readings(k, values))
        first = first or (k if alarm else None)
    assert 300 < first <= 310
    assert alarm.unused == {Sensor.HITCH}


def test_a_sensor_that_is_quiet_by_nature_is_used():
    """Noise of 0.02 deg at a resolution of 0.1 deg: readings change where the angle does."""
    rng, monitor = np.random.default_rng(10), Watched(SensorIndex.HITCH)
    step = math.radians(0.1)
    for k in range(1, 1000):
        angle = 0.2 * max(0.0, math.sin(0.03 * k))
        values = step * np.round(rng.normal(angle, math.radians(0.02), 5) / step)
        assert monitor.alarm(k, readings(k, values)) is None


def estimates(k, x, slips=(0.0,) * 4, yaw=0.0, slip_t=0.0, whitened=()):
    """Return an observation of an estimate that moves east at 1 m/s and has some slips."""
    state = np.array([x, 0.0, yaw, yaw, 0.0, 0.0, 1.0])
    disturbance = np.array([slip_t, 0.0, 0.0, 0.0, 0.0])
    given = [Innovation(Sensor.HITCH, z * z, 1, True, (z,), 0.0) for z in whitened]
    estimate = Estimate(
        k * PERIOD_S,
        state,
        1e-4 * np.eye(7),
        np.zeros(2),
        0.0,
        disturbance,
        tuple(given),
        np.array(slips),
    )
    return Observation(k * PERIOD_S, (), None, estimate, VEHICLE)


def first_alarm(index, ticks, make):
    """Return the tick of the first alarm of a detector over some estimates, and the monitors."""
    monitors, first = Monitors(), None
    name = monitors.detectors[index].name
    for k in range(ticks):
        alarms = observed(monitors, make(k))
        if any(alarm.detector == name for alarm in alarms):
            first = k if first is None else first
    return first, monitors


@pytest.mark.parametrize(("jump_m", "noticed"), [(0.1, False), (0.5, True), (3.0, True)])
def test_a_jump_is_not_believed_until_an_operator_says_so(jump_m, noticed):
    def make(k):
        return estimates(k, k * PERIOD_S + (jump_m if k >= 100 else 0.0), slip_t=1e-3)

    first, monitors = first_alarm(DetectorIndex.POSITION, 1000, make)
    assert first == (100 if noticed else None)
    assert bool(monitors.alarms) is noticed
    monitors.resume(np.zeros(4))
    assert not observed(monitors, make(1000))


def test_a_position_that_was_uncertain_may_come_back():
    """After an outage that the estimate knows of, its correction is no jump."""
    monitors = Monitors()
    for k in range(200):
        seen = estimates(k, k * PERIOD_S + (0.4 if k >= 100 else 0.0))
        seen.estimate.covariance[:2, :2] *= 400.0 if 50 <= k < 100 else 1.0
        assert not observed(monitors, seen)


@pytest.mark.parametrize("how", ["side", "wheel"])
@pytest.mark.parametrize(("east_mps", "drifts"), [(0.0, False), (0.02, True), (-0.05, True)])
def test_gnss_that_moves_while_the_vehicle_stands_drifts(how, east_mps, drifts):
    """Slips change at 24 s and ask for a check at rest; after one that was passed they are true."""
    rng, monitors, first, x = np.random.default_rng(17), Monitors(), None, 0.0
    for k in range(400):
        time_s, checked = k * PERIOD_S, any(one.detector == "drift" for one in monitors.alarms)
        first = k if checked and first is None else first
        seen = estimates(k, x, (0.0, 0.03 * (how == "side" and k >= 120), 0.0, 0.0))
        seen.estimate.disturbance[4] = 0.2 * (how == "wheel" and k >= 120)
        seen.estimate.state[6] = 0.0 if checked else 1.0
        x += PERIOD_S * seen.estimate.state[6]
        at = rng.normal((x + east_mps * time_s, 0.0), 0.03, (2, 2)).tolist()
        named = zip((Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER), at, strict=True)
        samples = [Measurement(time_s, sensor, tuple(xy)) for sensor, xy in named]
        observed(monitors, replace(seen, samples=samples))
    told = [one.reason for one in monitors.alarms if one.detector == "drift"]
    assert first in range(121, 145)
    speeds = [float(reason.split()[3]) for reason in told]
    assert speeds == drifts * [pytest.approx(100.0 * abs(east_mps), abs=1.0)]


def test_the_protection_level_has_the_risk_of_a_rayleigh_distribution():
    levels = []
    for sd in (0.1, 0.2):
        monitors, seen = Monitors(), estimates(0, 0.0)
        seen.estimate.covariance[:2, :2] = sd**2 * np.eye(2)
        observed(monitors, seen)
        detector = monitors.detectors[DetectorIndex.PROTECTION]
        assert detector.statistic == 0.0  # all sensors are used
        levels.append(detector.residual)
    assert math.exp(-0.5 * ((levels[1] - levels[0]) / 0.1) ** 2) == pytest.approx(1e-5)


@pytest.mark.parametrize("how", ["innovations", "slip"])
def test_a_hitch_sensor_that_contradicts_is_not_used_again(how):
    """The mean of whitened innovations, and a side slip of one body alone, both from 20 s on."""
    rng = np.random.default_rng(11)

    def make(k):
        wrong = 100 <= k < 110
        mean = 3.0 if wrong and how == "innovations" else 0.0
        slip = 0.1 if wrong and how == "slip" else 0.0
        return estimates(k, k * PERIOD_S, slip_t=slip, whitened=rng.normal(mean, 1.0, 5))

    first, monitors = first_alarm(DetectorIndex.HITCH, 400, make)
    assert 100 <= first <= 105
    (alarm,) = (alarm for alarm in monitors.alarms if alarm.detector == "hitch")
    assert alarm.unused == {Sensor.HITCH, Sensor.IMU_TRACTOR, Sensor.IMU_TRAILER}
    monitors.resume(np.zeros(4))
    assert not monitors.alarms
