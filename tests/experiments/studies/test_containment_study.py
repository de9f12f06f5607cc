"""Containment study: counting of laps, resumption and figures."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
from proving_ground.experiments.results.containment import QUANTITIES
from proving_ground.experiments.scenario.tube_file import (
    PointHalfWidths,
    RunCalibration,
    read_tube,
    to_json,
)
from proving_ground.experiments.studies.containment import CASES, read_laps, table
from proving_ground.experiments.studies.containment_figures import draw_containment

from tests.ttempc.tubes import DESIGN


def lap(case="grass-soil", seed=1, outside=0, status="completed"):
    def counts(steps, out):
        return {"steps": steps, "points": steps - out}

    return {
        "case": case,
        "seed": seed,
        "status": status,
        "straight": counts(300, 0),
        "curve": counts(350, outside),
        "restarts": outside,
        "largest_m": [0.05, 0.07, 0.05, 0.05 + 0.001 * outside],
        "largest_share": [0.4 + 0.1 * outside] * len(QUANTITIES),
        "cross_error_p95_m": [0.03, 0.02],
        "slip_mean": 0.05,
    }


def test_laps_are_counted_by_steps_and_as_wholes(tmp_path):
    laps = [lap(seed=1), lap(seed=2, outside=13), lap(seed=3, status="lost")]
    text = "".join(json.dumps(one) + "\n" for one in laps)
    (tmp_path / "laps.jsonl").write_text(text + '{"case": "grass-so')  # cut off
    assert read_laps(tmp_path) == laps
    tube = read_tube("grass")
    calibration = RunCalibration(
        scenario="grass",
        controller="ttempc-tube",
        reference={},
        coverage=0.95,
        guaranteed=0.96,
        scored_seeds=[1],
        scale_seeds=[2],
        half_widths=PointHalfWidths(0.06, 0.08, 0.06, 0.06),
        versions={},
    )
    (tmp_path / "grass-soil.json").write_text(to_json(replace(tube, calibration=calibration)))
    (tmp_path / "wet-grass-soil-refused.txt").write_text("the tightened set is empty\n")
    lines = list(table(tmp_path))
    cells = [cell.strip() for cell in lines[2].split("|")[1:-1]]
    assert cells[:3] == ["`grass-soil`", "3", "1"]
    assert cells[3] == f"{1.0 - 13 / 1950:.4f}"
    assert cells[4] == "1.0000"
    assert cells[5] == f"{1.0 - 13 / 1050:.4f}"
    assert cells[6].startswith("0.3333 (")  # a lap that was lost is not inside
    assert cells[8] == "1.70"
    assert cells[9:11] == ["8.0 / 6.0", "0.9600"]
    assert cells[11].startswith("0.3333 (")  # one left the half width of the trailer, one was lost
    assert lines[-1].endswith("the tightened set is empty")


def test_every_borrowed_tube_is_that_of_a_case_with_its_own():
    for case in CASES.values():
        assert not case.tube_of or not CASES[case.tube_of].tube_of


def test_the_figures_are_drawn_from_what_is_in_the_folder(tmp_path):
    (tmp_path / "tracks").mkdir()
    time_s = 8.0 + 0.2 * np.arange(600)
    for seed in (2001, 2002):
        np.savez(
            tmp_path / "tracks" / f"grass-soil-{seed}.npz",
            time_s=time_s,
            deviation=0.01 * np.random.default_rng(seed).standard_normal((600, 9)),
            half_width=np.full((600, 9), 0.2),
        )
    draw_containment(tmp_path, DESIGN, [lap(), lap("grass-200kpa")], "grass-soil")
    for name in ("path", "tracks", "sections", "slip"):
        picture = (tmp_path / f"{name}.png").read_bytes()
        assert picture.startswith(b"\x89PNG")
        assert 5_000 < len(picture) < 300_000
