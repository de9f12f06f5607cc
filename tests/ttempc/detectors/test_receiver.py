"""Status of a receiver: its way into the detectors, and the reaction to each warning."""

import pytest

from tests.ttempc.detectors.observed import observation, observed
from ttempc.detectors.interface import Reaction
from ttempc.detectors.monitors import Monitors
from ttempc.layout import sample_rows
from ttempc.sensors import SensorIndex
from ttempc.types import Measurement, ReceiverStatus, Sensor


def seen(k, status, sensor=Sensor.GNSS_TRACTOR):
    return observation(k, [Measurement(0.2 * k, sensor, (0.0, 0.0), 1, status)])


@pytest.mark.parametrize(
    ("status", "reaction", "words"),
    [
        (ReceiverStatus(spoofed=True), Reaction.STOP_ON_PATH, "spoofed"),
        (ReceiverStatus(jammed=True), Reaction.WARN, "jammed"),
        (ReceiverStatus(satellites=4), Reaction.WARN, "few satellites"),
        (ReceiverStatus(dead_reckoning=True), Reaction.WARN, "dead reckoning"),
        (ReceiverStatus(correction_age_s=90.0), Reaction.SLOW, "90 s old"),
        (ReceiverStatus(protection_m=2.0), Reaction.SLOW, "2.0 m"),
        (ReceiverStatus(spoofed=True, protection_m=2.0), Reaction.STOP_ON_PATH, "spoofed"),
    ],
)
def test_each_warning_has_its_reaction_until_it_is_taken_back(status, reaction, words):
    monitors = Monitors(["receiver of the trailer"])
    (alarm,) = observed(monitors, seen(0, status, Sensor.GNSS_TRAILER))
    assert alarm.reaction is reaction
    assert words in alarm.reason
    assert observed(monitors, observation(1))  # silence takes nothing back
    assert not observed(monitors, seen(2, ReceiverStatus(satellites=12), Sensor.GNSS_TRAILER))


def test_positions_of_dead_reckoning_are_not_used():
    monitors = Monitors(["receiver of the tractor"])
    observed(monitors, seen(0, ReceiverStatus(dead_reckoning=True)))
    rows = sample_rows(
        [
            Measurement(0.2, Sensor.GNSS_TRACTOR, (0.0, 0.0)),
            Measurement(0.2, Sensor.GNSS_TRAILER, (0.0, 0.0)),
        ]
    )
    assert monitors.usable(rows)[:, 1].tolist() == [SensorIndex.GNSS_TRAILER]


def test_a_status_is_a_row_behind_that_of_its_position():
    status = ReceiverStatus(jammed=True, correction_age_s=1.5)
    rows = sample_rows([Measurement(1.0, Sensor.GNSS_TRAILER, (3.0, 4.0), 1, status)])
    assert rows.tolist() == [
        [1.0, SensorIndex.GNSS_TRAILER, 3.0, 4.0, 1.0],
        [1.0, SensorIndex.RECEIVER_TRAILER, 4.0, 1.5, 0.0],
    ]
