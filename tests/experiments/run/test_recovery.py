"""The default controller finds back on the plant, filter in the loop; faults end in a stop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from proving_ground.experiments.papers.studies.control import recover
from proving_ground.experiments.papers.study import Case
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.recording.channels import CONTROL, STATE
from proving_ground.testbed.recording.record import Recorder
from proving_ground.testbed.simulation.loop import STAGES, drive, sense

from ttempc.types import Sensor

SHORT = 'path={kind="straight",length_m=24.0}'
SLOW = 'path={kind="straight",length_m=21.0,speed_mps=0.7}'


@pytest.mark.parametrize(("lateral_m", "yaw_deg"), [(1.0, 20.0), (-1.0, 20.0)])
def test_recovers_from_a_metre_and_twenty_degrees_in_fifteen_metres(lateral_m, yaw_deg):
    seen = recover(Case("grass", 1, labels={"offset": (lateral_m, yaw_deg)}), ticks=110)
    assert seen["travel_m"] < 15.0
    assert seen["overshoot_m"] < 0.20
    assert seen["excess"] < 1e-9


def run(spoil, ticks=110, path=SHORT):
    """Drive a straight line, `spoil` changing what the sensors say at every tick."""

    def faulty(rig, period):
        sense(rig, period)
        period.measurements = [
            changed
            for sample in period.measurements
            if (changed := spoil(period.k, sample)) is not None
        ]

    assembly, recorder = assemble(load("grass", [path])[1], seed=1), Recorder()
    stages = [faulty if stage is sense else stage for stage in STAGES]
    outcome = drive(assembly.setup(recorder), ticks, stages)
    record = recorder.record()
    commands = record[CONTROL].columns("delta_t_rad_command", "delta_i_rad_command", "hp_command")
    assert np.all(np.isfinite(commands))
    return outcome, record, [event.text for event in record.events]


def test_without_gnss_the_vehicle_stops_within_ten_metres_and_stands_still():
    """At 0.7 m/s; the reference waits for the vehicle, which may stand for half a minute."""
    gnss = (Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER)
    outcome, record, events = run(
        lambda k, s: None if k >= 30 and s.sensor in gnss else s, ticks=130, path=SLOW
    )
    assert outcome.status == "stopped", outcome.failure
    assert any("half speed" in text for text in events)
    assert any("not measured for more than 12 s: stopped" in text for text in events)
    state = record[STATE]
    since = state.time_s >= 6.0
    assert np.sum(state["v_mps"][since]) * 0.04 < 10.0
    assert abs(state["v_mps"][-1]) < 0.02


def test_sensors_that_say_nan_are_no_reason_to_crash():
    nan = float("nan")
    _, _, said = run(
        lambda k, s: replace(s, value=tuple(nan for _ in s.value)) if k >= 30 else s, ticks=90
    )
    assert any("stopped" in text for text in said)
