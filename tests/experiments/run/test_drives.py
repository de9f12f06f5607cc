"""Whole runs: baselines, dead times, learning, implements, reverse, lost sensors, QP solvers."""

from __future__ import annotations

import math
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.results.table import format_run
from proving_ground.experiments.results.tracking_errors import tracking_errors
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load, shipped
from proving_ground.testbed.recording.channels import CONTROL, REFERENCE, STATE
from proving_ground.testbed.recording.record import REACTION, Recorder
from proving_ground.testbed.simulation.loop import STAGES, drive, sense
from proving_ground.testbed.vehicle.vehicle import VEHICLES

from ttempc.baselines.pid import pid_controller
from ttempc.types import Command, Input, Sensor
from ttempc.vehicle import Vehicle

LARGEST_M = 0.05  # mean Euclidean error after the first 8 s; two to three times what they show
BACK = "path={kind='straight', length_m=20.0, reverse=true}"
WRONG = ["path.laps=1", "controller.vehicle.wheelbase_m=1.74", "controller.vehicle.drawbar_m=0.96"]


def straight(length_m, **keys):
    more = "".join(f", {key}={value}" for key, value in keys.items())
    return f"path={{kind='straight', length_m={length_m}{more}}}"


def driven(name, *overrides, seed=1, **how):
    return simulate(*load(name, overrides), seed, **how)


@pytest.mark.parametrize("name", ["pid", "lqr", "nmpc", "nmpc-rti"])
def test_baseline_drives_the_plant_straight_ahead(name):
    summary, _ = driven("pavement", f"controller.name={name}", straight(16.0), seed=31)
    assert summary.status == "completed"
    for error in (summary.tracking.all.tractor, summary.tracking.all.trailer):
        assert error.mean_euclidean_m < LARGEST_M


def test_without_daqp_one_line_says_how_to_get_it(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "daqp", None)
    folder = tmp_path / "out"
    assert main(["run", "pavement", "--controller", "nmpc", "--out", str(folder)]) == 2
    assert not folder.exists()
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "pip install -e './ttempc[baselines]'" in said


AT_WORKING_SPEED = [name for name in shipped() if name.startswith(("work-", "fast-"))]


@pytest.mark.parametrize("name", [name for name in AT_WORKING_SPEED if "passes" in name])
def test_a_tool_works_on_the_passes_alone(name):
    scenario = load(name)[1]
    for begins, ends in scenario.implement.work_m:
        along = np.arange(begins, ends, 0.5)
        assert not scenario.mission().path.curvature(along).any()


@pytest.mark.slow
@pytest.mark.parametrize("name", AT_WORKING_SPEED)
def test_scenarios_at_working_speed_run_to_their_end(name):
    summary, _ = driven(name)
    assert summary.status == "completed"


class Slow:
    """A constant hydrostat, followed by place."""

    space_based = True

    def __init__(self, hp):
        self._hp = hp

    def step(self, estimate, k):
        return Command(0.0, 0.0, self._hp)


@pytest.mark.parametrize(("share", "status"), [(0.5, "completed"), (0.05, "lost")])
def test_a_run_by_place_ends_at_the_end_of_its_path_or_is_lost(share, status):
    def controller(vehicle, reference, period_s):
        return Slow(share * float(reference.at(0.0).inputs[Input.HP]))

    summary, record = driven("pavement", straight(20.0), seed=31, factory=controller)
    assert summary.status == status
    left = 20.0 - (record[STATE]["x_t_m"][-1] - record[STATE]["x_t_m"][0])
    if status == "completed":
        assert left == pytest.approx(5.0, abs=0.5)  # as far as a vehicle may be from its reference
        assert record[STATE].time_s[-1] > 1.3 * 20.0
    else:
        assert f"{left:.0f} m" in summary.failure


@pytest.mark.parametrize("controller", ["ttempc", "pid"])
def test_unknown_dead_times_of_the_valves_are_learnt_within_twenty_seconds(controller):
    plant = [f"actuators.{name}.dead_time_s=0.4" for name in ("front", "trailer", "hydrostat")]
    _, record = driven("grass", *plant, straight(20.0), f"controller.name={controller}")
    told = " ".join(event.text for event in record.events if "learnt" in event.text)
    for field in ("dead_time_t", "dead_time_i"):
        value, sd = re.search(rf"vehicle.{field} 0 -> (\S+) \+- (\S+) s", told).groups()
        assert abs(float(value) - 0.4) < 4.0 * float(sd) < 0.15


def test_wrong_lengths_are_learnt_told_and_cost_little_from_then_on():
    # Slips of a wrong model may stop the vehicle for a check, in which it lags along the path.
    alone = "controller.detect=false"
    summary, record = driven("grass", *WRONG, "controller.name=pid", alone)
    first, *_ = summary.learnt
    assert first.startswith("25 s: vehicle.wheelbase 1.74 -> 1.")
    assert "Learnt at 25 s: vehicle.wheelbase" in format_run(summary)
    errors = tracking_errors(record)
    before, after = errors.counted & (errors.time_s < 25.0), errors.time_s > 70.0
    assert errors.trailer.euclidean_m[before].mean() > 0.04
    assert errors.tractor.euclidean_m[after].mean() < 0.03
    assert errors.trailer.euclidean_m[after].mean() < 0.03
    # Judged by the lengths of the plant, which no controller moves by what it learns.
    assert assemble(load("grass", WRONG)[1], 1).reference.vehicle == Vehicle()


def test_with_the_right_lengths_learning_changes_no_bit():
    path = straight(34)  # the first attempt is at 20 s
    (summary, record), (_, other) = (
        driven("grass", path, *more, seed=2) for more in ((), ("controller.learn=false",))
    )
    assert summary.learnt == []
    assert np.array_equal(record[STATE].values, other[STATE].values)


def test_no_detector_stops_a_run_on_the_true_state():
    summary, _ = driven("grass", "path.laps=1", 'controller.estimator="truth"', seed=201)
    assert summary.status == "completed"


def locked(vehicle, reference, period_s):
    """Return a controller that guides the tractor and keeps the trailer's steering straight.

    A controller's own choice: of a valve that stays behind its command the supervisor would stop.
    """
    both = pid_controller(vehicle, reference, period_s)

    class Locked:
        def step(self, estimate, k):
            return replace(both.step(estimate, k).command, delta_i=0.0)

    return Locked()


def test_on_a_side_slope_a_steered_trailer_keeps_the_tool_where_a_locked_one_does_not():
    """Veal (2009): an unsteered implement slides aside behind a guided tractor."""
    drive = ("side-slope", straight(25), "implement={}", "controller.name=pid")
    summaries = [driven(*drive, seed=5, factory=factory)[0] for factory in (None, locked)]
    assert [summary.status for summary in summaries] == ["completed"] * 2
    steered, aside = (summary.tracking.all for summary in summaries)
    assert aside.tractor.cross_p95_m < 0.06
    assert aside.tool.cross_p95_m > 2.0 * steered.tool.cross_p95_m
    assert aside.tool.cross_mean_m < -0.03  # downhill


def reversing(*overrides, seed=1):
    summary, record = driven("grass", "controller.name=ttempc-nominal", *overrides, seed=seed)
    errors = tracking_errors(record)
    return summary, record, max(error.euclidean_m.max() for error in errors.by_point.values())


def test_a_straight_reverse_on_grass_keeps_both_points_within_20_cm():
    """Acceptance of the project, start-up included."""
    summary, record, largest_m = reversing(BACK, seed=11)
    assert summary.status == "completed"
    assert largest_m < 0.20
    state = record[STATE]
    assert np.all(state["v_mps"] < 0.0)
    assert state["x_t_m"][-1] - state["x_t_m"][0] == pytest.approx(20.0, abs=0.2), "to the east"
    assert np.abs(np.abs(state["psi_t_rad"]) - np.pi).max() < 0.3, "looking west"
    command = record[CONTROL]["hp_command"]
    assert np.all((command >= -1.0) & (command <= 0.0))


def test_curves_hold_in_reverse_too_and_without_feedback_the_trailer_folds(tmp_path, capsys):
    turns = "path={kind='headland', passes=2, length_m=4.0, width_m=15.0, reverse=true}"
    summary, _, largest_m = reversing(turns)
    assert summary.status == "completed"
    assert largest_m < 0.20
    summary, *_ = reversing(BACK, 'controller.name="feedforward"')
    assert summary.status == "lost"
    assert "jack-knife" in summary.failure
    forward_only = tmp_path / "forward-only.toml"
    lines = VEHICLES.find("farm4500").read_text().splitlines(keepends=True)
    forward_only.write_text("".join(line for line in lines if not line.startswith("reverse")))
    changes = [f"--set=plant.vehicle.file='{forward_only}'", "--set=path.reverse=true"]
    assert main(["run", "farm", "--out", str(tmp_path / "new"), *changes]) == 2
    assert "forward-only" in capsys.readouterr().err


def test_in_reverse_the_front_steering_is_calm_again_after_a_curve():
    """With the step weights of driving ahead it swung from stop to stop along the second pass."""
    summary, record = driven("work-reverse", seed=22)
    assert summary.status == "completed"
    reference, control = record[REFERENCE], record[CONTROL]
    in_curve = np.abs(reference["delta_t_rad"]) > 1e-3
    after_s = reference.time_s[in_curve][-1]
    command = control["delta_t_rad_command"][control.time_s > after_s]
    assert np.abs(command).max() < math.radians(15.0)
    assert not [event.text for event in record.events if "learnt: vehicle" in event.text]


def spoilt(spoil, ticks, path):
    """Drive a straight line, `spoil` changing what the sensors say at every tick."""

    def faulty(rig, period):
        sense(rig, period)
        changed = (spoil(period.k, sample) for sample in period.measurements)
        period.measurements = [sample for sample in changed if sample is not None]

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
    outcome, record, events = spoilt(
        lambda k, s: None if k >= 30 and s.sensor in gnss else s, 130, straight(21, speed_mps=0.7)
    )
    assert outcome.status == "stopped", outcome.failure
    assert any("half speed" in text for text in events)
    state = record[STATE]
    since = state.time_s >= 6.0
    assert np.sum(state["v_mps"][since]) * 0.04 < 10.0
    assert abs(state["v_mps"][-1]) < 0.02


def test_sensors_that_say_nan_are_no_reason_to_crash():
    def nan(k, sample):
        return replace(sample, value=(math.nan,) * len(sample.value)) if k >= 30 else sample

    assert any("stopped" in text for text in spoilt(nan, 90, straight(24))[2])


def test_the_wait_for_the_first_estimate_is_no_warning():
    """Receivers of `grass-field` deliver late: the filter starts after the first tick."""
    name, scenario = load("grass-field", ["path={kind='straight', length_m=4}"])
    _, record = simulate(name, scenario, seed=1)
    first = next(event for event in record.events if event.text.startswith(REACTION))
    assert (first.time_s, first.level) == (0.0, "info")
    assert "no estimate yet" in first.text
    assert not [event for event in record.events if event.level == "warning"]
