"""Extended Kalman filter: consistency, start, outliers, late samples and time stamps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from tests.ttempc.sensed_drive import GNSS, PERIOD_S, REFERENCE, VEHICLE, SensedDrive
from ttempc.errors import InvalidTuning
from ttempc.estimation.ekf import ExtendedKalmanFilter
from ttempc.estimation.noise import ProcessNoise, SensorNoise
from ttempc.models.augmented_state import LENGTH, SIZE, STATES, predicted_measurement
from ttempc.models.kinematics import trailer_point
from ttempc.types import Command, Measurement, Sensor, State

SEEDS = range(8)
TICKS = 250


@pytest.fixture(scope="module")
def drives():
    return [SensedDrive(seed).run(TICKS) for seed in SEEDS]


def test_state_errors_are_as_large_as_the_covariance_says(drives):
    """The mean normalised squared error lies within the 95 % band of chi-square.

    Ticks 4 s apart are taken as independent.
    """
    ticks = range(20, TICKS, 20)
    squares = []
    for drive in drives:
        errors = drive.errors()
        squares += [
            errors[k] @ np.linalg.solve(drive.estimates[k].covariance, errors[k]) for k in ticks
        ]
    freedom = 7 * len(squares)
    low, high = chi2.ppf([0.025, 0.975], freedom) / freedom
    assert low < np.sum(squares) / freedom < high


@pytest.mark.parametrize("sensor", LENGTH)
def test_innovations_are_as_large_as_predicted(drives, sensor):
    """Innovations of a filter on its own model are white: their mean square has a 99 % band.

    Six sensors together leave it by chance for 6 % of all seeds.
    """
    squares = np.concatenate([drive.normalised_innovations(sensor) for drive in drives])
    freedom = LENGTH[sensor] * len(squares)
    low, high = chi2.ppf([0.005, 0.995], freedom) / freedom
    assert low < squares.sum() / freedom < high


def test_estimate_is_complete_and_consistent(drives):
    for estimate in drives[0].estimates:
        np.testing.assert_array_equal(estimate.covariance, estimate.covariance.T)
        assert np.linalg.eigvalsh(estimate.covariance).min() > 0.0
        np.testing.assert_array_equal(estimate.trailer_xy, trailer_point(estimate.state, VEHICLE))
        psi_t, psi_i, _, delta_i = estimate.state[State.PSI_T : State.V]
        assert estimate.hitch_angle == pytest.approx(psi_t - psi_i - delta_i)


def test_position_is_better_than_gnss(drives):
    errors = np.concatenate([drive.errors()[40:] for drive in drives])
    assert np.sqrt(np.mean(errors[:, :2] ** 2)) < 0.02  # each axis; a single fix has 0.03


def test_filter_starts_from_the_first_set_whatever_the_heading():
    for heading in (-3.0, -1.0, 0.5, 3.1):
        state = np.array([3.0, -2.0, heading, heading - 0.3, 0.1, 0.2, 1.0])
        estimate = ExtendedKalmanFilter(VEHICLE).update(0.0, perfect_set(state, 0.0), None)
        difference = estimate.state - state
        difference[2:4] = [math.remainder(angle, math.tau) for angle in difference[2:4]]
        np.testing.assert_allclose(difference, 0.0, atol=1e-9)


def test_both_receivers_at_one_place_give_no_heading_and_the_filter_starts_later():
    state, estimator = REFERENCE.at(0.0).state, ExtendedKalmanFilter(VEHICLE)
    for k in range(20):
        readings = perfect_set(state, 0.2 * k)
        if k < 4:
            readings = [
                replace(item, value=(0.0, 0.0)) if len(item.value) == 2 else item
                for item in readings
            ]
        estimate = estimator.update(0.2 * k, readings, None)
        assert k >= 4 or np.isnan(estimate.state).all()
    assert np.isfinite(estimate.state).all()


def test_estimate_is_nan_until_the_set_is_complete():
    state = REFERENCE.at(0.0).state
    readings = perfect_set(state, 0.0)
    estimator = ExtendedKalmanFilter(VEHICLE)
    early = estimator.update(0.0, readings[:3], None)
    assert np.isnan(early.state).all()
    later = estimator.update(PERIOD_S, perfect_set(state, PERIOD_S)[3:], None)
    assert np.isfinite(later.state).all()


def test_the_filter_recovers_from_wrong_first_readings():
    """First readings with three times their noise; after 3 s the filter is as good as any."""
    drive = SensedDrive(5)

    def corrupt_first(measurements):
        if measurements[0].time_s > 0.0:
            return measurements
        shifts = {1: (0.05,), 2: (0.09, -0.09)}
        return [
            replace(m, value=tuple(np.add(m.value, shifts[LENGTH[m.sensor]]))) for m in measurements
        ]

    drive.corrupt = corrupt_first
    errors = drive.run(60).errors()
    assert np.hypot(*errors[0, :2]) > 0.08
    assert np.abs(errors[15:, :2]).max() < 0.06


def perfect_set(state, time_s):
    augmented = np.concatenate([state, np.zeros(SIZE - STATES)])
    return [
        Measurement(
            time_s, sensor, tuple(predicted_measurement(sensor, augmented, VEHICLE)[0].tolist())
        )
        for sensor in LENGTH
    ]


@pytest.mark.parametrize("sensor", GNSS)
def test_outlier_of_three_metres_is_rejected_and_reported(sensor):
    tick = 50

    def corrupt(measurements):
        return [
            replace(m, value=(m.value[0] + 3.0, m.value[1]))
            if m.sensor is sensor and abs(m.time_s - tick * PERIOD_S) < 1e-6
            else m
            for m in measurements
        ]

    clean = SensedDrive(7).run(tick + 1)
    hit = SensedDrive(7, corrupt=corrupt).run(tick + 1)
    reported = [i for i in hit.estimates[tick].innovations if i.sensor is sensor]
    assert [i.accepted for i in reported] == [False]
    assert reported[0].normalised_squared > 1000.0
    moved = hit.estimates[tick].state - clean.estimates[tick].state
    assert np.hypot(*moved[:2]) < 0.05


def test_sensor_that_is_rejected_for_a_second_is_accepted():
    """A wrong filter must return to its sensors: here both GNSS points jump by 3 m."""

    def corrupt(measurements):
        return [
            replace(m, value=(m.value[0] + 3.0, m.value[1]))
            if m.sensor in GNSS and m.time_s > 4.0
            else m
            for m in measurements
        ]

    drive = SensedDrive(8, corrupt=corrupt).run(120)
    errors = drive.errors()
    assert abs(errors[24, State.X]) < 0.2  # 4.8 s: still unmoved
    assert errors[-1, State.X] == pytest.approx(-3.0, abs=0.5)


def test_the_filter_stays_stable_under_threefold_noise():
    """Sensors three times as noisy as in the model, and process noise three times as large."""
    rough = ProcessNoise(
        slip_forward=0.017,
        slip_lateral=0.0144,
        yaw_t=0.042,
        yaw_i=0.0144,
        steering=0.0054,
        drive=0.0102,
    )
    for drive in (
        SensedDrive(9, sensor_scale=3.0).run(200),
        SensedDrive(9, process_noise=rough).run(200),
        SensedDrive(
            9, process_noise=rough, estimator=ExtendedKalmanFilter(VEHICLE, None, rough)
        ).run(200),
    ):
        errors = drive.errors()
        assert np.isfinite(errors).all()
        assert np.hypot(errors[:, 0], errors[:, 1]).max() < 0.5
        assert np.linalg.eigvalsh(drive.estimates[-1].covariance).min() > 0.0


def test_samples_that_cannot_be_used_are_reported_and_change_nothing():
    state = REFERENCE.at(0.0).state
    command = Command(0.0, 0.0, 1.0 / VEHICLE.speed_gain)
    clean, tested = ExtendedKalmanFilter(VEHICLE), ExtendedKalmanFilter(VEHICLE)
    for estimator in (clean, tested):
        estimator.update(0.0, perfect_set(state, 0.0), None)
    bad = [
        Measurement(0.1, Sensor.ENCODER, (math.nan,)),
        Measurement(0.1, Sensor.GNSS_TRACTOR, (1.0,)),  # too short
        Measurement(-1.0, Sensor.ENCODER, (1.0,)),  # too early
        Measurement(0.0, Sensor.HITCH, (0.5,)),  # repeated
        Measurement(9.0, Sensor.HITCH, (0.5,)),  # from the future
    ]
    estimate = tested.update(PERIOD_S, bad, command)
    assert [i.accepted for i in estimate.innovations] == [False] * len(bad)
    expected_estimate = clean.update(PERIOD_S, [], command)
    np.testing.assert_array_equal(estimate.state, expected_estimate.state)


def test_outage_is_predicted_and_the_covariance_grows():
    def corrupt(measurements):
        return [m for m in measurements if not (m.sensor in GNSS and 5.0 < m.time_s < 7.0)]

    drive = SensedDrive(10, corrupt=corrupt).run(60)
    position = [np.trace(e.covariance[:2, :2]) for e in drive.estimates]
    assert position[34] > 2.0 * position[24]
    assert position[-1] < 1.5 * position[24]
    assert np.hypot(*drive.errors()[34, :2]) < 0.15


@pytest.mark.parametrize(
    "true", [{"roughness": 0.02}, {"roughness": 4.0}, {"wheel": 3.0}, {"valves": 300.0}]
)
def test_factors_of_the_noise_are_learnt(true):
    """From the same start, innovations have their predicted size after 40 s on any ground."""
    drives = [SensedDrive(seed, ProcessNoise(**true)).run(300) for seed in (21, 22)]
    late = [i for drive in drives for e in drive.estimates[200:] for i in e.innovations]
    squares, freedom = sum(i.normalised_squared for i in late), sum(i.dimension for i in late)
    low, high = chi2.ppf([0.001, 0.999], freedom) / freedom
    assert low < squares / freedom < high


def test_slow_errors_of_two_receivers_are_in_the_covariance():
    """Receivers that are 4 cm off to opposite sides: a filter that takes errors as white is sure
    of a wrong heading."""

    def corrupt(measurements):
        shift = {Sensor.GNSS_TRACTOR: -0.03, Sensor.GNSS_TRAILER: 0.03}
        return [
            replace(m, value=(m.value[0], m.value[1] + shift[m.sensor])) if m.sensor in GNSS else m
            for m in measurements
        ]

    nees = {}
    for share in (1.0, 0.1):
        noise = SensorNoise(gnss=0.04, gnss_white_share=share)
        estimator = ExtendedKalmanFilter(VEHICLE, noise)
        drive = SensedDrive(12, corrupt=corrupt, estimator=estimator).run(200)
        variances = np.array([np.diag(e.covariance) for e in drive.estimates])
        nees[share] = np.mean((drive.errors() ** 2 / variances)[50:], axis=0)
    affected = [State.Y, State.PSI_T, State.PSI_I]
    assert nees[1.0][affected].min() > 2.0
    assert (nees[0.1][affected] < 0.6 * nees[1.0][affected]).all()


@pytest.mark.parametrize("memory_s", [0.0, -1.0, math.inf, math.nan])
def test_memory_must_be_finite_and_positive(memory_s):
    with pytest.raises(InvalidTuning, match="memory_s"):
        ExtendedKalmanFilter(VEHICLE, memory_s=memory_s)


def test_gate_must_be_a_probability():
    with pytest.raises(InvalidTuning, match="gate_probability"):
        ExtendedKalmanFilter(VEHICLE, gate_probability=0.0)
