"""Innovations: those of a consistent filter, and larger ones."""

import numpy as np
import pytest

from tests.ttempc.detectors.observed import Alone, observation
from ttempc.detectors.interface import Reaction
from ttempc.detectors.table import DetectorIndex
from ttempc.types import Innovation, Sensor

KINDS = {
    DetectorIndex.INNOVATIONS_GNSS_TRACTOR: (Sensor.GNSS_TRACTOR, 2),
    DetectorIndex.INNOVATIONS_GNSS_TRAILER: (Sensor.GNSS_TRAILER, 2),
    DetectorIndex.INNOVATIONS_HITCH: (Sensor.HITCH, 1),
    DetectorIndex.INNOVATIONS_ENCODER: (Sensor.ENCODER, 1),
}


def test_the_statistic_of_consistent_innovations_is_standard_normal():
    """Chi-square sums of 5 samples of two entries, each in a second of its own.

    The negative half counts as 0.
    """
    squares = np.random.default_rng(3).chisquare(2, (4000, 5)).tolist()
    monitor, values = Alone(DetectorIndex.INNOVATIONS_GNSS_TRACTOR), []
    for n, of_second in enumerate(squares):
        given = [Innovation(Sensor.GNSS_TRACTOR, square, 2) for square in of_second]
        monitor.alarm(observation(6 * n, innovations=given))
        values.append(monitor.statistic)
    for level, share in ((1.0, 0.1587), (2.0, 0.02275)):
        assert np.mean(np.array(values) > level) == pytest.approx(share, rel=0.25)


@pytest.mark.parametrize("index", KINDS)
@pytest.mark.parametrize("scale", [1.0, 6.0])
def test_innovations_six_times_their_standard_deviation_are_an_alarm_consistent_ones_none(
    index, scale
):
    """Five of each tick from 2 s on, of which the alarm is reported only."""
    sensor, dimension = KINDS[index]
    rng, monitor, noticed = np.random.default_rng(7), Alone(index), []
    for k in range(100):
        factor = scale**2 if k >= 10 else 1.0
        squares = factor * rng.chisquare(dimension, 5)
        given = [Innovation(sensor, float(square), dimension) for square in squares]
        alarm = monitor.alarm(observation(k, innovations=given))
        noticed += [k] if alarm else []
    assert (10 <= noticed[0] <= 15) if scale > 1.0 else not noticed
    assert scale == 1.0 or (alarm.reaction is Reaction.WARN and not alarm.unused)


def test_a_single_outlier_is_no_alarm():
    """As the gate of the filter rejects it: its square is 10,000."""
    rng, monitor = np.random.default_rng(8), Alone(DetectorIndex.INNOVATIONS_HITCH)
    for k in range(60):
        squares = rng.chisquare(1, 5)
        squares[0] = 1e4 if k == 30 else squares[0]
        given = [Innovation(Sensor.HITCH, float(square), 1) for square in squares]
        assert not monitor.alarm(observation(k, innovations=given))
