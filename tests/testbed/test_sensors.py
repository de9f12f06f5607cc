import numpy as np
import pytest

from testbed.errors import InvalidPlant
from testbed.sensors import SensorSpecification, SensorSuite
from tests.testbed.truths import truth
from ttempc.types import Sensor

SPEEDS = {"speed": 1.0, "rim_speed": 1.1}


def collect(noise, seed, steps, timestep=0.002):
    suite = SensorSuite(noise, timestep, seed)
    values = {sensor: [] for sensor in Sensor}
    for step in range(steps):
        for sample in suite.sample(truth(**SPEEDS), step):
            values[sample.sensor].append(sample.value)
    return {sensor: np.array(rows) for sensor, rows in values.items()}


def test_every_sensor_keeps_its_own_rate():
    values = collect(SensorSpecification(), seed=1, steps=1000)  # 2 s
    assert len(values[Sensor.GNSS_TRACTOR]) == 10
    assert len(values[Sensor.GNSS_TRAILER]) == 10
    for sensor in (Sensor.STEERING_TRACTOR, Sensor.STEERING_TRAILER, Sensor.HITCH, Sensor.ENCODER):
        assert len(values[sensor]) == 50


def test_noise_is_white_with_the_stated_deviation():
    noise = SensorSpecification(gnss_rate=500.0, angle_rate=500.0, encoder_rate=500.0)
    n = 4000
    values = collect(noise, seed=2, steps=n)
    expected = {
        Sensor.GNSS_TRACTOR: noise.gnss_sd,
        Sensor.GNSS_TRAILER: noise.gnss_sd,
        Sensor.HITCH: noise.angle_sd,
        Sensor.ENCODER: noise.encoder_sd,
    }
    for sensor, sd in expected.items():
        for column in values[sensor].T:
            # 4 standard deviations of the sample deviation and of the lag-one correlation
            assert column.std() == pytest.approx(sd, rel=4 / np.sqrt(2 * n))
            assert abs(np.corrcoef(column[:-1], column[1:])[0, 1]) < 4 / np.sqrt(n)


def test_encoder_reads_the_wheel_and_not_the_ground():
    values = collect(SensorSpecification(encoder_sd=0.0), seed=1, steps=1)
    assert values[Sensor.ENCODER] == pytest.approx(SPEEDS["rim_speed"])


def test_each_sensor_has_a_stream_of_its_own():
    plain = collect(SensorSpecification(), seed=5, steps=500)
    slower = collect(SensorSpecification(angle_rate=5.0), seed=5, steps=500)
    np.testing.assert_array_equal(plain[Sensor.GNSS_TRACTOR], slower[Sensor.GNSS_TRACTOR])
    np.testing.assert_array_equal(plain[Sensor.ENCODER], slower[Sensor.ENCODER])
    assert not np.array_equal(plain[Sensor.GNSS_TRACTOR], plain[Sensor.GNSS_TRAILER])


def test_same_seed_same_samples():
    one, two = (collect(SensorSpecification(), seed=9, steps=500) for _ in range(2))
    for sensor in Sensor:
        np.testing.assert_array_equal(one[sensor], two[sensor])


def test_a_rate_between_two_steps_is_refused():
    with pytest.raises(InvalidPlant, match=r"gnss_tractor.*whole number of physics steps"):
        SensorSuite(SensorSpecification(gnss_rate=7.0), 0.002, 1)
