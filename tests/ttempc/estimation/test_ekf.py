"""Extended Kalman filter: consistency, start, outliers, late samples, dead times, gyros."""

from __future__ import annotations

import copy
import functools
import importlib
import itertools
import math
import pickle
import pkgutil
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from tests.reference.estimation.augmented_state import predicted_measurement
from tests.ttempc.sensed_drive import GNSS, PERIOD_S, REFERENCE, VEHICLE, SensedDrive
from ttempc.estimation import filter as filter_package
from ttempc.estimation.ekf import ExtendedKalmanFilter
from ttempc.estimation.filter.sample import turned
from ttempc.estimation.noise import ProcessNoise, SensorNoise
from ttempc.layout import sample_rows
from ttempc.learning.replay import axle_points
from ttempc.models import augmented_state, measurement
from ttempc.models.augmented_state import SIZE, STATES, AugmentedState
from ttempc.sensors import ROW_OF, STARTING_SENSORS
from ttempc.types import Command, Estimate, FloatArray, Measurement, Sensor, State

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


@pytest.mark.parametrize("sensor", STARTING_SENSORS)
def test_innovations_are_as_large_as_predicted(drives, sensor):
    """Innovations of a filter on its own model are white: their mean square has a 99 % band.

    Six sensors together leave it by chance for 6 % of all seeds.
    """
    squares = np.concatenate([drive.normalised_innovations(sensor) for drive in drives])
    freedom = ROW_OF[sensor].length * len(squares)
    low, high = chi2.ppf([0.005, 0.995], freedom) / freedom
    assert low < squares.sum() / freedom < high


@pytest.mark.parametrize("named", [True, False])
def test_without_its_hydrostat_the_filter_goes_as_fast_as_the_wheels(named):
    """The vehicle rolls on at 1 m/s under a command to stop; the filter knows that or does not."""
    drive = SensedDrive(3).run(100)
    sensed, commands = zip(*drive.received, strict=True)
    estimator = ExtendedKalmanFilter(VEHICLE)
    for k, (samples, command) in enumerate(zip(sensed, commands, strict=True)):
        sent = command
        if k >= 50:
            sent = replace(command, hp=math.nan if named else 0.0)
        estimate = estimator.update(k * PERIOD_S, samples, sent)
    error = estimate.state - drive.states[-1]
    assert (abs(error[State.V]) < 0.05) == named
    assert (math.hypot(*error[:2]) < 0.1) == named


def test_estimate_is_nan_until_the_set_is_complete():
    state = REFERENCE.at(0.0).state
    readings = perfect_set(state, 0.0)
    estimator = ExtendedKalmanFilter(VEHICLE)
    early = estimator.update(0.0, readings[:3], None)
    assert np.isnan(early.state).all()
    later = estimator.update(PERIOD_S, perfect_set(state, PERIOD_S)[3:], None)
    assert np.isfinite(later.state).all()


def perfect_set(state, time_s):
    augmented = np.concatenate([state, np.zeros(SIZE - STATES)])
    return [
        Measurement(time_s, s, tuple(predicted_measurement(s, augmented, VEHICLE)[0].tolist()))
        for s in STARTING_SENSORS
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
    assert errors[50, State.X] < -0.5  # 10 s: on its way since 5 s
    assert errors[-1, State.X] == pytest.approx(-3.0, abs=0.5)


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
    """Every sample comes up to `latest` ticks late, in random order; the last ones are in time.

    The gate rejects one sensor for a while: its patience refers to the times of samples, too.
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


def same(one, other):
    fields = "state", "covariance", "disturbance", "map_disturbance", "noise_factors"
    for name in fields:
        np.testing.assert_array_equal(getattr(other, name), getattr(one, name))
    assert other.innovations == one.innovations


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda e: pickle.loads(pickle.dumps(e))])
def test_a_copy_goes_on_like_the_filter_itself_from_rows_as_from_measurements(sensed, copied):
    one = ExtendedKalmanFilter(VEHICLE)
    for k, (samples, command) in enumerate(sensed.received):
        if k == 30:
            other = copied(one)
        estimate = one.update(k * PERIOD_S, samples, command)
        if k >= 30:
            same(estimate, other.update(k * PERIOD_S, sample_rows(samples), command))


def test_the_epoch_of_the_clock_does_not_matter(sensed):
    one, other, epoch = ExtendedKalmanFilter(VEHICLE), ExtendedKalmanFilter(VEHICLE), 1.7e9
    for k, (samples, command) in enumerate(sensed.received):
        later = [replace(m, time_s=m.time_s + epoch) for m in samples]
        a = one.update(k * PERIOD_S, samples, command)
        b = other.update(k * PERIOD_S + epoch, later, command)
        np.testing.assert_allclose(b.state, a.state, atol=1e-5)


@pytest.mark.parametrize("gap_s", [3.0, 3600.0, 1e9, -100.0])
def test_after_a_gap_the_filter_starts_anew_with_what_it_has_learnt(sensed, gap_s):
    """Position and heading are those of a new filter, factors and faded disturbances the old ones.

    A gap of 30 years is as cheap as one of 3 s: integrated, it would take hours.
    """
    estimator, fresh = ExtendedKalmanFilter(VEHICLE), ExtendedKalmanFilter(VEHICLE)
    for k, (samples, command) in enumerate(sensed.received):
        before = estimator.update(k * PERIOD_S, samples, command)
    now_s = before.time_s + gap_s
    assert np.isnan(estimator.update(now_s, [], Command(0.0, 0.0, 0.5)).state).all()
    readings = perfect_set(REFERENCE.at(20.0).state, now_s + PERIOD_S)
    after = estimator.update(now_s + PERIOD_S, readings, Command(0.0, 0.0, 0.5))
    new = fresh.update(now_s + PERIOD_S, readings, None)
    np.testing.assert_array_equal(after.state[: State.V], new.state[: State.V])
    np.testing.assert_array_equal(after.noise_factors, before.noise_factors)
    travel = abs(before.state[State.V] / (1.0 - before.disturbance[-1]) * gap_s)
    faded = before.map_disturbance * math.exp(-travel / ProcessNoise().map_fading_m)
    np.testing.assert_allclose(after.map_disturbance, faded, rtol=1e-9, atol=1e-300)


def test_updates_without_samples_are_no_gap_and_cost_no_more_the_longer_they_last(sensed):
    """The filter predicts by the commands; only the last seconds are predicted anew each time."""
    estimator = ExtendedKalmanFilter(VEHICLE)
    for k, (samples, command) in enumerate(sensed.received):
        estimator.update(k * PERIOD_S, samples, command)
    stop = Command(0.0, 0.0, 0.0)
    last = [estimator.update((k + i) * PERIOD_S, [], stop) for i in range(1, 101)][-1]
    assert abs(last.state[State.V]) < 0.05  # hydrostat at 0 for 20 s
    assert estimator.snapshots()["time_s"][-1] >= last.time_s - 2.6


def test_each_input_acts_its_own_dead_time_after_it_was_sent():
    """Inputs with dead times of some periods are prompt ones that come as many periods later."""
    received, later = SensedDrive(seed=3).run(60).received, (2, 1, 3)
    t, i, hp = (PERIOD_S * n for n in later)
    late = replace(VEHICLE, dead_time_t=t, dead_time_i=i, dead_time_hp=hp)
    delayed, prompt = ExtendedKalmanFilter(late), ExtendedKalmanFilter(VEHICLE)
    sent = [np.full(3, math.nan) if c is None else c.as_array() for _, c in received]
    for k, (measurements, command) in enumerate(received):
        before = Command(*(float(sent[max(k - n, 0)][j]) for j, n in enumerate(later)))
        one = delayed.update(k * PERIOD_S, measurements, command)
        other = prompt.update(k * PERIOD_S, measurements, before)
        np.testing.assert_allclose(one.state, other.state, atol=1e-9)
        np.testing.assert_allclose(one.covariance, other.covariance, atol=1e-9)


HEIGHTS = (1.8, 1.2)


def imu(sensor, time_s, roll, pitch):
    return Measurement(time_s, sensor, (0.0, roll, pitch))


@pytest.mark.parametrize(
    ("body", "gnss", "sensor"),
    [(0, Sensor.GNSS_TRACTOR, Sensor.IMU_TRACTOR), (1, Sensor.GNSS_TRAILER, Sensor.IMU_TRAILER)],
)
def test_a_position_moves_by_the_lever_arm_turned_by_yaw_pitch_and_roll(body, gnss, sensor):
    generator = np.random.default_rng(81)
    for _ in range(10):
        yaw, pitch, roll = generator.uniform(-1.0, 1.0, 3) * (3.0, 0.3, 0.3)
        turn = Rotation.from_euler("ZYX", (yaw, pitch, roll))
        east, north, _ = turn.apply((0.0, 0.0, HEIGHTS[body]))
        headings = np.full((2, 2), 9.0)
        headings[:, body] = yaw
        antenna = Measurement(0.2, gnss, (5.0 + east, 3.0 + north))
        rows = sample_rows([antenna, imu(sensor, 0.2, roll, pitch)])
        point, _ = axle_points(rows, headings, HEIGHTS)
        np.testing.assert_allclose(point[2:4], (5.0, 3.0), atol=1e-12)


@pytest.mark.parametrize("yaw", [0.3, -2.0])
def test_roll_and_pitch_move_the_slip_that_is_fixed_in_the_map(yaw):
    """At rest no sample tells of slip: k (pitch e(psi) - roll n(psi)), smoothed over 0.5 s."""
    gain, roll, pitch = 0.2, 0.08, -0.05
    straight = np.zeros(SIZE)
    straight[State.PSI_T] = straight[State.PSI_I] = yaw
    results = []
    for side_per_slope in (0.0, gain):
        noise = replace(ProcessNoise(), side_per_slope=side_per_slope)
        estimator = ExtendedKalmanFilter(VEHICLE, None, noise)
        estimates = []
        for k in range(10):
            time_s, tilted = PERIOD_S * k, 1.0 if k >= 5 else 0.0
            samples = [
                Measurement(time_s, s, tuple(predicted_measurement(s, straight, VEHICLE)[0]))
                for s in STARTING_SENSORS
            ]
            samples += [imu(s, time_s, tilted * roll, tilted * pitch) for s in IMUS]
            estimates.append(estimator.update(time_s, samples, Command(0.0, 0.0, 0.0)))
        results.append([estimate.map_disturbance[:2] for estimate in estimates])
    change = np.subtract(results[1], results[0])
    slope = pitch * np.array([math.cos(yaw), math.sin(yaw)])
    slope -= roll * np.array([-math.sin(yaw), math.cos(yaw)])
    periods = np.clip(np.arange(10) - 4, 0, None)
    share = -np.expm1(-periods * PERIOD_S / 0.5)
    np.testing.assert_allclose(change, gain * share[:, None] * slope, atol=1e-4)


IMUS = (Sensor.IMU_TRACTOR, Sensor.IMU_TRAILER)
BIAS = {Sensor.IMU_TRACTOR: 0.002, Sensor.IMU_TRAILER: -0.0015}  # [rad/s], twice their sd
IMU_S = 0.04
NOISE = SensorNoise()


@dataclass
class WithGyros:
    """An estimator that also receives samples of IMUs from true yaw rates, (N, 2) every `IMU_S`."""

    rates: FloatArray
    inner: ExtendedKalmanFilter
    generator: np.random.Generator = field(default_factory=lambda: np.random.default_rng(5))

    def update(
        self, time_s: float, measurements: list[Measurement], command: Command | None
    ) -> Estimate:
        first, last = (round(t / IMU_S) for t in (time_s - PERIOD_S, time_s))
        imus = [
            Measurement(k * IMU_S, sensor, (self._read(k, body) + bias, 0.0, 0.0))
            for k in range(max(0, first + 1), last + 1)
            for body, (sensor, bias) in enumerate(BIAS.items())
        ]
        return self.inner.update(time_s, [*imus, *measurements], command)

    def _read(self, k: int, body: int) -> float:
        noise = NOISE.yaw_rate * self.generator.normal() if NOISE.yaw_rate else 0.0
        return float(self.rates[min(k, len(self.rates) - 1), body]) + noise


@functools.cache
def plain_drive(seed: int, ticks: int) -> SensedDrive:
    """Return a drive without gyros, which none of those who share it changes."""
    return SensedDrive(seed).run(ticks)


def drive_of(seed: int, noise: SensorNoise, ticks: int = 250) -> tuple[SensedDrive, WithGyros]:
    """The drive of a seed, with gyros that read the mean yaw rates between its control ticks.

    The drive keeps its states at control ticks; within a tick the gyros read a constant rate.
    """
    plain = plain_drive(seed, ticks)
    yaw = np.unwrap(np.array(plain.states)[:, State.PSI_T : State.DELTA_T], axis=0)
    held = np.repeat(np.diff(yaw, axis=0) / PERIOD_S, round(PERIOD_S / IMU_S), axis=0)
    estimator = WithGyros(held, ExtendedKalmanFilter(VEHICLE, noise))
    again = SensedDrive(seed)
    for k, (samples, command) in enumerate(plain.received):
        again.states.append(plain.states[k])
        again.estimates.append(estimator.update(k * PERIOD_S, samples, command))
    return again, estimator


def test_gyros_give_the_heading_and_their_bias():
    """Headings are at most 0.6 times as far off as without gyros, and as far as claimed."""
    with_gyros, without, nees = [], [], []
    for seed in range(41, 45):
        drive, estimator = drive_of(seed, NOISE)
        plain, _ = drive_of(seed, SensorNoise(yaw_rate=0.0))
        yaw = slice(State.PSI_T, State.DELTA_T)
        with_gyros.append(drive.errors()[60:, yaw])
        without.append(plain.errors()[60:, yaw])
        variance = np.array([np.diag(e.covariance) for e in drive.estimates])[60:, yaw]
        nees.append(drive.errors()[60:, yaw] ** 2 / variance)
        state = estimator.inner.snapshots()[-1]
        biases = slice(AugmentedState.GYRO_T, AugmentedState.GYRO_I + 1)
        sd = np.sqrt(np.diag(state["covariances"][0])[biases])
        assert (np.abs(state["augmented"][0, biases] - list(BIAS.values())) < 4.0 * sd).all()
        assert (sd < 0.5 * NOISE.yaw_rate_bias).all()
    rms = [np.sqrt(np.mean(np.concatenate(errors) ** 2)) for errors in (with_gyros, without)]
    assert rms[0] < 0.6 * rms[1]
    assert 0.3 < np.mean(nees) < 2.0


@pytest.mark.parametrize("slope", [0.0, 0.15])
def test_the_heading_on_a_slope_follows_from_the_rate_about_the_vertical(slope):
    """A vehicle turns on a plane by 1.5 rad; the sum of all steps is the change of its heading."""
    rate, step_s, angle = 0.3, 0.02, 0.0
    plane = Rotation.from_euler("x", slope)

    def attitude(time_s: float) -> tuple[float, float, float]:
        yaw, pitch, roll = (plane * Rotation.from_euler("z", rate * time_s)).as_euler("ZYX")
        return yaw, pitch, roll

    def row(time_s: float) -> list[float]:
        _, pitch, roll = attitude(time_s)
        return [time_s, rate * math.cos(slope), roll, pitch]

    times = np.arange(0.0, 5.0 + 0.5 * step_s, step_s)
    for before, after in itertools.pairwise(times):
        angle += turned(np.array(row(before)), np.array(row(after)))
    heading = attitude(times[-1])[0] - attitude(0.0)[0]
    assert angle == pytest.approx(heading, abs=2e-6)
    if slope:
        assert abs(rate * math.cos(slope) * times[-1] - heading) > 5e-3


@pytest.fixture(scope="module")
def received():
    return SensedDrive(31).run(30).received


def test_warm_up_changes_no_later_estimate(received):
    cold, warm = ExtendedKalmanFilter(VEHICLE), ExtendedKalmanFilter(VEHICLE)
    warm.warm_up()
    for k, (samples, command) in enumerate(received):
        if k == 20:
            warm.warm_up()
        one, other = (e.update(k * PERIOD_S, samples, command) for e in (cold, warm))
        same(one, other)


def test_no_kernel_compiles_after_warm_up():
    """Signatures after `warm_up` and after 50 varied updates."""
    estimator = ExtendedKalmanFilter(VEHICLE)
    estimator.warm_up()
    compiled = signatures()
    assert compiled["observe_filter"]
    SensedDrive(32, corrupt=varied, estimator=estimator).run(50)
    estimator.update(50 * PERIOD_S, [], None)
    estimator.update(11, [], Command(0, 0, 1))  # integers
    assert signatures() == compiled


def varied(measurements):
    """Return a tick's samples with gaps, outliers and values of other numeric types."""
    time_s = measurements[-1].time_s
    if 2.0 < time_s < 3.0:
        return []
    if 4.0 < time_s < 6.0:  # longer than the patience of the gate
        return [
            replace(m, value=(m.value[0] + 3.0, m.value[1])) if m.sensor in GNSS else m
            for m in measurements
        ]
    if time_s > 7.0:
        measurements = [replace(m, value=tuple(np.array(m.value))) for m in measurements]
    if time_s > 8.0:
        measurements = [replace(m, value=tuple(map(round, m.value))) for m in measurements]
    return measurements


def modules_of(package):
    """Return the modules of a package."""
    names = [item.name for item in pkgutil.iter_modules(package.__path__)]
    return [importlib.import_module(f"{package.__name__}.{name}") for name in names]


def signatures():
    """Return the compiled signatures of every kernel by its name."""
    modules = (augmented_state, measurement, *modules_of(filter_package))
    members = {name: item for module in modules for name, item in vars(module).items()}
    return {n: tuple(v.signatures) for n, v in members.items() if hasattr(v, "signatures")}
