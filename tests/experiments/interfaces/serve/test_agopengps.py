"""Frames of AgOpenGPS against its documentation and sources, byte by byte."""

import math
import struct

import numpy as np
import pytest
from proving_ground.experiments.interfaces.serve import agopengps as frames
from proving_ground.experiments.interfaces.serve.agopengps import AgOpenGpsProtocol, Dialect
from proving_ground.experiments.interfaces.serve.link import Refused, RunFacts, TickData

from ttempc import Vehicle, straight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Estimate, Measurement, Sensor, State

# By hand from the table of PGN 254: header, source 7f, fe, 8 bytes: 5.4 km/h (54), on, 12.34 deg
# to the right (1234 = 04d2), no line, no section. Sum from 7f on: 127 + 254 + 8 + 54 + 0 + 1 + 210
# + 4 + 255 = 913 = 3 * 256 + 145.
STEER_RIGHT = bytes.fromhex("80 81 7f fe 08 36 00 01 d2 04 ff 00 00 91")
# As AgIO sends it, UDP.designer.cs: the last byte is constant and no checksum.
AGIO_HELLO = bytes([0x80, 0x81, 0x7F, 200, 3, 56, 0, 0, 0x47])


def steering_frame(angle_deg, engaged):
    """Return a steering frame as AgOpenGPS sends it, without a line and sections."""
    data = struct.pack("<HBhBBB", 54, engaged, round(100.0 * angle_deg), 255, 0, 0)
    return frames.frame(0x7F, 254, data)


def test_the_steering_frame_of_the_documentation_is_read():
    """An angle to the left is negative there and positive here; off is no command."""
    assert steering_frame(12.34, True) == STEER_RIGHT
    protocol = AgOpenGpsProtocol(Dialect.AGOPENGPS)
    assert protocol.receive(steering_frame(5.0, False)).command is None
    assert not protocol.ready
    left = protocol.receive(steering_frame(-20.0, True)).command
    assert left.delta_t == pytest.approx(math.radians(20.0))
    assert protocol.receive(STEER_RIGHT).command.delta_t == pytest.approx(-math.radians(12.34))
    assert protocol.ready


def web_frame(status, angle_deg=0.0, cross_cm=0):
    """Return PGN 254 as `BuildAutoSteerPgn` of AgOpenWeb makes it."""
    data = struct.pack("<HBhbBB", 54, status, round(100.0 * angle_deg), cross_cm, 0, 0)
    return frames.frame(0x7F, 254, data)


# Bits of AgOpenWeb: 1 steer switch, 2 work switch, 4 engaged, 8 GNSS valid, 16 guidance valid.
@pytest.mark.parametrize("status", [0x00, 0x01, 0x08, 0x09, 0x0B, 0x18, 0x19, 0x1B])
@pytest.mark.parametrize("dialect", [None, Dialect.AGOPENWEB], ids=["by frames", "by option"])
def test_agopenweb_starts_nothing_while_it_is_not_engaged(status, dialect):
    protocol = AgOpenGpsProtocol(dialect)
    for _ in range(200):
        received = protocol.receive(web_frame(status, 20.0))
        assert received.command is None
        assert received.released
    assert not protocol.ready


def test_agopenweb_steers_while_it_is_engaged_with_or_without_its_switch():
    for status in (0x1C, 0x1D, 0x1F):
        protocol = AgOpenGpsProtocol()
        protocol.receive(web_frame(0x08))
        command = protocol.receive(web_frame(status, -10.0, cross_cm=-12)).command
        assert protocol.ready
        assert command.delta_t == pytest.approx(math.radians(10.0))
        assert protocol.receive(web_frame(0x19, -10.0)).released
        assert protocol.receive(web_frame(status)).command is not None
        assert protocol.receive(web_frame(0x0C)).command is None  # of one that has not begun
        assert protocol.receive(web_frame(0x0C), known=True).command is not None
    test_of_the_motor = AgOpenGpsProtocol()  # its free drive: engaged, without GNSS and guidance
    assert test_of_the_motor.receive(web_frame(0x05, 10.0)).command is None
    assert not test_of_the_motor.ready


def test_agopengps_is_known_by_its_status_and_starts_when_its_button_is_pressed():
    """One that is on when it is first heard may be AgOpenWeb, whose bit 0 is our own switch."""
    protocol = AgOpenGpsProtocol()
    protocol._start = [0.0, 0.0, 0.0]
    for _ in range(60):
        protocol.standing()
        assert protocol.receive(steering_frame(5.0, True)).command is None
    assert protocol.peer_name == "AgOpenGPS"
    assert protocol.receive(steering_frame(5.0, False)).command is None
    assert protocol.receive(steering_frame(5.0, True)).command is not None
    assert protocol.ready


def test_positions_have_the_form_of_the_dialect_and_both_while_it_is_unknown():
    unknown, web = AgOpenGpsProtocol(), AgOpenGpsProtocol(Dialect.AGOPENWEB)
    gps = AgOpenGpsProtocol(Dialect.AGOPENGPS)
    kinds = {}
    for protocol in (unknown, web, gps):
        protocol._start = [1.0, 2.0, 0.5]
        sent = [*protocol.standing(), *protocol.standing()]
        kinds[protocol] = [part[:6] if part[:1] == b"$" else part[3] for part in sent]
    assert kinds[unknown] == [253, 253, 214, b"$PAOGI"]
    assert kinds[web] == [253, 253, b"$PAOGI"]
    assert kinds[gps] == [253, 253, 214]


def test_the_switches_are_open_in_the_sense_of_each_program():
    """AgOpenGPS: both low when closed. AgOpenWeb: work switch inverted, steer switch not."""
    for dialect, switches in ((Dialect.AGOPENGPS, 0b11), (Dialect.AGOPENWEB, 0b01)):
        protocol = AgOpenGpsProtocol(dialect)
        protocol._start = [0.0, 0.0, 0.0]
        (status,) = protocol.standing()
        assert status[11] == switches


def read_paogi(sentence):
    """Return latitude, longitude, speed [m/s], heading, roll as NmeaParserServiceFast.cs does."""
    body, _, checksum = sentence[1:].partition(b"*")
    total = 0
    for byte in body:
        total ^= byte
    assert int(checksum[:2], 16) == total
    fields = body.decode().split(",")
    assert fields[0] == "PAOGI"
    assert len(fields) >= 15

    def angle(text, letter):
        point = text.index(".") - 2
        degrees = float(text[:point]) + float(text[point:]) / 60.0
        return -degrees if letter in "SW" else degrees

    place = angle(*fields[2:4]), angle(*fields[4:6])
    return *place, 0.514444 * float(fields[11]), float(fields[12]), float(fields[13])


@pytest.mark.parametrize("place", [(50.86, 4.68), (-37.1234567891, -179.999999999), (0.0, -0.5)])
def test_a_sentence_keeps_the_position_to_a_tenth_of_a_millimetre(place):
    sentence = frames.paogi_sentence(3723.45, *place, 370.25, 3.6, -2.5)
    assert sentence.startswith(b"$PAOGI,010203.45,")
    latitude, longitude, speed, heading, roll = read_paogi(sentence)
    assert (latitude, longitude) == pytest.approx(place, abs=1e-9)
    assert speed == pytest.approx(1.0, abs=1e-3)
    assert (heading, roll) == (10.25, -2.5)


def test_a_scan_finds_the_module_at_the_address_of_the_session():
    protocol = AgOpenGpsProtocol()
    protocol.host = "192.168.5.126"
    (reply,) = protocol.receive(bytes([0x80, 0x81, 0x7F, 202, 3, 202, 202, 5, 0x47])).replies
    assert len(reply) == 13  # as AgIO and `TryParseScanReply` ask for
    assert list(reply[2:12]) == [126, 203, 7, 192, 168, 5, 126, 192, 168, 5]


def test_the_hello_of_agio_is_answered_as_its_simulated_module_does():
    (reply,) = AgOpenGpsProtocol().receive(AGIO_HELLO).replies
    assert len(reply) == 11  # ReceiveFromUDP of AgIO asks for this length
    assert list(reply[:5]) == [128, 129, 126, 126, 5]  # helloFromAutoSteer of ModSim
    assert reply[-1] == sum(reply[2:-1]) % 256


def test_damaged_frames_are_refused_and_those_for_others_are_no_command():
    for datagram in (
        STEER_RIGHT[:-1] + b"\x92",
        bytes([*STEER_RIGHT[:8], 0xD3, *STEER_RIGHT[9:]]),
        STEER_RIGHT[:-2],
        STEER_RIGHT + b"\x00",
        b"\x80\x81",
        b"",
        b"$PANDA,1",
        frames.frame(0x7F, 254, b"\x00\x00\x01"),
    ):
        with pytest.raises(Refused):
            AgOpenGpsProtocol().receive(datagram)
    for number in (229, 239, 251, 252):
        assert AgOpenGpsProtocol().receive(frames.frame(0x7F, number, bytes(8))).command is None


def received(frame):
    """Return fields of a position frame as UDPComm.Designer.cs reads them."""
    length = max(frame[4] + 5, 5)
    assert len(frame) == length + 1 == 57
    assert frame[length] == sum(frame[2:length]) % 256
    fields = {"longitude": "<d5", "latitude": "<d13", "dual": "<f21", "single": "<f25"}
    fields |= {"speed": "<f29", "roll": "<f33", "altitude": "<f37", "fix": "<B43"}
    fields |= {"imu_heading": "<H48", "imu_roll": "<h50"}
    return {
        name: struct.unpack_from(place[:2], frame, int(place[2:]))[0]
        for name, place in fields.items()
    }


def test_the_position_frame_is_what_agopengps_reads():
    fields = received(frames.position_frame(50.86, 4.68, 370.0, 3.6, -2.5))
    assert (fields["latitude"], fields["longitude"]) == (50.86, 4.68)
    assert (fields["dual"], fields["roll"]) == (pytest.approx(10.0), pytest.approx(-2.5))
    assert fields["speed"] == pytest.approx(3.6)
    largest = struct.unpack("<f", bytes.fromhex("ffff7f7f"))[0]  # float.MaxValue: not available
    assert fields["single"] == fields["altitude"] == largest
    assert received(frames.position_frame(0.0, 0.0, 0.0, 0.0, None))["roll"] == largest
    assert (fields["imu_heading"], fields["imu_roll"]) == (0xFFFF, 0x7FFF)


def local_plane(latitude, longitude, origin):
    """Return easting and northing as LocalPlane.cs of AgOpenGPS has them: another geodesy."""
    phi_0, phi = math.radians(origin[0]), math.radians(latitude)
    north = 111132.92 - 559.82 * math.cos(2 * phi_0) + 1.175 * math.cos(4 * phi_0)
    north -= 0.0023 * math.cos(6 * phi_0)
    east = 111412.84 * math.cos(phi) - 93.5 * math.cos(3 * phi) + 0.118 * math.cos(5 * phi)
    return (longitude - origin[1]) * east, (latitude - origin[0]) * north


def test_samples_arrive_in_the_plane_of_agopengps():
    origin = (44.97, -93.26)
    vehicle = Vehicle()
    reference = Reference(straight(20.0), vehicle, ConstantSpeed(1.0))
    protocol = AgOpenGpsProtocol(Dialect.AGOPENGPS)
    protocol.begin(RunFacts("grass", 1, 0.2, 100, False, vehicle, origin), reference)
    vector = np.zeros(7)
    vector[State.PSI_T] = math.radians(120.0)
    estimate = Estimate(1.0, vector, np.zeros((7, 7)), np.zeros(2), 0.0)
    data = TickData(
        k=5,
        time_s=1.0,
        samples=[
            Measurement(1.0, Sensor.GNSS_TRACTOR, (31.25, -17.5)),
            Measurement(1.0, Sensor.ENCODER, (1.5,)),
            Measurement(1.0, Sensor.STEERING_TRACTOR, (math.radians(7.0),)),
            Measurement(1.0, Sensor.IMU_TRACTOR, (0.1, math.radians(3.0), 0.0)),
        ],
        estimate=estimate,
        reference=reference,
        reference_tick=5,
    )
    status, position = protocol.period(data)
    fields = received(position)
    east, north = local_plane(fields["latitude"], fields["longitude"], origin)
    assert (east, north) == pytest.approx((31.25, -17.5), abs=2e-3)
    assert fields["dual"] == pytest.approx(330.0)  # 120 deg from east, counter-clockwise
    assert fields["speed"] == pytest.approx(5.4)
    assert fields["roll"] == pytest.approx(3.0)  # right side down in both
    assert len(status) == 14
    assert struct.unpack_from("<hhh", status, 5) == (-700, 9999, 8888)
    nothing = TickData(0, 0.0, [], estimate, data.reference, 0)
    assert [frame[3] for frame in protocol.period(nothing)] == [253]
