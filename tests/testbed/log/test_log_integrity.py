"""Damaged and foreign logs: no change of a bit is silent, no byte opens a file or takes memory."""

import io
import random
import struct
import zipfile

import numpy as np
import pytest
import zstandard
from proving_ground.testbed.errors import InvalidField, LogError
from proving_ground.testbed.ground.ground import Ground
from proving_ground.testbed.ground.terrain import flat
from proving_ground.testbed.log.reader import integrity_error, read_content, record_of
from proving_ground.testbed.log.scene import check_model, lines_of, motion_of
from proving_ground.testbed.log.writer import McapFile
from proving_ground.testbed.recording.channels import EVENT_TOPIC, REFERENCE_PATH_TOPIC, STATE
from proving_ground.testbed.vehicle.vehicle import read_vehicle, shipped_vehicles
from proving_ground.testbed.vehicle.vehicle_model import build_spec, level_mjcf, level_model
from proving_ground.testbed.wheels.soil_law import SoilLaw
from proving_ground.testbed.wheels.wheel_models import WHEEL_MODELS

from tests.testbed.logs import feed, writer


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """The bytes of a log of 0.4 s."""
    file = tmp_path_factory.mktemp("short") / "log.mcap"
    with writer(file) as log:
        feed(log, 0.4)
    return file.read_bytes()


def test_no_damage_is_silent_and_none_raises_more_than_one_line(short, tmp_path):
    file, draw, reasons = tmp_path / "log.mcap", random.Random(1), []
    flips = [draw.randrange(8 * len(short)) for _ in range(100)]
    flips += [8 * place + 3 for place in range(len(short) - 60, len(short), 3)]  # footer, magic
    damaged = [bytearray(short) for _ in range(len(flips) + 40)]
    for data, place in zip(damaged, flips, strict=False):
        data[place // 8] ^= 1 << place % 8
    for data in damaged[len(flips) :]:  # bytes of someone else, and missing ones
        for _ in range(draw.randrange(1, 60)):
            data[draw.randrange(8, len(data))] = draw.randrange(256)
        start = draw.randrange(8, len(data))
        del data[start : start + draw.choice((0, 1, 500))]
    for data in damaged:
        assert integrity_error(bytes(data)) is not None
        file.write_bytes(data)
        try:
            content = read_content(file)
            assert content.salvage is not None
            record_of(content)
            motion_of(content)
            lines_of(content, REFERENCE_PATH_TOPIC)
        except LogError as error:  # the only exception that may come out
            reasons.append(str(error))
    assert "\n" not in "".join(reasons)


@pytest.mark.parametrize("topic", [STATE.topic, EVENT_TOPIC, REFERENCE_PATH_TOPIC])
def test_messages_that_do_not_decode_are_refused_although_every_checksum_is_right(
    short, tmp_path, topic
):
    file = tmp_path / "short.mcap"
    file.write_bytes(short)
    content = read_content(file)
    with (tmp_path / "evil.mcap").open("wb") as stream:
        mcap = McapFile(stream, "evil")
        mcap.add_metadata("run", {**content.metadata, "log_format": "1"})
        number = mcap.add_topic(content.topics[topic])
        mcap.add_message(number, 0, b"\xff\xff\xff")
        mcap.finish()
    evil = read_content(tmp_path / "evil.mcap")
    assert evil.salvage is None
    decode = lines_of if topic == REFERENCE_PATH_TOPIC else lambda content, _: record_of(content)
    with pytest.raises(LogError, match=topic):
        decode(evil, topic)


def packed_log(chunk: bytes, declared: int) -> bytes:
    """Return a log that consists of its start and one chunk."""
    stream = io.BytesIO()
    McapFile(stream, "evil").add_metadata("run", {"log_format": "1"})
    head = struct.pack("<QQQII", 0, 0, declared, 0, 4) + b"zstd" + struct.pack("<Q", len(chunk))
    record = head + chunk
    return stream.getvalue() + struct.pack("<BQ", 6, len(record)) + record


def test_the_declared_size_of_a_chunk_is_limited_before_it_is_allocated(tmp_path):
    file = tmp_path / "log.mcap"
    for declared in (2**32, 2**44, 2**63):
        # a frame that declares so many bytes: magic, descriptor (8 bytes of size, one segment)
        head = b"\x28\xb5\x2f\xfd" + bytes([0xE0])
        file.write_bytes(packed_log(head + struct.pack("<Q", declared) + b"\x01\x00\x00", declared))
        with pytest.raises(LogError, match=f"declares {declared} bytes"):
            read_content(file)


def test_a_frame_that_declares_another_size_than_its_chunk_is_damage(tmp_path):
    file, data = tmp_path / "log.mcap", bytes(2**20)
    file.write_bytes(packed_log(zstandard.compress(data), 100))
    salvage = read_content(file).salvage
    assert salvage is not None
    assert (salvage.chunks, salvage.damaged) == (0, 1)


def test_statistics_must_be_those_of_the_messages(tmp_path, monkeypatch):
    honest = McapFile._end_chunk

    def forged(mcap):
        honest(mcap)
        mcap._counts = {number: count + 1 for number, count in mcap._counts.items()}

    monkeypatch.setattr(McapFile, "_end_chunk", forged)
    with writer(tmp_path / "log.mcap") as log:
        feed(log, 0.4)
    assert "numbers of messages" in str(read_content(tmp_path / "log.mcap").salvage)


def test_a_model_that_opens_files_or_takes_memory_is_refused():
    for inside, reason in (
        ('<include file="/etc/passwd"/>', "include"),
        ('<asset><mesh name="a" file="/dev/stdin"/></asset>', "attribute file"),
        ('<asset><texture name="a" type="2d" fileright="x.png"/></asset>', "attribute fileright"),
        ('<asset><hfield name="a" nrow="60000" ncol="60000" size="1 1 1 1"/></asset>', "60000"),
        ('<asset><texture name="a" width="60000" height="2" builtin="flat"/></asset>', "60000"),
        ('<worldbody><replicate count="100000000"/></worldbody>', "replicate"),
        ('<extension><plugin plugin="mujoco.pid"/></extension>', "extension"),
        ('<size memory="900G"/>', "900G"),
        ("<worldbody>" + 40 * "<body>" + 40 * "</body>" + "</worldbody>", "inside each other"),
        ("<worldbody>", "is no XML"),
        ('<asset><mesh name="a" vertex="' + 4_000_000 * "0" + '"/></asset>', "characters"),
    ):
        with pytest.raises(ValueError, match=reason):
            check_model(f"<mujoco>{inside}</mujoco>")
    with pytest.raises(ValueError, match="document type"):
        check_model('<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]><mujoco>&b;</mujoco>')


def test_models_of_this_program_pass():
    for wheels in WHEEL_MODELS:
        for vehicle in shipped_vehicles():
            plant = read_vehicle(vehicle)
            spec = build_spec(plant, flat((4.0, 4.0)), wheels, SoilLaw(), 0.002)
            check_model(level_mjcf(level_model(spec)[1], (501, 801)))


def npz(heights: bytes) -> bytes:
    good, stream = Ground(flat((4.0, 4.0)), np.ones((41, 41))).to_npz(), io.BytesIO()

    with zipfile.ZipFile(io.BytesIO(good)) as old, zipfile.ZipFile(stream, "w", 8) as new:
        for name in old.namelist():
            new.writestr(name, heights if name == "heights_m.npy" else old.read(name))
    return stream.getvalue()


def header(shape: str) -> bytes:
    text = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode()


def test_the_ground_of_a_log_is_limited_before_it_is_allocated():
    for heights, reason in (
        (header("(1000000, 2000000)") + bytes(64), "8000000000000 bytes"),
        (header("(8000, 6000)") + bytes(192_000_000), "once decompressed"),
        (b"\x93NUMPY", "not the ground"),
    ):
        with pytest.raises(InvalidField, match=reason):
            Ground.from_npz(npz(heights))
    for content in (b"", b"PK\x03\x04", b"no archive"):
        with pytest.raises(InvalidField, match="not the ground"):
            Ground.from_npz(content)
