"""`sensors.preset`: the values of a preset, keys beside it, and the laws of its errors."""

import math
from dataclasses import asdict, replace

import numpy as np
import pytest
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import Scenario, dump, load
from proving_ground.testbed.recording.channels import CHANNELS, TIMING
from proving_ground.testbed.sensing.sensor_presets import SENSOR_PRESETS
from proving_ground.testbed.sensing.sensors import SensorSuite

from tests.testbed.truths import truth
from ttempc.types import Sensor

FIELD = 'sensors.preset="field"'
GNSS = (Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER)


def sensors(*overrides, name="grass"):
    return load(name, overrides)[1].sensors


@pytest.mark.parametrize("name", SENSOR_PRESETS)
def test_a_preset_gives_its_values_and_the_defaults_the_rest(name):
    table, default = asdict(sensors(f"sensors.preset={name!r}")), asdict(Scenario().sensors)
    preset = dict(SENSOR_PRESETS[name])
    imu = default["imu"] | preset.pop("imu", {})
    assert table == default | preset | {"preset": name, "imu": imu}


def test_the_default_is_the_preset_of_the_paper():
    assert sensors() == sensors('sensors.preset="paper"') == Scenario().sensors


def test_keys_beside_a_preset_replace_its_values_alone():
    plain = sensors(FIELD)
    changed = sensors(FIELD, "sensors.gnss_latency_s=0.0", "sensors.imu.angle_bias_sd_deg=0.1")
    imu = replace(plain.imu, angle_bias_sd_deg=0.1)
    assert changed == replace(plain, gnss_latency_s=0.0, imu=imu)


def test_another_preset_replaces_the_values_of_a_file(tmp_path):
    assert sensors(FIELD, name="raw-gnss") == sensors(FIELD)
    resolved = tmp_path / "resolved.toml"
    resolved.write_text(dump(load("grass-field")[1]))
    assert sensors('sensors.preset="paper"', name=str(resolved)) == sensors()
    same = sensors(FIELD, "sensors.gnss_sd_m=0.02", name=str(resolved))
    assert same == replace(sensors(FIELD), gnss_sd_m=0.02)


def test_a_resolved_scenario_drives_the_same_bits_again(tmp_path):
    changes = (
        "path={kind='straight', length_m=4}",
        "sensors.gnss_white_share=0.5",
        "controller.noise.gnss_sd_m=0.02",
    )
    name, scenario = load("grass-field", changes)
    resolved = tmp_path / "scenario.toml"
    resolved.write_text(dump(scenario))
    again = load(str(resolved))[1]
    assert again == scenario
    one, two = (simulate(name, which, seed=5)[1] for which in (scenario, again))
    for channel in CHANNELS:
        if channel is not TIMING:
            np.testing.assert_array_equal(one[channel].values, two[channel].values)


def test_gnss_of_the_field_forgets_its_error_over_a_minute():
    """Autocorrelation (1 - white share) exp(-t / 60 s), and the stated deviation.

    The bands are four deviations of the mean of four independent first-order processes (Bartlett's
    formula at lag 1, which is wider than that of their sum with white noise).
    """
    period_s, count = 2.0, 10_000
    rates = ("gnss_rate_hz", "angle_rate_hz", "encoder_rate_hz", "imu.rate_hz")
    specification = sensors(FIELD, *(f"sensors.{key}={1.0 / period_s}" for key in rates))
    steps, late = round(period_s / 0.002), round(specification.gnss_latency_s / 0.002)
    suite = SensorSuite(specification, 0.002, 7, np.zeros((2, 3)))
    state = truth(antennas=np.zeros((2, 3)))
    errors = {sensor: [] for sensor in GNSS}
    for k in range(count):
        for step in (k * steps, k * steps + late):
            for sample in suite.sample(state, step):
                if sample.sensor in errors:
                    errors[sample.sensor].append(sample.value)
    columns = np.hstack([errors[sensor] for sensor in GNSS])
    assert columns.shape == (count, 4)
    decay = math.exp(-2.0 * period_s / 60.0)
    independent = 4 * count * (1.0 - decay) / (1.0 + decay)
    assert columns.std() == pytest.approx(0.03, rel=4 / math.sqrt(2 * independent))
    for lag in (1, 15, 30, 60):
        rho = np.mean(columns[:-lag] * columns[lag:]) / np.mean(columns**2)
        assert abs(rho - 0.9 * math.exp(-lag * period_s / 60.0)) < 4 / math.sqrt(independent)


def test_an_antenna_of_the_field_leans_and_the_imu_leaves_its_own_error():
    """At heading 0 the corrected point errs by h (sin(measured roll) - sin(true roll)) across."""
    heights, roll = np.array([1.78, 1.27]), 0.1
    lean = heights * math.sin(roll)
    antennas = np.array([[0.0, -lean[0], 1.7], [-2.4, -lean[1], 1.2]])
    state = truth(tractor={"roll": roll}, trailer={"roll": roll}, antennas=antennas)
    levers = np.column_stack([np.zeros((2, 2)), heights])
    specification = sensors(FIELD, "sensors.gnss_sd_m=0.0", "sensors.gnss_latency_s=0.0")
    raw = replace(specification, gnss_antenna="raw")
    for seed in range(20):
        samples = {
            sample.sensor: sample.value
            for sample in SensorSuite(specification, 0.002, seed, levers).sample(state, 0)
        }
        uncorrected = SensorSuite(raw, 0.002, seed, levers).sample(state, 0)
        for sample in uncorrected:
            if sample.sensor in GNSS:
                assert sample.value[1] == -lean[GNSS.index(sample.sensor)]
        for gnss, imu, height in zip(
            GNSS, (Sensor.IMU_TRACTOR, Sensor.IMU_TRAILER), heights, strict=True
        ):
            measured = samples[imu][1]
            left = height * (math.sin(measured) * math.cos(0.0) - math.sin(roll))
            assert samples[gnss][1] == pytest.approx(left, abs=1e-12)
            assert 0.0 < abs(samples[gnss][1]) < 5 * height * math.radians(math.hypot(0.2, 0.3))
