"""Imperfect actuators and sensors, from the scenario to the record of a run."""

import numpy as np
import pytest
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.errors import InvalidPlant
from proving_ground.testbed.recording.channels import CONTROL, ESTIMATE, MEASUREMENT, STATE

SHORT = "path={kind='straight', length_m=8}"
IMU = tuple(name for name in MEASUREMENT.fields if name.startswith("imu"))


def run(*overrides, name="grass"):
    return simulate(name, load(name, [SHORT, *overrides])[1], seed=3)[1]


@pytest.fixture(scope="module")
def plain():
    return run()


@pytest.mark.parametrize("name", ["old-valves", "raw-gnss", "grass-field"])
def test_effects_that_are_on_are_logged_at_the_start(name):
    first = [event for event in run(name=name).events if event.time_s == 0.0]
    message = [event.text for event in first if event.level == "info"]
    assert message
    assert all(text.startswith(("actuators: ", "sensors: ")) for text in message)


def test_default_actuators_and_sensors_are_not_logged(plain):
    assert plain.events == ()
    assert np.isnan(plain[MEASUREMENT].columns(*IMU)).all()


def test_an_imu_whose_yaw_rate_is_not_used_changes_nothing_else(plain):
    record = run("sensors.imu.on=true", "controller.noise.yaw_rate_sd_degps=0.0")
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


def test_late_gnss_samples_are_taken_in_and_named_in_the_log(plain):
    record = run("sensors.gnss_latency_s=0.2")
    assert "sensors: GNSS latency 0.2 s" in [event.text for event in record.events]
    later = record[ESTIMATE].time_s > 1.0
    assert record[ESTIMATE]["nis_dof"][later].max() == 4 * 5 + 4, "as many as without latency"

    def error(record):
        place = ["x_t_m", "y_t_m"]
        rows = np.searchsorted(record[STATE].time_s, record[ESTIMATE].time_s - 1e-6)
        away = record[ESTIMATE].columns(*place) - record[STATE].columns(*place)[rows]
        return np.hypot(*away[5:].T).mean()

    assert error(record) < 2.0 * error(plain)


def test_late_samples_are_logged_with_the_time_and_the_value_of_their_sampling():
    measured = run("sensors.gnss_latency_s=0.2", "sensors.gnss_sd_m=0.0")
    table, state = measured[MEASUREMENT], measured[STATE]
    late = np.isfinite(table["gnss_tractor_x_m"])
    assert np.array_equal(late, np.isfinite(table["gnss_tractor_time_s"]))
    taken = table["gnss_tractor_time_s"][late]
    np.testing.assert_allclose(table.time_s[late] - taken, 0.2, atol=1e-9)
    rows = np.abs(state.time_s[:, None] - taken).argmin(axis=0)
    np.testing.assert_array_equal(state["x_t_m"][rows], table["gnss_tractor_x_m"][late])
    prompt = np.isfinite(table["encoder_mps"])
    np.testing.assert_array_equal(table["encoder_time_s"][prompt], table.time_s[prompt])


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("actuators.trailer.backlash_deg=30", r"trailer\.backlash_deg: got 30, must be below"),
        ("actuators.front.dead_time_s=0.0015", r"front\.dead_time_s: 0\.0015 s is not a whole"),
        ("sensors.gnss_latency_s=0.0015", r"latency of sensor gnss_tractor: 0\.0015 s"),
    ],
)
def test_settings_that_do_not_fit_the_vehicle_or_the_step_are_refused(override, message):
    with pytest.raises(InvalidPlant, match=message) as caught:
        assemble(load("grass", [override])[1], seed=1)
    assert "\n" not in str(caught.value)
