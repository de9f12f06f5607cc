"""Faults of a scenario: all kinds, when and where they act, refusals, marks, axes of sweeps."""

import math

import numpy as np
import pytest
from proving_ground.experiments.logs.replay import estimator_of, replay, same_as_recorded
from proving_ground.experiments.run.assembly import assemble, check
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.errors import InvalidFault
from proving_ground.testbed.faults.kinds import KINDS
from proving_ground.testbed.recording.channels import STATE
from proving_ground.testbed.recording.record import RESUMED

SHORT = "path={kind='straight', length_m=8}"
BENT = "path={kind='figure-eight', laps=1}"
IMU, LOADED = "sensors.imu.on=true", "plant.vehicle.load_kg=300"
STATUS = "sensors.gnss_status=true"
WINDOW = "start_s = 2.0, duration_s = 2.0"
LASTING = """
gnss_out; gnss_frozen; gnss_jump offset_m = 0.5; gnss_drift rate_mps = 0.1;
gnss_stairs rise_m = 0.1, every_s = 0.5; gnss_sine amplitude_m = 0.2, period_s = 2.0;
gnss_accelerating acceleration_mps2 = 0.05; gnss_rotation rate_degps = 0.5;
gnss_moving_drift rate_mps = 0.1; gnss_held speed_mps = 2.0; gnss_warning warning = 'jammed';
angle_scaled sensor = 'hitch', factor = 0.5; gyro_ramp rate_degps2 = 0.05; gyro_scaled factor = 0.8;
gyro_swapped axis = 'roll'; samples_ageing first_s = 0.1, last_s = 1.0, over_s = 2.0;
samples_noisier factor = 5.0;
gnss_outlier offset_m = 2.0; gnss_float; gnss_late delay_s = 0.4; antennas_swapped;
angle_stuck sensor = 'hitch'; angle_bias sensor = 'steering_tractor', bias_deg = 3.0;
angle_drift sensor = 'steering_trailer', rate_degps = 1.0;
angle_noise sensor = 'hitch', sd_deg = 5.0; gyro_bias body = 'tractor', bias_degps = 2.0;
encoder_dead; encoder_scaled factor = 2.0; samples_duplicated; stamps_backward;
stamps_shifted offset_s = -0.3; commands_lost; commands_late delay_s = 0.4; front_steering_stuck;
trailer_steering_stuck; hydrostat_stuck; front_steering_slow rate_degps = 0.5;
trailer_steering_slow rate_degps = 0.5; front_steering_hard_over side = 'left';
trailer_steering_hard_over side = 'right'; front_steering_play backlash_deg = 2.0;
trailer_steering_play backlash_deg = 2.0; hydrostat_cut; hydrostat_sluggish time_constant_s = 2.0;
front_steering_free; trailer_steering_free; load_shift left_m = 0.1;
tyre_flat wheel = 'trailer_left'; gust force_n = 800.0, direction_deg = 90.0;
stone wheel = 'front_left', impulse_ns = 200.0
"""
FOR_TIME = {
    kind: keys for kind, _, keys in (text.strip().partition(" ") for text in LASTING.split(";"))
}
ON_THE_WAY = {
    "soil_patch": "radius_m = 1.0, cone_index_kpa = 100.0",
    "ditch": "depth_m = 0.1, width_m = 1.0",
    "step": "height_m = 0.1, ramp_m = 0.5",
}


def table(kind):
    if kind in ON_THE_WAY:
        return f"faults=[{{kind = '{kind}', at_m = 5.0, {ON_THE_WAY[kind]}}}]"
    keys = ", ".join(filter(None, (WINDOW, FOR_TIME[kind])))
    return f"faults=[{{kind = '{kind}', {keys}}}]"


def scenario(*overrides):
    return load("grass", [SHORT, IMU, STATUS, LOADED, *overrides])[1]


def run(*overrides):
    return simulate("grass", scenario(*overrides), seed=3)


def test_every_kind_is_accepted_where_it_can_act():
    assert set(KINDS) == {*FOR_TIME, *ON_THE_WAY}
    assert all(check(scenario(table(kind))) > 0 for kind in KINDS)


def test_faults_are_those_of_the_seed_and_a_replay_has_the_faulty_samples():
    faults = (
        "faults=[{kind='gnss_float', start_s=2.0}, {kind='samples_duplicated', start_s=3.0}, "
        "{kind='gnss_late', start_s=4.0, duration_s=1.0, delay_s=0.3}]"
    )
    overrides = (faults, "controller.learn=false")
    record, again = run(*overrides)[1], run(*overrides)[1]
    np.testing.assert_array_equal(record[STATE].values, again[STATE].values)
    assert same_as_recorded(replay(record, estimator_of(scenario(*overrides))), record)


def test_an_operator_resumes_at_the_times_of_the_scenario():
    _, record = simulate(*load("pavement", [SHORT, "control.resume_s=[1.1]"]), seed=1)
    assert [event.time_s for event in record.events if event.text == RESUMED] == [
        pytest.approx(1.2)
    ]


def test_at_m_is_the_distance_of_the_reference_over_all_laps():
    ditch = "faults=[{kind='ditch', at_m=20.0, depth_m=0.2, width_m=2.0}]"
    speed = "path.speed_mps=0.8"
    assembly = assemble(load("grass", [BENT, speed, ditch])[1], seed=1)
    level = assemble(load("grass", [BENT, speed])[1], seed=1).terrain
    x, y, yaw = assembly.reference.path.pose(20.0).tolist()
    across = np.array([-3.0, 0.0, 3.0])
    places = x - across * math.sin(yaw), y + across * math.cos(yaw)
    depth = level.height(*places) - assembly.terrain.height(*places)
    np.testing.assert_allclose(depth, 0.2, atol=0.02)
    np.testing.assert_array_equal(level.heights[0], assembly.terrain.heights[0])


def test_a_fault_that_cannot_act_is_refused_before_the_run():
    for fault, message in (
        ("kind='gnss_out', start_s=8.0", "faults.0 (gnss_out): got start_s 8"),
        ("kind='gnss_out', at_m=9.0", "got at_m 9"),
        ("kind='gnss_out', start_s=2.05, duration_s=0.1", "gnss_tractor"),
        ("kind='commands_lost', start_s=2.05, duration_s=0.1", "no command"),
        ("kind='front_steering_slow', start_s=2.0, rate_degps=90.0", "rate_degps"),
        ("kind='trailer_steering_play', start_s=2.0, backlash_deg=80.0", "backlash_deg"),
        ("kind='load_shift', start_s=2.0", "left_m and forward_m are 0"),
        ("kind='load_shift', start_s=2.0, left_m=3.0", "half the box"),
        ("kind='tyre_flat', start_s=2.0, wheel='rear_left', radius_loss_m=0.4", "half the radius"),
    ):
        for refuse in (check, lambda one: assemble(one, seed=1)):
            with pytest.raises(InvalidFault) as caught:
                refuse(scenario(f"faults=[{{{fault}}}]"))
            assert message in str(caught.value)
            assert "\n" not in str(caught.value)
    twice = "faults=[{kind='gnss_out',start_s=1.0},{kind='gnss_out',start_s=3.0}]"
    for overrides, message in (
        (("sensors.imu.on=false", table("gyro_bias")), "IMU"),
        (("sensors.gnss_status=false", table("gnss_warning")), "gnss_status"),
        (("plant.vehicle.load_kg=0", table("load_shift")), "the trailer is empty"),
        (("controller.estimator='truth'", table("gnss_out")), "no sample"),
        ((twice,), "name"),
    ):
        with pytest.raises(InvalidFault, match=message):
            check(scenario(*overrides))


LONGER = "path={kind='straight', length_m=30}"


@pytest.mark.parametrize(
    ("fault", "status", "reason"),
    [
        ("kind='gnss_out', start_s=3.0, duration_s=1.5", "completed", None),
        ("kind='gnss_out', start_s=3.0", "stopped", "position not measured for more than 12 s"),
        ("kind='front_steering_hard_over', side='left', start_s=3.0", "stopped", "front steering"),
    ],
)
def test_a_safe_stop_is_neither_completed_nor_lost(fault, status, reason):
    overrides = (LONGER, "plant.vehicle.load_kg=0", f"faults=[{{{fault}}}]")
    summary, record = run(*overrides)
    assert summary.status == status
    assert (summary.failure or "").startswith(reason or "")
    speed = record[STATE]["v_mps"][-1]
    assert (abs(speed) < 0.05) == (status == "stopped")
