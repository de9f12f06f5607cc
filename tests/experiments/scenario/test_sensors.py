"""`[sensors]` and `[actuators]`: presets, laws of their errors, and what a record has of them."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import Scenario, dump, load
from proving_ground.testbed.errors import InvalidPlant
from proving_ground.testbed.recording.channels import CONTROL, ESTIMATE, MEASUREMENT, STATE
from proving_ground.testbed.sensing.sensor_specification import SENSOR_PRESETS

DEFAULTS = str(Path(__file__).with_name("defaults.toml"))
FIELD = 'sensors.preset="field"'
SHORT = "path={kind='straight', length_m=8}"
IMU = tuple(name for name in MEASUREMENT.fields if name.startswith("imu"))


def sensors(*overrides, name=DEFAULTS):
    return load(name, overrides)[1].sensors


def run(*overrides, name="grass"):
    return simulate(name, load(name, [SHORT, *overrides])[1], seed=3)[1]


@pytest.fixture(scope="module")
def plain():
    return run("sensors.imu.on=false")


def test_an_imu_whose_yaw_rate_is_not_used_changes_nothing_else(plain):
    record = run("controller.noise.yaw_rate_sd_degps=0.0")
    assert np.isfinite(record[MEASUREMENT].columns(*IMU)).all()
    np.testing.assert_array_equal(record[STATE].values, plain[STATE].values)
    np.testing.assert_array_equal(record[ESTIMATE].values, plain[ESTIMATE].values)


def test_commands_and_set_points_are_recorded():
    record = run("actuators.front.dead_time_s=0.12", "actuators.hydrostat.dead_time_s=0.4")
    state, control = record[STATE], record[CONTROL]
    for field, late in (("delta_t_rad", 0.12), ("delta_i_rad", 0.0), ("hp", 0.4)):
        sent = control[f"{field}_command"]
        # A row shows what the step that led to it was done with: the command of a tick ends its
        # way `late` after it and holds for a period.
        for k in range(len(sent) - 4):
            middle = control.time_s[k] + late + 0.1
            row = np.argmin(np.abs(state.time_s - middle))
            assert state[f"{field}_set_point"][row] == sent[k]


def test_settings_that_do_not_fit_the_vehicle_or_the_step_are_refused():
    for override, words in (
        ("actuators.trailer.backlash_deg=30", "trailer.backlash_deg: got 30"),
        ("actuators.front.dead_time_s=0.0015", "front.dead_time_s: 0.0015"),
        ("sensors.gnss_latency_s=0.0015", "latency of sensor gnss_tractor: 0.0015"),
    ):
        with pytest.raises(InvalidPlant) as caught:
            assemble(load("grass", [override])[1], seed=1)
        assert words in str(caught.value)
        assert "\n" not in str(caught.value)


def test_a_preset_gives_its_values_and_the_defaults_the_rest():
    default = asdict(Scenario().sensors)
    for name in SENSOR_PRESETS:
        preset = dict(SENSOR_PRESETS[name])
        imu = default["imu"] | preset.pop("imu", {})
        table = asdict(sensors(f"sensors.preset={name!r}"))
        assert table == default | preset | {"preset": name, "imu": imu}
    assert sensors() == sensors('sensors.preset="paper"') == Scenario().sensors


def test_keys_beside_a_preset_replace_its_values_and_another_preset_those_of_a_file(tmp_path):
    plain = sensors(FIELD)
    changed = sensors(FIELD, "sensors.gnss_latency_s=0.0", "sensors.imu.angle_bias_sd_deg=0.1")
    imu = replace(plain.imu, angle_bias_sd_deg=0.1)
    assert changed == replace(plain, gnss_latency_s=0.0, imu=imu)
    assert sensors(FIELD, name="raw-gnss") == plain
    resolved = tmp_path / "resolved.toml"
    resolved.write_text(dump(load("grass-field")[1]))
    assert sensors('sensors.preset="paper"', name=str(resolved)) == sensors()
    same = sensors(FIELD, "sensors.gnss_sd_m=0.02", name=str(resolved))
    assert same == replace(plain, gnss_sd_m=0.02)
