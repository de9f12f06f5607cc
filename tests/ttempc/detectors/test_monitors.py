"""Monitors: begin and end of alarms, detectors of a user, choice of detectors, a whole drive."""

import copy
import re
from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.detectors.observed import (
    PERIOD_S,
    VEHICLE,
    moving,
    observation,
    observed,
    readings,
)
from tests.ttempc.sensed_drive import SensedDrive
from ttempc.detectors.interface import Alarm, Detector, Observation, Reaction
from ttempc.detectors.monitors import Monitors, chosen
from ttempc.detectors.table import BUILT_IN, DetectorIndex
from ttempc.errors import InvalidTuning
from ttempc.layout import sample_rows
from ttempc.types import Measurement, Sensor


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


WITHOUT = [f"-{row.name}" for row in BUILT_IN.values()]


def test_an_alarm_lasts_until_half_the_limit():
    monitors = Monitors([*WITHOUT, Given([3.9, 4.1, 5.0, 2.1, 1.9, 3.9])])
    alarms = [observed(monitors, observation(k)) for k in range(6)]
    assert [len(item) for item in alarms] == [0, 1, 1, 1, 0, 0]
    assert alarms[3][0].reason == "4.1"


def test_a_detector_of_ones_own_sees_what_no_alarm_of_a_built_in_one_rules_out():
    rng, own = np.random.default_rng(8), Given([0.0] * 20 + [5.0] * 2, [Sensor.ENCODER])
    monitors = Monitors([own])
    for k in range(20):
        observed(monitors, observation(k, readings(k, rng.normal(0.0, 0.01, 5).tolist())))
    stuck = [*readings(20, [0.1] * 5), *readings(20, [1.0, 1.1], Sensor.ENCODER)]
    alarms = observed(monitors, observation(20, stuck))
    assert [alarm.unused for alarm in alarms] == [{Sensor.HITCH}, {Sensor.ENCODER}]
    assert [sample.sensor for sample in own.seen[-1]] == [Sensor.ENCODER] * 2
    assert not len(monitors.usable(sample_rows(stuck)))
    assert len(observed(monitors, observation(21, readings(21, [0.2])))) == 1


def test_a_drive_without_faults_is_silent():
    monitors = Monitors()
    drive = SensedDrive(seed=4)
    drive.run(250)
    for k, ((samples, command), estimate) in enumerate(
        zip(drive.received, drive.estimates, strict=True)
    ):
        now = Observation(k * PERIOD_S, samples, command, estimate, VEHICLE)
        assert not observed(monitors, now)


def test_every_built_in_detector_has_a_row_and_a_name_of_its_own():
    assert list(BUILT_IN) == list(DetectorIndex)
    assert len({row.name for row in BUILT_IN.values()}) == len(BUILT_IN)
    for row in BUILT_IN.values():
        for reaction in Reaction:
            assert "{" not in row.alarm(reaction, [1.0, 0.0, 2.0]).reason


def test_detectors_are_chosen_by_name():
    every = frozenset(DetectorIndex)
    assert chosen(True).built_in == chosen([]).built_in == every
    assert not chosen(False).built_in
    assert chosen(["drift", "motion"]).built_in == {DetectorIndex.DRIFT, DetectorIndex.MOTION}
    assert chosen(["-drift"]).built_in == every - {DetectorIndex.DRIFT}
    own = Given([])
    assert chosen(["-drift", own]).own == (own,)
    for name in ("drifts", "-drifts", ""):
        with pytest.raises(InvalidTuning, match=f"detect: got {name!r}"):
            chosen([name])
    with pytest.raises(InvalidTuning, match=re.escape("did you mean drift?")):
        chosen(["drifts"])


@pytest.mark.parametrize("only", [True, False])
def test_a_detector_that_is_switched_off_gives_no_alarm_and_excludes_nothing(only):
    """The hitch angle repeats itself."""
    name = BUILT_IN[DetectorIndex.READINGS_HITCH].name
    monitors, rng = Monitors([name if only else f"-{name}"]), np.random.default_rng(8)
    for k in range(40):
        values = rng.normal(0.0, 0.01, 5).tolist() if k < 20 else [0.1] * 5
        samples = readings(k, values)
        alarms = observed(monitors, observation(k, samples))
    assert [alarm.detector for alarm in alarms] == ([name] if only else [])
    assert len(monitors.usable(sample_rows(samples))) == (0 if only else 5)


def test_a_copy_goes_on_as_the_original():
    monitors, rng = Monitors(), np.random.default_rng(8)
    for k in range(40):
        observed(monitors, observation(k, readings(k, rng.normal(0.0, 0.01, 5).tolist())))
    other, stuck = copy.deepcopy(monitors), readings(40, [0.1] * 5)
    assert observed(other, observation(40, stuck))
    assert not monitors.alarms
    assert observed(monitors, observation(40, stuck)) == other.alarms
    np.testing.assert_array_equal(monitors.record, other.record)


def test_after_resume_an_imu_is_used_whatever_else_is_excluded():
    """An alarm of the hitch angle excludes both IMUs until then; later the encoder is stuck."""
    monitors, rng = Monitors(), np.random.default_rng(8)
    imus = (Sensor.IMU_TRACTOR, Sensor.IMU_TRAILER)
    hitch = Measurement(0.0, Sensor.HITCH, (0.0,))
    received = sample_rows([hitch, *(Measurement(0.0, imu, (0.0, 0.0, 0.0)) for imu in imus)])
    for k in range(120):
        seen = moving(k, k * PERIOD_S, slip_t=0.2 if 50 <= k < 60 else 0.0)
        values = rng.normal(1.0, 0.1, 5).tolist() if k < 100 else [1.0] * 5
        samples = readings(k, values, Sensor.ENCODER)
        alarms = observed(monitors, replace(seen, samples=samples))
        if k == 60:
            assert not len(monitors.usable(received))
            monitors.resume()
    assert [alarm.unused for alarm in alarms] == [{Sensor.ENCODER}]
    assert len(monitors.usable(received)) == 3


@pytest.mark.parametrize("reaction", [Reaction.WARN, Reaction.SLOW])
def test_the_supervisor_has_the_words_of_the_alarm_itself(reaction):
    """Words depend on the reaction: an encoder that is not used is said as such."""
    monitors = Monitors()
    monitors.rows[DetectorIndex.WHEELS] = (reaction, 1.5, 1.0, 1.0)
    (alarm,) = monitors.alarms

    row = monitors.rows[DetectorIndex.WHEELS]
    assert monitors.reason(DetectorIndex.WHEELS, row) == alarm.reason
    assert ("encoder not used" in alarm.reason) == (reaction is Reaction.WARN)
