"""Soak: random scenarios are drawn alike for a number, loaded, driven; a defect is found."""

import numpy as np
import pytest
from proving_ground.experiments.studies.faults import soak
from proving_ground.experiments.studies.faults.random_scenario import RandomTables
from proving_ground.experiments.studies.faults.soak import (
    DriveTask,
    LoadTask,
    drive_one,
    load_block,
)


def test_random_scenarios_load_or_are_refused_with_one_line():
    result = load_block(LoadTask(0, 40))
    assert result.loaded + result.refused == 40
    assert min(result.loaded, result.refused) > 5
    assert not result.defects


@pytest.mark.parametrize("number", [3, 14])
def test_random_scenarios_with_faults_drive_without_a_defect(number):
    result = drive_one(DriveTask(number, seconds=5.0))
    assert not result.defects
    assert result.status in {"completed", "stopped", "lost"}
    assert result.simulated_s > 0.0


def test_a_number_draws_the_same_tables():
    one, other = (
        RandomTables(np.random.default_rng(5), share=0.2, near=True).faults(10.0) for _ in range(2)
    )
    assert one == other


def test_an_exception_and_a_warning_are_defects(monkeypatch):
    monkeypatch.setattr(soak, "assemble", lambda scenario, seed: np.log(np.array(-1.0)).x)
    result = drive_one(DriveTask(0, seconds=1.0))
    assert result.status == "error"
    assert any("AttributeError" in line for line in result.defects)
    assert any("RuntimeWarning" in line for line in result.defects)
