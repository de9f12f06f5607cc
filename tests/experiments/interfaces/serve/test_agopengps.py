"""Frames of AgOpenGPS against its documentation and sources, byte by byte."""

import math
import struct

import numpy as np
import pytest
from proving_ground.experiments.interfaces.serve import agopengps as frames
from proving_ground.experiments.interfaces.serve.agopengps import AgOpenGpsProtocol
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
    protocol = AgOpenGpsProtocol()
    assert protocol.receive(steering_frame(5.0, False)).command is None
    assert not protocol.ready
    left = protocol.receive(steering_frame(-20.0, True)).command
    assert left.delta_t == pytest.approx(math.radians(20.0))
    assert protocol.receive(STEER_RIGHT).command.delta_t == pytest.approx(-math.radians(12.34))
    assert protocol.ready


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
    protocol = AgOpenGpsProtocol()
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
