"""Atomic writes: the new content is complete, or the file is unchanged."""

import errno
import os

import pytest

from proving_ground.experiments.errors import SweepStopped
from proving_ground.experiments.output import atomic_write
from proving_ground.experiments.sweep.results import Results, settle


@pytest.fixture(params=[None, b"old"], ids=["new", "old"])
def file(request, tmp_path):
    file = tmp_path / "rows.jsonl"
    if request.param is not None:
        file.write_bytes(request.param)
    return file


def test_the_file_has_the_new_content_and_no_partial_file_is_left(file):
    with atomic_write(file) as stream:
        stream.write(b"new")
        assert not file.exists() or file.read_bytes() == b"old"
    assert file.read_bytes() == b"new"
    assert list(file.parent.iterdir()) == [file]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, OSError])
def test_an_error_leaves_the_file_unchanged(error, file):
    before = {each: each.read_bytes() for each in file.parent.iterdir()}
    with pytest.raises(error):
        fail_within(file, error)
    assert {each: each.read_bytes() for each in file.parent.iterdir()} == before


def fail_within(file, error):
    with atomic_write(file) as stream:
        stream.write(b"ne")
        raise error


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
