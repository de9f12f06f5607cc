"""Faults of sensors on samples with known values."""

import math
import operator

import numpy as np
import pytest
from proving_ground.testbed.faults.fault import Window
from proving_ground.testbed.faults.faulty import SampleFaults
from proving_ground.testbed.faults.kinds import KINDS, Sampling
from proving_ground.testbed.sensing.sensor_specification import (
    ImuSpecification,
    SensorSpecification,
)
from proving_ground.testbed.sensing.sensors import SensorSuite

from tests.testbed.truths import moments, truth
from ttempc.layout import measurements_of
from ttempc.sensors import ROW_OF
from ttempc.types import Sensor

DT, EVERY = 0.02, 10  # five samples a second of each sensor
START_S, END_S = 1.0, 2.0
BODIES = ("tractor", "trailer")
GNSS = {Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER}
IMUS = {Sensor.IMU_TRACTOR, Sensor.IMU_TRAILER}
PRESENT = [row.sensor for row in ROW_OF.values() if row.used_by_filter]


SENSORS = SensorSpecification(  # without noise, five samples a second of each
    **dict.fromkeys(("gnss_sd_m", "angle_sd_deg", "encoder_sd_mps"), 0.0),
    **dict.fromkeys(("angle_rate_hz", "encoder_rate_hz"), 5.0),
    imu=ImuSpecification(
        on=True,
        rate_hz=5.0,
        **dict.fromkeys(("angle_sd_deg", "angle_bias_sd_deg"), 0.0),
        **dict.fromkeys(("yaw_rate_sd_degps", "yaw_rate_bias_sd_degps"), 0.0),
    ),
)


def value(sensor, time_s):
    first = list(Sensor).index(sensor) + 0.1 * time_s
    return tuple(first + 10.0 * k for k in range(ROW_OF[sensor].length))


def delivered(seed=1, **keys):
    """Return what arrives with one fault from 1 to 2 s: pairs of arrival time and sample."""
    fault = KINDS[keys["kind"]](start_s=START_S, **keys)
    suite = SensorSuite(SENSORS, DT, seed, np.zeros((2, 3)))
    suite.changes = (SampleFaults([(0, fault, Window(START_S, END_S))], SENSORS, DT, seed),)
    samples = []
    for first in range(0, 160, 4 * EVERY):
        steps = range(first, first + 4 * EVERY, EVERY)
        rows, at = suite.sample(moments(*[state(step * DT) for step in steps]).rows, first, EVERY)
        times = np.array(steps)[at.astype(int)] * DT
        samples += zip(times.tolist(), measurements_of(rows), strict=True)
    return samples


def state(time_s):
    """Return a truth with readings that are known: number of the sensor + 0.1 per second."""
    of = {sensor: value(sensor, time_s) for sensor in Sensor}
    points = [dict(zip("xy", of[f"gnss_{body}"], strict=True)) for body in BODIES]
    tilts = [dict(zip(("roll", "pitch"), of[f"imu_{body}"][1:], strict=True)) for body in BODIES]
    return truth(
        *map(operator.or_, points, tilts),
        time_s=time_s,
        delta_t=of["steering_tractor"][0],
        delta_i=of["steering_trailer"][0],
        beta=of["hitch"][0],
        wheel_speed=of["encoder"][0],
        yaw_rate_t=of["imu_tractor"][0],
        yaw_rate_i=of["imu_trailer"][0],
    )


def errors(sensor, samples):
    """Return sampling times and errors (n, m) of the samples of one sensor."""
    mine = [sample for _, sample in samples if sample.sensor == sensor]
    times = np.array([sample.time_s for sample in mine])
    wrong = [np.subtract(sample.value, value(sensor, sample.time_s)) for sample in mine]
    return times, np.array(wrong)


def acting(times):
    return (times > START_S - 1e-6) & (times < END_S - 1e-6)


# keys, faulty sensors, errors at 0, 0.2, ... 0.8 s after the start; None: drawn at random
NUMBER = {sensor: number for number, sensor in enumerate(Sensor)}
READINGS = 0.1 * (START_S + 0.2 * np.arange(5)) + NUMBER[Sensor.ENCODER]
# fmt: off
ERRORS = (
    ("gnss_jump", {"offset_m": 0.5, "direction_deg": 90.0}, GNSS, [[0.0, 0.5]] * 5),
    ("gnss_jump", {"offset_m": 0.5, "receiver": "trailer"}, {Sensor.GNSS_TRAILER},
     [[0.5, 0.0]] * 5),
    ("gnss_drift", {"rate_mps": 0.2}, GNSS, [[0.04 * k, 0.0] for k in range(5)]),
    ("gnss_stairs", {"rise_m": 0.3, "every_s": 0.4}, GNSS,
     [[0.3, 0.0]] * 2 + [[0.6, 0.0]] * 2 + [[0.9, 0.0]]),
    ("gnss_sine", {"amplitude_m": 0.3, "period_s": 0.8, "direction_deg": 90.0}, GNSS,
     [[0.0, height] for height in (0.0, 0.3, 0.0, -0.3, 0.0)]),
    ("gnss_accelerating", {"acceleration_mps2": 0.5}, GNSS,
     [[0.25 * (0.2 * k) ** 2, 0.0] for k in range(5)]),
    ("gnss_frozen", {}, GNSS, [[-0.02 * k] * 2 for k in range(5)]),
    ("gnss_outlier", {"offset_m": 2.0}, GNSS, None),
    ("gnss_float", {}, GNSS, None),
    ("angle_stuck", {"sensor": "hitch"}, {Sensor.HITCH}, [[-0.02 * k] for k in range(5)]),
    ("angle_bias", {"sensor": "hitch", "bias_deg": -2.0}, {Sensor.HITCH},
     [[math.radians(-2.0)]] * 5),
    ("angle_drift", {"sensor": "steering_tractor", "rate_degps": 1.0}, {Sensor.STEERING_TRACTOR},
     [[math.radians(0.2 * k)] for k in range(5)]),
    ("angle_noise", {"sensor": "steering_trailer", "sd_deg": 1.0}, {Sensor.STEERING_TRAILER}, None),
    ("gyro_bias", {"body": "tractor", "bias_degps": 1.0}, {Sensor.IMU_TRACTOR},
     [[math.radians(1.0), 0.0, 0.0]] * 5),
    ("angle_scaled", {"sensor": "hitch", "factor": 0.5}, {Sensor.HITCH},
     [[-0.5 * (0.1 * (START_S + 0.2 * k) + NUMBER[Sensor.HITCH])] for k in range(5)]),
    ("gyro_ramp", {"rate_degps2": 1.0}, IMUS,
     [[math.radians(0.2 * k), 0.0, 0.0] for k in range(5)]),
    ("encoder_dead", {}, {Sensor.ENCODER}, -READINGS[:, None]),
    ("encoder_scaled", {"factor": -1.0}, {Sensor.ENCODER}, -2.0 * READINGS[:, None]),
)
# fmt: on


@pytest.mark.parametrize(("kind", "keys", "sensors", "expected"), ERRORS)
def test_only_samples_of_the_faulty_sensor_in_the_window_have_the_error(
    kind, keys, sensors, expected
):
    samples = delivered(kind=kind, **keys)
    for sensor in PRESENT:
        times, wrong = errors(sensor, samples)
        assert len(times) == 16
        inside = acting(times) & (sensor in sensors)
        assert not wrong[~inside].any()
        if sensor in sensors:
            if expected is None:
                assert wrong[inside].any(axis=1).all()
            else:
                np.testing.assert_allclose(wrong[inside], expected, atol=1e-12)


def test_a_lost_fix_gives_no_samples_of_that_receiver():
    samples = delivered(kind="gnss_out", receiver="tractor")
    times, _ = errors(Sensor.GNSS_TRACTOR, samples)
    assert len(times) == 16 - 5
    assert not acting(times).any()
    assert len(errors(Sensor.GNSS_TRAILER, samples)[0]) == 16


def test_more_noise_multiplies_the_deviation_that_a_sensor_is_said_to_have():
    fault = KINDS["samples_noisier"](start_s=0.0, factor=5.0)
    for sensor, sd in ((Sensor.ENCODER, 0.1), (Sensor.GNSS_TRACTOR, 0.03)):
        rng = np.random.default_rng(2)
        sampling = Sampling(Window(0.0, math.inf), SensorSpecification(), sensor, DT, rng)
        noise = fault.row.effect(fault, sampling)(np.zeros((4000, 7)))[:, 2]
        assert np.hypot(sd, noise.std()) == pytest.approx(5.0 * sd, rel=0.05)


def test_a_receiver_that_holds_at_rest_follows_again_when_it_moves():
    fault = KINDS["gnss_held"](start_s=0.0, speed_mps=0.1)
    rng = np.random.default_rng(2)
    sampling = Sampling(Window(0.0, math.inf), SENSORS, Sensor.GNSS_TRACTOR, DT, rng)
    rows = np.zeros((100, 7))
    rows[:, 0] = 0.2 * np.arange(100)
    rows[:, 2] = 0.05 * np.minimum(rows[:, 0], 10.0) + 1.0 * np.maximum(rows[:, 0] - 10.0, 0.0)
    truth_m = rows[:, 2].copy()
    held = fault.row.effect(fault, sampling)(rows)[:, 2]
    assert np.ptp(held[5:50]) < 0.01 < np.ptp(truth_m[5:50])
    np.testing.assert_array_equal(held[60:], truth_m[60:])


def test_ageing_samples_are_stamped_as_they_arrive():
    samples = delivered(kind="samples_ageing", first_s=0.1, last_s=0.5, over_s=1.0)
    late = [
        (arrival, sample.time_s, sample.value)
        for arrival, sample in samples
        if sample.sensor == Sensor.ENCODER
    ]
    taken = np.array([(value[0] - NUMBER[Sensor.ENCODER]) / 0.1 for *_, value in late])
    arrivals, stamps = np.array([item[:2] for item in late]).T
    waits = arrivals - stamps  # for the next moment at which the sensors deliver
    assert ((waits > -1e-9) & (waits < EVERY * DT)).all()
    inside = acting(taken)
    expected = 0.1 + 0.4 * (taken[inside] - START_S)
    np.testing.assert_allclose((stamps - taken)[inside], expected, atol=DT)


def test_outliers_have_one_length_and_are_those_of_the_seed():
    def offsets(seed):
        times, wrong = errors(
            Sensor.GNSS_TRACTOR, delivered(seed, kind="gnss_outlier", offset_m=3.0)
        )
        return wrong[acting(times)]

    np.testing.assert_allclose(np.hypot(*offsets(1).T), 3.0)
    np.testing.assert_array_equal(offsets(1), offsets(1))
    assert (offsets(1) != offsets(2)).all()


def test_swapped_antennas_exchange_their_positions():
    for _, sample in delivered(kind="antennas_swapped"):
        if sample.sensor in GNSS and acting(np.array(sample.time_s)):
            (other,) = GNSS - {sample.sensor}
            assert sample.value == value(other, sample.time_s)


def test_late_samples_keep_value_and_stamp():
    for arrival, sample in delivered(kind="gnss_late", delay_s=0.4):
        late = sample.sensor in GNSS and acting(np.array(sample.time_s))
        assert arrival - sample.time_s == pytest.approx(0.4 if late else 0.0)
        assert sample.value == value(sample.sensor, sample.time_s)


def test_duplicates_arrive_together():
    samples = [(arrival, s) for arrival, s in delivered(kind="samples_duplicated", group="encoder")]
    inside = [item for item in samples if acting(np.array(item[0]))]
    for sensor in PRESENT:
        count = sum(s.sensor == sensor for _, s in inside)
        assert count == (10 if sensor == Sensor.ENCODER else 5)


def test_stamps_are_shifted_or_run_backward():
    shifted = [s for t, s in delivered(kind="stamps_shifted", offset_s=-0.3) if acting(np.array(t))]
    mine = [s.time_s for s in shifted if s.sensor == Sensor.ENCODER]
    np.testing.assert_allclose(mine, START_S - 0.3 + 0.2 * np.arange(5))
    backward = [s for t, s in delivered(kind="stamps_backward") if acting(np.array(t))]
    mine = [s.time_s for s in backward if s.sensor == Sensor.HITCH]
    np.testing.assert_allclose(mine, START_S - 0.2 * np.arange(5))
