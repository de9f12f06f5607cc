"""Hitch: an angle that agrees with the motion of both bodies, and one that does not."""

import numpy as np
import pytest

from tests.ttempc.detectors.observed import PERIOD_S, Alone, moving, observed
from ttempc.detectors.interface import Reaction
from ttempc.detectors.table import DetectorIndex
from ttempc.types import Innovation, Sensor


@pytest.mark.parametrize("how", ["innovations", "slip"])
def test_a_hitch_sensor_that_contradicts_is_not_used_again(how):
    """The mean of whitened innovations, and a side slip of one body alone, both from 20 s on."""
    rng, monitor, first = np.random.default_rng(11), Alone(DetectorIndex.HITCH), None
    for k in range(400):
        wrong = 100 <= k < 110
        mean = 3.0 if wrong and how == "innovations" else 0.0
        slip = 0.1 if wrong and how == "slip" else 0.0
        seen = moving(k, k * PERIOD_S, slip_t=slip, whitened=rng.normal(mean, 1.0, 5))
        alarm = monitor.alarm(seen)
        first = k if alarm and first is None else first
    assert 100 <= first <= 105
    assert alarm.reaction is Reaction.WARN
    assert alarm.unused == {Sensor.HITCH, Sensor.IMU_TRACTOR, Sensor.IMU_TRAILER}
    monitor.resume()
    assert not monitor.alarms


def test_a_slope_is_no_fault_on_any_heading():
    """Slips that are fixed in the map act on both bodies from other directions in a turn."""
    monitor, slope = Alone(DetectorIndex.HITCH), np.array([0.1, -0.05])
    for k in range(300):
        seen = moving(k, k * PERIOD_S, slips=(*slope, 0.0, 0.0))
        for body, yaw in enumerate((0.05 * k, 0.05 * k - 0.6)):
            seen.estimate.state[2 + body] = yaw
            along_left = np.array([-np.sin(yaw), np.cos(yaw)])
            seen.estimate.disturbance[body] = along_left @ slope
        assert not monitor.alarm(seen)


@pytest.mark.parametrize("accepted", [True, False])
def test_a_steering_angle_that_the_filter_rejects_may_be_what_is_wrong(accepted):
    rng, monitor, noticed = np.random.default_rng(12), Alone(DetectorIndex.HITCH), False
    for k in range(120):
        seen = moving(k, k * PERIOD_S, whitened=rng.normal(3.0 if k >= 100 else 0.0, 1.0, 5))
        steering = Innovation(Sensor.STEERING_TRACTOR, 1.0, 1, accepted or k < 100)
        object.__setattr__(seen.estimate, "innovations", (*seen.estimate.innovations, steering))
        noticed = noticed or bool(observed(monitor, seen))
    assert noticed is accepted
