"""Records and sinks: rows by field name, events, and a tee to several sinks."""

import tracemalloc

import numpy as np
import pytest
from proving_ground.testbed.recording.channels import (
    STATE,
    Channel,
)
from proving_ground.testbed.recording.record import Recorder

PAIR = Channel("/pair", "two numbers", ("a_m", "b_m"))


def test_a_record_does_not_change_when_the_run_goes_on():
    recorder = Recorder([PAIR])
    recorder.row(PAIR, 0.0, (1.0, 2.0))
    early = recorder.record({"seed": "1"})
    recorder.row(PAIR, 1.0, (3.0, 4.0))
    assert len(early[PAIR]) == 1
    assert early.metadata == {"seed": "1"}
    assert len(recorder.record()[PAIR]) == 2


def test_a_record_is_read_by_topic_and_shown_in_a_line():
    recorder = Recorder()
    for time_s in (0.0, 0.5):
        recorder.row(STATE, time_s, [time_s] * len(STATE.fields))
    record = recorder.record({"scenario": "grass", "controller": "paper", "seed": "3"})
    assert record["/state"] is record[STATE]
    with pytest.raises(KeyError, match=r"/stat.*topics are /state, /reference"):
        record["/stat"]
    assert repr(record) == "<Record, grass, paper, seed 3, 0.5 s, 0 events: /state (2)>"
    assert repr(record[STATE]) == f"</state: 2 rows, 0 to 0.5 s, {len(STATE.fields)} fields>"


def test_data_frames_hold_the_record_to_the_bit():
    pytest.importorskip("pandas")
    recorder = Recorder()
    values = [1.0 / (number + 1) for number in range(len(STATE.fields))]
    recorder.row(STATE, 0.1, values)
    frames = recorder.record().to_pandas()
    assert list(frames) == ["/state"], "topics without rows are left out"
    assert frames["/state"].index.name == "time_s"
    assert frames["/state"].loc[0.1].tolist() == values
    assert tuple(frames["/state"].columns) == STATE.fields


@pytest.mark.parametrize("rows", [900, 900_000])
def test_memory_does_not_grow_with_the_run_nor_do_its_rows_change(rows):
    recorder, block = Recorder([PAIR]), np.random.default_rng(1).normal(size=(900, 3))
    tracemalloc.start()
    for _ in range(rows // 900):
        recorder.rows(PAIR, block[:, 0], block[:, 1:])
    table = recorder.record()[PAIR]
    live, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert live < peak < 8e6 < 24 * 900_000
    recorder.row(PAIR, 0.0, (1.0, 2.0))
    assert len(table) == rows
    assert len(recorder.record()[PAIR]) == rows + 1
    for column, values in ((table.time_s, 0), (table["a_m"], 1), (table["b_m"], 2)):
        np.testing.assert_array_equal(column, np.tile(block[:, values], rows // 900))
