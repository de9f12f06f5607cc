"""Learning of a model's lengths in a whole run."""

import numpy as np
from proving_ground.experiments.results.table import format_run
from proving_ground.experiments.results.tracking_errors import tracking_errors
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.recording.channels import STATE

from ttempc.vehicle import Vehicle

WRONG = ["path.laps=1", "controller.vehicle.wheelbase_m=1.74", "controller.vehicle.drawbar_m=0.96"]

DRIVE_34_M = "path={kind='straight', length_m=34}"  # the first attempt is at 20 s


def test_wrong_lengths_are_learnt_told_and_cost_little_from_then_on():
    _, scenario = load("grass", [*WRONG, 'controller.name="pid"'])
    summary, record = simulate("grass", scenario, 1)
    first, *_ = summary.learnt
    assert first.startswith("25 s: vehicle.wheelbase 1.74 -> 1.")
    assert "Learnt at 25 s: vehicle.wheelbase" in format_run(summary)
    errors = tracking_errors(record)
    before, after = errors.time_s < 25.0, errors.time_s > 70.0
    counted = errors.time_s > 8.0
    assert errors.trailer.euclidean_m[before & counted].mean() > 0.04
    assert errors.tractor.euclidean_m[after].mean() < 0.03
    assert errors.trailer.euclidean_m[after].mean() < 0.03


def test_with_the_right_lengths_learning_changes_no_bit():
    runs = [
        simulate("grass", load("grass", [DRIVE_34_M, *extra])[1], 2)
        for extra in ([], ["controller.learn=false"])
    ]
    (summary, record), (_, other) = runs
    assert summary.learnt == []
    assert np.array_equal(record[STATE].values, other[STATE].values)


def test_a_run_is_judged_by_the_lengths_of_the_plant():
    """Against a reference that no controller can move by what it learns."""
    reference = assemble(load("grass", WRONG)[1], 1).reference
    assert reference.vehicle == Vehicle()
