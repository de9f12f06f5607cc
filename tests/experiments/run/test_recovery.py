"""The default controller finds back on the plant, filter in the loop."""

from __future__ import annotations

import math

import numpy as np
import pytest
from proving_ground.experiments.results.tracking_errors import tracking_errors
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.recording.channels import CONTROL
from proving_ground.testbed.recording.record import Recorder
from proving_ground.testbed.simulation.loop import drive


@pytest.mark.parametrize("lateral_m", [1.0, -1.0])
def test_recovers_from_a_metre_and_twenty_degrees_in_fifteen_metres(lateral_m):
    assembly = assemble(load("grass", ['path={kind="straight",length_m=22.0}'])[1], 1)
    recorder = Recorder()
    setup = assembly.setup(recorder)
    x, y, yaw = assembly.reference.at(0.0).state[:3].tolist()
    x, y = x - lateral_m * math.sin(yaw), y + lateral_m * math.cos(yaw)
    assembly.plant.reset(x, y, yaw + math.radians(20.0), 1.0)
    drive(setup, 110)
    record = recorder.record()
    errors, sent, vehicle = tracking_errors(record), record[CONTROL], assembly.vehicle
    beside = np.stack([errors.tractor.cross_m, errors.trailer.cross_m])
    assert np.abs(beside[:, errors.time_s > 15.0]).max() < 0.10  # at 1 m/s
    assert (-math.copysign(1.0, lateral_m) * beside[1]).max() < 0.20
    commands = np.stack([sent[f"{name}_command"] for name in ("delta_t_rad", "delta_i_rad", "hp")])
    most = setup.control_steps * assembly.plant.timestep_s * vehicle.input_rate[:, None]
    assert (np.abs(np.diff(commands)) - most).max() < 1e-9
    assert (vehicle.input_min[:, None] - commands).max() < 1e-9
    assert (commands - vehicle.input_max[:, None]).max() < 1e-9


def test_a_vehicle_whose_hydrostat_is_stuck_is_steered_along_its_path():
    """It rolls on at 1 m/s, whatever the supervisor sends: the reference goes with it."""
    changes = ["sensors.imu.on=true", 'faults=[{kind="hydrostat_stuck",start_s=20.0}]']
    assembly = assemble(load("side-slope", changes)[1], 8)
    recorder = Recorder()
    drive(assembly.setup(recorder), 400)
    alarms = {alarm.detector for alarm in assembly.guidance.alarms}
    assert alarms >= {"hydrostat", "motion"}
    assert "position" not in alarms

    errors = tracking_errors(recorder.record())
    assert errors.time_s[-1] > 75.0
    assert np.abs(errors.tractor.cross_m).max() < 0.25
    assert np.abs(errors.tractor.along_m).max() < 1.0
