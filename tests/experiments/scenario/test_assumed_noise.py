"""`[controller.noise]`: the noise that the filter assumes, true by default and wrong by choice."""

import numpy as np
import pytest
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.controller import NoiseSettings
from proving_ground.experiments.scenario.scenario import dump, load
from proving_ground.testbed.recording.channels import ESTIMATE, MEASUREMENT, STATE

from ttempc.estimation.noise import SensorNoise

NOISY = ("sensors.gnss_sd_m=0.1", "sensors.angle_sd_deg=4.0", "sensors.encoder_sd_mps=0.3")
PAPER = "controller.noise.assumed='paper'"


def noise(*overrides, name="grass"):
    return load(name, overrides)[1].controller.noise


def test_the_filter_assumes_the_specification_of_the_sensors():
    slow = ("sensors.gnss_error='correlated'", "sensors.gnss_white_share=0.3")
    for more, share in (((), 1.0), (slow, 0.3)):
        assert noise(*NOISY, *more) == NoiseSettings(
            gnss_sd_m=0.1,
            angle_sd_deg=4.0,
            encoder_sd_mps=0.3,
            gnss_white_share=share,
            gnss_correlation_time_s=60.0,
            yaw_rate_sd_degps=0.1,
            yaw_rate_bias_sd_degps=0.05,
        )


def test_the_noise_of_the_paper_does_not_depend_on_the_sensors():
    scenario = load("grass", [*NOISY, PAPER])[1]
    assumed = scenario.controller.noise.sensor_noise(scenario.sensors)
    assert assumed == SensorNoise()  # sec. II of the paper


def test_values_replace_those_of_the_selection_alone():
    assert noise(*NOISY, PAPER, "controller.noise.angle_sd_deg=2.0") == NoiseSettings(
        assumed="paper",
        gnss_sd_m=0.03,
        angle_sd_deg=2.0,
        encoder_sd_mps=0.1,
        gnss_white_share=1.0,
        gnss_correlation_time_s=60.0,
        yaw_rate_sd_degps=0.1,
        yaw_rate_bias_sd_degps=0.05,
    )


def test_another_selection_replaces_the_values_of_a_file(tmp_path):
    resolved = tmp_path / "resolved.toml"
    resolved.write_text(dump(load("grass", [*NOISY, PAPER])[1]))
    again = noise("controller.noise.assumed='sensors'", name=str(resolved))
    assert again == noise(*NOISY)


def test_sensors_without_noise_leave_a_covariance_that_can_be_inverted():
    exact = ("sensors.gnss_sd_m=0.0", "sensors.angle_sd_deg=0.0", "sensors.encoder_sd_mps=0.0")
    scenario = load("grass", exact)[1]
    assumed = scenario.controller.noise.sensor_noise(scenario.sensors)
    assert assumed == SensorNoise(gnss=1e-3, steering=1e-3, hitch=1e-3, encoder=1e-3)


def test_wrong_noise_changes_the_filter_and_no_sample():
    """`feedforward` takes nothing from the estimate, so that the vehicle drives the same way."""
    drive = ("path={kind='straight', length_m=6}", "controller.name='feedforward'")
    told, wrong = (
        simulate("grass", load("grass", [*drive, *NOISY, *more])[1], seed=4)[1]
        for more in ((), (PAPER,))
    )
    for channel in (MEASUREMENT, STATE):  # equal bits; a NaN has two signs
        np.testing.assert_array_equal(told[channel].values, wrong[channel].values)
    # Less assumed noise: a smaller covariance, and innovations larger than it says.
    place = ["sd_x_t_m", "sd_y_t_m"]
    assert (wrong[ESTIMATE].columns(*place) < told[ESTIMATE].columns(*place)).all()

    def nis(record):
        table = record[ESTIMATE]
        return np.nansum(table["nis"]) / np.nansum(table["nis_dof"])

    assert nis(wrong) > 4.0 > 1.5 > nis(told)


def test_a_difference_from_the_sensors_is_a_mismatch_of_the_run():
    def mismatch(*overrides):
        return [str(item) for item in assemble(load("grass", overrides)[1], seed=1).mismatch]

    assert mismatch(*NOISY) == []
    assert mismatch(PAPER) == []
    assert mismatch("sensors.gnss_sd_m=0.3", PAPER) == [
        "controller.noise.gnss_sd_m 0.03 (true 0.3)"
    ]


@pytest.mark.parametrize("estimator", ["ekf", "nmhe"])
def test_every_estimator_that_filters_is_told_the_assumed_noise(estimator):
    short = ("path={kind='straight', length_m=2}", f"controller.estimator='{estimator}'")
    one, other = (
        simulate("grass", load("grass", [*short, *more])[1], seed=1)[1][ESTIMATE].values
        for more in ((), ("controller.noise.gnss_sd_m=0.3",))
    )
    assert not np.array_equal(one, other, equal_nan=True)
