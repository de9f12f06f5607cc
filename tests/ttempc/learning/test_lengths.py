"""Identification of lengths: on the filter's own model as the plant, whose lengths are known."""

from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.sensed_drive import PERIOD_S, VEHICLE, SensedDrive
from ttempc.estimation.noise import ProcessNoise, SensorNoise
from ttempc.learning.learner import LENGTHS
from ttempc.learning.lengths import LengthIdentifier, fit_lengths
from ttempc.learning.window import RecordedTick
from ttempc.types import Sensor

TRUE = np.array([getattr(VEHICLE, name) for name in LENGTHS])
NOISE, PROCESS = SensorNoise(), ProcessNoise()


def scaled(*factors):
    return replace(VEHICLE, **dict(zip(LENGTHS, (TRUE * factors).tolist(), strict=True)))


@pytest.fixture(scope="module")
def window():
    """80 s of the figure eight: a straight, a whole circle, a straight."""
    drive = SensedDrive(seed=8).run(400)
    return [
        RecordedTick(k * PERIOD_S, tuple(samples), command, tuple(estimate.state[2:4].tolist()))
        for k, ((samples, command), estimate) in enumerate(
            zip(drive.received, drive.estimates, strict=True)
        )
    ]


@pytest.mark.parametrize(
    "factors", [(1.24, 1.09, 1.2, 0.92), (0.7, 0.7, 0.7, 0.7), (1.3, 0.7, 1.3, 0.7)]
)
def test_wrong_lengths_are_found_within_their_covariance(window, factors):
    given = scaled(*factors)
    fit = fit_lengths(window, given, given, NOISE, PROCESS)
    assert fit is not None
    error = fit.lengths - TRUE
    # chi-square with 4 degrees of freedom: 18.5 is exceeded with a probability of 0.1 %, to which
    # the pull of the prior towards lengths 30 % off adds.
    assert error @ np.linalg.solve(fit.covariance, error) < 25.0
    wheelbase, trailer = (fit.lengths / TRUE - 1.0)[[0, 3]]
    assert abs(wheelbase) < 0.08
    assert abs(trailer) < 0.08
    assert abs(error[1:].sum()) < 0.01  # hitch offset, drawbar and trailer together


def test_right_lengths_stay_and_wrong_ones_go(window):
    kept = LengthIdentifier(VEHICLE, NOISE).identify(window, VEHICLE)
    assert kept.vehicle == VEHICLE
    assert kept.changes == ()
    assert kept.settled
    given = scaled(1.2, 1.0, 1.0, 1.0)
    learnt = LengthIdentifier(given, NOISE).identify(window, given)
    assert abs(learnt.vehicle.wheelbase - VEHICLE.wheelbase) < 0.1
    assert [change.name for change in learnt.changes] == list(LENGTHS)
    assert replace(learnt.vehicle, **dict(zip(LENGTHS, TRUE.tolist(), strict=True))) == VEHICLE
    again = LengthIdentifier(given, NOISE).identify(window, learnt.vehicle)
    assert again.changes == ()  # the same data ask for no further change


def test_a_length_at_the_end_of_its_range_is_none(window):
    given = scaled(2.0, 1.0, 1.0, 1.0)  # the true wheelbase is less than 0.65 of it
    assert fit_lengths(window, given, given, NOISE, PROCESS) is None
    assert LengthIdentifier(given, NOISE).identify(window, given).vehicle == given


def test_lengths_that_slips_of_curves_could_feign_stay(window):
    given = scaled(1.15, 1.0, 1.0, 1.0)
    stiff = replace(given, compliance_t=0.0, compliance_i=0.0)
    assert LengthIdentifier(stiff, NOISE).identify(window, stiff).vehicle != stiff
    soft = replace(given, compliance_t=0.1, compliance_i=0.1)  # 0.1 m of lengths at 1 m/s
    assert LengthIdentifier(soft, NOISE).identify(window, soft).vehicle == soft


def test_on_a_straight_only_the_sum_behind_the_rear_axle_is_seen(window):
    straight = window[:78]  # the first circle begins at 17 s or later, its transition before
    given = scaled(1.0, 1.1, 1.1, 1.1)
    fit = fit_lengths(straight, given, given, NOISE, PROCESS)
    assert fit is not None
    assert abs((fit.lengths - TRUE)[1:].sum()) < 0.02
    sd = np.sqrt(np.diag(fit.covariance))
    assert sd[1:].min() > 4.0 * np.sqrt(fit.covariance[1:, 1:].sum())
    kept = LengthIdentifier(given, NOISE).identify(straight, given)
    assert kept.vehicle == given
    assert not kept.settled


@pytest.mark.parametrize("sensor", [Sensor.GNSS_TRAILER, Sensor.HITCH])
def test_without_a_sensor_or_time_nothing_is_identified(window, sensor):
    blind = [
        replace(tick, samples=tuple(s for s in tick.samples if s.sensor is not sensor))
        for tick in window
    ]
    for unusable in (blind, window[:50], window[:1], []):
        assert fit_lengths(unusable, VEHICLE, VEHICLE, NOISE, PROCESS) is None


@pytest.mark.parametrize("prior", [0.1, 0.24])
def test_a_trailer_whose_tool_holds_nothing_turns_about_its_axle(window, prior):
    given = replace(VEHICLE, tool_behind=0.6, trailer_turning_offset=prior)
    fit = fit_lengths(window, given, given, NOISE, PROCESS)
    assert fit is not None
    sd = np.sqrt(fit.covariance[4, 4])
    pull = prior * (sd / (0.2 * given.tool_behind)) ** 2  # of the prior, for one unknown
    assert 0.0 <= fit.lengths[4] < pull + 2.5 * sd
    assert sd < 0.07  # of 0.12 before
