"""Position and protection level: jumps, spinning wheels, and what a bound promises."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.detectors.observed import PERIOD_S, Alone, moving, observed, readings
from ttempc.detectors.interface import Reaction
from ttempc.detectors.monitors import Monitors
from ttempc.detectors.position import _without_spin
from ttempc.detectors.table import BUILT_IN, DetectorIndex
from ttempc.types import Measurement, Sensor


@pytest.mark.parametrize(("jump_m", "noticed"), [(0.1, False), (0.5, True), (3.0, True)])
def test_a_jump_is_not_believed_until_an_operator_says_so(jump_m, noticed):
    def make(k):
        return moving(k, k * PERIOD_S + (jump_m if k >= 100 else 0.0), slip_t=1e-3)

    monitor, first = Alone(DetectorIndex.POSITION), None
    for k in range(1000):
        alarm = monitor.alarm(make(k))
        first = k if alarm and first is None else first
    assert first == (100 if noticed else None)
    assert bool(alarm) is noticed
    assert not noticed or alarm.reaction is Reaction.STOP_ON_PATH
    monitor.resume()
    assert not monitor.alarm(make(1000))


@pytest.mark.parametrize(("jump_m", "noticed"), [(0.36, False), (0.38, True)])
def test_the_bound_of_a_jump_is_a_quarter_of_a_metre_and_12_cm_at_a_roughness_of_1(jump_m, noticed):
    """Side slip is stated, else the bound is three times as large."""
    monitor = Alone(DetectorIndex.POSITION)
    for k in range(60):
        monitor.alarm(moving(k, k * PERIOD_S, slip_t=1e-9))
    alarm = monitor.alarm(moving(60, 60 * PERIOD_S + jump_m, slip_t=1e-9))
    assert bool(alarm) is noticed


@pytest.mark.parametrize(("left_m", "ends"), [(0.12, False), (0.06, True)])
def test_a_jump_has_ended_where_less_than_a_quarter_of_the_bound_of_37_cm_is_left(left_m, ends):
    """The position jumps by half a metre at tick 60, and back but for a rest at tick 80."""
    monitor = Alone(DetectorIndex.POSITION)
    for k in range(120):
        jump_m = left_m if k >= 80 else 0.5 if k >= 60 else 0.0
        alarm = monitor.alarm(moving(k, k * PERIOD_S + jump_m, slip_t=1e-9))
        assert bool(alarm) is (60 <= k < 80 or (k >= 80 and not ends))


@pytest.mark.parametrize(("wheels_mps", "jumps"), [(None, True), (1.0, True), (1.3, False)])
def test_a_way_that_the_wheels_have_rolled_is_no_jump(wheels_mps, jumps):
    """The estimate says 1 m/s and the position goes at 1.2 m/s: do the wheels go as fast?"""
    monitor = Alone(DetectorIndex.POSITION)
    for k in range(120):
        seen = moving(k, 1.2 * k * PERIOD_S, slip_t=1e-9)
        if wheels_mps is not None:
            sample = Measurement(seen.time_s, Sensor.ENCODER, (wheels_mps,))
            seen = replace(seen, samples=[sample])
        alarm = monitor.alarm(seen)
    assert bool(alarm) == jumps


def test_a_position_that_was_uncertain_may_come_back():
    """After an outage that the estimate knows of, its correction is no jump."""
    monitors = Monitors()
    for k in range(200):
        seen = moving(k, k * PERIOD_S + (0.4 if k >= 100 else 0.0))
        seen.estimate.covariance[:2, :2] *= 400.0 if 50 <= k < 100 else 1.0
        assert not observed(monitors, seen)


def levels(standard_deviations, detect):
    """Return statistic and residual of the protection level for some standard deviations [m]."""
    made = []
    for sd in standard_deviations:
        monitors, seen = Monitors(detect), moving(0, 0.0)
        seen.estimate.covariance[:2, :2] = sd**2 * np.eye(2)
        observed(monitors, seen)
        made.append(monitors.detectors[DetectorIndex.PROTECTION])
    return made


def test_the_protection_level_has_the_risk_of_a_rayleigh_distribution():
    low, high = levels((0.1, 0.2), ["protection level"])
    assert low.statistic == high.statistic == 0.0  # all sensors are used
    assert math.exp(-0.5 * ((high.residual - low.residual) / 0.1) ** 2) == pytest.approx(1e-5)


@pytest.mark.parametrize("angle", [0.3, 1.2, 2.5])
def test_the_protection_level_is_the_same_in_every_frame(angle):
    """It follows the larger axis of the ellipse, not the larger diagonal entry."""
    residuals = []
    for turn in (0.0, angle):
        rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
        monitors, seen = Monitors(["protection level"]), moving(0, 0.0)
        seen.estimate.covariance[:2, :2] = rotation @ np.diag([0.04, 0.01]) @ rotation.T
        observed(monitors, seen)
        residuals.append(monitors.detectors[DetectorIndex.PROTECTION].residual)
    assert residuals[1] == pytest.approx(residuals[0])


@pytest.mark.parametrize("stuck", [False, True])
def test_an_uncertain_position_is_an_alarm_while_a_sensor_is_excluded(stuck):
    """The hitch angle repeats itself from tick 40 on; the standard deviation is 0.2 m."""
    hitch = BUILT_IN[DetectorIndex.READINGS_HITCH].name
    rng, monitors, found = np.random.default_rng(2), Monitors([hitch, "protection level"]), set()
    for k in range(50):
        values = [0.1] * 5 if stuck and k >= 40 else rng.normal(0.0, 0.01, 5).tolist()
        seen = moving(k, k * PERIOD_S)
        seen.estimate.covariance[:2, :2] = 0.2**2 * np.eye(2)
        object.__setattr__(seen, "samples", readings(k, values, Sensor.HITCH))
        found |= {(alarm.detector, alarm.reaction) for alarm in observed(monitors, seen)}
    assert (("protection level", Reaction.SLOW) in found) is stuck


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
@pytest.mark.parametrize("distance", [0.3, -0.3])
def test_wheels_that_spin_lose_at_most_their_own_distance(yaw, distance):
    """An offset ahead or to the side stays; one back is taken off, no more than the distance."""
    ahead = math.copysign(1.0, distance) * np.array([math.cos(yaw), math.sin(yaw)])
    left = np.array([-math.sin(yaw), math.cos(yaw)])
    for along, remains in ((-0.2, 0.0), (-0.3, 0.0), (-1.0, -0.7), (0.4, 0.4)):
        found = _without_spin(*(along * ahead + 0.1 * left), yaw, distance)
        np.testing.assert_allclose(found, remains * ahead + 0.1 * left, atol=1e-12)
