"""Motion and wheels: speeds that agree, and that do not."""

import numpy as np
import pytest

from tests.ttempc.detectors.observed import (
    PERIOD_S,
    VEHICLE,
    Alone,
    observation,
    observed,
    speeds,
)
from ttempc.detectors.interface import Reaction
from ttempc.detectors.monitors import Monitors
from ttempc.detectors.table import BUILT_IN, DetectorIndex
from ttempc.types import Command, Innovation, Sensor


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
    rng, monitor = np.random.default_rng(5), Alone(DetectorIndex.WHEELS)
    place, first = 0.0, None
    for k in range(60):
        place += PERIOD_S * (1.0 if k < 20 else ground_mps)
        samples = speeds(k, 1.0 if k < 20 else encoder, place, rng)
        command = Command(0.0, 0.0, planned / VEHICLE.speed_gain)
        alarm = monitor.alarm(observation(k, samples, command))
        if first is None and alarm is not None:
            first = k, "no encoder" if alarm.unused == {Sensor.ENCODER} else alarm.reaction
    assert (first and first[1]) == reaction
    assert first is None or first[0] <= 20 + round(2.0 / PERIOD_S)


@pytest.mark.parametrize("stops", [False, True])
def test_a_vehicle_that_does_not_obey_its_hydrostat(stops):
    rng, monitor, place = np.random.default_rng(6), Alone(DetectorIndex.MOTION), 0.0
    hp, noticed = 1.0 / VEHICLE.speed_gain, []
    for k in range(60):
        place += PERIOD_S * 1.0
        command = Command(0.0, 0.0, 0.0 if stops and k >= 30 else hp)
        seen = observation(k, speeds(k, 1.0, place, rng), command)
        noticed += [k] if monitor.alarm(seen) else []
    assert bool(noticed) is stops
    assert not stops or 30 < noticed[0] < 30 + round(4.0 / PERIOD_S)  # the hydrostat's lag is 2 s


@pytest.mark.parametrize(
    ("wheels_mps", "ground_mps", "planned_mps", "noticed"),
    [
        (1.05, 1.0, 0.5, True),  # it is stuck, and the vehicle rolls on
        (0.5, 0.5, 1.0, True),  # it gives less than it is told
        (1.05, 1.0, 1.0, False),
        (1.2, 0.8, 1.0, False),  # the wheels slip
        (1.0, 0.0, 1.0, False),  # receivers that stand still
        (0.5, 1.0, 1.0, False),  # an encoder that is wrong
        (3.4, 3.3, 4.0, False),  # a climb at speed
    ],
)
def test_a_hydrostat_is_named_where_wheels_and_ground_agree_on_another_speed(
    wheels_mps, ground_mps, planned_mps, noticed
):
    rng = np.random.default_rng(8)
    monitors = Monitors(["hydrostat"])
    command = Command(0.1, 0.0, planned_mps / VEHICLE.speed_gain)
    place = 0.0
    for k in range(75):
        place += PERIOD_S * ground_mps
        seen = observation(k, speeds(k, wheels_mps, place, rng), command)
        named = bool(observed(monitors, seen))
    assert named is noticed

    # the filter gets no command of a hydrostat that is named
    sent = command.as_array()
    obeyed = monitors.obeyed(sent)
    assert np.isnan(obeyed).tolist() == [False, False, noticed]
    assert np.isfinite(sent).all()


@pytest.mark.parametrize(
    ("planned_mps", "share", "noticed"),
    [(4.0, 0.83, False), (4.0, 0.5, True), (1.0, 0.83, False), (1.0, 0.1, True)],
)
def test_a_hydrostat_under_load_is_slower_in_proportion(planned_mps, share, noticed):
    """A climb takes a sixth of the speed, at any speed; half of it is a fault."""
    rng = np.random.default_rng(6)
    monitor = Alone(DetectorIndex.MOTION)
    command = Command(0.0, 0.0, planned_mps / VEHICLE.speed_gain)
    place = 0.0
    alarms = 0
    for k in range(100):
        ground_mps = planned_mps * (1.0 if k < 50 else share)
        place += PERIOD_S * ground_mps
        alarm = monitor.alarm(observation(k, speeds(k, ground_mps, place, rng), command))
        alarms += alarm is not None and k >= 50
    assert (alarms > 0) is noticed


@pytest.mark.parametrize("contradicting", [0, 1, 2])
def test_an_alarm_of_motion_lasts_while_both_receivers_contradict_the_estimate(contradicting):
    """The hydrostat is at 0 from tick 30 to 45, and the vehicle drives on; then they agree."""
    receivers = (Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER)
    names = [BUILT_IN[DetectorIndex.MOTION].name]
    names += [BUILT_IN[DetectorIndex.INNOVATIONS_GNSS_TRACTOR + n].name for n in range(2)]
    rng, monitors = np.random.default_rng(6), Monitors(names)
    hp, place, last = 1.0 / VEHICLE.speed_gain, 0.0, 0
    for k in range(140):
        place += PERIOD_S
        command = Command(0.0, 0.0, 0.0 if 30 <= k < 45 else hp)
        squares = [99.0 if n < contradicting and 40 <= k < 120 else 1.0 for n in range(2)]
        named = zip(receivers, squares, strict=True)
        given = [Innovation(sensor, square, 2) for sensor, square in named for _ in range(3)]
        seen = observation(k, speeds(k, 1.0, place, rng), command, given)
        alarms = {alarm.detector for alarm in observed(monitors, seen)}
        last = k if "motion" in alarms else last
    assert (120 <= last < 130) if contradicting == 2 else (40 < last < 90)
