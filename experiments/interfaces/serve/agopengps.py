"""AgOpenGPS over UDP: the plant in the place of GNSS receiver and steering module.

docs/integrations.md describes the set-up. The bytes are checked against AgOpenGPS
(https://github.com/AgOpenGPS-Official/AgOpenGPS) at commit
d3cfa141be6259c894604fe80da177275323ff2f: docs/pgn-protocol.md; under SourceCode the receiver
GPS/Forms/UDPComm.Designer.cs, the sender GPS/Forms/PGN.Designer.cs and Position.designer.cs, the
bridge AgIO/Source/Forms/UDP.designer.cs and NMEA.Designer.cs, the simulated modules
ModSim/Source/Forms/UDP.designer.cs. Where documentation and source differ, as in the lengths of
data, the source holds. A frame is

    0x80 0x81 source number length data... checksum,

little-endian, with the sum of all bytes from the source on, modulo 256, as checksum. Angles are
positive clockwise: headings from north, steering and roll to the right.
"""

import math
import struct
from collections.abc import Sequence
from typing import Final

import numpy as np

from ttempc.reference.reference import Reference
from ttempc.types import Sensor, State

from ....testbed.geodesy import MapFrame
from .link import Received, Refused, RemoteCommand, RunFacts, TickData, WireProtocol

STEER: Final = 254  # from AgOpenGPS: speed, switch, steering angle
STEER_STATUS: Final = 253  # from the steering module
POSITION: Final = 214  # 0xD6, as AgIO makes it from NMEA
HELLO: Final = 200  # from AgIO to all modules
_HELLO_REPLY: Final = 126

_HEADER: Final = b"\x80\x81"
_SHORTEST: Final = 6  # header, source, number, length, checksum
_MODULE: Final = 126  # source address of a steering module (ModSim)
_AGIO: Final = 0x7C  # source address that AgIO gives to positions (NMEA.Designer.cs)
# AgIO sends hello, new subnet and scan with the constant 0x47 in the place of a checksum
# (UDP.designer.cs, FormUDP.cs).
_WITHOUT_CHECKSUM: Final = frozenset({HELLO, 201, 202})

_STEER: Final = struct.Struct("<HBhBBB")  # speed, status, angle, line distance, sections
_STEER_STATUS: Final = struct.Struct("<hhhBB")  # angle, heading, roll, switches, PWM
_HELLO_DATA: Final = struct.Struct("<hhB")  # angle, counts of its sensor, switches
# Longitude, latitude, headings of two antennas and of one, speed, roll, altitude; satellites, fix,
# 100 HDOP, 100 age; heading, roll, pitch, yaw rate of an IMU.
_POSITION: Final = struct.Struct("<ddfffffHBHHHhhh")

_NO_FLOAT: Final = float.fromhex("0x1.fffffep+127")  # float.MaxValue of C#
_NO_USHORT: Final = 0xFFFF
_NO_SHORT: Final = 0x7FFF
_NO_HEADING: Final = 9999  # of a module without an IMU (UDPComm.Designer.cs)
_NO_ROLL: Final = 8888
_SIMULATED: Final = 8  # fix quality "Sim" (GUI.Designer.cs)
_SWITCHES_OPEN: Final = 0b11  # work and steer switch are low when closed (CModuleComm.cs)


def frame(source: int, number: int, data: bytes) -> bytes:
    """Return a frame with its checksum."""
    body = bytes((source, number, len(data))) + data
    return _HEADER + body + bytes((sum(body) % 256,))


def parse(datagram: bytes) -> tuple[int, bytes]:
    """Return number and data of a frame.

    Raises:
        Refused: no frame, or one of wrong length or checksum.
    """
    if datagram[:2] != _HEADER:
        raise Refused(f"{datagram[:16].hex(' ')}: a frame starts with 80 81")
    declared = _SHORTEST + datagram[4] if len(datagram) > 4 else _SHORTEST
    if len(datagram) != declared:
        raise Refused(f"a frame of {len(datagram)} bytes, must have {declared} by its header")
    number, sent, expected = datagram[3], datagram[-1], sum(datagram[2:-1]) % 256
    if number not in _WITHOUT_CHECKSUM and sent != expected:
        raise Refused(f"PGN {number}: checksum {sent:02x}, must be {expected:02x}")
    return number, datagram[5:-1]


def position_frame(
    latitude_deg: float,
    longitude_deg: float,
    heading_deg: float,
    speed_kmh: float,
    roll_deg: float | None,
) -> bytes:
    """Return a position frame, PGN 214, with the heading as that of two antennas.

    What no sensor measures has the value that AgOpenGPS takes for "not available".
    """
    roll = _NO_FLOAT if roll_deg is None else roll_deg
    motion = (heading_deg % 360.0, _NO_FLOAT, speed_kmh, roll, _NO_FLOAT)
    quality = (_NO_USHORT, _SIMULATED, _NO_USHORT, _NO_USHORT)
    no_imu = (_NO_USHORT, _NO_SHORT, _NO_SHORT, _NO_SHORT)
    data = _POSITION.pack(longitude_deg, latitude_deg, *motion, *quality, *no_imu)
    return frame(_AGIO, POSITION, data)


def _centi(angle_deg: float) -> int:
    return max(-_NO_SHORT, min(_NO_SHORT, round(100.0 * angle_deg)))


class AgOpenGpsProtocol(WireProtocol):
    """Positions and steering angles out, steering angles in.

    Position, speed, steering angle and roll are those of the sensors, the heading is that of the
    estimate: the vehicle has no sensor of it. A tick without a sample of GNSS sends no position.
    Steering with the autosteer button off is no command.
    """

    name = "agopengps"
    peer_name = "AgOpenGPS"
    space_based = True

    def __init__(self) -> None:
        self._frame = MapFrame()  # until the run begins
        self._angle_deg = 0.0  # measured last, positive to the right
        self._speed_kmh = 0.0
        self._roll_deg: float | None = None

    def begin(self, facts: RunFacts, reference: Reference) -> None:
        """Keep the map frame and the place where the vehicle waits: x, y [m], yaw [rad]."""
        self._frame = MapFrame(facts.origin_deg)
        self._start = reference.at(0.0).state.tolist()[: State.PSI_I]

    def receive(self, payload: bytes) -> Received:
        """Return the steering command of PGN 254, or the answer to a hello.

        Raises:
            Refused: no frame, wrong length, wrong checksum.
        """
        number, data = parse(payload)
        if number == HELLO:
            reply = _HELLO_DATA.pack(_centi(self._angle_deg), 0, _SWITCHES_OPEN)
            return Received(replies=(frame(_MODULE, _HELLO_REPLY, reply),))
        if number != STEER:  # settings, sections, machine data: nothing for this plant
            return Received()
        if len(data) != _STEER.size:
            raise Refused(f"PGN 254: {len(data)} bytes of data, must be {_STEER.size}")
        _, status, angle, *_ = _STEER.unpack(data)
        if not status & 1:  # the autosteer button is off
            return Received()
        self.ready = True
        return Received(RemoteCommand(tick=None, delta_t=-math.radians(0.01 * angle)))

    def standing(self) -> Sequence[bytes]:
        """Return the place of the start, without motion."""
        return self._frames(*self._start)

    def period(self, data: TickData) -> Sequence[bytes]:
        """Return the position and the steering angle of a tick, as measured."""
        place: tuple[float, float] | None = None
        for item in data.samples:
            if item.sensor == Sensor.GNSS_TRACTOR:
                place = item.value[0], item.value[1]
            elif item.sensor == Sensor.ENCODER:
                self._speed_kmh = 3.6 * item.value[0]
            elif item.sensor == Sensor.STEERING_TRACTOR:
                self._angle_deg = -math.degrees(item.value[0])
            elif item.sensor == Sensor.IMU_TRACTOR:
                self._roll_deg = math.degrees(item.value[1])
        if place is None:
            return (self._status(),)
        return self._frames(*place, float(data.estimate.state[State.PSI_T]))

    def _frames(self, x: float, y: float, yaw: float) -> Sequence[bytes]:
        latitude, longitude = self._frame.degrees(np.array([x, y])).tolist()
        heading_deg = 90.0 - math.degrees(yaw)
        position = position_frame(latitude, longitude, heading_deg, self._speed_kmh, self._roll_deg)
        return self._status(), position

    def _status(self) -> bytes:
        """Return the frame of the steering module: its measured angle, both switches open."""
        data = (_centi(self._angle_deg), _NO_HEADING, _NO_ROLL, _SWITCHES_OPEN, 0)
        return frame(_MODULE, STEER_STATUS, _STEER_STATUS.pack(*data))
