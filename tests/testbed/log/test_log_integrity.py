"""Damaged and foreign logs: no change of a bit is silent, no byte opens a file or takes memory."""

import io
import random
import struct

import numpy as np
import pytest
from mcap.writer import Writer
from proving_ground.testbed.errors import InvalidField, LogError
from proving_ground.testbed.ground.ground import Ground
from proving_ground.testbed.ground.terrain import flat
from proving_ground.testbed.log.model_whitelist import check_model
from proving_ground.testbed.log.reader import read_content, record_of
from proving_ground.testbed.log.scene import lines_of, motion_of
from proving_ground.testbed.log.writer import begin_log
from proving_ground.testbed.recording.channels import EVENT_TOPIC, REFERENCE_PATH_TOPIC, STATE
from proving_ground.testbed.vehicle.vehicle import VEHICLES, read_vehicle
from proving_ground.testbed.vehicle.vehicle_model import build_spec, level_model
from proving_ground.testbed.wheels.soil_law import SoilLaw

from tests.testbed.logs import feed, writer

WRONG_MODELS = (
    '<include file="/etc/passwd"/>',
    '<asset><mesh name="a" file = "/dev/stdin"/></asset>',
    '<asset><texture name="a" type="2d" fileright="x.png"/></asset>',
    '<worldbody><replicate count="100000000"/></worldbody>',
    '<extension><plugin plugin="mujoco.pid"/></extension>',
    '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]>',
    '<asset><mesh name="a" vertex="' + 4_000_000 * "0" + '"/></asset>',
    '<size memory="99G"/>',
    '<asset><texture name="a" type="2d" width="99999" height="9"/></asset>',
    '<asset><hfield name="a" nrow="99999" ncol="99999" size="1 1 1 1"/></asset>',
    5 * '<texture type="2d" width="2048" height="2048"/>',  # one is allowed
    2 * '<hfield nrow="4000" ncol="4000"/>',
    '<texture type="cube" width="2048" height="2048"/>',
    9_000 * "<geom/>",
    '<texture gridsize="9999 9999" width="4096" height="4096"/>' * 9,
    '<hfield file="x.png"/>',
    *(100_000 * f"<{kind}/>" for kind in ("key", "site")),
    "<body><joint/><geom/></body>" * 10_000,
    "<body>" * 40 + "</body>" * 40,
    '<flexcomp type="grid" count="999 999 9"/>',
    '<size nuserdata="2000000000"/>',
)


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
        file.write_bytes(data)
        try:
            content = read_content(file)
            assert content.salvage
            record_of(content)
            motion_of(content)
            lines_of(content, REFERENCE_PATH_TOPIC)
        except LogError as error:  # the only exception that may come out
            reasons.append(str(error))
    assert "\n" not in "".join(reasons)


def test_messages_that_do_not_decode_are_refused_although_every_checksum_is_right(short, tmp_path):
    file = tmp_path / "log.mcap"
    file.write_bytes(short)
    content = read_content(file)
    for topic in (STATE.topic, EVENT_TOPIC, REFERENCE_PATH_TOPIC):
        with file.open("wb") as stream:
            log, numbers = begin_log(stream, content.metadata, {}, [content.topics[topic]])
            log.add(numbers[topic], np.zeros(1, int), np.full((1, 3), 0xFF, np.uint8))
            log.finish()
        evil = read_content(file)
        assert not evil.salvage
        with pytest.raises(LogError, match=topic):
            lines_of(evil, topic) if topic == REFERENCE_PATH_TOPIC else record_of(evil)


def packed_log(chunk: bytes, declared: int) -> bytes:
    """Return a log that consists of its start and one chunk."""
    stream = io.BytesIO()
    mcap = Writer(stream)
    mcap.start()
    mcap.add_metadata("run", {"log_format": "1"})
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


def test_a_model_that_opens_files_is_refused_and_those_of_this_program_pass():
    for inside in WRONG_MODELS:
        with pytest.raises(ValueError, match=r"not allowed|at most|more than|1M to 99M"):
            check_model(f"<mujoco>{inside}</mujoco>")
    for vehicle in VEHICLES.names():
        spec = build_spec(read_vehicle(vehicle), flat((80.0, 50.0)), SoilLaw(), 0.002)
        check_model(level_model(spec)[1])


def test_bytes_that_are_no_ground_are_refused():
    good = Ground(flat((4.0, 4.0)), np.ones((41, 41))).to_npz()
    for content in (b"", b"no archive", good[:-30]):
        with pytest.raises(InvalidField, match="not the ground"):
            Ground.from_npz(content)
