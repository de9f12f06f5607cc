"""Drift: slips that change, and GNSS at rest."""

from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.detectors.observed import PERIOD_S, Alone, moving
from ttempc.detectors.interface import Reaction
from ttempc.detectors.table import DetectorIndex
from ttempc.types import Measurement, Sensor
from ttempc.vehicle import Vehicle


def drive(monitor, how, east_mps, ticks=400):
    """Return the first tick with an alarm, and the last alarm.

    From 24 s on the slips are those of a slope or a drift; the vehicle stands while there is an
    alarm. GNSS drifts by `east_mps` all the time.
    """
    rng, first, alarm, x = np.random.default_rng(17), None, None, 0.0
    for k in range(ticks):
        first = k if alarm and first is None else first
        seen = moving(k, x, (0.0, 0.03 * (how == "side" and k >= 120), 0.0, 0.0))
        seen.estimate.disturbance[4] = 0.2 * (how == "wheel" and k >= 120)
        seen.estimate.state[6] = 0.0 if alarm else 1.0
        x += PERIOD_S * seen.estimate.state[6]
        time_s = k * PERIOD_S
        at = rng.normal((x + east_mps * time_s, 0.0), 0.03, (2, 2)).tolist()
        named = zip((Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER), at, strict=True)
        samples = [Measurement(time_s, sensor, tuple(xy)) for sensor, xy in named]
        alarm = monitor.alarm(replace(seen, samples=samples))
    return first, alarm


@pytest.mark.parametrize("how", ["side", "wheel"])
@pytest.mark.parametrize(("east_mps", "drifts"), [(0.0, False), (0.02, True), (-0.05, True)])
def test_gnss_that_moves_while_the_vehicle_stands_drifts(how, east_mps, drifts):
    """Slips change at 24 s and ask for a check at rest; after one that was passed they are true."""
    first, alarm = drive(Alone(DetectorIndex.DRIFT), how, east_mps)
    assert first in range(121, 145)
    assert bool(alarm) is drifts
    if drifts:
        assert alarm.reaction is Reaction.STOP_ON_PATH
        speed_cmps = float(alarm.reason.split()[3])
        assert speed_cmps == pytest.approx(100.0 * abs(east_mps), abs=1.0)


def test_slips_that_stay_are_those_of_a_slope():
    first, _ = drive(Alone(DetectorIndex.DRIFT), "nothing", 0.0, ticks=200)
    assert first is None


def test_a_tool_in_the_soil_has_slips_of_its_own():
    class Towing(Alone):
        def observe(self, rows, now, sent, estimate, innovations, vehicle, view):
            towing = Vehicle(tool_behind=1.0)
            return super().observe(rows, now, sent, estimate, innovations, towing, view)

    first, _ = drive(Towing(DetectorIndex.DRIFT), "side", 0.0, ticks=200)
    assert first is None
