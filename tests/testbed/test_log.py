"""Logs: what is written is read back to the bit, by us and by others, whole or torn."""

import io
import os
import signal
import subprocess
import sys
import textwrap
import time
from dataclasses import replace

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

from testbed.channels import CHANNELS, CONTROL, MEASUREMENT, SOLVER, STATE, Channel
from testbed.errors import LogError, PlantDiverged
from testbed.log import FORMAT_KEY, LogWriter
from testbed.log_content import salvage_content
from testbed.log_reader import SALVAGED_KEY, read_log, record_of
from testbed.record import Event, Record, Recorder
from testbed.scenery import Scenery
from testbed.schemas import RowEncoder, message_class, message_name
from testbed.sink import Tee
from testbed.topics import PREDICTED_PATH_TOPIC, REFERENCE_PATH_TOPIC
from tests.testbed.truths import truth

PERIOD_S = 0.04
METADATA = {"scenario": "made up", "seed": "7", "ttempc": "0.1.0"}
ATTACHMENTS = {"scenario.toml": 'name = "made up"\n', "model.xml": "<mujoco/>"}
BODIES = ("tractor", "trailer")


def writer(path, **other) -> LogWriter:
    given = {"metadata": METADATA, "attachments": ATTACHMENTS, "scenery": Scenery(BODIES), **other}
    return LogWriter(path, **given)


def feed(sink, duration_s=22.0) -> None:
    """Say all that a run says, with every number that a double can be."""
    rng = np.random.default_rng(3)
    sink.path(REFERENCE_PATH_TOPIC, 0.0, np.array([[0.0, 0.0], [0.0, 0.2], [0.0, 0.4]]))
    sink.event(Event(0.0, "info", "start"))
    now = 0.0
    for k in range(round(duration_s / PERIOD_S)):
        for channel in CHANNELS:
            values = rng.normal(size=len(channel.fields))
            first = 4 if channel is MEASUREMENT else 0  # a fix has to be a place
            values[first : first + 4] = (np.nan, -0.0, np.inf, 5e-324)
            sink.row(channel, now, values.tolist())
        bodies = {"body_xyz": rng.normal(size=(2, 3)), "body_quat": rng.normal(size=(2, 4))}
        sink.scene(truth(tractor={"x": now, "yaw": 0.3}, time_s=now, **bodies))
        if k % 5 == 0:
            sink.path(PREDICTED_PATH_TOPIC, now, rng.normal(size=(15, 2)))
        now += PERIOD_S  # adds up rounding errors, as simulated time does
    sink.event(Event(round(now, 9), "error", "roll-over – über Kopf"))


def same(one: Record, other: Record) -> bool:
    assert one.events == other.events
    assert one.metadata == other.metadata
    assert one.tables.keys() == other.tables.keys()
    return all(
        table.time_s.tobytes() == other.tables[topic].time_s.tobytes()
        and table.values.tobytes() == other.tables[topic].values.tobytes()
        for topic, table in one.tables.items()
    )


def starts_like(part: Record, whole: Record) -> bool:
    return all(
        table.values.tobytes() == whole.tables[topic].values[: len(table)].tobytes()
        for topic, table in part.tables.items()
    )


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return a whole log and the record of the same run."""
    path = tmp_path_factory.mktemp("log") / "log.mcap"
    recorder = Recorder()
    with writer(path) as log:
        feed(Tee(recorder, log))
    return path, recorder.record(METADATA)


def test_what_is_written_is_read_back_to_the_bit(run):
    path, record = run
    assert same(read_log(path), record)
    assert [file.name for file in path.parent.iterdir()] == ["log.mcap"]


@pytest.mark.parametrize("channel", CHANNELS, ids=lambda channel: channel.topic)
def test_rows_are_what_protobuf_itself_would_write(channel):
    values = np.random.default_rng(1).normal(size=len(channel.fields)).tolist()
    message = message_class(channel)(time_s=1.5, **dict(zip(channel.fields, values, strict=True)))
    filled = RowEncoder(channel).encode(np.array([[1.5, *values], [2.0, *values]]))
    assert filled[0].tobytes() == message.SerializeToString()
    message.time_s = 2.0
    assert filled[1].tobytes() == message.SerializeToString()


def test_a_reader_that_is_not_ours_finds_everything(run):
    path, record = run
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        names = {metadata.name: metadata.metadata for metadata in reader.iter_metadata()}
        assert METADATA.items() <= names["run"].items()
        found = {file.name: file.data.decode() for file in reader.iter_attachments()}
        assert found == ATTACHMENTS
        rows = dict.fromkeys(record.tables, 0)
        seen = {}
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert message.log_time == message.publish_time
            seen.setdefault(channel.topic, (schema.name, decoded))
            if channel.topic in rows:
                table, row = record.tables[channel.topic], rows[channel.topic]
                assert message.log_time == round(1e9 * table.time_s[row])
                assert decoded.time_s == table.time_s[row]
                name = table.channel.fields[-1]
                assert getattr(decoded, name) == table[name][row]
                rows[channel.topic] += 1
    assert rows == {topic: len(table) for topic, table in record.tables.items()}
    assert {topic: name for topic, (name, _) in seen.items() if name.startswith("foxglove")} == {
        "/tf": "foxglove.FrameTransforms",
        "/tractor/pose": "foxglove.PoseInFrame",
        "/trailer/pose": "foxglove.PoseInFrame",
        "/tractor/path": "foxglove.PosesInFrame",
        "/trailer/path": "foxglove.PosesInFrame",
        "/gnss/tractor": "foxglove.LocationFix",
        "/gnss/trailer": "foxglove.LocationFix",
        "/reference/path": "foxglove.PosesInFrame",
        "/mpc/predicted_path": "foxglove.PosesInFrame",
        "/log": "foxglove.Log",
    }
    transforms = seen["/tf"][1].transforms
    assert [item.child_frame_id for item in transforms] == list(BODIES)
    assert {item.parent_frame_id for item in transforms} == {"map"}
    turn = seen["/tractor/pose"][1].pose.orientation
    assert (turn.w, turn.z) == pytest.approx((np.cos(0.15), np.sin(0.15)))
    ahead = seen["/reference/path"][1].poses[-1]
    assert ahead.position.y == pytest.approx(0.4, rel=1e-7)
    assert ahead.position.z > 0.0, "above the ground, to be seen"
    assert ahead.orientation.z == pytest.approx(np.sin(np.pi / 4))


def test_schemas_explain_themselves(run):
    path, _ = run
    with path.open("rb") as stream:
        schemas = make_reader(stream).get_summary().schemas.values()
    by_name = {schema.name: schema for schema in schemas}
    file = FileDescriptorSet.FromString(by_name[message_name(SOLVER)].data).file[0]
    assert message_name(SOLVER) == "ttempc.MpcInfo"
    assert SOLVER.about in file.source_code_info.location[0].leading_comments
    assert [field.name for field in file.message_type[0].field] == ["time_s", *SOLVER.fields]


def test_at_most_a_flush_period_is_lost_wherever_the_log_is_torn(run, tmp_path):
    path, record = run
    data, torn = path.read_bytes(), tmp_path / "log.mcap.part"
    ends, last_s = chunk_ends(data)
    assert np.diff([0.0, *last_s]).max() < 5.0 + 2 * PERIOD_S
    start = data.index(b"model.xml") + 40  # from here on the description is whole
    places = {*np.linspace(start, len(data) - 1, 150).astype(int).tolist()}
    for end in ends:  # around the tear: in an opcode, a length, a body, on the edge
        places |= {end - 1, end, end + 1, end + 5, end + 9, end + 40}
    places |= set(range(len(data) - 45, len(data)))  # and everywhere in footer and magic
    for place in sorted(places):
        torn.write_bytes(data[:place])
        content = salvage_content(torn)
        left, found = content.salvage, record_of(content)
        assert left.chunks == sum(end <= place for end in ends)
        assert left.damaged == 0
        assert starts_like(found, record)
        if left.chunks:
            newest_s = found[STATE].time_s[-1]
            assert newest_s == pytest.approx(last_s[left.chunks - 1], abs=1.5 * PERIOD_S)
        kept = read_log(torn).metadata[SALVAGED_KEY]
        assert kept.startswith(f"{left.chunks} whole chunks, up to ")


def chunk_ends(data: bytes) -> tuple[list[int], list[float]]:
    """Return where every chunk ends in the file and in time [s]."""
    stream, ends, last_s = io.BytesIO(data), [], []
    for item in StreamReader(stream, emit_chunks=True).records:
        if type(item).__name__ == "Chunk":
            ends.append(stream.tell())
            last_s.append(item.message_end_time / 1e9)
    return ends, last_s


def test_a_damaged_chunk_costs_no_other(run, tmp_path):
    path, record = run
    data, damaged = bytearray(path.read_bytes()), tmp_path / "log.mcap"
    ends, _ = chunk_ends(bytes(data))
    data[ends[1] - 1000] ^= 0xFF
    damaged.write_bytes(data)
    left = salvage_content(damaged).salvage
    assert (left.chunks, left.damaged) == (len(ends) - 1, 1)
    found = read_log(damaged)
    assert "1 damaged left out" in found.metadata[SALVAGED_KEY]
    assert 0 < len(found[STATE]) < len(record[STATE])
    assert found.events == record.events


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is not an MCAP log"),
        (b"\x89MCAP", "is not an MCAP log"),
        (b"time,x,y\n0,1,2\n" * 9, "is not an MCAP log"),
        (b"\x89MCAP0\r\n", "describes no run"),
    ],
    ids=["empty", "torn in its first bytes", "another format", "nothing but the first bytes"],
)
def test_what_is_no_log_is_said_in_one_line(tmp_path, content, words):
    file = tmp_path / "log.mcap"
    file.write_bytes(content)
    with pytest.raises(LogError, match=words) as caught:
        read_log(file)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_log(tmp_path):
    with pytest.raises(LogError, match="cannot be read: No such file"):
        read_log(tmp_path / "log.mcap")


def test_an_mcap_of_someone_else_is_refused(tmp_path):
    file = tmp_path / "log.mcap"
    with file.open("wb") as stream:
        other = Writer(stream)
        other.start()
        other.finish()
    with pytest.raises(LogError, match="not a log of ttempc"):
        read_log(file)


def test_another_version_is_refused_with_what_differs(tmp_path):
    older = replace(CONTROL, fields=(*CONTROL.fields[1:], "retired_mps"))
    with writer(tmp_path / "log.mcap", channels=[older]):
        pass
    with pytest.raises(LogError, match=r"delta_t_rad_feedforward, retired_mps.*ttempc 0\.1\.0"):
        read_log(tmp_path / "log.mcap")


def test_another_format_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("testbed.log.FORMAT", "99")
    with writer(tmp_path / "log.mcap") as log:
        feed(log, 0.4)
    monkeypatch.undo()
    with pytest.raises(LogError, match="log format 99, this version reads 1"):
        read_log(tmp_path / "log.mcap")


def test_format_is_the_logs_own_business(run):
    assert FORMAT_KEY not in read_log(run[0]).metadata


def test_a_run_without_rows_is_a_log(tmp_path):
    with writer(tmp_path / "log.mcap"):
        pass
    assert same(read_log(tmp_path / "log.mcap"), Recorder().record(METADATA))


def test_a_run_that_ends_by_design_leaves_a_whole_log(tmp_path):
    path = tmp_path / "log.mcap"
    with pytest.raises(PlantDiverged):
        run_that_raises(path, PlantDiverged("NaN in qacc"))
    assert SALVAGED_KEY not in read_log(path).metadata


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError, LogError])
def test_any_other_end_leaves_a_readable_part(tmp_path, error):
    path = tmp_path / "log.mcap"
    with pytest.raises(error):
        run_that_raises(path, error())
    assert not path.exists()
    assert len(read_log(tmp_path / "log.mcap.part")[STATE]) == 25


def run_that_raises(path, error):
    with writer(path) as log:
        feed(log, 1.0)
        raise error


@pytest.mark.parametrize("name", ["log.mcap", "log.mcap.part"])
def test_nothing_is_written_over(tmp_path, name):
    (tmp_path / name).write_text("precious")
    with pytest.raises(LogError, match="exists already"):
        writer(tmp_path / "log.mcap")
    assert (tmp_path / name).read_text() == "precious"


def test_an_unwritable_place_is_said_in_one_line(tmp_path):
    with pytest.raises(LogError, match="cannot be written: No such file"):
        writer(tmp_path / "nowhere" / "log.mcap")


def test_a_full_disk_is_said_and_leaves_no_log(tmp_path):
    limited = textwrap.dedent(f"""
        import resource, signal
        from pathlib import Path
        from testbed.errors import LogError
        from tests.testbed.test_log import feed, writer
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
        try:
            with writer(Path({str(tmp_path)!r}) / "log.mcap") as log:
                feed(log)
        except LogError as error:
            print(error)
    """)
    done = subprocess.run([sys.executable, "-c", limited], capture_output=True, text=True)
    assert done.stdout.endswith("log.mcap.part: cannot be written: File too large\n"), done.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["log.mcap.part"]


def test_a_killed_process_leaves_all_but_the_last_seconds(tmp_path):
    endless = textwrap.dedent(f"""
        from pathlib import Path
        from tests.testbed.test_log import feed, writer
        with writer(Path({str(tmp_path)!r}) / "log.mcap") as log:
            feed(log, 1e6)
    """)
    process = subprocess.Popen([sys.executable, "-c", endless])
    part, deadline = tmp_path / "log.mcap.part", time.monotonic() + 30.0
    while time.monotonic() < deadline and not (part.exists() and part.stat().st_size > 500_000):
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert not (tmp_path / "log.mcap").exists()
    record = read_log(part)
    assert len(record[STATE]) * PERIOD_S > 5.0
    assert SALVAGED_KEY in record.metadata
    assert METADATA.items() <= record.metadata.items()


def test_a_level_that_no_viewer_knows_is_refused(tmp_path):
    with (
        writer(tmp_path / "log.mcap") as log,
        pytest.raises(LogError, match="got 'fatal', allowed are info, warning, error"),
    ):
        log.event(Event(0.0, "fatal", "?"))


def test_a_row_of_the_wrong_length_is_refused(tmp_path):
    narrow = Channel("/narrow", "two numbers", ("a", "b"))
    with writer(tmp_path / "log.mcap", channels=[narrow]) as log:
        with pytest.raises(ValueError, match="/narrow: got 3 values, has 2 fields"):
            log.row(narrow, 0.0, (1.0, 2.0, 3.0))
        log.row(narrow, 0.0, (1.0, 2.0))
    assert read_log(tmp_path / "log.mcap", [narrow])[narrow].values.tolist() == [[1.0, 2.0]]
