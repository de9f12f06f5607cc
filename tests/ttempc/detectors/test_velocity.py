"""Velocity: positions that drift from the integral of the velocities of the same receivers."""

from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.detectors.observed import PERIOD_S, VEHICLE, observed
from ttempc.detectors.interface import Observation, Reaction
from ttempc.detectors.kernel import DETECTORS
from ttempc.detectors.monitors import Monitors
from ttempc.detectors.table import BUILT_IN, DetectorIndex
from ttempc.layout import FLOAT
from ttempc.types import Estimate, Measurement, Sensor

NAMES = [BUILT_IN[index].name for index in (DetectorIndex.VELOCITY, DetectorIndex.VELOCITY_SURE)]
CLOCK = BUILT_IN[DetectorIndex.CLOCK].name
STEPS = BUILT_IN[DetectorIndex.STEPS].name
BODIES = ("tractor", "trailer")
START_S = 30.0


class Receivers:
    """Two receivers on a vehicle that drives east on a weaving line, with white errors."""

    def __init__(
        self,
        seed=1,
        velocity_sd=0.03,
        floats=False,
        ageing=0.0,
        names=(*NAMES, CLOCK),
        position_sd=0.03,
        ticks=1,
    ):
        self.rng = np.random.default_rng(seed)
        self.position_sd = position_sd
        self.ticks = ticks  # of the control in a period of the receivers
        self.names = names
        self.monitors = Monitors([*names])
        self.ageing = ageing  # by which the delay of the samples grows [s/s] from `START_S` on
        self.velocity_sd = velocity_sd
        self.floats = floats  # for two seconds from the start of the error on

    def first(self, error, seconds=60.0):
        """Drive with an error of the positions (2,) as a function of the time since its start.

        Returns the time [s] since then of the first alarm of each name, by default of both limits
        and of the clock, NaN where there is none, and the alarms at the end.
        """
        limits = dict.fromkeys(self.names, np.nan)
        alarms = ()
        for k in range(round((START_S + seconds) / PERIOD_S)):
            since_s = k * PERIOD_S - START_S
            wrong = np.asarray(error(since_s)) if since_s >= 0.0 else np.zeros(2)
            seen = self._seen(k * PERIOD_S, wrong)
            alarms = observed(self.monitors, seen)
            for tick in range(1, self.ticks):
                later_s = (k + tick / self.ticks) * PERIOD_S
                alarms = observed(self.monitors, replace(seen, time_s=later_s, samples=[]))
            for alarm in alarms:
                if np.isnan(limits.get(alarm.detector, 0.0)):
                    limits[alarm.detector] = since_s
        return tuple(limits.values()), alarms

    def _seen(self, time_s, wrong):
        place = np.array([time_s, np.sin(0.3 * time_s)])
        velocity = np.array([1.0, 0.3 * np.cos(0.3 * time_s)])
        status = FLOAT if self.floats and START_S <= time_s < START_S + 2.0 else 1
        time_s += self.ageing * max(0.0, time_s - START_S)  # stamped on arrival
        samples = []
        for body in BODIES:
            at = place + wrong + self.rng.normal(0.0, self.position_sd, 2)
            samples.append(Measurement(time_s, Sensor(f"gnss_{body}"), tuple(at), int(status)))
            moves = velocity + self.velocity_sd * self.rng.standard_normal(2)
            samples.append(Measurement(time_s, Sensor(f"velocity_{body}"), (*moves, 0.03)))
        estimate = Estimate(time_s, np.zeros(7), 1e-4 * np.eye(7), np.zeros(2), 0.0)
        return Observation(time_s, samples, None, estimate, VEHICLE)


@pytest.mark.parametrize("direction", [0.0, 2.0, 4.0])
def test_a_drift_slows_the_vehicle_then_stops_it_whatever_its_direction(direction):
    along = np.array([np.cos(direction), np.sin(direction)])
    (slow_s, stop_s, _), alarms = Receivers().first(lambda t: 0.03 * t * along, seconds=30.0)
    assert 0.0 < slow_s < stop_s < 15.0
    assert [alarm.reaction for alarm in alarms] == [Reaction.SLOW, Reaction.STOP_ON_PATH]
    assert float(alarms[-1].reason.split()[3]) == pytest.approx(3.0, abs=1.0)
    assert alarms[-1].unused == {Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER}


def test_a_faster_drift_is_found_sooner_and_a_step_of_thirty_centimetres_is_not_believed():
    (slow, _, _), _ = Receivers().first(lambda t: (0.0, 0.03 * t), seconds=20.0)
    (fast, _, _), _ = Receivers().first(lambda t: (0.0, 0.10 * t), seconds=20.0)
    assert fast < slow
    (_, step, _), _ = Receivers().first(lambda t: (0.3, 0.0), seconds=20.0)
    assert step < 3.0


def test_without_an_error_and_with_single_outliers_there_is_no_alarm():
    limits, _ = Receivers().first(lambda t: (0.0, 0.0), seconds=300.0)
    assert np.isnan(limits).all()
    limits, _ = Receivers().first(lambda t: (3.0 * (round(t / PERIOD_S) % 10 == 0), 0.0))
    assert np.isnan(limits).all()


def test_a_velocity_without_noise_is_no_measurement_and_is_not_used():
    limits, _ = Receivers(velocity_sd=0.0).first(lambda t: (0.05 * t, 0.0))
    assert np.isnan(limits).all()


def test_another_fix_after_a_float_solution_begins_anew():
    limits, _ = Receivers(floats=True).first(lambda t: (0.3, 0.0))
    assert np.isnan(limits).all()


def test_an_operator_ends_the_alarm():
    receivers = Receivers()
    _, alarms = receivers.first(lambda t: (0.3, 0.0), seconds=20.0)
    assert alarms
    receivers.monitors.resume()
    assert not receivers.monitors.alarms
    memory = receivers.monitors.record.view(DETECTORS)[0]["velocity"]
    assert memory["wander_mps"] == 0.002


def test_samples_whose_delay_grows_are_named_by_the_clock_long_before():
    """A stamp that runs late by d moves positions by v d: 2 cm/s here, but no drift."""
    (slow_s, _, clock_s), _ = Receivers(ageing=0.02).first(lambda t: (0.0, 0.0), seconds=40.0)
    assert clock_s < 10.0
    assert slow_s > 1.5 * clock_s


def stairs(rise_m, every_s, direction):
    along = np.array([np.cos(direction), np.sin(direction)])
    return lambda since_s: rise_m * (1.0 + since_s // every_s) * along


def stepping(seed, position_sd=0.03, ticks=1):
    """Return receivers without an encoder beside them: there is no dead reckoning."""
    return Receivers(seed, names=(*NAMES, STEPS), position_sd=position_sd, ticks=ticks)


@pytest.mark.parametrize("ticks", [1, 5])
@pytest.mark.parametrize("direction", [0.0, 2.0, 4.0])
@pytest.mark.parametrize("rise_m", [0.07, 0.15, 0.3])
def test_stairs_are_noticed_by_the_velocities_before_they_are_half_a_metre(
    rise_m, direction, ticks
):
    error = stairs(rise_m, 10.0, direction)
    times, alarms = stepping(2, ticks=ticks).first(error, seconds=100.0)
    assert np.hypot(*error(np.nanmin(times))) < 0.5
    assert alarms[-1].reaction is Reaction.STOP_ON_PATH


def test_noise_and_a_bump_that_goes_back_are_no_stairs():
    for seed, error in ((3, lambda t: (0.0, 0.0)), (4, lambda t: (0.12 * (t < 20.0), 0.0))):
        (*_, noticed_s), _ = stepping(seed).first(error, seconds=600.0)
        assert np.isnan(noticed_s)


@pytest.mark.parametrize("position_sd", [0.008, 0.1, 0.3])
def test_noise_of_any_size_is_no_stairs(position_sd):
    (*_, noticed_s), _ = stepping(5, position_sd).first(lambda t: (0.0, 0.0), seconds=600.0)
    assert np.isnan(noticed_s)
