"""The filter: honest on its own model, quick at the start, unmoved by outliers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from tests.ttempc.sensed_drive import GNSS, PERIOD_S, REFERENCE, VEHICLE, SensedDrive
from ttempc.errors import InvalidTuning
from ttempc.estimation.augmented_state import SIZE
from ttempc.estimation.ekf import ExtendedKalmanFilter
from ttempc.estimation.measurement_model import LENGTH, predicted_measurement
from ttempc.estimation.noise import ProcessNoise
from ttempc.models.kinematics import trailer_point
from ttempc.types import Command, Measurement, Sensor, State

SEEDS = range(8)
TICKS = 250


@pytest.fixture(scope="module")
def drives():
    return [SensedDrive(seed).run(TICKS) for seed in SEEDS]


def test_state_errors_are_as_large_as_the_covariance_says(drives):
    """Mean normalised squared error at a tick within its 95 % band over independent runs.

    Ticks 4 s apart are taken as independent; the band is that of chi-square.
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
    """Innovations of a filter on its own model are white: the 95 % band is that of their number.

    With six sensors at 1 % each, the set of them fails by chance in 6 % of all seeds.
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


def test_estimate_is_nan_until_the_set_is_complete():
    state = REFERENCE.at(0.0).state
    readings = perfect_set(state, 0.0)
    estimator = ExtendedKalmanFilter(VEHICLE)
    early = estimator.update(0.0, readings[:3], None)
    assert np.isnan(early.state).all()
    later = estimator.update(PERIOD_S, perfect_set(state, PERIOD_S)[3:], None)
    assert np.isfinite(later.state).all()


def test_start_forgets_a_wrong_first_set():
    """First readings with three times their noise; after 3 s the filter is as good as any."""
    drive = SensedDrive(5)

    def spoil_first(measurements, seen=[]):  # noqa: B006 - remembers that the first set has passed
        if seen:
            return measurements
        seen.append(True)
        shifts = {1: (0.05,), 2: (0.09, -0.09)}
        return [
            replace(m, value=tuple(np.add(m.value, shifts[LENGTH[m.sensor]]))) for m in measurements
        ]

    drive.spoil = spoil_first
    errors = drive.run(60).errors()
    assert np.hypot(*errors[0, :2]) > 0.08
    assert np.abs(errors[15:, :2]).max() < 0.06


def perfect_set(state, time_s):
    belief = np.zeros(SIZE)
    belief[:7] = state
    return [
        Measurement(
            time_s, sensor, tuple(predicted_measurement(sensor, belief, VEHICLE)[0].tolist())
        )
        for sensor in LENGTH
    ]


@pytest.mark.parametrize("sensor", GNSS)
def test_outlier_of_three_metres_is_kept_out_and_reported(sensor):
    tick = 50

    def spoil(measurements):
        return [
            replace(m, value=(m.value[0] + 3.0, m.value[1]))
            if m.sensor is sensor and abs(m.time_s - tick * PERIOD_S) < 1e-6
            else m
            for m in measurements
        ]

    clean = SensedDrive(7).run(tick + 1)
    hit = SensedDrive(7, spoil=spoil).run(tick + 1)
    reported = [i for i in hit.estimates[tick].innovations if i.sensor is sensor]
    assert [i.accepted for i in reported] == [False]
    assert reported[0].normalised_squared > 1000.0
    moved = hit.estimates[tick].state - clean.estimates[tick].state
    assert np.hypot(*moved[:2]) < 0.05


def test_sensor_that_is_kept_out_for_a_second_gets_its_way():
    """A filter that is wrong must not shut itself in: here both GNSS points jump by 3 m."""

    def spoil(measurements):
        return [
            replace(m, value=(m.value[0] + 3.0, m.value[1]))
            if m.sensor in GNSS and m.time_s > 4.0
            else m
            for m in measurements
        ]

    drive = SensedDrive(8, spoil=spoil).run(120)
    errors = drive.errors()
    assert abs(errors[24, State.X]) < 0.2  # 4.8 s: still unmoved
    assert errors[-1, State.X] == pytest.approx(-3.0, abs=0.5)


def test_threefold_noise_does_not_upset_the_filter():
    """Neither sensors three times as noisy as believed, nor a process three times as rough."""
    rough = ProcessNoise(0.017, 0.0144, 0.042, 0.0144, 0.0054, 0.0102)
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
    clean, spoilt = ExtendedKalmanFilter(VEHICLE), ExtendedKalmanFilter(VEHICLE)
    for estimator in (clean, spoilt):
        estimator.update(0.0, perfect_set(state, 0.0), None)
    bad = [
        Measurement(0.1, Sensor.ENCODER, (math.nan,)),
        Measurement(0.1, Sensor.GNSS_TRACTOR, (1.0,)),  # too short
        Measurement(-1.0, Sensor.ENCODER, (1.0,)),  # too early
        Measurement(0.0, Sensor.HITCH, (0.5,)),  # there twice
        Measurement(9.0, Sensor.HITCH, (0.5,)),  # from the future
    ]
    found = spoilt.update(PERIOD_S, bad, command)
    assert [i.accepted for i in found.innovations] == [False] * len(bad)
    expected_estimate = clean.update(PERIOD_S, [], command)
    np.testing.assert_array_equal(found.state, expected_estimate.state)


def test_outage_is_predicted_and_the_covariance_grows():
    def spoil(measurements):
        return [m for m in measurements if not (m.sensor in GNSS and 5.0 < m.time_s < 7.0)]

    drive = SensedDrive(10, spoil=spoil).run(60)
    position = [np.trace(e.covariance[:2, :2]) for e in drive.estimates]
    assert position[34] > 2.0 * position[24]
    assert position[-1] < 1.5 * position[24]
    assert np.hypot(*drive.errors()[34, :2]) < 0.15


@pytest.mark.parametrize("roughness", [0.02, 4.0])
def test_roughness_of_the_ground_is_learnt(roughness):
    """From the same start, innovations soon have the size that the filter says on any ground."""
    noise = ProcessNoise(roughness=roughness)
    drives = [SensedDrive(seed, noise).run(200) for seed in (21, 22)]
    late = [i for drive in drives for e in drive.estimates[100:] for i in e.innovations]
    squares, freedom = sum(i.normalised_squared for i in late), sum(i.dimension for i in late)
    low, high = chi2.ppf([0.001, 0.999], freedom) / freedom
    assert low < squares / freedom < high


@pytest.fixture(scope="module")
def sensed():
    return SensedDrive(11).run(60)


def estimates_of(arrivals, commands, **tuning):
    estimator = ExtendedKalmanFilter(VEHICLE, **tuning)
    return [
        estimator.update(k * PERIOD_S, samples, command)
        for k, (samples, command) in enumerate(zip(arrivals, commands, strict=True))
    ]


@pytest.mark.parametrize("latest", [1, 2, 4])
def test_the_order_of_arrival_does_not_matter(sensed, latest):
    """Every sample comes up to `latest` ticks late and in any order: in the end all is the same.

    The last ticks hold nothing back. Outliers are among the samples, and a sensor that the gate
    keeps out: its patience is a matter of the samples' times, too.
    """
    ticks, generator = len(sensed.received), np.random.default_rng(latest)
    commands = [command for _, command in sensed.received]
    ordered, mixed = ([[] for _ in range(ticks)] for _ in range(2))
    for k, (samples, _) in enumerate(sensed.received):
        for sample in samples:
            if sample.sensor is Sensor.GNSS_TRAILER and 4.0 < sample.time_s < 7.0:
                sample = replace(sample, value=(sample.value[0] + 2.0, sample.value[1]))
            ordered[k].append(sample)
            late = generator.integers(latest + 1) if 0 < k < ticks - latest else 0
            mixed[k + late].append(sample)
    for samples in mixed:
        generator.shuffle(samples)
    one, other = estimates_of(ordered, commands)[-1], estimates_of(mixed, commands)[-1]
    np.testing.assert_array_equal(other.state, one.state)
    np.testing.assert_array_equal(other.covariance, one.covariance)
    np.testing.assert_array_equal(other.disturbance, one.disturbance)


def test_late_positions_cost_little(sensed):
    """GNSS samples two ticks late, as long as they come: near to what it is without latency."""
    commands = [command for _, command in sensed.received]
    arrivals = [[] for _ in range(len(commands) + 2)]
    for k, (samples, _) in enumerate(sensed.received):
        for sample in samples:
            arrivals[k + 2 * (sample.sensor in GNSS)].append(sample)
    estimates = estimates_of(arrivals[: len(commands)], commands)
    errors = np.array(sensed.states) - np.array([e.state for e in estimates])
    assert np.isnan(estimates[0].state).all(), "no position yet"
    assert np.hypot(*errors[5:, :2].T).mean() < 1.5 * np.hypot(*sensed.errors()[5:, :2].T).mean()
    assert all(i.accepted for e in estimates for i in e.innovations)


def test_samples_older_than_the_memory_and_repeated_ones_are_refused(sensed):
    commands = [command for _, command in sensed.received]
    arrivals = [samples for samples, _ in sensed.received]
    plain = estimates_of(arrivals, commands, memory_s=0.5)
    old = next(m for m in arrivals[40] if m.sensor is Sensor.GNSS_TRACTOR)
    for tick, copies in ((41, 1), (43, 2)):  # there already; older than 0.5 s
        spoilt = [list(samples) for samples in arrivals]
        spoilt[tick] += copies * [replace(old, value=(0.0, 0.0))]
        if tick == 43:
            spoilt[40].remove(old)
        found = estimates_of(spoilt, commands, memory_s=0.5)[tick]
        refused = [i for i in found.innovations if not i.accepted]
        assert [i.sensor for i in refused] == copies * [Sensor.GNSS_TRACTOR]
        if tick == 41:
            np.testing.assert_array_equal(found.state, plain[tick].state)


@pytest.mark.parametrize("memory_s", [0.0, -1.0, math.inf, math.nan])
def test_memory_must_be_finite_and_positive(memory_s):
    with pytest.raises(InvalidTuning, match="memory_s"):
        ExtendedKalmanFilter(VEHICLE, memory_s=memory_s)


def test_gate_must_be_a_probability():
    with pytest.raises(InvalidTuning, match="gate_probability"):
        ExtendedKalmanFilter(VEHICLE, gate_probability=0.0)
