"""Logs: bit-exact round trip, readable by the reference reader, foreign files refused."""

from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from proving_ground.testbed.errors import LogError
from proving_ground.testbed.log.reader import read_log
from proving_ground.testbed.messages.encoding import message_class, row_template
from proving_ground.testbed.recording.channels import (
    CHANNELS,
    CONTROL,
    ERROR,
    MEASUREMENT,
)
from proving_ground.testbed.recording.record import Record

from tests.testbed.logs import ATTACHMENTS, BODIES, METADATA, writer


def same(one: Record, other: Record) -> bool:
    assert one.events == other.events
    assert one.metadata == other.metadata
    assert one.tables.keys() == other.tables.keys()
    return all(
        table.time_s.tobytes() == other.tables[topic].time_s.tobytes()
        and table.values.tobytes() == other.tables[topic].values.tobytes()
        for topic, table in one.tables.items()
    )


def nanoseconds(*columns):
    return zip(*(np.rint(1e9 * column).astype(int).tolist() for column in columns), strict=True)


def test_what_is_written_is_read_back_to_the_bit_and_a_folder_stands_for_its_log(logged, tmp_path):
    path, record = logged
    assert same(read_log(str(path)), record)
    assert same(read_log(path.parent), record)
    assert [file.name for file in path.parent.iterdir()] == ["log.mcap"]
    with pytest.raises(LogError, match="is a folder"):
        read_log(tmp_path)
    (tmp_path / "log.mcap.part").write_bytes(path.read_bytes())  # as a killed run leaves it
    assert same(read_log(tmp_path), record)


def test_a_record_computes_the_errors_that_the_log_has(logged):
    path, record = logged
    logged_errors = read_log(path, (ERROR,))[ERROR]
    errors = read_log(path)["/error"]
    assert len(errors) == len(record["/state"]) > 0
    assert np.array_equal(errors.time_s, logged_errors.time_s)
    assert np.array_equal(errors.values, logged_errors.values, equal_nan=True)


def test_rows_are_what_protobuf_itself_would_write():
    for channel in CHANNELS:
        values = np.random.default_rng(1).normal(size=(2, 1 + len(channel.fields)))
        for row, filled in zip(values.tolist(), row_template(channel).fill(values), strict=True):
            fields = dict(zip(channel.fields, row[1:], strict=True))
            message = message_class(channel)(time_s=row[0], **fields)
            assert filled.tobytes() == message.SerializeToString()


def test_a_reader_that_is_not_ours_finds_everything(logged):
    path, record = logged
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        names = {metadata.name: metadata.metadata for metadata in reader.iter_metadata()}
        assert METADATA.items() <= names["run"].items()
        attachments = {file.name: file.data.decode() for file in reader.iter_attachments()}
        assert attachments == ATTACHMENTS
        rows = dict.fromkeys(record.tables, 0)
        first_messages, fixes, times = {}, [], []
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            times.append(message.log_time)
            first_messages.setdefault(channel.topic, (schema.name, decoded))
            if channel.topic.startswith("/gnss/"):
                fixes.append((channel.topic, message.log_time, decoded.timestamp.ToNanoseconds()))
            if channel.topic in rows:
                table, row = record.tables[channel.topic], rows[channel.topic]
                assert message.log_time == round(1e9 * table.time_s[row])
                assert decoded.time_s == table.time_s[row]
                name = table.channel.fields[-1]
                assert getattr(decoded, name) == table[name][row]
                rows[channel.topic] += 1
        statistics = reader.get_summary().statistics
    assert times == sorted(times)
    assert (statistics.message_count, statistics.message_start_time) == (len(times), times[0])
    assert (sum(statistics.channel_message_counts.values()), statistics.message_end_time) == (
        len(times),
        times[-1],
    )
    assert rows == {topic: len(table) for topic, table in record.tables.items()}
    for body in ("tractor", "trailer"):  # a fix is published on delivery, stamped with its sample
        taken = record[MEASUREMENT][f"gnss_{body}_time_s"]
        delivered = record[MEASUREMENT].time_s
        expected = [(f"/gnss/{body}", *pair) for pair in nanoseconds(delivered, taken)]
        assert [fix for fix in fixes if fix[0] == f"/gnss/{body}"] == expected
    transforms = first_messages["/tf"][1].transforms
    assert [item.child_frame_id for item in transforms] == list(BODIES)
    assert {item.parent_frame_id for item in transforms} == {"map"}
    turn = first_messages["/tractor/pose"][1].pose.orientation
    assert (turn.w, turn.z) == pytest.approx((np.cos(0.15), np.sin(0.15)))
    ahead = first_messages["/reference/path"][1].poses[-1]
    assert ahead.position.y == pytest.approx(0.4, rel=1e-7)
    assert ahead.position.z > 0.0, "above the ground, to be visible"
    assert ahead.orientation.z == pytest.approx(np.sin(np.pi / 4))


def test_what_is_no_log_is_said_in_one_line(tmp_path):
    file = tmp_path / "log.mcap"
    for content, words in (
        (None, "cannot be read"),
        (b"time,x,y\n0,1,2\n" * 9, "is not an MCAP log"),
        (b"\x89MCAP0\r\n", "describes no run"),
    ):
        if content is not None:
            file.write_bytes(content)
        with pytest.raises(LogError, match=words) as caught:
            read_log(file)
        assert str(file) in str(caught.value)
        assert "\n" not in str(caught.value)


def test_another_version_is_refused_with_what_differs(tmp_path, monkeypatch):
    older = replace(CONTROL, fields=(*CONTROL.fields[1:], "retired_mps"))
    with writer(tmp_path / "log.mcap", channels=[older]):
        pass
    with pytest.raises(LogError, match=r"delta_t_rad_feedforward, retired_mps.*ttempc 0\.1\.0"):
        read_log(tmp_path / "log.mcap")
    monkeypatch.setattr("proving_ground.testbed.log.writer.FORMAT", "99")
    with writer(tmp_path / "new.mcap"):
        pass
    monkeypatch.undo()
    with pytest.raises(LogError, match="format 99"):
        read_log(tmp_path / "new.mcap")


def test_nothing_is_written_over_or_to_an_impossible_place(tmp_path):
    for name in ("log.mcap", "log.mcap.part"):
        (tmp_path / name).write_text("precious")
        with pytest.raises(LogError, match="exists already"):
            writer(tmp_path / "log.mcap")
        assert (tmp_path / name).read_text() == "precious"
        (tmp_path / name).unlink()
    with pytest.raises(LogError, match="cannot be written"):
        writer(tmp_path / "nowhere" / "log.mcap")
