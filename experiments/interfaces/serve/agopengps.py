"""AgOpenGPS and AgOpenWeb over UDP: the plant in the place of GNSS receiver and steering module.

docs/integrations.md describes the set-up. The bytes are checked against AgOpenGPS
(https://github.com/AgOpenGPS-Official/AgOpenGPS) at commit
d3cfa141be6259c894604fe80da177275323ff2f: its page on the PGN protocol; under SourceCode the
receiver GPS/Forms/UDPComm.Designer.cs, the sender GPS/Forms/PGN.Designer.cs and
Position.designer.cs, the bridge AgIO/Source/Forms/UDP.designer.cs and NMEA.Designer.cs, the
simulated modules ModSim/Source/Forms/UDP.designer.cs; and against AgOpenWeb
(https://github.com/AgOpenGPS-Official/AgOpenWeb) at commit
ef18a148052f836364920b17605e953348444e0d: under Shared/AgOpenWeb.Services AutoSteer/PgnBuilder.cs,
NmeaParserServiceFast.cs and UdpCommunicationService.cs. Where documentation and source differ, as
in the lengths of data, the source holds.

The two give other meanings to the same bytes of PGN 254. In AgOpenGPS its status is 0 or 1, whether
the autosteer button is on. In AgOpenWeb it is a set of bits: steer switch, work switch, engaged,
GNSS valid, guidance valid; bit 0 is no sign that anything may move. A frame is

    0x80 0x81 source number length data... checksum,

little-endian, with the sum of all bytes from the source on, modulo 256, as checksum. Angles are
positive clockwise: headings from north, steering and roll to the right.
"""

import ipaddress
import math
import struct
from collections.abc import Sequence
from enum import Enum, IntFlag
from functools import reduce
from operator import xor
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
SCAN: Final = 202  # from AgIO to all modules
_HELLO_REPLY: Final = 126
_SCAN_REPLY: Final = 203

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
_KNOTS: Final = 3600.0 / 1852.0  # per m/s


class Dialect(Enum):
    """Program at the other end."""

    AGOPENGPS = "AgOpenGPS"
    AGOPENWEB = "AgOpenWeb"


class _WebStatus(IntFlag):
    """Bits of the status of PGN 254 in AgOpenWeb (BuildAutoSteerPgn)."""

    STEER_SWITCH = 1
    WORK_SWITCH = 2
    ENGAGED = 4
    GNSS_VALID = 8
    GUIDANCE_VALID = 16


_MAY_START: Final = _WebStatus.ENGAGED | _WebStatus.GNSS_VALID | _WebStatus.GUIDANCE_VALID
"""Without the last two, AgOpenWeb is in its test of the motor."""

# Switches of PGN 253 that let nothing happen: in AgOpenGPS both are low when closed
# (CModuleComm.cs), in AgOpenWeb the steer switch is on where bit 1 is set (TryParseSteerData).
_SWITCHES_OPEN: Final = {Dialect.AGOPENGPS: 0b11, Dialect.AGOPENWEB: 0b01}

# Periods after the first PGN 254 that a program is listened to before it counts as AgOpenGPS. Both
# forms of position are sent meanwhile, and AgOpenWeb says within a tenth of a second that its GNSS
# is valid.
_LISTENING: Final = 30


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
    number = datagram[3]
    sent = datagram[-1]
    expected = sum(datagram[2:-1]) % 256
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


def paogi_sentence(
    time_s: float,
    latitude_deg: float,
    longitude_deg: float,
    heading_deg: float,
    speed_kmh: float,
    roll_deg: float | None,
) -> bytes:
    """Return a position as `$PAOGI`, the sentence of a receiver with two antennas.

    Fields: time, latitude, longitude, fix quality, satellites, HDOP, altitude, age of corrections,
    speed [knots], heading [deg], roll [deg], pitch [deg], yaw rate [deg/s].
    """
    clock = time_s % 86400.0
    stamp = f"{int(clock // 3600):02d}{int(clock % 3600 // 60):02d}{clock % 60:05.2f}"
    north = "N" if latitude_deg >= 0.0 else "S"
    east = "E" if longitude_deg >= 0.0 else "W"
    fields = (
        "PAOGI",
        stamp,
        _degrees_and_minutes(latitude_deg, 2),
        north,
        _degrees_and_minutes(longitude_deg, 3),
        east,
        f"{_SIMULATED}",
        "12",
        "0.7",
        "0.0",
        "0.0",
        f"{speed_kmh / 3.6 * _KNOTS:.3f}",
        f"{heading_deg % 360.0:.2f}",
        f"{roll_deg or 0.0:.2f}",
        "0.0",
        "0.0",
    )
    body = ",".join(fields).encode()
    return b"$" + body + f"*{reduce(xor, body):02X}\r\n".encode()


def _degrees_and_minutes(angle_deg: float, digits: int) -> str:
    """Return an angle as NMEA 0183 has it, DDMM.MMMMMMMM; the last digit is 0.02 mm."""
    whole, minutes = divmod(round(abs(angle_deg) * 60e8), 60 * 10**8)
    return f"{whole:0{digits}d}{minutes / 1e8:011.8f}"


class AgOpenGpsProtocol(WireProtocol):
    """Positions and steering angles out, steering angles in.

    Position, speed, steering angle and roll are those of the sensors, the heading is that of the
    estimate: the vehicle has no sensor of it. A tick without a sample of GNSS sends no position.

    A program whose status has other bits than 0 is AgOpenWeb, and gets `$PAOGI`. One that keeps to
    0 and 1 for a while is AgOpenGPS, and gets PGN 214. The vehicle starts when the program engages:
    AgOpenGPS by a status that turns from 0 to 1, AgOpenWeb by its bit with valid GNSS and guidance.
    A frame that is not engaged lets the vehicle stop at once.

    Args:
        dialect: of the program, where it is known.
    """

    name = "agopengps"
    space_based = True
    hold_s = 0.15  # AgOpenGPS sends a command a position, every 0.1 s
    defaults = ("control.rate_hz=20.0", "sensors.gnss_rate_hz=10.0")

    def __init__(self, dialect: Dialect | None = None) -> None:
        self._frame = MapFrame()  # until the run begins
        self._dialect = dialect
        self._listened = 0  # periods since the first PGN 254
        self._heard = False  # whether there was one
        self._armed = False  # whether AgOpenGPS was seen disengaged
        self._positions = 0  # that were due while the vehicle stood
        self._angle_deg = 0.0  # measured last, positive to the right
        self._speed_kmh = 0.0
        self._roll_deg: float | None = None

    @property
    def peer_name(self) -> str:
        """Name of the program, as far as it is known."""
        return self._dialect.value if self._dialect else "AgOpenGPS or AgOpenWeb"

    def begin(self, facts: RunFacts, reference: Reference) -> None:
        """Keep the map frame and the place where the vehicle waits: x, y [m], yaw [rad]."""
        self._frame = MapFrame(facts.origin_deg)
        self._start = reference.at(0.0).state.tolist()[: State.PSI_I]

    def receive(self, payload: bytes, *, known: bool = False) -> Received:
        """Return the steering command of PGN 254, or the answer to a hello or a scan.

        Raises:
            Refused: no frame, wrong length, wrong checksum.
        """
        number, data = parse(payload)
        if number == HELLO:
            reply = _HELLO_DATA.pack(_centi(self._angle_deg), 0, self._switches)
            return Received(replies=(frame(_MODULE, _HELLO_REPLY, reply),))
        if number == SCAN:
            own = ipaddress.IPv4Address(self.host).packed
            return Received(replies=(frame(_MODULE, _SCAN_REPLY, own + own[:3]),))
        if number != STEER:  # settings, sections, machine data: nothing for this plant
            return Received()
        if len(data) != _STEER.size:
            raise Refused(f"PGN 254: {len(data)} bytes of data, must be {_STEER.size}")
        _, status, angle, *_ = _STEER.unpack(data)
        if not self._is_engaged(status, known):
            return Received(released=True)
        self.ready = True
        return Received(RemoteCommand(tick=None, delta_t=-math.radians(0.01 * angle)))

    def _is_engaged(self, status: int, known: bool) -> bool:
        """Return whether a status lets the vehicle steer; learn the dialect from it."""
        self._heard = True
        if status > 1:
            self._dialect = Dialect.AGOPENWEB
        if self._dialect is Dialect.AGOPENWEB:
            needed = _WebStatus.ENGAGED if known else _MAY_START
            return status & needed == needed
        if self._dialect is None:
            return False
        self._armed |= status == 0
        return self._armed and status == 1

    def lapse(self) -> None:
        """Forget that a peer was ready and whether its button was seen off."""
        super().lapse()
        self._armed = False

    @property
    def _switches(self) -> int:
        return _SWITCHES_OPEN[self._dialect or Dialect.AGOPENGPS]

    def standing(self) -> Sequence[bytes]:
        """Return the place of the start, without motion; a position every other period."""
        if self._dialect is None and self._heard:
            self._listened += 1
            if self._listened >= _LISTENING:
                self._dialect = Dialect.AGOPENGPS
        self._positions += 1
        if self._positions % 2:
            return (self._status(),)
        return self._status(), *self._position(0.0, *self._start)

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
        yaw = float(data.estimate.state[State.PSI_T])
        return self._status(), *self._position(data.time_s, *place, yaw)

    def _position(self, time_s: float, x: float, y: float, yaw: float) -> Sequence[bytes]:
        """Return the position in the form of the dialect, in both while that is not known."""
        latitude, longitude = self._frame.degrees(np.array([x, y])).tolist()
        place = latitude, longitude, 90.0 - math.degrees(yaw), self._speed_kmh, self._roll_deg
        frames = []
        if self._dialect is not Dialect.AGOPENWEB:
            frames.append(position_frame(*place))
        if self._dialect is not Dialect.AGOPENGPS:
            frames.append(paogi_sentence(time_s, *place))
        return frames

    def _status(self) -> bytes:
        """Return the frame of the steering module: its measured angle, both switches open."""
        data = (_centi(self._angle_deg), _NO_HEADING, _NO_ROLL, self._switches, 0)
        return frame(_MODULE, STEER_STATUS, _STEER_STATUS.pack(*data))
