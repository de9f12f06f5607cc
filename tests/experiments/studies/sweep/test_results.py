"""File of rows: whole lines after any failure; readable with inferred types."""

import errno
import os

import numpy as np
import pytest
from proving_ground.experiments.errors import SweepRefused, SweepStopped
from proving_ground.experiments.studies.sweep.results import (
    WORKING_P95,
    WORKING_SD,
    Results,
    frame,
    rows,
)
from proving_ground.experiments.studies.sweep.row import no_figures

from tests.experiments.sweep_rows import ERROR


def filled(file, count, **more):
    with Results(file, count) as results:
        for run in range(count):
            results.append({"run": run, **more})
    return file


@pytest.mark.parametrize("cut", [1, 5, 12])
def test_a_torn_last_line_is_removed_and_its_run_is_pending_again(cut, tmp_path):
    file = filled(tmp_path / "r.jsonl", 3, status="lost")
    whole = file.read_bytes()
    file.write_bytes(whole[:-cut])
    assert [row["run"] for row in rows(file)] == [0, 1]
    with Results(file, 3) as results:
        assert not results.has(2)
        results.append({"run": 2, "status": "lost"})
    assert file.read_bytes() == whole


@pytest.mark.parametrize("text", ["{}\n", "no json\n", '{"run": 9}\n'])
def test_a_foreign_line_is_refused_with_its_number(text, tmp_path):
    file = filled(tmp_path / "r.jsonl", 2)
    file.write_text(file.read_text() + text)
    with pytest.raises(SweepRefused, match="line 3 is no row of this study"):
        Results(file, 3)


def test_a_full_disk_ends_the_sweep_and_leaves_whole_lines(tmp_path, monkeypatch):
    file = filled(tmp_path / "r.jsonl", 2)
    whole, write = file.read_bytes(), os.write

    def full(descriptor, data):
        if len(data) > 4:
            return write(descriptor, data[:4])
        raise OSError(errno.ENOSPC, "No space left on device")

    with Results(file, 3) as results:
        monkeypatch.setattr(os, "write", full)
        with pytest.raises(SweepStopped, match="No space left on device"):
            results.append({"run": 2, "status": "lost"})
        monkeypatch.undo()
    assert file.read_bytes() == whole


def test_rows_are_a_frame_with_the_error_of_the_working_point():
    numbers = no_figures()
    trailer = {**numbers, ERROR: 0.2, "tracking.all.trailer.cross_sd_m": 0.1}
    tool = {**trailer, ERROR.replace("trailer", "tool"): 0.3}
    made = [
        {"run": run, "point": 0, "run_id": "1e5", "seed": 1, "status": "completed", **own}
        | {"wall_s": None}
        for run, own in ((2, numbers), (1, tool), (0, trailer))
    ]
    table = frame(made)
    assert list(table["run"]) == [0, 1, 2]
    assert list(table["run_id"]) == ["1e5"] * 3
    np.testing.assert_array_equal(table[WORKING_P95], [0.2, 0.3, np.nan])
    np.testing.assert_array_equal(table[WORKING_SD], [0.1, 0.1, np.nan])
    assert table["wall_s"].dtype == float
    assert not len(frame([]))
