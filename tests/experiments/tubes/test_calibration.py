"""Calibration of tubes: half widths hold the promised share of runs, bad runs are refused."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest
from proving_ground.experiments.errors import InvalidFit
from proving_ground.experiments.results.containment import Containment
from proving_ground.experiments.scenario.scenario import load
from proving_ground.experiments.scenario.tube_file import read_tube, to_json
from proving_ground.experiments.tubes.calibration import (
    DrivenRun,
    calibrate_tube,
    calibrated_widths,
    format_calibration,
)

from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.tube.reference_tube import ReferenceTube
from ttempc.vehicle import Vehicle

REFERENCE_PATH = Reference(
    load("grass", ["path.laps=1"])[1].mission().path, Vehicle(), ConstantSpeed(1.0)
)
ALONG_GRASS = ReferenceTube.along(read_tube("grass").design(), REFERENCE_PATH, 684)


def driven(seed, largest=(0.03, 0.05, 0.03, 0.04)):
    generator = np.random.default_rng(seed)
    settings = load("grass", ["path.laps=1", 'controller.name="ttempc-tube"'])[1]
    return DrivenRun(
        "grass",
        "ttempc-tube",
        seed,
        settings,
        REFERENCE_PATH,
        largest=np.array(largest) * generator.uniform(0.5, 1.5),
        half_width=ALONG_GRASS.half_widths[0, Containment.POINTS],
    )


def test_calibrated_half_widths_hold_the_promised_share_of_fresh_runs():
    generator = np.random.default_rng(3)
    inside = []
    for _ in range(300):
        largest = generator.gamma(3.0, [0.01, 0.03, 0.01, 0.02], (31, 4))
        widths, calibration = calibrated_widths(largest[:-1], 0.9)
        inside.append(bool(np.all(largest[-1] <= widths)))
    assert calibration.count == 24
    expected = calibration.coverage  # 23 / 25
    assert np.mean(inside) == pytest.approx(expected, abs=3.0 * np.sqrt(0.08 * 0.92 / 300))


def test_a_tube_is_calibrated_on_runs_in_it_and_keeps_its_design(tmp_path):
    runs = [driven(seed) for seed in range(1, 31)]
    tube = calibrate_tube(runs, 0.9)
    calibration = tube.calibration
    assert calibration is not None
    assert calibration.scale_seeds == [5, 10, 15, 20, 25, 30]
    assert calibration.guaranteed == 23 / 25
    widths = np.array(list(asdict(calibration.half_widths).values()))
    outside = [run for run in runs if run.seed % 5 and np.any(run.largest > widths)]
    assert len(outside) == 1  # the 23rd of 24
    assert replace(tube, calibration=None) == replace(read_tube("grass"), calibration=None)
    text = format_calibration(tube)
    assert "24 scored, 6 for the scale" in text
    assert f"{calibration.half_widths.trailer_across_m:.4f}" in text.splitlines()[-1]
    file = tmp_path / "tube.json"
    file.write_text(to_json(tube))
    assert read_tube(str(file)) == tube


def test_runs_that_calibrate_nothing_are_refused():
    runs = [driven(seed) for seed in range(1, 31)]
    with pytest.raises(InvalidFit, match=r"got 20 runs, a coverage of 0.95 .* takes 23 at least"):
        calibrate_tube(runs[:20], 0.95)
    assert calibrate_tube(runs[:23], 0.95).calibration is not None
    with pytest.raises(InvalidFit, match="seed 1: there twice"):
        calibrate_tube([*runs, runs[0]], 0.9)
    other = replace(runs[7], half_width=1.1 * runs[7].half_width)
    with pytest.raises(InvalidFit, match=r"seed 8: driven in another tube than grass .* 10.0 %"):
        calibrate_tube([*runs[:7], other, *runs[8:]], 0.9)
