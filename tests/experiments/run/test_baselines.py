"""Every baseline drives the plant, with the filter, a short way."""

from __future__ import annotations

import sys

import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.recording.channels import REFERENCE, STATE

from ttempc.types import Command, Input

LARGEST_M = 0.05  # mean Euclidean error after the first 8 s; two to three times what they show


@pytest.mark.parametrize(
    "name", ["pid", "lqr", "nmpc", "nmpc-rti", "nmpc-decentralised", "nmpc-distributed"]
)
def test_baseline_drives_the_plant_straight_ahead(name):
    overrides = [f'controller.name="{name}"', 'path.kind="straight"', "path.length_m=16.0"]
    summary, _ = simulate(*load("pavement", overrides), seed=31)
    assert summary.status == "completed"
    for error in (summary.tracking.all.tractor, summary.tracking.all.trailer):
        assert error.mean_euclidean_m is not None
        assert error.mean_euclidean_m < LARGEST_M


def test_space_based_reference_waits_for_the_vehicle():
    """It drives slower than 1 m/s; log and statistics have the place nearest to the tractor."""
    overrides = [
        'controller.name="proving_ground.experiments.papers.kayacan.nmpc:controller"',
        'controller.estimator="proving_ground.experiments.papers.kayacan.nmhe:Estimator"',
        'path={kind="straight",length_m=16.0}',
    ]
    summary, record = simulate(*load("pavement", overrides), seed=31)
    assert summary.status == "completed"
    state, reference = record[STATE], record[REFERENCE]
    assert 16.0 - state["x_t_m"][-1] - (state["x_t_m"][0] - reference["x_t_m"][0]) > 1.0
    error = summary.tracking.all.tractor
    assert error.along_mean_m == pytest.approx(0.0, abs=1e-9)
    assert error.along_sd_m == pytest.approx(0.0, abs=1e-9)
    assert 0.0 < error.mean_euclidean_m < 0.5


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

    scenario = load("pavement", ['path={kind="straight",length_m=20.0}'])
    summary, record = simulate(*scenario, seed=31, factory=controller)
    assert summary.status == status
    left = 20.0 - (record[STATE]["x_t_m"][-1] - record[STATE]["x_t_m"][0])
    if status == "completed":
        assert left == pytest.approx(5.0, abs=0.5)  # as far as a vehicle may be from its reference
        assert record[STATE].time_s[-1] > 1.3 * 20.0
    else:
        assert summary.failure.endswith(
            "of its path are left after 3 times the time of its reference"
        )
        assert f"{left:.0f} m" in summary.failure


def test_without_daqp_one_line_says_how_to_get_it(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "daqp", None)
    folder = tmp_path / "out"
    assert main(["run", "pavement", "--controller", "nmpc", "--out", str(folder)]) == 2
    assert not folder.exists()
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "pip install 'ttempc[baselines]'" in said
