"""Errors of receivers: the figures of the records, and what a copy of the state goes on with."""

import tomllib
from functools import cache

import numpy as np
import pytest
from proving_ground.testbed.sensing.receivers import FIXED, SHARED_VARIANCE, TABLE, receiver

from tests.testbed import receiver_drive
from ttempc.layout import FLOAT

PERIOD = 0.2
PLACES = ("open-sky", "wood", "street")
RECORD = tomllib.loads(TABLE.read_text(encoding="utf-8"))
WRONG = 0.3  # as in the records [m]


@cache
def drive(place, speed=1.0, n=60_000, seed=1):
    """Errors (n, 4) of x and y of both antennas, and states (n, 2)."""
    return np.split(receiver_drive.drive(place, speed, n, seed, PERIOD), [4], axis=1)


def autocorrelation(errors, lag):
    return np.mean(errors[:-lag] * errors[lag:]) / np.mean(errors**2)


@pytest.mark.parametrize("place", PLACES)
def test_correct_fixes_have_the_deviation_of_the_record(place):
    errors, status = drive(place)
    for antenna in (0, 1):
        own = errors[:, 2 * antenna : 2 * antenna + 2][status[:, antenna] == FIXED]
        correct = own[np.hypot(*own.T) < WRONG]
        assert np.sqrt(np.mean(correct**2)) == pytest.approx(RECORD[place]["sd_m"], rel=0.1)
        assert receiver(place).sd == pytest.approx(RECORD[place]["sd_m"], rel=1e-6)


@pytest.mark.parametrize(
    ("speed", "lags"), [(1.0, (2.0, 5.0, 9.0, 18.0)), (0.0, (5.0, 10.0, 20.0, 60.0))]
)
def test_errors_are_forgotten_over_way_and_time(speed, lags):
    """A second-order process of u = dt / T + ds / L beside white noise; lags are seconds."""
    of = receiver("open-sky")
    errors, _ = drive("open-sky", speed)
    for lag in lags:
        u = lag / of.time + speed * lag / of.length
        expected = (1.0 - (of.white_sd / of.sd) ** 2) * (1.0 + u) * np.exp(-u)
        assert autocorrelation(errors, round(lag / PERIOD)) == pytest.approx(expected, abs=0.05)


def test_the_fitted_autocorrelation_is_near_that_of_the_record():
    """Farther than 10 m it has a standard error of about 0.1: few of its pieces are independent."""
    motion = RECORD["motion"]
    near = np.array(motion["lag_m"]) < 10.0
    apart = np.abs(np.subtract(motion["fitted"], motion["autocorrelation"]))
    assert apart[near].mean() < 0.05
    assert (apart < 0.15).all()


@pytest.mark.parametrize("place", PLACES[:2])  # in a street both are seldom fixed
def test_both_antennas_share_a_part(place):
    of = receiver(place)
    errors, status = drive(place)
    both = (status == FIXED).all(axis=1) & (np.abs(errors) < WRONG / 2).all(axis=1)
    x_t, y_t, x_i, y_i = errors[both].T
    shared = np.mean([x_t @ x_i, y_t @ y_i]) / both.sum()
    assert shared == pytest.approx(of.shared_sd**2, rel=0.25)
    correlated = of.sd**2 - of.white_sd**2
    assert of.shared_sd**2 <= SHARED_VARIANCE * correlated * (1 + 1e-9)
    assert abs(np.corrcoef(x_t, y_i)[0, 1]) < 0.1


@pytest.mark.parametrize("place", ["wood", "street"])
@pytest.mark.parametrize("speed", [0.0, 3.0])
def test_fix_and_float_change_at_the_rates_of_the_record(place, speed):
    own = RECORD[place]
    lost, found = (own[f"{n}_per_s"] + speed * own[f"{n}_per_m"] for n in ("lost", "found"))
    status = drive(place, speed)[1]
    assert set(np.unique(status)) == {FIXED, FLOAT}
    assert np.mean(status == FIXED) == pytest.approx(found / (lost + found), abs=0.02)
    leave = np.mean(status[1:][status[:-1] == FIXED] == FLOAT)
    chain = lost / (lost + found) * -np.expm1(-(lost + found) * PERIOD)
    assert leave == pytest.approx(chain, rel=0.1)


def test_no_fix_is_lost_under_an_open_sky():
    assert (drive("open-sky")[1] == FIXED).all()


def test_wrong_fixes_say_that_they_are_fixed():
    errors, status = drive("street")
    own = errors[:, :2][status[:, 0] == FIXED]
    share = np.mean(np.hypot(*own.T) > WRONG)
    assert share == pytest.approx(RECORD["street"]["wrong_share"], rel=0.25)


@pytest.mark.parametrize("place", ["wood", "street"])
def test_a_float_solution_starts_near_the_fix_and_leaves_it(place):
    errors, status = drive(place, 3.0)
    floats = status[:, 0] == FLOAT
    first = np.flatnonzero(floats[1:] & ~floats[:-1]) + 1
    later = np.flatnonzero(np.lib.stride_tricks.sliding_window_view(floats, 20).all(axis=1)) + 19
    of = receiver(place)
    for rows, sd in ((first, of.float_first_sd), (later, of.float_sd)):
        expected = np.hypot(sd, of.sd)
        assert np.sqrt(np.mean(errors[rows, :2] ** 2)) == pytest.approx(expected, rel=0.15)


def test_the_first_epoch_is_that_of_a_long_drive():
    first = np.array([drive("wood", n=1, seed=seed)[0][0, 0] for seed in range(1000)])
    assert np.median(np.abs(first)) == pytest.approx(0.6745 * receiver("wood").sd, rel=0.1)
