"""Motion and wheels: speeds that agree, and that do not."""

import numpy as np
import pytest

from tests.ttempc.detectors.observed import PERIOD_S, VEHICLE, Alone, observation, speeds
from ttempc.detectors.interface import Reaction
from ttempc.detectors.table import DetectorIndex
from ttempc.types import Command, Sensor


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
