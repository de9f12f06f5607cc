"""Records and sinks: rows by field name, events, and a tee to several sinks."""

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
