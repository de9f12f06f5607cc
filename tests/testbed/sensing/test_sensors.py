import math
from dataclasses import astuple, replace

import numpy as np
import pytest
from proving_ground.testbed.errors import InvalidPlant
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.randomness import generator
from proving_ground.testbed.sensing.receivers import NORMALS, advance, new_state, receiver
from proving_ground.testbed.sensing.sensor_specification import (
    ImuSpecification,
    SensorSpecification,
)
from proving_ground.testbed.sensing.sensors import SensorSuite
from proving_ground.testbed.simulation.plant import Plant
from proving_ground.testbed.vehicle.vehicle import read_vehicle
from pydantic import ValidationError

from tests.testbed.truths import moments, truth
from ttempc.layout import measurements_of
from ttempc.sensors import STARTING_SENSORS
from ttempc.types import Sensor

SPEEDS = {"speed": 1.0, "wheel_speed": 1.1}
LEVERS = np.array([[0.0, 0.0, 1.78], [0.0, 0.0, 1.27]])
TILTED = np.array([[0.1, 0.2, 1.7], [-2.3, 0.1, 1.2]])  # antennas of a vehicle that leans
GNSS = (Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER)
EXACT = SensorSpecification(gnss_sd_m=0.0, angle_sd_deg=0.0, encoder_sd_mps=0.0)
PERFECT_IMU = ImuSpecification(
    on=True,
    angle_sd_deg=0.0,
    angle_bias_sd_deg=0.0,
    yaw_rate_sd_degps=0.0,
    yaw_rate_bias_sd_degps=0.0,
)


def collect(noise, seed, steps, timestep=0.002):
    suite = SensorSuite(noise, timestep, seed, LEVERS)
    values = {sensor: [] for sensor in Sensor}
    rows = np.tile(moments(truth(**SPEEDS, antennas=TILTED)).rows, (steps, 1))
    first = 0
    for block in np.split(rows, [1, 3, min(400, steps)]):  # the block does not matter
        for sample in measurements_of(suite.sample(block, first, 1)[0]):
            values[sample.sensor].append(sample.value)
        first += len(block)
    return {sensor: np.array(rows) for sensor, rows in values.items()}


def test_every_sensor_keeps_its_own_rate():
    values = collect(SensorSpecification(), seed=1, steps=1000)  # 2 s
    assert len(values[Sensor.GNSS_TRACTOR]) == 10
    assert len(values[Sensor.GNSS_TRAILER]) == 10
    for sensor in (Sensor.STEERING_TRACTOR, Sensor.STEERING_TRAILER, Sensor.HITCH, Sensor.ENCODER):
        assert len(values[sensor]) == 50
    for sensor in (Sensor.IMU_TRACTOR, Sensor.IMU_TRAILER):
        assert len(values[sensor]) == 0, "off by default"


def test_the_paper_s_samples_are_truth_plus_white_noise_bit_for_bit():
    values = collect(SensorSpecification(), seed=4, steps=500)
    exact = dict.fromkeys(STARTING_SENSORS, (0.0,)) | {
        Sensor.GNSS_TRACTOR: (0.0, 0.0),
        Sensor.GNSS_TRAILER: (-2.4, 0.0),
        Sensor.ENCODER: (1.1,),
    }
    sd = dict.fromkeys(STARTING_SENSORS, math.radians(1.0)) | dict.fromkeys(GNSS, 0.03)
    sd[Sensor.ENCODER] = 0.1
    for sensor in STARTING_SENSORS:
        rng = generator(4, f"sensor/{sensor}")
        plain = [
            [value + sd[sensor] * rng.standard_normal() for value in exact[sensor]]
            for _ in values[sensor]
        ]
        np.testing.assert_array_equal(values[sensor], plain)


@pytest.mark.parametrize(("on", "speed"), [("wheel", "wheel_speed"), ("ground", "speed")])
def test_the_encoder_measures_wheel_or_ground_speed(on, speed):
    values = collect(replace(EXACT, encoder_on=on), seed=1, steps=1)
    assert values[Sensor.ENCODER] == pytest.approx(SPEEDS[speed])


REST = (Sensor.STEERING_TRACTOR, Sensor.STEERING_TRAILER, Sensor.HITCH, Sensor.ENCODER)


@pytest.mark.parametrize(
    ("change", "untouched"),
    [
        ({"angle_rate_hz": 5.0}, (*GNSS, Sensor.ENCODER)),
        ({"angle_resolution_deg": 0.5}, (*GNSS, Sensor.ENCODER)),
        ({"encoder_on": "ground"}, (*GNSS, Sensor.HITCH)),
        ({"gnss_error": "correlated"}, REST),
        ({"gnss_error": "non-gaussian"}, REST),
        ({"gnss_error": "street"}, REST),
        ({"gnss_antenna": "raw"}, REST),
        ({"imu": ImuSpecification(on=True)}, STARTING_SENSORS),
    ],
)
def test_each_sensor_has_a_stream_of_its_own(change, untouched):
    plain = collect(SensorSpecification(), seed=5, steps=500)
    other = collect(SensorSpecification(**change), seed=5, steps=500)
    for sensor in untouched:
        np.testing.assert_array_equal(plain[sensor], other[sensor])
    assert any(not np.array_equal(plain[sensor], other[sensor]) for sensor in Sensor)
    assert not np.array_equal(plain[Sensor.GNSS_TRACTOR], plain[Sensor.GNSS_TRAILER])


# --- antennas --------------------------------------------------------------------------------


def standing_on(slope, yaw, along=math.pi / 2):
    """The plant at rest on a slope that rises towards `along`, and its lever arms."""
    ground = terrain.flat((20.0, 20.0)).tilted(slope, along)
    plant = Plant(read_vehicle(), ground, SoilMap.named("hard"))
    return plant.reset(0.0, 0.0, yaw, 0.0), plant.lever_arms


def gnss(specification, state, levers):
    rows, _ = SensorSuite(specification, 0.002, 1, levers).sample(moments(state).rows, 0, 1)
    return {sample.sensor: np.array(sample.value) for sample in measurements_of(rows)}


def points(state):
    return [np.array([pose.x, pose.y]) for pose in (state.tractor, state.trailer)]


def test_corrected_with_a_perfect_imu_is_the_axle_point():
    state, levers = standing_on(0.12, yaw=0.9, along=0.3)
    samples = gnss(replace(EXACT, gnss_antenna="corrected", imu=PERFECT_IMU), state, levers)
    for sensor, point in zip(GNSS, points(state), strict=True):
        np.testing.assert_allclose(samples[sensor], point, atol=1e-9)


def test_an_imu_reads_yaw_rate_roll_and_pitch_of_its_body():
    state = truth(
        tractor={"roll": 0.1, "pitch": -0.2},
        trailer={"roll": 0.3, "pitch": -0.4},
        yaw_rate_t=0.5,
        yaw_rate_i=0.6,
    )
    samples = gnss(replace(EXACT, imu=PERFECT_IMU), state, LEVERS)
    np.testing.assert_array_equal(samples[Sensor.IMU_TRACTOR], [0.5, 0.1, -0.2])
    np.testing.assert_array_equal(samples[Sensor.IMU_TRAILER], [0.6, 0.3, -0.4])


def test_the_bias_of_an_imu_is_drawn_once_a_run():
    imu = replace(
        PERFECT_IMU, angle_bias_sd_deg=math.degrees(0.01), yaw_rate_bias_sd_degps=math.degrees(0.02)
    )
    runs = [collect(replace(EXACT, imu=imu), seed, 100)[Sensor.IMU_TRACTOR] for seed in range(200)]
    for run in runs:
        np.testing.assert_array_equal(run, np.tile(run[0], (len(run), 1)))
    drawn = np.array([run[0] for run in runs]).std(axis=0)
    np.testing.assert_allclose(drawn, [0.02, 0.01, 0.01], rtol=4 / math.sqrt(2 * len(runs)))


def test_positions_have_the_errors_of_receivers_that_travel_as_far():
    """Also where the way bends; the status of each solution comes with it."""
    suite = SensorSuite(SensorSpecification(gnss_error="street"), 0.002, 3, LEVERS)
    times = 0.04 * np.arange(500)
    x, y = np.cos(times), np.sin(times)
    states = [
        truth(time_s=t, tractor={"x": a, "y": b}) for t, a, b in zip(times, x, y, strict=True)
    ]
    parts = [
        suite.sample(moments(*states[k : k + 7]).rows, 20 * k, 20)[0] for k in range(0, 500, 7)
    ]
    rows = np.concatenate(parts)
    rows = rows[rows[:, 1] == 0]
    normals = generator(3, f"sensor/{Sensor.GNSS_TRACTOR}").standard_normal((100, NORMALS))
    parameters, state, out = np.array(astuple(receiver("street"))), new_state(), np.empty(6)
    for k, row in enumerate(rows):
        way = 5 * 2 * math.sin(0.02) if k else 0.0
        advance(state, parameters, normals[k], 0.2 * k, way, out)
        expected = [x[5 * k] + out[0], y[5 * k] + out[1], out[4]]
        np.testing.assert_allclose(row[2:], expected, atol=1e-9)
    assert {sample.status for sample in measurements_of(rows)} == {1, 2}


# --- latency, resolution ---------------------------------------------------------------------


def test_a_late_sample_has_the_time_and_the_value_of_its_sampling():
    specification = replace(EXACT, gnss_latency_s=0.3, encoder_latency_s=0.05)
    suite = SensorSuite(specification, 0.002, 1, LEVERS)
    came = {Sensor.GNSS_TRACTOR: [], Sensor.ENCODER: [], Sensor.HITCH: []}
    times = 0.002 * np.arange(0, 1000, suite.every)
    states = moments(
        *(truth(time_s=t, tractor={"x": t}, wheel_speed=2 * t, beta=0.1 * t) for t in times)
    )
    for first in range(0, len(times), 8):
        block = slice(first, first + 8)
        rows, at = suite.sample(states.rows[block], first * suite.every, suite.every)
        for sample, time in zip(measurements_of(rows), times[block][at.astype(int)], strict=True):
            if sample.sensor in came:
                came[sample.sensor].append((time, sample.time_s, sample.value[0]))
    for sensor, latency, gain, first in (
        (Sensor.GNSS_TRACTOR, 0.3, 1.0, 9),  # of ten samples the last is still under way
        (Sensor.ENCODER, 0.05, 2.0, 49),
        (Sensor.HITCH, 0.0, 0.1, 50),
    ):
        delivered, taken, value = np.array(came[sensor]).T
        assert len(taken) == first
        np.testing.assert_allclose(delivered - taken, latency, atol=1e-12)
        np.testing.assert_allclose(value, gain * taken, atol=1e-12)


def test_the_suite_is_sampled_at_the_common_divisor_of_all_periods_and_delays():
    assert SensorSuite(SensorSpecification(), 0.002, 1, LEVERS).every == 20
    assert SensorSuite(SensorSpecification(gnss_latency_s=0.05), 0.002, 1, LEVERS).every == 5


def test_samples_are_rounded_to_the_resolution_of_their_sensor():
    grids = {
        **dict.fromkeys(GNSS, 0.02),
        **dict.fromkeys(
            (Sensor.STEERING_TRACTOR, Sensor.STEERING_TRAILER, Sensor.HITCH), math.radians(0.3)
        ),
        Sensor.ENCODER: 0.04,
    }
    fine = SensorSpecification()
    coarse = replace(
        fine, gnss_resolution_m=0.02, angle_resolution_deg=0.3, encoder_resolution_mps=0.04
    )
    plain, gridded = (collect(s, seed=6, steps=1000) for s in (fine, coarse))
    for sensor, grid in grids.items():
        cells = gridded[sensor] / grid
        np.testing.assert_allclose(cells, np.round(cells), atol=1e-9)
        assert np.abs(gridded[sensor] - plain[sensor]).max() <= 0.5 * grid + 1e-12


# --- refusals --------------------------------------------------------------------------------


def test_rates_and_latencies_between_two_steps_are_refused():
    for change, sensor in (
        ({"gnss_rate_hz": 7.0}, "gnss_tractor"),
        ({"angle_latency_s": 0.005}, r"steering_tractor: 0\.005 s"),
    ):
        with pytest.raises(InvalidPlant, match=sensor):
            SensorSuite(SensorSpecification(**change), 0.002, 1, LEVERS)


def test_impossible_sensors_are_refused_by_their_keys():
    for kind, key, value in (
        (SensorSpecification, "gnss_sd_m", -0.01),
        (SensorSpecification, "gnss_latency_s", 2.5),
        (SensorSpecification, "encoder_resolution_mps", math.nan),
        (SensorSpecification, "gnss_correlation_time_s", 0.0),
        (SensorSpecification, "gnss_white_share", 1.5),
        (SensorSpecification, "gnss_antenna", "corrected"),  # without an IMU
        (ImuSpecification, "angle_sd_deg", -1.0),
    ):
        with pytest.raises(ValidationError, match=key):
            kind(**{key: value})


# --- velocities and status of the receivers ------------------------------------------------------


def circling(specification, seconds=20.0, seed=3, stands_after=math.inf):
    """Return samples of a vehicle that drives in a circle, by sensor: times (n,), values (n, m)."""
    suite = SensorSuite(specification, 0.002, seed, LEVERS)
    times = 0.04 * np.arange(round(seconds / 0.04))
    angles = 0.2 * np.minimum(times, stands_after)
    states = [
        truth(
            {"x": 5.0 * math.cos(angle), "y": 5.0 * math.sin(angle)},
            {"x": 4.0 * math.cos(angle), "y": 4.0 * math.sin(angle)},
            time_s=time_s,
        )
        for time_s, angle in zip(times, angles, strict=True)
    ]
    samples = measurements_of(suite.sample(moments(*states).rows, 0, 20)[0])
    named = {sensor: [item for item in samples if item.sensor == sensor] for sensor in Sensor}
    return {
        sensor: (np.array([item.time_s for item in own]), np.array([item.value for item in own]))
        for sensor, own in named.items()
        if own
    }


@pytest.mark.parametrize(("kind", "largest_m"), [("carrier", 1e-9), ("doppler", 0.045)])
def test_the_integral_of_the_velocities_is_the_way_of_the_receiver(kind, largest_m):
    """Of a mean velocity exactly; of a moment's, late by 0.02 s, within 2 cm at either end."""
    exact = {"gnss_velocity_sd_mps": 0.0, "gnss_velocity_wander_mps": 0.0}
    samples = circling(replace(EXACT, gnss_velocity=kind, **exact))
    for body in ("tractor", "trailer"):
        times, places = samples[Sensor(f"gnss_{body}")]
        stamps, velocities = samples[Sensor(f"velocity_{body}")]
        np.testing.assert_array_equal(stamps, times[1:])
        moves = velocities[1:, :2]
        if kind == "doppler":
            moves = 0.5 * (velocities[1:, :2] + velocities[:-1, :2])
        way = np.cumsum(np.diff(stamps)[:, None] * moves, axis=0)
        assert np.abs(way - (places[2:] - places[1])).max() <= largest_m


def test_receivers_share_the_slow_part_of_a_velocity_s_error_and_not_the_white_one():
    of = replace(EXACT, gnss_velocity="doppler", gnss_velocity_wander_mps=0.01)
    slow = circling(replace(of, gnss_velocity_sd_mps=0.0), stands_after=0.0)
    tractor, trailer = (slow[Sensor(f"velocity_{body}")][1] for body in ("tractor", "trailer"))
    np.testing.assert_array_equal(tractor[:, :2], trailer[:, :2])
    assert np.abs(tractor[:, :2]).max() > 0.0
    noisy = circling(of, stands_after=0.0)
    tractor, trailer = (noisy[Sensor(f"velocity_{body}")][1] for body in ("tractor", "trailer"))
    assert np.std(tractor[:, :2] - trailer[:, :2]) == pytest.approx(0.03 * math.sqrt(2.0), rel=0.2)
    assert tractor[0, 2] == pytest.approx(math.hypot(0.03, 0.01))


def test_a_velocity_derived_from_the_positions_follows_their_faults():
    suite = SensorSuite(replace(EXACT, gnss_velocity="positions"), 0.002, 1, LEVERS)

    def drift(samples):
        is_position = samples[:, 1] < 2
        samples[is_position, 2] += 0.5 * samples[is_position, 0]
        return samples

    suite.changes = (drift,)
    states = [truth(time_s=0.2 * k) for k in range(60)]
    rows, _ = suite.sample(moments(*states).rows, 0, 100)
    velocities = [item.value for item in measurements_of(rows) if item.sensor.startswith("vel")]
    np.testing.assert_allclose(velocities[-1][:2], (0.5, 0.0), atol=1e-9)


def test_a_receiver_without_a_warning_says_zeros():
    samples = circling(replace(EXACT, gnss_status=True), seconds=2.0)
    assert not samples[Sensor.RECEIVER_TRACTOR][1].any()
    assert Sensor.RECEIVER_TRACTOR not in circling(EXACT, seconds=2.0)
