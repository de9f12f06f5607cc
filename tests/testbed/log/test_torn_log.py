"""Truncated and damaged logs: the complete chunks stay readable."""

import errno
import io
import os
import random

import numpy as np
import pytest
from mcap.stream_reader import StreamReader
from proving_ground.testbed.errors import LogError, PlantDiverged
from proving_ground.testbed.log.reader import SALVAGED_KEY, read_content, read_log
from proving_ground.testbed.recording.channels import STATE
from proving_ground.testbed.recording.record import Record

from tests.testbed.logs import METADATA, PERIOD_S, feed, writer


def starts_like(part: Record, whole: Record) -> bool:
    return all(
        table.values.tobytes() == whole.tables[topic].values[: len(table)].tobytes()
        for topic, table in part.tables.items()
    )


def test_at_most_a_flush_period_is_lost_wherever_the_log_is_torn(logged, tmp_path):
    path, record = logged
    data, truncated = path.read_bytes(), tmp_path / "log.mcap.part"
    ends, last_s = chunk_ends(data)
    assert np.diff([0.0, *last_s]).max() < 5.0 + 2 * PERIOD_S
    start = data.index(b"model.xml") + 40  # from here on the description is whole
    places = set(random.Random(4).choices(range(start, len(data)), k=12))
    for end in (ends[0], ends[-1]):  # around the tear: on the edge, in an opcode, a length, a body
        places |= {end - 1, end, end + 1, end + 5, end + 40}
    places |= {len(data) - 40, len(data) - 9, len(data) - 1}  # footer and magic
    for place in sorted(places):
        truncated.write_bytes(data[:place])
        recovered, chunks = read_log(truncated), sum(end <= place for end in ends)
        extent = recovered.metadata[SALVAGED_KEY]
        assert extent.startswith(f"{chunks} whole chunks")
        assert starts_like(recovered, record)
        if chunks:
            newest_s = recovered[STATE].time_s[-1]
            assert newest_s == pytest.approx(last_s[chunks - 1], abs=1.5 * PERIOD_S)


def chunk_ends(data: bytes) -> tuple[list[int], list[float]]:
    """Return where every chunk ends in the file and in time [s]."""
    stream, ends, last_s = io.BytesIO(data), [], []
    for item in StreamReader(stream, emit_chunks=True).records:
        if type(item).__name__ == "Chunk":
            ends.append(stream.tell())
            last_s.append(item.message_end_time / 1e9)
    return ends, last_s


def test_a_damaged_chunk_costs_no_other(logged, tmp_path):
    path, record = logged
    data, damaged = bytearray(path.read_bytes()), tmp_path / "log.mcap"
    ends, _ = chunk_ends(bytes(data))
    data[ends[1] - 1000] ^= 0xFF
    damaged.write_bytes(data)
    salvage = read_content(damaged).salvage
    assert f"{len(ends) - 1} whole chunks, 1 left out" in salvage
    recovered = read_log(damaged)
    assert "1 left out" in recovered.metadata[SALVAGED_KEY]
    assert 0 < len(recovered[STATE]) < len(record[STATE])
    assert recovered.events == record.events


def test_any_other_end_leaves_a_readable_part(tmp_path):
    for error in (KeyboardInterrupt, LogError, PlantDiverged):
        folder = tmp_path / error.__name__
        folder.mkdir()
        log = writer(folder / "log.mcap")
        feed(log, 1.0)
        ended = error()
        log.__exit__(error, ended, None)
        part = folder / "log.mcap.part"
        assert part.exists() == any(str(part) in note for note in getattr(ended, "__notes__", ()))
        assert (folder / "log.mcap").exists() == (error is PlantDiverged), "an end by design"
        assert len(read_log(folder)[STATE]) == 25


def test_a_full_disk_is_said(tmp_path, monkeypatch):
    class Full(io.BytesIO):
        def write(self, data):
            if self.tell() + len(data) > 200_000:
                raise OSError(errno.EFBIG, "File too large")
            return super().write(data)

        def fileno(self):
            return os.open(tmp_path, os.O_RDONLY)

    def run():
        with writer(tmp_path / "log.mcap") as log:
            feed(log)

    full = Full()
    monkeypatch.setattr("proving_ground.testbed.log.writer.open", lambda *_: full, raising=False)
    with pytest.raises(LogError, match=r"log\.mcap\.part: cannot be written: File too large"):
        run()


def test_a_killed_run_leaves_all_but_the_last_seconds(tmp_path):
    with writer(tmp_path / "log.mcap") as log:
        feed(log, 13.0)
        data = (tmp_path / "log.mcap.part").read_bytes()  # as it is on the disk at this moment
    (tmp_path / "killed").mkdir()
    (tmp_path / "killed" / "log.mcap.part").write_bytes(data)
    record = read_log(tmp_path / "killed")
    assert 13.0 - len(record[STATE]) * PERIOD_S < 5.0 + 2 * PERIOD_S
    assert SALVAGED_KEY in record.metadata
    assert METADATA.items() <= record.metadata.items()
