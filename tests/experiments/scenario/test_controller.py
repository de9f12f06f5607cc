"""`[controller]` and `[control]`: options, assumed noise, rate of the loop and of the records."""

from dataclasses import fields

import numpy as np
import pytest
from proving_ground.experiments.errors import InvalidFit, InvalidScenario
from proving_ground.experiments.run.assembly import assemble, check
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.controller import NoiseSettings
from proving_ground.experiments.scenario.scenario import dump, load
from proving_ground.experiments.studies.tubes.fit import fit_run
from proving_ground.testbed.recording.channels import CONTROL, ESTIMATE, MEASUREMENT, STATE

from tests.experiments.study_files import SHORT as SHORT_STUDY
from tests.experiments.study_files import plan_of
from ttempc.detectors.table import BUILT_IN
from ttempc.errors import InvalidTube
from ttempc.estimation.noise import SensorNoise
from ttempc.guidance.controllers import CONTROLLERS

SHORT = 'path={kind="straight",length_m=12.0}'
NOISY = ("sensors.gnss_sd_m=0.1", "sensors.angle_sd_deg=4.0", "sensors.encoder_sd_mps=0.3")
PAPER = "controller.noise.assumed='paper'"
NOISE = {
    "gnss_sd_m": 0.1,
    "angle_sd_deg": 4.0,
    "encoder_sd_mps": 0.3,
    "gnss_white_share": 1.0,
    "gnss_correlation_time_s": 60.0,
    **dict.fromkeys(("gnss_correlation_m", "gnss_shared", "gnss_float_sd_m"), 0.0),
    "angle_offset_sd_deg": 0.0,
    "yaw_rate_sd_degps": 0.1,
    "yaw_rate_bias_sd_degps": 0.05,
}


def controller(*overrides, name="grass"):
    return load(name, overrides)[1].controller


def test_a_resolved_scenario_has_every_option_and_loads_again(tmp_path):
    file = tmp_path / "again.toml"
    for name, entry in CONTROLLERS.items():
        scenario = load("grass", [f'controller.name="{name}"'])[1]
        names = set() if entry.options is None else {item.name for item in fields(entry.options)}
        assert set(scenario.controller.options) == names
        file.write_text(dump(scenario))
        assert load(str(file))[1] == scenario


@pytest.mark.parametrize("detect", ["true", "false", '["-drift"]', '["motion", "wheels"]'])
def test_detectors_are_chosen_by_name_in_a_scenario_that_loads_again(tmp_path, detect):
    scenario = load("grass", [SHORT, f"controller.detect={detect}"])[1]
    file = tmp_path / "again.toml"
    file.write_text(dump(scenario))
    assert load(str(file))[1] == scenario
    guidance = assemble(scenario, 3).guidance
    assert len(guidance.detectors) == (0 if detect == "false" else len(BUILT_IN))


@pytest.mark.parametrize("wrong", ['["drifts"]', '["-"]', '["motion", "-wheel"]', "[3]", "3"])
def test_a_detector_that_does_not_exist_is_refused_in_one_line(wrong):
    with pytest.raises(InvalidScenario, match=r"controller\.detect") as failure:
        load("grass", [f"controller.detect={wrong}"])
    assert "\n" not in str(failure.value)


def test_options_replace_their_defaults_and_belong_to_the_controller_that_is_named(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("[controller]\nname = 'ttempc'\noptions = { horizon = 12 }\n")
    assert controller(name=str(file)).options == {**controller().options, "horizon": 12}
    assert "horizon" not in controller('controller.name="pid"', name=str(file)).options
    assert controller('controller.name="ttempc"', name=str(file)).options["horizon"] == 12
    axis = '[[axis]]\nkey = "controller.options.horizon"\nkind = "list"\nvalues = [10, 20]\n'
    plan = plan_of(tmp_path, 'scenario = "grass"\nseeds = 1', SHORT_STUDY, axis)
    runs = [plan[run] for run in range(plan.size)]
    assert [run.setting.scenario.controller.options["horizon"] for run in runs] == [10, 20]


def test_the_filter_assumes_the_specification_of_the_sensors_or_the_paper_s(tmp_path):
    slow = ("sensors.gnss_error='correlated'", "sensors.gnss_white_share=0.3")
    assert controller(*NOISY).noise == NoiseSettings(**NOISE)
    assert controller(*NOISY, *slow).noise == NoiseSettings(**{**NOISE, "gnss_white_share": 0.3})
    scenario = load("grass", [*NOISY, PAPER])[1]
    assert scenario.controller.noise.sensor_noise(scenario.sensors) == SensorNoise()  # sec. II
    paper = {**NOISE, "gnss_sd_m": 0.03, "angle_sd_deg": 2.0, "encoder_sd_mps": 0.1}
    own = controller(*NOISY, PAPER, "controller.noise.angle_sd_deg=2.0").noise
    assert own == NoiseSettings(assumed="paper", **paper)
    resolved = tmp_path / "resolved.toml"
    resolved.write_text(dump(scenario))
    again = controller("controller.noise.assumed='sensors'", name=str(resolved)).noise
    assert again == controller(*NOISY).noise


def test_wrong_noise_changes_the_filter_and_no_sample():
    """`feedforward` takes nothing from the estimate, so that the vehicle drives the same way.

    Without detectors, which slow down where samples contradict the estimate.
    """
    path = "path={kind='straight', length_m=6}"
    drive = (path, "controller.name='feedforward'", "controller.detect=false")
    told, wrong = (
        simulate("grass", load("grass", [*drive, *NOISY, *more])[1], seed=4)[1]
        for more in ((), (PAPER,))
    )
    for channel in (MEASUREMENT, STATE):  # equal bits; a NaN has two signs
        np.testing.assert_array_equal(told[channel].values, wrong[channel].values)
    # Less assumed noise: a smaller covariance, and innovations larger than it says.
    place = ["sd_x_t_m", "sd_y_t_m"]
    assert (wrong[ESTIMATE].columns(*place) < told[ESTIMATE].columns(*place)).all()
    nis = [np.nansum(r[ESTIMATE]["nis"]) / np.nansum(r[ESTIMATE]["nis_dof"]) for r in (wrong, told)]
    assert nis[0] > 4.0 > 1.5 > nis[1]


def test_a_faster_loop_has_a_command_a_period_stays_on_the_line_and_fits_no_tube():
    for rate_hz in (10.0, 25.0):
        scenario = load("grass", (f"control.rate_hz={rate_hz}", SHORT))[1]
        summary, record = simulate("grass", scenario, 1)
        assert summary.status == "completed"
        np.testing.assert_allclose(np.diff(record[CONTROL].time_s), 1.0 / rate_hz, atol=1e-9)
        assert np.isin(record[ESTIMATE].time_s, record[STATE].time_s).all()
        assert summary.tracking.all.trailer.mean_euclidean_m < 0.04
        with pytest.raises(InvalidFit, match="rate_hz"):
            fit_run(record, scenario)
    tube = ('controller.name="ttempc-tube"', "control.rate_hz=10.0", SHORT)
    with pytest.raises(InvalidTube, match="period_s"):
        check(load("grass", tube)[1])
