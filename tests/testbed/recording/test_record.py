"""Records and sinks: rows by field name, events, and a tee to several sinks."""

import math
import tracemalloc

import numpy as np
import pytest
from proving_ground.testbed.recording.channels import (
    CHANNELS,
    ERROR,
    REFERENCE,
    STATE,
    Channel,
    error_rows,
    unit_of,
)
from proving_ground.testbed.recording.record import Event, Recorder, Tee

from tests.testbed.truths import truth

PAIR = Channel("/pair", "two numbers", ("a_m", "b_m"))


def test_rows_come_out_as_columns_in_their_order():
    recorder = Recorder([PAIR])
    for k in range(3):
        recorder.row(PAIR, 0.1 * k, (k, -k))
    table = recorder.record()[PAIR]
    assert len(table) == 3
    assert table.time_s.tolist() == [0.0, 0.1, 0.2]
    assert table["b_m"].tolist() == [0.0, -1.0, -2.0]
    assert table.columns("b_m", "a_m").tolist() == [[0.0, 0.0], [-1.0, 1.0], [-2.0, 2.0]]


def test_a_record_does_not_change_when_the_run_goes_on():
    recorder = Recorder([PAIR])
    recorder.row(PAIR, 0.0, (1.0, 2.0))
    early = recorder.record({"seed": "1"})
    recorder.row(PAIR, 1.0, (3.0, 4.0))
    assert len(early[PAIR]) == 1
    assert early.metadata == {"seed": "1"}
    assert len(recorder.record()[PAIR]) == 2


def test_recorder_and_record_share_the_memory_of_the_rows():
    recorder, rows = Recorder([PAIR]), 100_000
    tracemalloc.start()
    try:
        for k in range(rows):
            recorder.row(PAIR, k, (1.0, 2.0))
        record = recorder.record()
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert record[PAIR].values.shape == (rows, 2)
    assert held < 1.2 * rows * 3 * 8


def test_a_row_of_the_wrong_length_is_refused():
    with pytest.raises(ValueError, match="/pair: got 1 values, has 2 fields"):
        Recorder([PAIR]).row(PAIR, 0.0, (1.0,))


def test_an_unknown_field_is_named():
    with pytest.raises(KeyError, match="/pair has no field 'c_m'"):
        Recorder([PAIR]).record()[PAIR]["c_m"]


def test_a_record_without_rows_has_every_table():
    record = Recorder().record()
    for channel in CHANNELS:
        assert record[channel].values.shape == (0, len(channel.fields))


def test_names_of_topics_and_fields_are_unique():
    assert len({channel.topic for channel in CHANNELS}) == len(CHANNELS)
    for channel in CHANNELS:
        assert len(set(channel.fields)) == len(channel.fields)
        assert "time_s" not in channel.fields


def test_a_tee_passes_all_data_to_every_sink():
    one, other = Recorder([PAIR]), Recorder([PAIR])
    tee = Tee(one, other)
    tee.row(PAIR, 0.0, (1.0, 2.0))
    tee.event(Event(0.5, "info", "half way"))
    tee.scene(truth())
    tee.path("/reference/path", 0.0, np.zeros((2, 2)))
    assert one.record().events == other.record().events == (Event(0.5, "info", "half way"),)
    assert one.record()[PAIR].values.tolist() == other.record()[PAIR].values.tolist() == [[1, 2]]


def test_a_record_is_read_by_topic_and_shown_in_a_few_lines():
    recorder = Recorder()
    for time_s in (0.0, 0.5):
        recorder.row(STATE, time_s, [time_s] * len(STATE.fields))
    record = recorder.record({"scenario": "grass <b>", "controller": "paper", "seed": "3"})
    assert record["/state"] is record[STATE]
    with pytest.raises(KeyError, match=r"/stat.*topics are /state, /reference"):
        record["/stat"]
    assert repr(record) == "<Record, grass <b>, paper, seed 3, 0.5 s, 0 events: /state (2)>"
    assert repr(record[STATE]) == f"</state: 2 rows, 0 to 0.5 s, {len(STATE.fields)} fields>"
    page = record._repr_html_()
    assert "grass &lt;b&gt;" in page
    assert page.count("<tr>") == 1 + len(CHANNELS)
    assert "<td>x_t_m</td><td>m</td><td>0</td><td>0.5</td>" in record[STATE]._repr_html_()


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


def test_units_are_those_of_the_names():
    fields = {"x_t_m": "m", "x_t_m_m": "m", "delta_t_rad_command": "rad", "hp_min": "1"}
    fields |= {"curvature_per_m": "1/m", "drive_mps2": "m/s²", "yaw_rate_t_radps": "rad/s"}
    assert {name: unit_of(name) for name in fields} == fields


def test_the_true_error_is_in_the_frame_of_the_reference():
    """A point 3 m ahead and 4 m to the left of a reference that heads north lies to its west."""
    state, reference = np.zeros((1, len(STATE.fields))), np.zeros((1, len(REFERENCE.fields)))
    due = {"x_t_m": 10.0, "y_t_m": 20.0, "psi_t_rad": 0.5 * math.pi}
    at = {"x_t_m": 6.0, "y_t_m": 23.0, "psi_t_rad": 2.5 * math.pi + 0.1}
    for row, channel, values in ((reference, REFERENCE, due), (state, STATE, at)):
        for name, value in values.items():
            row[0, channel.fields.index(name)] = value
    row = error_rows(state, reference)[0]
    error = dict(zip(ERROR.fields, row, strict=True))
    assert [error[f"tractor_{part}_m"] for part in ("along", "cross", "euclidean")] == (
        pytest.approx([3.0, 4.0, 5.0])
    )
    assert error["tractor_heading_rad"] == pytest.approx(0.1)
    assert error["trailer_euclidean_m"] == 0.0
