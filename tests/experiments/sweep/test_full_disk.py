"""Rows of a sweep on a full disk."""

import errno
import os

import pytest
from proving_ground.experiments.errors import SweepStopped
from proving_ground.experiments.sweep.results import Results, settle


def test_rows_on_a_full_disk_stay_unchanged(tmp_path, monkeypatch):
    file = tmp_path / "rows.jsonl"
    with Results(file, 1) as results:
        results.append({"run": 0, "x": 1.0})

    def full(descriptor):
        raise OSError(errno.ENOSPC, "No space left on device")

    before = file.read_bytes()
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(SweepStopped, match=r"rows.jsonl: cannot be written: No space left"):
        settle(file, lambda row: {**row, "x": 2.0})
    assert file.read_bytes() == before
    assert list(tmp_path.iterdir()) == [file]
